"""Eyes made up: a fan across the course, and a camera that looks straight down."""

import numpy as np
from tests.imaging.helper import DOWN, imager

from rovtwin.console.swath.eyes import Eye, Sounder
from rovtwin.imaging.imager import Mount

ANGLES = np.linspace(-30.0, 30.0, 33)
LEVER = np.array([0.1, 0.05, 0.11])
SOUNDER = Sounder("altimeter", np.array([0.2, 0.0, 0.1]), np.array([0.0, 0.0, 1.0]))


def scanner():
    """A line imager without a port, and where it sits."""
    return imager(pixels=33, port=None, lens={"view_angles_deg": ANGLES.tolist()}), Mount(LEVER, DOWN, "uhi.camera")


def fan(reach: float = 12.0, kind: str = "imager", imager: str = "uhi") -> Eye:
    """The same as an eye, in closed form."""
    right, down = np.sin(np.radians(ANGLES)), np.cos(np.radians(ANGLES))
    direction = np.stack([np.zeros_like(right), right, down], axis=-1)
    return Eye("uhi.camera", kind, np.tile(LEVER, (33, 1)), direction, reach, imager)


def picture(reach: float = 12.0) -> Eye:
    """A camera of 60 by 40 degrees."""
    x, y = np.meshgrid(np.tan(np.radians([20.0, 0.0, -20.0])), np.tan(np.radians(ANGLES)), indexing="ij")
    direction = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=-1)
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return Eye("camera", "camera", np.zeros_like(unit), unit, reach)


def states(t, eta, floor=5.0, sounder=SOUNDER, **more):
    """As the engine reports them: poses (n, 6) at times, and what an altimeter measures of a level floor."""
    from rovtwin.core.arrays.rotations import rotation_from_euler

    found = []
    for at, pose in zip(np.asarray(t).tolist(), np.asarray(eta, float), strict=True):
        R = rotation_from_euler(pose[3:])
        beam = (floor - pose[2] - (R @ sounder.position)[2]) / (R @ sounder.direction)[2]
        sensors = {sounder.name: {"age": 0.05, "value": [float(beam)]}}
        found.append({"t": at, "eta": pose.tolist(), "link_age": 0.0, "sensors": sensors, "folder": "runs/a"} | more)
    return found


def straight(seconds=30.0, speed=0.3, east=1.0, depth=3.4, heading=0.0, rate=20.0, begin=0.0):
    """Times and poses along a line; it rolls and pitches."""
    t = begin + np.arange(0.0, seconds, 1.0 / rate)
    way = speed * (t - begin)
    roll, pitch = 0.06 * np.sin(1.1 * t), 0.04 * np.cos(0.7 * t)
    place = [way * np.cos(heading), east + way * np.sin(heading), depth + 0.02 * np.sin(t)]
    return t, np.column_stack([*place, roll, pitch, np.full_like(t, heading)])
