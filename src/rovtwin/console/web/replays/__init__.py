"""Replays of finished runs for browsers: page, addresses, and where each replay is."""
