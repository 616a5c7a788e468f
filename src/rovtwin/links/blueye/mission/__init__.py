"""Missions of a drone's clients: read, as steps, flown, and how far they are."""
