"""The equations: `Model`, 6-DOF dynamics, thrusters, boundaries of the water, ideal measurements."""
