"""Steady motion to damping and thrust: towing, free running, bollard tables, each usable alone."""
