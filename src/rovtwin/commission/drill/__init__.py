"""Fail-safe drill: STOP, a program that falls silent, a line that is cut, each with its time to thrusters off."""
