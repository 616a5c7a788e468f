"""Poses over a floor, for an imager that looks down."""

import numpy as np
from scipy.spatial.transform import Rotation
from tests.imaging.helper import DOWN, imager

from rovtwin.imaging.imager import Mount
from rovtwin.mapping.navigation import Navigation

LEVER = np.array([0.12, -0.03, 0.11])


def moving(euler=(0.0, 0.0, 0.0), speed=0.2, seconds=4.0, rate=10.0, begin=(0.0, 0.3, 3.4), **given) -> Navigation:
    """Straight ahead in the direction that it looks in."""
    t = np.arange(0.0, seconds + 0.5 / rate, 1.0 / rate)
    course = np.array([np.cos(euler[2]), np.sin(euler[2]), 0.0])
    q = Rotation.from_euler("ZYX", euler[::-1]).as_quat()[[3, 0, 1, 2]]
    return Navigation(t, np.array(begin) + speed * t[:, None] * course, np.tile(q, (len(t), 1)), **given)


def mount() -> Mount:
    return Mount(LEVER, DOWN, "uhi.camera")


__all__ = ["DOWN", "LEVER", "imager", "mount", "moving"]
