"""Commands that learn a vehicle from logs, and find what has changed of it."""
