"""Lenses: calibrated, kept in files, and what a flat port costs."""
