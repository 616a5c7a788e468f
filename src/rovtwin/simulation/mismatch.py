"""A plant that differs from the model its autopilot was given, as real vehicles do."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, jax, jnp, module_for
from rovtwin.core.types import Matrix6, PRNGKey, ScalarLike
from rovtwin.simulation.noise import key_for
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.model import GRAVITY, Model
from rovtwin.vehicle.physics.thrusters import Thrusters

DAMPING = ("linear_damping_ahead", "linear_damping_astern", "quadratic_damping_ahead", "quadratic_damping_astern")


def perturbed(
    model: Model, key: PRNGKey, damping: ScalarLike = 0.25, mass: ScalarLike = 1.10, thrust: ScalarLike = 0.90
) -> Model:
    """A plant like `model`, but drawn anew.

    Args:
        model: The autopilot's.
        key: Seeds the draws.
        damping: Every damping coefficient (linear and quadratic, each entry, ahead and astern where they differ) is
            multiplied by its own draw, uniform in [1 - damping, 1 + damping].
        mass: Factor on rigid-body and added mass; weight, buoyancy and displaced mass go with it.
        thrust: Factor on the force of every thruster.
    """

    def factors(name: str) -> Matrix6:
        ahead = name.replace("astern", "ahead")
        own, shared = (
            jax.random.uniform(key_for(key, n), (6, 6), minval=1.0 - damping, maxval=1.0 + damping)
            for n in (name, ahead)
        )
        # A coefficient that is the same ahead and astern is one coefficient, and has one draw.
        return jnp.where(getattr(model, name) == getattr(model, ahead), shared, own)

    def scaled(name: str) -> Float[Array, "*axes"]:
        return getattr(model, name) * factors(name)

    heavier = ("rigid_body_mass", "added_mass", "weight", "buoyancy", "displaced_mass")
    return model.replace(
        **{name: scaled(name) for name in DAMPING},
        **{name: mass * getattr(model, name) for name in heavier},
        thrusters=_weaker(model, thrust),
    )


def drawn(plant: Model, model: Model) -> dict[str, float]:
    """Factors between a plant and the model in the same water that it was drawn from, by name.

    `mass` and `thrust`; of every damping coefficient that is not zero its own, named as `identify` names parameters:
    `linear_damping.surge` ahead, `linear_damping_astern.surge` astern, `quadratic_damping.sway_yaw` for the moment in
    yaw that motion in sway makes.
    """
    found = {"mass": float(plant.weight / model.weight), "thrust": _factor(plant.thrusters, model.thrusters)}
    for name in DAMPING:
        ours, theirs = np.asarray(getattr(plant, name)), np.asarray(getattr(model, name))
        for i, j in zip(*np.nonzero(theirs.T), strict=True):
            entry = AXES[i] if i == j else f"{AXES[i]}_{AXES[j]}"
            found[f"{name.removesuffix('_ahead')}.{entry}"] = float(ours[j, i] / theirs[j, i])
    return found


def _factor(ours: Thrusters, theirs: Thrusters) -> float:
    """Of the forces of all thrusters; 1 without any."""
    weaker, whole = (np.abs(np.concatenate([one.force_ahead, one.table_force.ravel()])).sum() for one in (ours, theirs))
    return float(weaker / whole) if whole > 0 else 1.0


def _weaker(model: Model, factor: ScalarLike) -> Thrusters:
    thrusters = model.thrusters
    return jax.tree.unflatten(
        jax.tree.structure(thrusters),
        [
            leaf * factor if path[-1].name in ("force_ahead", "force_astern", "table_force") else leaf
            for path, leaf in jax.tree_util.tree_leaves_with_path(thrusters)
        ],
    )


def lifted(model: Model, force: ScalarLike) -> Model:
    """The same vehicle with `force` more net buoyancy [N], at its centre of buoyancy, of displaced volume."""
    xp = module_for(model, force)
    more = xp.asarray(force)
    return model.replace(
        buoyancy=xp.add(model.buoyancy, more), displaced_mass=xp.add(model.displaced_mass, more / GRAVITY)
    )
