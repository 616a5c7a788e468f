"""Whether sensors of speed and depth agree with the accelerometer about each push.

Both go through the same leaky integral, so that drift falls out: the accelerations of CO add up to a velocity that
forgets with MEMORY, and so do the rates of what the sensor says.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from rovtwin.commission.dip.response import MEMORY, accelerations
from rovtwin.commission.stage import Check
from rovtwin.identification.logs.motion import STEP, Motion
from rovtwin.identification.logs.record import Record

SCALE = (0.45, 2.2)  # of a sensor over the accelerometer, within which its unit is right: feet would be 3.3
TURNED = 20.0  # of a velocity in the horizontal plane against the accelerometer [deg]
TELLS = 0.6  # correlation from which on the comparison tells something
MOVED = 0.02  # [m/s] in the root of the mean square, below which nothing is compared
FEET = 3.281


def compared(record: Record) -> Iterator[Check]:
    """A line for depth and one for velocity, where pushes moved the vehicle enough."""
    motion = Motion.of(record)
    a = accelerations(motion)[:, :3]
    R = motion.rotation
    if R is None or not np.isfinite(a).any():
        return
    yield from _depth(motion, np.einsum("ni,ni->n", R[:, 2], np.nan_to_num(a)))
    yield from _velocity(motion, np.nan_to_num(a))


def _leaky(rate: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
    """What rates add up to, forgetting with MEMORY, without errors that stay and without the start."""
    keep = np.exp(-STEP / MEMORY)
    rate = np.nan_to_num(rate)
    way = np.asarray(lfilter([STEP], [1.0, -keep], rate - np.mean(rate, axis=0), axis=0))[round(MEMORY / STEP) :]
    return np.asarray(way - way.mean(axis=0))


def _depth(motion: Motion, down: Float[np.ndarray, " m"]) -> Iterator[Check]:
    depth = motion.values("depth")
    if depth is None:
        return
    lever = motion.record.signals["depth"].lever
    assert motion.rotation is not None  # of `compared`
    # What a sensor away from CO moves up and down by roll and pitch alone.
    tilting = np.gradient(np.nan_to_num(motion.rotation[:, 2, :]) @ lever, STEP)
    rate = np.nan_to_num(depth[1][:, 0]) - tilting
    a, b = _leaky(down), _leaky(np.gradient(rate, STEP))
    moved, likeness = float(np.sqrt(np.mean(a**2))), float(np.corrcoef(a, b)[0, 1]) if np.ptp(b) > 0 else 0.0
    if moved < MOVED or abs(likeness) < TELLS:
        yield Check("note", "pressure", "pushes moved it too little up and down to judge depth by the accelerometer")
        return
    scale = float(np.copysign(b.std() / a.std(), likeness))  # both are noisy
    if scale < 0.0:
        yield Check("stop", "pressure", "depth falls when it goes down.", "Turn its sign, or write `frame: up`.")
    elif not SCALE[0] <= scale <= SCALE[1]:
        unit = " It looks like feet." if abs(scale / FEET - 1.0) < 0.3 else ""
        text = f"depth changes {scale:.2g} times as much as the accelerometer says.{unit}"
        yield Check("stop", "pressure", text, "Check its unit and the density of the water.")
    else:
        yield Check("ok", "pressure", f"depth changes {scale:.2f} times as the accelerometer says")


def _velocity(motion: Motion, a: Float[np.ndarray, "m 3"]) -> Iterator[Check]:
    velocity = motion.values("velocity")
    if velocity is None:
        return
    x, y = _leaky(a)[:, :2], _leaky(velocity[1])[:, :2]
    if np.sqrt(np.mean(x**2, axis=0)).max() < MOVED:
        yield Check("note", "dvl", "pushes moved it too little to compare the velocity with the accelerometer")
        return
    # Of a vehicle that is pushed along one axis only, the other says nothing.
    moved = np.sqrt(np.mean(x**2, axis=0)) > MOVED
    A = np.linalg.lstsq(x[:, moved], y, rcond=None)[0].T
    if moved.all():
        turn = float(np.degrees(np.arctan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1])))
        scale = float(np.sqrt(abs(np.linalg.det(A))))
    else:
        own = int(np.flatnonzero(moved)[0])
        across = A[1 - own, 0] * (1.0 if own == 0 else -1.0)
        turn, scale = float(np.degrees(np.arctan2(across, A[own, 0]))), float(np.hypot(*A[:, 0]))
    if abs(turn) > TURNED:
        text = f"velocity is turned by {turn:.0f} deg about z against the accelerometer."
        yield Check("stop", "dvl", text, "Write how it is mounted (`attitude_deg`), or turn it.")
    elif not SCALE[0] <= scale <= SCALE[1]:
        yield Check("stop", "dvl", f"velocity is {scale:.2g} times the accelerometer's.", "Check its unit.")
    else:
        yield Check("ok", "dvl", f"velocity agrees with the accelerometer: turned by {turn:.0f} deg, {scale:.2f} times")
