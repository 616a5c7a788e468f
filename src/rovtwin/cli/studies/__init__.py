"""Commands that fly a scenario many times."""
