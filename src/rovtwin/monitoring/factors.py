"""Factors: what may have changed of a vehicle, as few numbers that a flight can tell.

    D_ij -> sqrt(d_i d_j) D_ij      drag, linear and quadratic, ahead and astern
    A_ij -> sqrt(a_i a_j) A_ij      added mass; it stays symmetric and positive definite
    f_k  -> k_k f_k                 force of each thruster
    lever and net buoyancy          what shifts or falls off changes them; additive but for the metacentric height

Factors are held as logarithms, so that none gets negative: theta = 0 is the vehicle as its file describes it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, jnp
from rovtwin.vehicle.physics.model import Model

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
DRAG_STD, ADDED_STD, HEIGHT_STD = 0.5, 0.4, 0.3  # logarithms; wide, so that the result comes from the flight
COMMON_FORCE_STD, OWN_FORCE_STD = 0.2, 0.25  # logarithms, of all thrusters alike and of each
NET_STD, LEVER_STD = 0.02, 0.05  # of the weight [1], and of the vehicle's length [1]


@dataclass(frozen=True)
class Factor:
    """One of them: its name, and the unit of theta, `1` for the logarithm of a factor."""

    name: str
    unit: str

    @property
    def relative(self) -> bool:
        """Whether theta is a logarithm."""
        return self.unit == "1"


@dataclass(frozen=True)
class Factors:
    """All of a vehicle's, in the order of theta: drag, added mass, thrusters' forces, restoring.

    Attributes:
        each: Names and units.
        covariance: Of theta before any flight.
    """

    each: tuple[Factor, ...]
    covariance: Float[np.ndarray, "p p"]

    @property
    def names(self) -> list[str]:
        return [factor.name for factor in self.each]

    @classmethod
    def of(cls, model: Model, thrusters: Sequence[str], length: float) -> "Factors":
        """Factors of a vehicle.

        Args:
            model: The vehicle as it is assumed to be.
            thrusters: Their names.
            length: Of the vehicle [m].
        """
        names = [*(f"drag.{axis}" for axis in AXES), *(f"added_mass.{axis}" for axis in AXES)]
        names += [f"force.{name}" for name in thrusters]
        each = [*(Factor(name, "1") for name in names), Factor("restoring.metacentric_height", "1")]
        each += [Factor("restoring.net_buoyancy", "N")]
        each += [Factor(f"restoring.center_of_buoyancy_{side}", "m") for side in "xy"]
        std = [DRAG_STD] * 6 + [ADDED_STD] * 6 + [OWN_FORCE_STD] * len(thrusters)
        std += [HEIGHT_STD, NET_STD * float(model.weight), LEVER_STD * length, LEVER_STD * length]
        covariance = np.diag(np.square(std))
        covariance[12 : 12 + len(thrusters), 12 : 12 + len(thrusters)] += COMMON_FORCE_STD**2
        return cls(tuple(each), covariance)


def changed(model: Model, theta: Float[Array, " p"]) -> Model:
    """The vehicle with these factors; its `inertia_inverse` is that of `model` still, for who solves by other means.

    Args:
        model: The vehicle at theta = 0.
        theta: The factors.
    """
    n = model.thrusters.count
    drag, added = jnp.exp(0.5 * theta[:6]), jnp.exp(0.5 * theta[6:12])
    height, net, aside = jnp.exp(theta[12 + n]), theta[13 + n], theta[14 + n : 16 + n]
    added_mass = added[:, None] * model.added_mass * added
    lever = model.center_of_buoyancy - model.center_of_gravity
    lever = jnp.stack([lever[0] + aside[0], lever[1] + aside[1], height * lever[2]])
    configuration = model.thrusters.configuration * jnp.exp(theta[12 : 12 + n])
    return eqx.tree_at(
        lambda m: (
            m.added_mass,
            m.inertia,
            m.damping,
            m.buoyancy,
            m.center_of_buoyancy,
            m.thrusters.configuration,
        ),
        model,
        (
            added_mass,
            model.rigid_body_mass + added_mass,
            drag[:, None] * model.damping * jnp.tile(drag, 4),
            model.buoyancy + net,
            model.center_of_gravity + lever,
            configuration,
        ),
    )
