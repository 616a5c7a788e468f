"""Pages of mosaics."""
