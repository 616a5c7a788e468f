"""When thrusters went off, as the vehicle's own sensors feel it.

Along the axis that is pushed, acceleration is a force that begins, lasts, and ends at an unknown time T after the
event, beside drag that goes with the speed:

    a(t) = k f(t; T) + c_0 + c_1 s(t) + c_2 s(t) |s(t)| + noise,

f being the push through the model's thruster lag and the kernel of the readings. T is that of the largest likelihood,
its interval all T whose likelihood a chi-square test does not tell apart from it (profile likelihood; Venzon and
Moolgavkar 1988, Applied Statistics 37(1)). k is free: neither mass nor thrust of the file matters.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rovtwin.commission.dip.response import accelerations, speeds
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.motion import STEP, Motion
from rovtwin.identification.logs.record import Record
from rovtwin.identification.logs.response import thruster_forces
from rovtwin.vehicle.physics.model import Model

FELT = 15.0  # least gain of 2 log likelihood by the push, from which on it counts as felt
CHI_SQUARE = 3.84  # 95 %, one degree of freedom


@dataclass(frozen=True)
class OffTime:
    """Time from an event to thrusters off.

    Attributes:
        seconds: Most likely [s].
        low, high: 95 % interval [s].
        lasted: Whether the push may have lasted to the end of what was recorded.
    """

    seconds: float
    low: float
    high: float
    lasted: bool


def off_time(
    model: Model,
    record: Record,
    axis: int,
    u: Float[np.ndarray, " n"],
    began: float,
    event: float,
    end: float,
    lag: float = 0.0,
) -> OffTime | None:
    """When the push ended; None where the sensors do not feel it at all.

    Args:
        model: Of the vehicle as its file has it.
        record: Of the push.
        axis: That it pushes most, 0 to 5.
        u: Command of the push.
        began: When the push began [s].
        event: When it was ended, as far as is known here [s].
        end: Up to when readings count [s].
        lag: By how much the vehicle answers a command late, as the dip has found [s]: the push begins so much later,
            and what is late of its end counts.

    Raises:
        IdentificationError: No sensor tells that axis, or readings are missing.
    """
    motion = Motion.of(record).alike("gyro", "accelerometer", "attitude")
    found = accelerations(motion)
    y, s = found[:, axis], speeds(motion, found)[:, axis]
    good = np.isfinite(y) & np.isfinite(s) & (motion.t > began - 1.5) & (motion.t < end)
    if good.sum() * STEP < 0.8 * (end - began):
        raise IdentificationError(
            f"{record.source}: found {good.sum() * STEP:.1f} s of readings, expected {end - began + 1.5:.1f} s"
        )
    others = np.stack([np.ones(len(s)), s, s * np.abs(s)], axis=1)[good]
    Q = np.linalg.qr(others)[0]
    ends = np.arange(0.0, end - event + 4.0 * motion.width, STEP)  # the last of these: never
    left = np.array([_left(y[good], Q, _push(model, motion, u, began + lag, event + T)[good]) for T in ends])
    independent = good.sum() * STEP / (2.0 * np.sqrt(np.pi) * motion.width)
    nothing = _left(y[good], Q, np.zeros(int(good.sum())))
    if independent * np.log(nothing / left.min()) < FELT:
        return None
    likely = ends[independent * np.log(left / left.min()) < CHI_SQUARE]
    lasted = bool(likely[-1] > end - event - 2.0 * motion.width)
    return OffTime(float(ends[np.argmin(left)]), float(likely[0]), float(likely[-1]), lasted)


def _push(model: Model, motion: Motion, u: Float[np.ndarray, " n"], on: float, off: float) -> Float[np.ndarray, " m"]:
    """Size of a push between two times on the grid."""
    record = motion.record
    times, commands = np.array([record.start, on, off]), np.stack([0.0 * u, u, 0.0 * u])
    force = thruster_forces(model, Motion(replace(record, t_command=times, command=commands), motion.t, motion.width))
    return np.asarray(np.abs(force).sum(axis=1))


def _left(y: Float[np.ndarray, "k a"], Q: Float[np.ndarray, "k b"], f: Float[np.ndarray, "k _"]) -> float:
    """Sum of squares of y that Q and f leave."""
    y, f = y - Q @ (Q.T @ y), f - Q @ (Q.T @ f)
    size = f @ f
    return float(y @ y - (f @ y) ** 2 / size) if size > 0.0 else float(y @ y)
