"""Dip: whether thrusters and sensors are what the vehicle file says, by short pushes of each thruster in turn."""
