"""MAV_RESULT: how a command ended."""

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
