"""What changed between two mosaics: `rovtwin map-diff`."""
