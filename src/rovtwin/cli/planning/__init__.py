"""Commands that plan: surveys, tests, and what the sea allows."""
