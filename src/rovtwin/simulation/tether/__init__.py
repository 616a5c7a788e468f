"""Cables: their forces and shape, and the tether as a Block."""
