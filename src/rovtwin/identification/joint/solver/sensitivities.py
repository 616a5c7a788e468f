"""Derivatives of a simulated path by its start and by the parameters.

The error of a state obeys a linear equation along the path, s_dot = A(t) s + B(t), whose matrices are derivatives of
the equations of motion. One evaluation at each grid point serves all directions; differentiating the integration
carries every direction through every stage of every step.

Between grid points A and B are taken as linear, but for what the thrusters do: that is exact, so that directions of
equal motion (the scale of all forces) cancel as they do in the path itself. Derivatives agree with those of the
integration to some 1e-4 of their size (5 s in steps of 0.02 s). Residuals do not change, so that least squares ends in
the same place.

Reference: Bock (1983), Recent advances in parameter identification techniques for ODE.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from jaxtyping import Float

from rovtwin.core.frames import cross, rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Matrix6, Vector6
from rovtwin.identification.joint.model.nodes import FADES, NODE, Nodes, moved

Rate = Callable[[Any, Nodes, Float[Array, " _"]], Vector6]
"""nu_dot of parameters of the model, a state and a wrench: linear in the wrench, alike in all states."""


def sensitivities(
    rate: Rate,
    parts: Any,
    d_parts: Any,
    path: Nodes,
    tau: Float[Array, "K 3 w"],
    d_tau: Float[Array, "K 3 w n"],
    step: float,
    nonlinear: Rate | None = None,
    loads: int = 0,
) -> tuple[Float[Array, "points 18 m"], Float[Array, "points 6 m"]]:
    """Derivatives of the states of a path, and of nu_dot there.

    Columns are the error of the start, then n parameters.

    Args:
        rate: The equations of motion.
        parts: What of them depends on parameters, a tree.
        d_parts: Its derivatives, leading axis n.
        path: States at K + 1 grid points.
        tau: Wrench at the start, middle and end of every step, and what else `nonlinear` takes.
        d_tau: Its derivatives.
        step: Between grid points [s].
        nonlinear: What comes to nu_dot beside the equations of motion, in any way of the wrench: taken as linear
            between grid points like the rest.
        loads: How many of the last columns are no parameters but loads, which are no thrust to `nonlinear`.
    """
    n = d_tau.shape[-1]
    start = jax.tree.map(lambda x: x[0], path)

    def by_wrench(parts: Any) -> Matrix6:
        return jax.jacfwd(lambda wrench: rate(parts, start, wrench))(jnp.zeros(6))

    W = by_wrench(parts)
    d_W = jax.vmap(lambda d: jax.jvp(by_wrench, (parts,), (d,))[1], out_axes=-1)(d_parts)
    pushed = W @ d_tau[:, :, :6] + jnp.einsum("ijn,kcj->kcin", d_W, tau[:, :, :6])
    A, B = jax.vmap(partial(_linearised, rate, parts, d_parts))(path)
    if nonlinear is not None:
        at, d_at = (jnp.concatenate([x[:, 0], x[-1:, 2]]) for x in (tau, d_tau))
        d_at = d_at.at[..., n - loads :].set(0.0)
        more = jax.vmap(partial(_nonlinear, nonlinear, parts, d_parts))(path, at, d_at)
        A, B = A + more[0], B + more[1]
    instants = (B[:-1], 0.5 * (B[:-1] + B[1:]), B[1:])
    forcings = [b + pushed[:, i] for i, b in enumerate(instants)]
    transition, forcing = jax.vmap(partial(_one_step, h=step))(A[:-1], A[1:], forcings)
    forcing = jnp.pad(forcing, ((0, 0), (0, 0), (NODE, 0)))

    def advance(
        s: Float[Array, "18 m"], now: tuple[Float[Array, "18 18"], Float[Array, "18 m"]]
    ) -> tuple[Float[Array, "18 m"], Float[Array, "18 m"]]:
        after = now[0] @ s + now[1]
        return after, after

    first = jnp.concatenate([jnp.eye(NODE), jnp.zeros((NODE, n))], axis=1)
    _, rest = jax.lax.scan(advance, first, (transition, forcing))
    S = jnp.concatenate([first[None], rest])
    by_parts = jnp.concatenate([forcings[0], forcings[2][-1:]])
    return S, (A[:, 6:12] @ S).at[:, :, NODE:].add(by_parts)


def _linearised(rate: Rate, parts: Any, d_parts: Any, x: Nodes) -> tuple[Float[Array, "18 18"], Float[Array, "6 n"]]:
    """Rate of an error by that error, and nu_dot by the parameters, at a state without thrust."""

    def of_error(error: Float[Array, "18"]) -> Float[Array, "18"]:
        y = moved(x, error)
        turning = cross(error[3:6], x.nu[3:]) + y.nu[3:] - x.nu[3:]
        velocity = rotation_from_quaternion(y.attitude) @ y.nu[:3]
        return jnp.concatenate([velocity, turning, rate(parts, y, jnp.zeros(6)), -error[12:] / FADES])

    def of_parts(d: Any) -> Vector6:
        return jax.jvp(lambda p: rate(p, x, jnp.zeros(6)), (parts,), (d,))[1]

    return jax.jacfwd(of_error)(jnp.zeros(NODE)), jax.vmap(of_parts, out_axes=-1)(d_parts)


def _nonlinear(
    rate: Rate, parts: Any, d_parts: Any, x: Nodes, wrench: Float[Array, " w"], d_wrench: Float[Array, "w n"]
) -> tuple[Float[Array, "18 18"], Float[Array, "6 n"]]:
    """What these wrenches add to the matrices of `_linearised` at a state and thrust."""
    by_error = jax.jacfwd(lambda error: rate(parts, moved(x, error), wrench))(jnp.zeros(NODE))
    by_wrench = jax.jacfwd(lambda w: rate(parts, x, w))(wrench)
    by_parts = jax.vmap(lambda d: jax.jvp(lambda p: rate(p, x, wrench), (parts,), (d,))[1], out_axes=-1)(d_parts)
    return jnp.concatenate([jnp.zeros((6, NODE)), by_error, jnp.zeros((6, NODE))]), by_parts + by_wrench @ d_wrench


def _one_step(
    A0: Float[Array, "18 18"], A1: Float[Array, "18 18"], b: Sequence[Float[Array, "6 n"]], h: float
) -> tuple[Float[Array, "18 18"], Float[Array, "18 n"]]:
    """Runge-Kutta's step of s_dot = A s + [0, b]: transition and what the forcing adds.

    A at the start and the end of the step, b at its start, middle and end.
    """
    middle, one = 0.5 * (A0 + A1), jnp.eye(NODE)
    k2 = middle @ (one + 0.5 * h * A0)
    k3 = middle @ (one + 0.5 * h * k2)
    k4 = A1 @ (one + h * k3)
    transition = one + h / 6.0 * (A0 + 2.0 * (k2 + k3) + k4)
    # What a forcing has become at the end of the step; that of the middle acts in two stages.
    early = one + h * middle + 0.5 * h**2 * middle @ middle + 0.25 * h**3 * A1 @ middle @ middle
    late = 4.0 * one + h * (middle + A1) + 0.5 * h**2 * A1 @ middle
    return transition, h / 6.0 * (early[:, 6:12] @ b[0] + late[:, 6:12] @ b[1] + one[:, 6:12] @ b[2])
