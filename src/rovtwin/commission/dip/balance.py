"""Buoyancy, trim and righting of the vehicle that is let go between pushes, against the file.

In heave, with mass and drag of the file, what is left is net buoyancy and a factor on the thrusters' force:

    M w_dot + d_1 w + d_2 w |w| = -(B - W) + k F.

About a level axis, with the inertia of the file, the coefficient of the tilt is the righting stiffness:

    q_dot = c_0 + c_1 q + c_2 q |q| + c_3 tilt + c_4' F

(Fossen 2021, sec. 4.1). The mean tilt is the trim. Times at the surface and on the floor are left out.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.commission.dip.response import clear
from rovtwin.commission.stage import Check
from rovtwin.core.numerics import as_array, jax
from rovtwin.identification.logs.motion import STEP, WIDTH, Motion
from rovtwin.identification.logs.record import Record
from rovtwin.identification.logs.response import thruster_forces
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.analysis.hydrostatics import floating_of
from rovtwin.vehicle.physics.dynamics import damping_wrench
from rovtwin.vehicle.physics.linearisation import restoring_stiffness
from rovtwin.vehicle.physics.model import Model

HEAVE, ROLL, PITCH = 2, 3, 4
SINKS, ODD = 0.01, 0.004  # of the weight: net buoyancy off by so much stops, warns
TILTED, LEANS = 8.0, 3.0  # trim off by so much stops, warns [deg]
RIGHTS = 2.0  # factor of the righting stiffness that warns
SURE = 3.0  # standard deviations that a difference has to have
CLEAR = 0.03  # of hull and surface, hull and floor [m]
KNOWN = 0.2  # standard deviation of a stiffness as a share, up to which it is judged
LOOK = (
    "What is on board, and where, that the file does not have, or the other way round? Is the water as the file has it?"
)

_damping = jax.jit(jax.vmap(damping_wrench, in_axes=(None, 0)))


def balance(vehicle: Vehicle, record: Record, floor: float = np.inf) -> Iterator[Check]:
    """Lines about net buoyancy, trim, and righting stiffness, as far as sensors tell them; depth of the floor [m]."""
    model, motion = vehicle.model(), Motion.of(record)
    force = thruster_forces(model, motion) @ np.asarray(model.thrusters.configuration).T
    free = clear(model, motion, floor, CLEAR)
    yield from _buoyancy(model, motion, force, free)
    yield from _trim(vehicle, motion, free)
    yield from _righting(model, motion, force, free)


def _buoyancy(
    model: Model, motion: Motion, force: Float[np.ndarray, "m 6"], free: Bool[np.ndarray, " m"]
) -> Iterator[Check]:
    depth, R = motion.values("depth"), motion.rotation
    if depth is None or R is None:
        return
    # What a sensor away from CO moves up and down by roll and pitch alone.
    w = depth[1][:, 0] - np.gradient(R[:, 2, :] @ motion.record.signals["depth"].lever, STEP)
    at = np.zeros((len(w), 6))
    at[:, HEAVE] = w
    drag = np.asarray(_damping(model, as_array(np.nan_to_num(at))))[:, HEAVE]
    mass, weight = float(np.asarray(model.inertia)[HEAVE, HEAVE]), float(model.weight)
    y = np.where(free, mass * np.gradient(w, STEP) + drag, np.nan)
    found = _regression(y, [np.ones(len(w)), R[:, 2, HEAVE] * force[:, HEAVE]])
    if found is None:
        text = "too little time afloat to judge net buoyancy."
        yield Check("warning", "buoyancy", text, "Begin in the middle of the tank, well below the surface.")
        return
    net, std = -float(found[0][0]), float(found[1][0])
    expected = float(model.buoyancy - model.weight)
    text = f"net buoyancy about {net:z.1f} N, expected {expected:z.1f} N by the file"
    off = abs(net - expected)
    if off < max(ODD * weight, SURE * std):
        yield Check("ok", "buoyancy", text)
    else:
        yield Check("stop" if off > max(SINKS * weight, SURE * std) else "warning", "buoyancy", f"{text}.", LOOK)


def _trim(vehicle: Vehicle, motion: Motion, free: Bool[np.ndarray, " m"]) -> Iterator[Check]:
    R = motion.rotation
    if R is None or not free.any():
        return
    down = np.nanmean(R[free, 2, :], axis=0)  # of a vehicle that swings about its trim
    found = np.degrees([np.arctan2(down[1], down[2]), np.arctan2(-down[0], np.hypot(down[1], down[2]))])
    expected = np.degrees(np.asarray(floating_of(vehicle.assembly).trim))
    off = float(np.abs(found - expected).max())
    text = f"roll {found[0]:z.1f}, pitch {found[1]:z.1f} deg at rest, "
    text += f"expected {expected[0]:z.1f} and {expected[1]:z.1f} deg"
    if off < LEANS:
        yield Check("ok", "trim", text)
    else:
        yield Check("stop" if off > TILTED else "warning", "trim", f"{text} by the file.", LOOK)


def _righting(
    model: Model, motion: Motion, force: Float[np.ndarray, "m 6"], free: Bool[np.ndarray, " m"]
) -> Iterator[Check]:
    gyro, R = motion.values("gyro"), motion.rotation
    if gyro is None or R is None:
        return
    tilt = {ROLL: R[:, 2, 1], PITCH: -R[:, 2, 0]}  # sines
    for axis, name in ((ROLL, "roll"), (PITCH, "pitch")):
        s, a = gyro[0][:, axis - 3], np.where(free, gyro[1][:, axis - 3], np.nan)
        stiffness, inertia = float(restoring_stiffness(model)[axis]), float(np.asarray(model.inertia)[axis, axis])
        pushed = [force[:, i] for i in range(6) if np.ptp(force[:, i]) > 0.0]  # levers of all forces are free
        found = _regression(a, [np.ones(len(s)), s, s * np.abs(s), tilt[axis], *pushed])
        if found is None or stiffness <= 0.0:
            continue
        rights, std = -inertia * found[0][3], inertia * found[1][3]
        if std > KNOWN * stiffness:
            continue
        text = f"righting stiffness about {rights:.2g} N m/rad, expected {stiffness:.3g} by the file"
        if stiffness / RIGHTS < rights < stiffness * RIGHTS:
            yield Check("ok", f"righting in {name}", text)
        else:
            yield Check("warning", f"righting in {name}", f"{text}.", LOOK)


def _regression(
    y: Float[np.ndarray, " m"], columns: list[Float[np.ndarray, " m"]]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]] | None:
    """Coefficients and their standard deviations; None where readings are too few. Neighbours are not independent."""
    X = np.stack(columns, axis=1)
    good = np.isfinite(y) & np.isfinite(X).all(axis=1)
    alike = 2.0 * np.sqrt(np.pi) * WIDTH / STEP
    if good.sum() < 2.0 * alike * X.shape[1]:
        return None
    X, y = X[good], y[good]
    scale = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-9)
    inverse = np.linalg.pinv((X / scale).T @ (X / scale))
    slopes = inverse @ ((X / scale).T @ y)
    left = y - (X / scale) @ slopes
    variance = float(left @ left) / max(len(y) - alike * X.shape[1], 1.0)
    return slopes / scale, np.sqrt(alike * variance * np.diag(inverse)) / scale
