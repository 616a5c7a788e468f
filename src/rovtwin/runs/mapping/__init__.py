"""Mosaics of runs: what a map is made of is found beside the log, put together, and made."""
