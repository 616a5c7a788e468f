"""What a line imager is, wherever its lines come from: description, rays, spectra of the water, the file of its lines.

Depends on `core` and `vehicle`. `simulation` makes lines with it, `mapping` maps of them; neither knows the other.
"""
