"""Finished runs: found, and their states at any time as the engine tells them of a flight."""
