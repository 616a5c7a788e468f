"""Added mass from the start-up of one push, damping and thrust held (thesis 2.20, 2.33, 8.1): the residual alone.

    M v_dot = F(t) - d_l v - d_q |v| v,  s_dot = v,  residual = s measured - s predicted

One step cannot tell mass from errors of thrust and damping: whoever minimises this gets their errors in M.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.record import Record
from rovtwin.identification.steady.damping_yaml import DOFS
from rovtwin.identification.steady.forces import forces, weights
from rovtwin.identification.steady.smoothed_motion import motion_of
from rovtwin.vehicle.physics.model import Model

STEP = 0.02  # longest step of the integration [s]


@dataclass(frozen=True, eq=False)
class StartUp:
    """One push in one direction.

    Attributes:
        t: Times of the readings [s], starting at zero.
        distance: Travelled along the direction since t = 0 [m or rad], raw readings.
        force: Thrust and weight along it [N or N m] at those times; held until the next one.
        speed: At t = 0, smoothed [m/s or rad/s].
    """

    t: Float[np.ndarray, " n"]
    distance: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    speed: float


def start_up(record: Record, model: Model, dof: str, start: float, end: float, linear: bool = False) -> StartUp:
    """The push between two times of a test.

    Args:
        record: The test.
        model: Thrust curves, weight and buoyancy.
        dof: surge, sway, heave or yaw.
        start: Before or at the command [s].
        end: [s]
        linear: Force linear in the command, as the thesis takes it.

    Raises:
        IdentificationError: Fewer than 10 readings between the times, or a gap at its start.
    """
    motion = motion_of(record)
    name, columns = {
        "surge": ("horizontal", (0, 1)),
        "sway": ("horizontal", (0, 1)),
        "heave": ("depth", (0,)),
        "yaw": ("attitude", (2,)),
    }[dof]
    name = name if name in record.signals else "position"
    if name not in record.signals or dof not in motion.velocity:
        raise IdentificationError(f"{record.source}: {dof}: nothing measures it; found {', '.join(record.signals)}")
    signal = record.signals[name].cut(start, end)
    if len(signal.t) < 10:
        raise IdentificationError(f"{record.source}: found {len(signal.t)} readings from {start:g} to {end:g} s")
    value = signal.value[:, (2,)] if name == "position" and dof == "heave" else signal.value[:, list(columns)]
    inside = (motion.t >= start) & (motion.t <= end)
    psi = float(np.nanmean(motion.attitude[inside, 2]))
    ahead, starboard = heading_rotation(psi).T
    along = {"surge": ahead, "sway": starboard}.get(dof, np.ones(1))
    distance = (np.unwrap(value[:, 0])[:, None] if dof == "yaw" else value) @ along
    i = DOFS.index(dof)
    force = forces(model, record, signal.t, linear)[:, i]
    if i < 3:
        attitude = np.stack([np.interp(signal.t, motion.t, motion.attitude[:, k]) for k in range(3)], axis=1)
        force = force + weights(model, record, attitude)[:, i]
    speed = float(np.interp(signal.t[0], motion.t, motion.velocity[dof]))
    if not np.isfinite(speed):
        raise IdentificationError(f"{record.source}: {dof}: a gap at {start:g} s; start the push outside of it")
    return StartUp(signal.t - signal.t[0], distance - distance[0], force, speed)


def start_up_residual(push: StartUp, linear: float, quadratic: float) -> Callable[..., Float[np.ndarray, " n"]]:
    """Residual of the distance as a function of the total mass [kg or kg m2] and a factor on the force.

    The offset of the first noisy reading is taken out, as the mean of the residual.

    Args:
        push: From `start_up`.
        linear: d_l, held.
        quadratic: d_q, held.
    """

    def residual(mass: float, thrust: float = 1.0) -> Float[np.ndarray, " n"]:
        predicted = predict(push, mass, thrust, linear, quadratic)
        error = push.distance - predicted
        return error - np.mean(error)

    return residual


def predict(push: StartUp, mass: float, thrust: float, linear: float, quadratic: float) -> Float[np.ndarray, " n"]:
    """Distance at the times of the readings, by RK4."""

    def rate(v: float, force: float) -> float:
        return (thrust * force - linear * v - quadratic * abs(v) * v) / mass

    s, v, out = 0.0, push.speed, [0.0]
    for force, span in zip(push.force[:-1], np.diff(push.t), strict=True):
        count = max(int(np.ceil(span / STEP)), 1)
        h = span / count
        for _ in range(count):
            a1 = rate(v, force)
            a2 = rate(v + h / 2 * a1, force)
            a3 = rate(v + h / 2 * a2, force)
            a4 = rate(v + h * a3, force)
            s += h * v + h * h / 6 * (a1 + a2 + a3)
            v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        out.append(s)
    return np.array(out)
