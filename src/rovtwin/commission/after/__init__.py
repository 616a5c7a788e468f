"""After a commissioning: later dives against its certificate."""
