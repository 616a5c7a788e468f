"""What an identified model lacks: a learned wrench of the velocity through the water and of the thrust.

Each part is a Gaussian process of one component of the wrench, written with kernel functions at m places ("inducing
points"), so that mean and variance cost m exponentials. Its inputs are z = (nu_r, tau): velocity through the water and
the thrusters' wrench. Parts are of two kinds:

    motion: depends on nu_r alone, and is zero at nu_r = 0;
    thrust: depends on nu_r and tau, and is zero at tau = 0: thrust that is lost or turned aside by an inflow.

Both are what a process with the kernel rho(z, z') = exp(-|z - z'|^2 / 2), lengths taken out, becomes once it is known
to be zero there. With `a` the inputs that have to vanish and `f` the others

    k(z, z') = rho_f(z, z') [rho_a(z, z') - rho_a(z, 0) rho_a(z', 0)].

Far from the data the mean goes to zero and the variance to the prior's.

Parts of motion and damping together take energy out: where nu_r . (tau_motion - D(nu_r) nu_r) would be positive, the
excess is taken off along nu_r. The damping is included because the estimate knows only the sum of both: a part that may
not undo a damping that is too large could not be learned beside it. Without thrust the vehicle then never gains energy.

References: Kennedy and O'Hagan (2001), Bayesian calibration of computer models, J. R. Stat. Soc. B 63(3) (a Gaussian
process as the discrepancy of a model); Rasmussen and Williams (2006), Gaussian Processes for Machine Learning, sec.
8.3.
"""

from typing import Any

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import Scalar, Vector6


class Discrepancy(eqx.Module):
    """P parts with up to m kernel functions each.

    Attributes:
        along: Which component of the wrench each part adds to, columns of unit vectors.
        motion: 1 for parts of motion, 0 for parts of thrust.
        anchored: 1 for the inputs that have to vanish for the part to.
        std: Prior standard deviation of each part [N, N m].
        inverse_lengths: One over the length over which a part changes with an input [s/m, s/rad, 1/N, 1/(N m)], 0 where
            it does not.
        centres: Places of the kernel functions [m/s, rad/s, N, N m].
        coefficients: Of the kernel functions in the mean [N, N m].
        reduction: G with k' G' G k the share of the prior's variance that the data have taken away.
        speeds: Typical of each component of nu_r [m/s, rad/s]: what excess energy is taken off by.
    """

    along: Float[Array, "6 P"]
    motion: Float[Array, " P"]
    anchored: Float[Array, "P 12"]
    std: Float[Array, " P"]
    inverse_lengths: Float[Array, "P 12"]
    centres: Float[Array, "P m 12"]
    coefficients: Float[Array, "P m"]
    reduction: Float[Array, "P m m"]
    speeds: Vector6


def with_coefficients(discrepancy: Discrepancy, coefficients: Float[Array, "P m"]) -> Discrepancy:
    """The same with other coefficients of the mean."""
    return eqx.tree_at(lambda d: d.coefficients, discrepancy, coefficients)


def replace_discrepancy(model: Any, discrepancy: Discrepancy | None) -> Any:
    """A Model with another discrepancy; nothing else is computed anew, as `Model.replace` would."""
    return eqx.tree_at(
        lambda m: m.discrepancy, model, discrepancy, is_leaf=lambda x: x is None or isinstance(x, Discrepancy)
    )


def without_discrepancy(model: Any) -> Any:
    """A Model with its equations of motion alone."""
    return replace_discrepancy(model, None)


def kernels(discrepancy: Discrepancy, nu_r: Vector6, tau: Vector6) -> tuple[Float[Array, "P m"], Float[Array, " P"]]:
    """k(z, centre) of every kernel function, and k(z, z) of every part.

    Args:
        discrepancy: Uses places, lengths and `anchored`.
        nu_r: Velocity through the water, b at CO [m/s, rad/s].
        tau: Wrench of the thrusters, b at CO [N, N m].
    """
    d = discrepancy
    z = jnp.concatenate([nu_r, tau]) * d.inverse_lengths
    c = d.centres * d.inverse_lengths[:, None, :]
    far = jnp.sum((z[:, None, :] - c) ** 2, axis=2)
    # What the process at z and at a centre have in common with its value where it is known to be zero.
    free = jnp.sum((1.0 - d.anchored[:, None, :]) * (z[:, None, :] - c) ** 2, axis=2)
    out = jnp.sum(d.anchored * z**2, axis=1)
    common = free + out[:, None] + jnp.sum(d.anchored[:, None, :] * c**2, axis=2)
    return jnp.exp(-0.5 * far) - jnp.exp(-0.5 * common), 1.0 - jnp.exp(-out)


def discrepancy_wrench(discrepancy: Discrepancy, nu_r: Vector6, tau: Vector6, drag: Vector6) -> Vector6:
    """Mean of the learned wrench on the vehicle, b at CO [N, N m].

    Args:
        discrepancy: The parts.
        nu_r: Velocity through the water, b at CO [m/s, rad/s].
        tau: Wrench of the thrusters, b at CO [N, N m].
        drag: D(nu_r) nu_r of the model, b at CO [N, N m]: what may be undone at most.
    """
    k, _ = kernels(discrepancy, nu_r, tau)
    values = jnp.sum(discrepancy.coefficients * k, axis=1)
    of_motion = jnp.sum(discrepancy.along * (discrepancy.motion * values), axis=1)
    of_thrust = jnp.sum(discrepancy.along * ((1.0 - discrepancy.motion) * values), axis=1)
    return of_thrust + _passive(discrepancy, of_motion, nu_r, drag)


def _passive(discrepancy: Discrepancy, wrench: Vector6, nu_r: Vector6, drag: Vector6) -> Vector6:
    """The wrench without what it would give in energy beyond what the drag takes."""
    excess = jnp.sum(nu_r * wrench) - jnp.maximum(jnp.sum(nu_r * drag), 0.0)
    moved = jnp.where(jnp.sum(discrepancy.along * discrepancy.motion, axis=1) > 0.0, discrepancy.speeds**-2.0, 0.0)
    square = jnp.sum(moved * nu_r**2)
    share = jnp.where(excess > 0.0, excess / jnp.where(square > 0.0, square, 1.0), 0.0)
    return wrench - share * moved * nu_r


def discrepancy_variance(discrepancy: Discrepancy, nu_r: Vector6, tau: Vector6) -> Vector6:
    """Variance of the learned wrench, per component [N^2, N^2 m^2]; arguments as of `kernels`.

    Far from the data it is the prior's. Of several parts along one axis the variances add up.
    """
    return jnp.sum(discrepancy.along * (discrepancy.std**2 * _left(discrepancy, nu_r, tau)), axis=1)


def novelty(discrepancy: Discrepancy, nu_r: Vector6, tau: Vector6) -> Scalar:
    """How far a motion is from the data, 0 to 1: the largest of the parts' standard deviations over their prior's."""
    return jnp.sqrt(jnp.max(_left(discrepancy, nu_r, tau)))


def _left(discrepancy: Discrepancy, nu_r: Vector6, tau: Vector6) -> Float[Array, " P"]:
    """What is left of the prior's variance of each part, a share."""
    k, whole = kernels(discrepancy, nu_r, tau)
    taken = jnp.sum(discrepancy.reduction * k[:, None, :], axis=2)
    return jnp.clip(whole - jnp.sum(taken**2, axis=1), 0.0, 1.0)
