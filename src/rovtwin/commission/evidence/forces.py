"""Damping forces at the tested speeds and the thrust of all thrusters, with standard deviations to first order.

GUM (JCGM 100:2008), 5.2.2: u^2(y) = g' C g, with g the derivatives of y by the parameters and C their covariance.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Scalar
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.actuation import wrench_limits
from rovtwin.vehicle.physics.dynamics import damping_wrench
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force

COVERAGE = 2.0  # k of GUM: about 95 %
TASK = ("surge", "sway", "heave", "yaw")  # axes whose damping has to be known, as far as thrusters push them
SLOW = 0.3  # of the faster end of an axis's tested speeds, below which the other end is no speed of its own


@dataclass(frozen=True, eq=False)
class Quantity:
    """What is stated with its uncertainty.

    Attributes:
        axis: One of AXES.
        what: damping or thrust.
        at: Speed [m/s, rad/s], or command.
        value: [N, N m].
        slope: Derivatives by theta.
    """

    axis: str
    what: str
    at: float
    value: float
    slope: Float[np.ndarray, " n"]

    @property
    def unit(self) -> str:
        return "N" if AXES.index(self.axis) < 3 else "N m"

    def std(self, covariance: Float[np.ndarray, "n n"]) -> float:
        """[N, N m], from the covariance of theta."""
        return float(np.sqrt(max(self.slope @ covariance @ self.slope, 0.0)))

    def share(self, covariance: Float[np.ndarray, "n n"]) -> float:
        """Half-width of the interval of coverage factor 2, over the value."""
        return COVERAGE * self.std(covariance) / max(abs(self.value), 1e-12)


def damping_forces(result: Any, axes: Sequence[str] = TASK) -> list[Quantity]:
    """Damping at the fastest tested speeds of each axis, both ways where both were tested.

    Args:
        result: An `Identification` with tests.
        axes: Those of interest.
    """
    ends = [(axis, speed) for axis in axes for speed in _ends(result.tested.get(axis, (0.0, 0.0)))]

    def force(model: Model, axis: int, speed: float) -> Scalar:
        return damping_wrench(model, jnp.zeros(6).at[axis].set(speed))[axis]

    return _evaluated(result, "damping", ends, force)


def thrust_forces(result: Any, axes: Sequence[str] = TASK) -> list[Quantity]:
    """Pull of all thrusters that help along an axis, at full command."""
    T = np.asarray(result.model().thrusters.configuration)
    able = np.asarray(wrench_limits(result.model().thrusters)[1]) > 0.0
    fully = [(axis, 1.0) for axis in axes if able[AXES.index(axis)]]

    def force(model: Model, axis: int, command: float) -> Scalar:
        row = T[axis]
        u = command * np.sign(np.where(np.abs(row) > 0.05 * np.abs(row).max(), row, 0.0))
        return (model.thrusters.configuration @ static_force(model.thrusters, jnp.asarray(u)))[axis]

    return _evaluated(result, "thrust", fully, force)


def up_to_scale(result: Any) -> Float[np.ndarray, "n n"]:
    """Covariance of theta if the common scale of all forces were known, shape (n, n).

    No motion tells that scale: more minutes of tests make nothing of it smaller, a pull on a scale does.
    """
    C, mean = result.covariance, np.zeros(len(result.parameters.names))
    for i, name in enumerate(result.parameters.names):
        mean[i] = float(name.startswith("thrusters.") and ".force_" in name)
    known = C @ mean
    variance = float(mean @ known)
    return C if variance <= 0.0 else C - np.outer(known, known) / variance


def pushed(model: Model) -> list[str]:
    """Axes of TASK that thrusters push either way."""
    lower, upper = (np.asarray(limit) for limit in wrench_limits(model.thrusters))
    return [axis for axis in TASK if min(-lower[AXES.index(axis)], upper[AXES.index(axis)]) > 1e-9]


def _ends(tested: Sequence[float]) -> Iterator[float]:
    fastest = max(abs(tested[0]), abs(tested[1]))
    for end in tested:
        if abs(end) > max(SLOW * fastest, 1e-6):
            yield float(end)


def _evaluated(
    result: Any, what: str, places: Sequence[tuple[str, float]], force: Callable[[Model, int, float], Scalar]
) -> list[Quantity]:
    if not places:
        return []

    def forces(theta: Float[Array, " n"]) -> Float[Array, " places"]:
        model = result.parameters.model_at(theta)[0]
        return jnp.stack([force(model, AXES.index(axis), at) for axis, at in places])

    theta = as_array(result.theta)
    values, slopes = np.asarray(jax.jit(forces)(theta)), np.asarray(jax.jit(jax.jacfwd(forces))(theta))
    return [
        Quantity(axis, what, at, float(value), slope)
        for (axis, at), value, slope in zip(places, values, slopes, strict=True)
    ]
