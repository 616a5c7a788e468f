"""What pushes a vehicle off its way, in words: a current, or thrusters that do not give what was asked of them.

What an autopilot feels as a disturbing force is given as the current whose drag is that force. A thruster that is dead,
reversed or fouled feels the same: unless the water is known, as in the twin, both are named.
"""

import math

import numpy as np
from jaxtyping import Float, Shaped

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.runs.limits import compass_point
from rovtwin.runs.scoring.scores import Flown, headings
from rovtwin.vehicle import Model
from rovtwin.vehicle.analysis.stability import steady_speed

FELT = 0.02  # current from which it is worth a word [m/s]
OTHERWISE = 0.25  # share of the estimated current by which the water's own may differ from it
WEIGHS = 1e-3  # of the weight: a vertical force that is worth a word
THRUSTERS = "thrusters that give less than they should (dead, reversed, fouled)"


def pushed(flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model) -> str:
    """The disturbance that the autopilot estimates, as a force and as the current whose drag it is, or thrusters."""
    force, current = disturbance(flown, rows, model)
    speed = float(np.hypot(*current))
    if speed < FELT:
        return ""
    drift = _turned(flown, rows).T @ current  # drag differs ahead and aside: not where the force points
    towards = compass_point(math.atan2(drift[1], drift[0]))
    surge, sway = np.abs(_in_body(force, flown, rows))
    takes = f"which takes {surge:.2g} N in surge and {sway:.2g} N in sway"
    felt = f"something like a current of {speed:.2g} m/s to the {towards} pushes it"
    water = _water(flown, rows)
    if water is None:
        return f"{felt}, {takes}, or it has {THRUSTERS}"
    if explained(flown, rows, model):
        return f"{felt}, {takes}{_others(force, flown, rows)}"
    ran = f"ran at {np.hypot(*water):.2g} m/s to the {compass_point(math.atan2(water[1], water[0]))}"
    ran = ran if np.hypot(*water) > FELT else "stood still"
    return (
        f"{felt}, {takes}, but the water {ran}: the rest is {THRUSTERS}, a tether, or drag that its file does not have"
    )


def _water(flown: Flown, rows: Shaped[np.ndarray, " rows"]) -> Float[np.ndarray, "2"] | None:
    """Mean level velocity of the water, n [m/s]; None where nobody knows it."""
    return None if flown.water is None else flown.water[rows, :2].mean(axis=0)


def explained(flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model) -> bool | None:
    """Whether the water, waves and tethers push as the autopilot estimates; None where nobody knows.

    But for a quarter, or for twice the standard error of waves' mean force over this time, which a filter lags behind.
    """
    water = _water(flown, rows)
    if water is None:
        return None
    force, current = disturbance(flown, rows, model)
    outside = _level(flown, rows)
    rest = force - outside.mean(axis=0)
    if float(np.hypot(*rest)) < 2.0 * _standard_error(outside):
        return True
    estimated = _turned(flown, rows).T @ _drag_of(rest, flown, rows, model)
    return float(np.hypot(*(water - estimated))) < max(OTHERWISE * float(np.hypot(*current)), FELT)


def _standard_error(force: Float[np.ndarray, "n 2"]) -> float:
    """Of the mean of a force that goes to and fro, by its variance and number of periods [N]."""
    off = force - force.mean(axis=0)
    main = off @ np.linalg.eigh(off.T @ off)[1][:, -1]
    periods = max(np.count_nonzero(np.diff(np.signbit(main))) / 2.0, 1.0)
    return float(np.hypot(*force.std(axis=0)) / np.sqrt(periods))


def _level(flown: Flown, rows: Shaped[np.ndarray, " rows"]) -> Float[np.ndarray, "rows 2"]:
    """Level force of waves, their drift and tethers, n [N]; zero where nobody knows it."""
    if flown.outside is None:
        return np.zeros((1, 2))
    return np.einsum("nij,nj->ni", heading_rotation(headings(flown.eta[rows])), flown.outside[rows, :2])


def _others(force: Float[np.ndarray, "2"], flown: Flown, rows: Shaped[np.ndarray, " rows"]) -> str:
    """What pushes besides the current, where it is a good part of the force."""
    outside = _level(flown, rows).mean(axis=0)
    size = float(np.hypot(*outside))
    if size < OTHERWISE * float(np.hypot(*force)):
        return ""
    towards = compass_point(math.atan2(outside[1], outside[0]))
    return f" (waves, their drift and tethers push with {size:.2g} N to the {towards})"


def lifted(flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model) -> str:
    """The vertical force that the autopilot estimates: weight or buoyancy, or thrusters that do not give it."""
    if flown.bias is None:
        return ""
    force = float(flown.bias[rows, 2].mean())
    way = "down" if force > 0.0 else "up"
    return (
        f"something like {abs(force):.2g} N {way} pushes it, or it has {THRUSTERS}"
        if abs(force) > WEIGHS * float(model.weight)
        else ""
    )


def disturbance(
    flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Mean horizontal force in n [N] and the current whose drag it is along each axis of the body."""
    if flown.bias is None:
        return np.zeros(2), np.zeros(2)
    force = flown.bias[rows, :2].mean(axis=0)
    return force, _drag_of(force, flown, rows, model)


def _drag_of(
    force: Float[np.ndarray, "2"], flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model
) -> Float[np.ndarray, "2"]:
    """Current along surge and sway [m/s] whose drag is a level force in n [N]."""
    body = _in_body(force, flown, rows)
    return np.array([math.copysign(steady_speed(model, i, float(f), thrust=False), f) for i, f in enumerate(body)])


def _in_body(force: Float[np.ndarray, "2"], flown: Flown, rows: Shaped[np.ndarray, " rows"]) -> Float[np.ndarray, "2"]:
    return _turned(flown, rows) @ force


def _turned(flown: Flown, rows: Shaped[np.ndarray, " rows"]) -> Float[np.ndarray, "2 2"]:
    """From n to b by the mean heading."""
    psi = headings(flown.eta_hat[rows])
    c, s = float(np.mean(np.cos(psi))), float(np.mean(np.sin(psi)))
    return np.array([[c, s], [-s, c]]) / max(math.hypot(c, s), 1e-9)
