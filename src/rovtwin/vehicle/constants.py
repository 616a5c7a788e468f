"""What the description and the model share; imports nothing, so that reading a file starts no JAX."""

GRAVITY = 9.81  # the value behind the thesis's and the MSS toolbox's weights [m/s2]
FRESH_WATER = 1000.0  # [kg/m3]
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
