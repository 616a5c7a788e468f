"""What changed between two mosaics of one place: displacement, difference, test, and the things that changed."""
