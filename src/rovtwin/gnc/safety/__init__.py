"""What keeps a vehicle safe: rules, supervisor, contingencies, and which thrusters still push."""
