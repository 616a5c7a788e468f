"""The strip of floor that imager, downward camera or sonar has seen: painted while it is flown, and from a log."""
