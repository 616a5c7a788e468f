"""Processes: work beside, priority, and what XLA prints kept off the terminal."""
