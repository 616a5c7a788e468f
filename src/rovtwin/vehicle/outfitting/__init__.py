"""Changing what a vehicle carries: parts bolted on and off, ballast, and the file's text edited in place."""
