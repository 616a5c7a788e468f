"""Processes: children and the pipes to them, work beside, priority, and what XLA prints kept off the terminal."""
