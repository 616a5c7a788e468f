"""Figures of cameras: lenses, what a camera saw, and markers to print."""
