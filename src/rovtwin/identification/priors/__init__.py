"""What shapes say before any test: formulas for boxes, the panel method, and how wide either is."""
