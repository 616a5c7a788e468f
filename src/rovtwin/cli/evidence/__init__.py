"""The commands of `rovtwin evidence`."""
