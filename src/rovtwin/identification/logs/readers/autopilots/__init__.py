"""Logs of autopilots: ArduPilot on board and from ground stations, PX4."""
