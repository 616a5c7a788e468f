"""Derivatives of the terms of the equations of motion: what filters, controllers and analyses linearise with.

Written out: in a compiled loop automatic differentiation of the same terms costs more.

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 3, 4 and 6.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.small_matrices import product
from rovtwin.core.frames import skew
from rovtwin.core.numerics import Array, in_numpy, jnp, module_for
from rovtwin.core.types import Matrix6, Vector6
from rovtwin.vehicle.physics.dynamics import restoring_lever
from rovtwin.vehicle.physics.model import Model


def damping_jacobian(model: Model, nu: Vector6, size: int = 6) -> Float[Array, "{size} {size}"]:
    """d(D(nu) nu)/dnu of the first `size` components; at zero velocity the mean of both sides.

    Args:
        model: Its damping matrices are used.
        nu: Velocity through the water, b at CO [m/s, rad/s].
        size: 6, or 3 for forces by linear velocities alone.
    """
    model, nu = in_numpy((model, nu))
    v, xp = nu[:size], module_for(model, nu)

    def part(matrix: Any) -> Any:
        return matrix if size == 6 else matrix[:size, :size]

    ahead = xp.where(v > 0, 1.0, xp.where(v < 0, 0.0, 0.5))
    linear = part(model.linear_damping_ahead) * ahead + part(model.linear_damping_astern) * (1.0 - ahead)
    quadratic = xp.where(v >= 0, part(model.quadratic_damping_ahead), part(model.quadratic_damping_astern))
    return jnp.asarray(linear + 2.0 * quadratic * xp.abs(v))


def coriolis_jacobian(mass: Matrix6, nu: Vector6) -> Matrix6:
    """d(C(nu) nu)/dnu of a full inertia matrix."""
    momentum = mass @ nu
    S_p, S_h, S_v, S_w = skew(momentum[:3]), skew(momentum[3:]), skew(nu[:3]), skew(nu[3:])
    upper = product(S_w, mass[:3]) - jnp.concatenate([jnp.zeros((3, 3)), S_p], axis=1)
    lower = product(S_v, mass[:3]) + product(S_w, mass[3:]) - jnp.concatenate([S_p, S_h], axis=1)
    return jnp.concatenate([upper, lower])


def restoring_jacobian(model: Model) -> Float[Array, "6 3"]:
    """dg/d(down_b): g is linear in the direction of gravity."""
    force = (model.weight - model.buoyancy) * jnp.eye(3)
    moment = model.weight * skew(model.center_of_gravity) - model.buoyancy * skew(model.center_of_buoyancy)
    return -jnp.concatenate([force, moment])


def restoring_stiffness(model: Model) -> Float[Array | np.ndarray, "6"]:
    """Slope of the restoring wrench of each axis at level trim; roll and pitch only [N m/rad].

    NumPy, but under a trace.

    Reference: Fossen (2021), eq. 4.14, for W and B that differ.
    """
    given: tuple[Any, ...] = (model.weight, model.buoyancy, model.center_of_gravity, model.center_of_buoyancy)
    xp = module_for(given)
    rights = restoring_lever(*(xp.asarray(value) for value in given))[2]
    zero = xp.zeros_like(rights)
    return xp.stack([zero, zero, zero, rights, rights, zero])
