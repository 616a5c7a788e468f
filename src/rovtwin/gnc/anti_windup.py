"""Anti-windup by conditional integration: an axis does not integrate further in the direction in which it is cut short.

Reference: Astrom and Hagglund (2006), Advanced PID Control, sec. 3.5.
"""

from rovtwin.core.numerics import Array, jnp

ROUNDING = 1e-6  # of an allocation [N, N m]: a shortfall that is smaller is none


def integrated(integral: Array, growth: Array, cut: Array, shortfall: Array) -> Array:
    """The integral a tick later, shape (n,).

    Args:
        integral: Before, shape (n,).
        growth: What the tick adds to it, shape (n,).
        cut: What the axis's own limit takes of its output now, shape (n,).
        shortfall: What the allocation took of it a tick ago, shape (n,).
    """
    lost = jnp.where(jnp.abs(shortfall) > ROUNDING, shortfall, 0.0)
    winding = (growth * cut > 0.0) | (growth * lost > 0.0)
    return jnp.where(winding, integral, integral + growth)
