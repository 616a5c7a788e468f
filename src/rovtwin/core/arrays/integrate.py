"""Fixed-step integration."""

from collections.abc import Callable
from typing import TypeVar

from rovtwin.core.numerics import jax

Tree = TypeVar("Tree")


def rk4_step(derivative: Callable[[float, Tree], Tree], x: Tree, dt: float) -> Tree:
    """One classical Runge-Kutta step of `x_dot = derivative(s, x)`, s from 0 to dt.

    Args:
        derivative: Takes the time since the start of the step [s] and the state; returns a tree like the state.
        x: State, any pytree of arrays.
        dt: Step [s].

    Returns:
        The state dt later.
    """

    def along(tree: Tree, rate: Tree, h: float) -> Tree:
        return jax.tree.map(lambda a, b: a + h * b, tree, rate)

    k1 = derivative(0.0, x)
    k2 = derivative(0.5 * dt, along(x, k1, 0.5 * dt))
    k3 = derivative(0.5 * dt, along(x, k2, 0.5 * dt))
    k4 = derivative(dt, along(x, k3, dt))
    return jax.tree.map(lambda a, b, c, d, e: a + dt / 6.0 * (b + 2.0 * (c + d) + e), x, k1, k2, k3, k4)
