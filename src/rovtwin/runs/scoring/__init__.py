"""What a run was worth, and why: scores, and their explanation in words."""
