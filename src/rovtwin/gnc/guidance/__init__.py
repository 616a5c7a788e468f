"""Guidance along a path: the path, the speed and heading at which it is followed, depths above a floor, missions."""
