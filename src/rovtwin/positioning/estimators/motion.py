"""How a vehicle nobody has identified yet moves: its acceleration in n is a first-order Gauss-Markov process.

Reference: Singer (1970), Estimating optimal tracking filter performance for manned maneuvering targets, IEEE Trans.
Aerospace and Electronic Systems 6(4).
"""

import numpy as np

from rovtwin.core.numerics import jnp
from rovtwin.core.types import Matrix3, Scalar

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def transition(dt: Scalar, correlation: Scalar) -> Matrix3:
    """Of position, velocity and acceleration of one axis over dt [s]."""
    s = dt / correlation
    fall, lost = jnp.exp(-s), -jnp.expm1(-s)
    one, zero = jnp.ones_like(s), jnp.zeros_like(s)
    # s - (1 - e^-s) loses all digits for small s.
    second = jnp.where(s < 1e-2, s**2 * (0.5 - s / 6.0 + s**2 / 24.0), s - lost)
    rows = [[one, dt, correlation**2 * second], [zero, one, correlation * lost], [zero, zero, fall]]
    return jnp.stack([jnp.stack(row) for row in rows])


def process_noise(dt: Scalar, correlation: Scalar) -> Matrix3:
    """Covariance that one axis gains over dt, for an acceleration of variance 1."""
    total = jnp.zeros((3, 3))
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        column = transition(0.5 * dt * (1.0 + node), correlation)[:, 2]
        total = total + 0.5 * dt * weight * (2.0 / correlation) * column[:, None] * column
    return total
