"""What the link to a real vehicle is made of: the line, its clock, its readings, what it makes of our sticks."""
