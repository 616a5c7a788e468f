"""What an estimate is worth: verdicts, blind directions, held-out tests, whiteness, and files against each other."""
