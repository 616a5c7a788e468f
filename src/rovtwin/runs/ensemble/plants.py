"""Vehicles as they may truly be: drawn from what an identification left open, or from a stated spread."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import jax
from rovtwin.core.types import PRNGKey
from rovtwin.identification.diagnostics.stated import Stated, stated
from rovtwin.identification.joint.model.gaussian import root_of
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.world import in_water
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.mismatch import lifted, perturbed
from rovtwin.vehicle.physics.model import Model

SPREAD = {"damping": 0.25, "mass": 0.10, "thrust": 0.10}
"""Of a vehicle that nobody identified: half-widths of uniform draws, as shares."""


@dataclass(frozen=True)
class Plants:
    """A distribution of plants.

    Attributes:
        description: What they are drawn from, in words.
        drawn: The plant of a random generator.
    """

    description: str
    drawn: Callable[[np.random.Generator], Model]


def plants_of(scenario: Scenario) -> Plants:
    """What the plants of a scenario are drawn from.

    The covariance of the vehicle's `identified:` block, if it has one; else the scenario's own mismatch; else SPREAD.
    """
    vehicle = vehicle_of(scenario)
    model = vehicle.model()
    watery = in_water(scenario.world, vehicle, model)
    found = stated(vehicle, vehicle.name)
    if found.covariance is not None:
        text = f"the covariance of the {len(found.parameters)} parameters that {vehicle.name} was identified by"
        lift = float(watery.buoyancy - model.buoyancy)
        return Plants(text, partial(_of_posterior, found, root_of(found.covariance), lift))
    mismatch = scenario.world.mismatch
    if mismatch:
        text = (
            f"the scenario's mismatch: each damping coefficient ±{100 * mismatch.damping:g} % uniform, mass x "
            f"{mismatch.mass:g}, thrust x {mismatch.thrust:g}"
        )
        given = mismatch.damping, (mismatch.mass, mismatch.mass), (mismatch.thrust, mismatch.thrust)
    else:
        text = (
            f"the usual spread, since {vehicle.name} was not identified and the scenario has no mismatch: each damping "
            f"coefficient ±{100 * SPREAD['damping']:g} %, mass ±{100 * SPREAD['mass']:g} %, thrust "
            f"±{100 * SPREAD['thrust']:g} %, uniform"
        )
        given = SPREAD["damping"], _about_one(SPREAD["mass"]), _about_one(SPREAD["thrust"])
    return Plants(text, partial(_of_spread, watery, *given))


def _about_one(share: float) -> tuple[float, float]:
    return 1.0 - share, 1.0 + share


def _of_spread(
    model: Model, damping: float, mass: tuple[float, float], thrust: tuple[float, float], rng: np.random.Generator
) -> Model:
    return perturbed(model, _key(rng), damping, rng.uniform(*mass), rng.uniform(*thrust))


def _key(rng: np.random.Generator) -> PRNGKey:
    return jax.random.key(int(rng.integers(2**31)))


def _of_posterior(found: Stated, root: Float[np.ndarray, "n n"], lift: float, rng: np.random.Generator) -> Model:
    drawn = found.model_at(root @ rng.standard_normal(root.shape[1]))
    return lifted(drawn, lift) if lift else drawn
