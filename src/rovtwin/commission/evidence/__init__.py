"""What the stages excite and identify share: logs as records, forces with their uncertainty, whether tests repeat."""
