"""Before a mission: how far a dive rolls and pitches the vehicle, by its equations of motion in one plane at a time.

Diving at w and going at v through the water a vehicle is turned by Munk's moment, on which its own tilt phi acts back:

    I phi_ddot = D ((v cos phi + w sin phi) (w cos phi - v sin phi)) - k sin phi - d phi_dot + control,
    D = A_zz - A_yy  (roll, v in sway),   A_zz - A_xx  (pitch, v in surge)

It starts at rest: all of the heave thrust brings w to the dive's speed, and the water takes the vehicle along, as long
as the filter does not know the current. To the current's part of v comes what the first position fix makes: a pull of
half the bandwidth times its error. With a Doppler log there is no such pull: in calm water the disc of the tests rolls
by 0.2 degrees with one, by 14 to 18 without. Control counts where thrusters turn the vehicle about that axis. Once the
current is known a dive is slowed until the flow tilts it by no more than `level_speed.TILT`, so no more than that is
said.

Reference: Fossen (2021), sec. 6.3.3 (Munk's moment).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.gnc.guidance.level_speed import TILT
from rovtwin.gnc.scales import HEAVE, VehicleScales, straight
from rovtwin.vehicle import Model
from rovtwin.vehicle.analysis.stability import hang
from rovtwin.vehicle.physics.actuation import axis_limits, pushed_axes

BEGINS = 12.0  # times of the heave loop that the start of a dive takes
STEPS = 60  # in one of them
TIPPED = 0.5 * np.pi  # beyond which nothing more is to be found out
PLANES = ((3, 1), (4, 0))  # roll with sway, pitch with surge


@dataclass(frozen=True)
class _Plane:
    """One of roll and pitch with the speed that turns it: scalars of the model, SI."""

    munk: float
    stiffness: float
    inertia: float
    damping: tuple[float, float]
    control: tuple[float, float, float]  # stiffness, damping, largest moment
    mass: float
    drag: tuple[float, float]


def tilts(
    model: Model, flow: Float[np.ndarray, "2"], dive: float | None, position_std: float
) -> Float[np.ndarray, "2"]:
    """Largest roll and pitch as a dive begins [rad].

    Args:
        model: The vehicle as it truly is.
        flow: Current along and across the vehicle, b [m/s].
        dive: Speed of the dive [m/s]; None: the vehicle's own.
        position_std: Of a position fix, each axis [m]; 0 with a Doppler log.
    """
    scales = VehicleScales.of(model)
    fast = scales.dive_speed if dive is None else dive
    kicked = 0.5 * scales.level_bandwidth * position_std
    found = []
    for angle, level in PLANES:
        moved = kicked if scales.force[level] > 0.0 else 0.0
        found.append(
            _largest(_plane(model, scales, angle, level), model, scales, abs(float(flow[level])) + moved, fast)
        )
    return np.minimum(found, TILT)


def _plane(model: Model, scales: VehicleScales, angle: int, level: int) -> _Plane:
    mass, added = np.diagonal(np.asarray(model.inertia)), np.diagonal(np.asarray(model.added_mass))
    linear, quadratic = (
        np.diagonal(np.asarray(d)) for d in (model.linear_damping_ahead, model.quadratic_damping_ahead)
    )
    rights = float(hang(model).stiffness[angle - 3])
    low, high = axis_limits(model)
    w = max(scales.bandwidth[angle], straight(model)[angle])
    damped = 2.0 * np.sqrt(w**2 + max(rights, 0.0) / mass[angle])
    most = float(min(-low[angle], high[angle])) if pushed_axes(model)[angle] else 0.0
    return _Plane(
        munk=float(added[HEAVE] - added[level]),
        stiffness=rights,
        inertia=float(mass[angle]),
        damping=(float(linear[angle]), float(quadratic[angle])),
        control=(float(w**2 * mass[angle]), float(damped * mass[angle]), most),
        mass=float(mass[level]),
        drag=(float(linear[level]), float(quadratic[level])),
    )


def _largest(plane: _Plane, model: Model, scales: VehicleScales, v: float, dive: float) -> float:
    """Largest angle [rad] from rest, by semi-implicit steps."""
    rate = float(scales.bandwidth[HEAVE])
    dt, w, phi, p, largest = 1.0 / (STEPS * rate), 0.0, 0.0, 0.0, 0.0
    push = float(scales.acceleration[HEAVE])
    most = plane.control[2]
    for _ in range(round(BEGINS * STEPS)):
        w += dt * min(max(2.0 * rate * (dive - w), 0.0), push)
        v -= dt * (plane.drag[0] + plane.drag[1] * abs(v)) * v / plane.mass
        c, s = np.cos(phi), np.sin(phi)
        moment = plane.munk * (v * c + w * s) * (w * c - v * s) - plane.stiffness * s
        moment -= (plane.damping[0] + plane.damping[1] * abs(p)) * p
        moment -= min(max(plane.control[0] * phi + plane.control[1] * p, -most), most)
        p += dt * moment / plane.inertia
        phi += dt * p
        largest = max(largest, abs(phi))
        if largest > TIPPED:
            break
    return largest
