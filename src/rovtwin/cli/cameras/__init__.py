"""Commands of cameras, markers and pictures."""
