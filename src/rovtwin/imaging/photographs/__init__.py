"""Photographs for photogrammetry: where and when each was taken in its tags, and whether they overlap.

Depends on `core` and `vehicle`. Pictures are rendered in `simulation`, or come from a real camera.
"""
