"""The world around a vehicle: current, waves, sensors, and the twin that puts them round the plant.

Depends on `core` and `vehicle` only. Every process is a `core.block.Block`: seeded by a key in its memory, pure, and
the same bit for bit for the same seed.
"""
