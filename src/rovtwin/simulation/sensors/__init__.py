"""Sensors: ideal readings by kind, and the errors, delays and gaps of real ones."""
