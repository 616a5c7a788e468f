"""Mistakes in logs, named before they become parameters."""
