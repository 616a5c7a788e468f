"""What the description and the model share; imports nothing, so that reading a file starts no JAX."""

GRAVITY = 9.81  # the value behind the thesis's and the MSS toolbox's weights [m/s2]
FRESH_WATER = 1000.0  # [kg/m3]
FRICTION = 0.3  # of wet plastic on concrete and sand
SLIDING_SPEED = 0.02  # above it a thing slides over walls and floor, below it creeps [m/s]
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
COEFFICIENT_UNITS = {  # along an axis, and about one
    "added_mass": ("kg", "kg m2"),
    "linear_damping": ("N s/m", "N m s/rad"),
    "quadratic_damping": ("N s2/m2", "N m s2/rad2"),
}
