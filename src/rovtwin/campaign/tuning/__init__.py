"""Tuning of the model-based autopilot: what may be tuned, the cost of a flight, search, flights and result."""
