"""What links to real drones are made of: connecting, two drones as one, thrust as motion input."""
