"""Commissioning: from a vehicle file with a new payload to a proven vehicle, stage by stage, each with go or no-go."""
