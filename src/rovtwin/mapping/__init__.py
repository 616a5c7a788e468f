"""Maps of an imager's lines: where pixels lie on the floor, what reflectance they have, cells of a mosaic.

Depends on `core`, `vehicle` and `imaging`; it knows lines and not who made them, a simulation or an instrument.
"""
