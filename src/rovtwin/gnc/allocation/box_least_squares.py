"""Least squares within bounds: the small quadratic programme of allocation, fast enough for every tick.

    minimise  |A x - b|^2 / 2 + damping |x - preferred|^2 / 2    over  lower <= x <= upper

With the residual r = b - A x, each x_i has its best value in closed form, x(r) = clip(preferred + A^T r / damping).
What is left are as many equations as A has rows, r + A x(r) = b: the gradient of a strictly convex function of r,
quadratic between kinks. Newton's method with an exact line search ends on the right piece after finitely many steps,
two or three as a rule, and there it is exact: which x are at a bound is decided, not approached.

Reference: Madsen, Nielsen and Pinar (1999), Bound constrained quadratic programming via piecewise quadratic functions,
    Math. Program. 85; Qi and Sun (1993), A nonsmooth version of Newton's method, Math. Program. 58.
"""

from jaxtyping import Bool, Float

from rovtwin.core.arrays.small_matrices import solution, summed_product
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Flag, Index, Scalar

# A bound for the real-time loop (benchmarks/allocation.py counts them); what it leaves is within bounds all the same.
MOST_STEPS = 30


def box_least_squares(
    A: Float[Array, "m n"],
    b: Float[Array, " m"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    preferred: Float[Array, " n"],
    damping: float,
) -> Float[Array, " n"]:
    """The x of the minimum; see the module.

    The bounds that hold are found without gradient, x from them with it: derivatives are those of the minimum (the
    implicit function theorem), one-sided where a bound is about to hold.

    Args:
        A: Matrix, of any rank. Entries should be of the order of one, rows of importance larger.
        b: Right-hand side.
        lower: Of x.
        upper: Nowhere below `lower`; an x whose bounds are equal is fixed.
        preferred: Where x goes where A leaves it free; need not be within the bounds.
        damping: Positive. x is exact to about 1e-16 (largest entry of A)^2 / damping.
    """
    fixed = jax.lax.stop_gradient((A, b, lower, upper, preferred))
    y, _ = unbounded(*fixed, damping)
    free = (y > lower) & (y < upper)
    held = jnp.where(free, preferred, jnp.where(y >= upper, upper, lower))
    r = solution(_slope(A, free, damping), b - A @ held)
    return jnp.where(free, jnp.clip(preferred + A.T @ r / damping, lower, upper), held)


def unbounded(
    A: Float[Array, "m n"],
    b: Float[Array, " m"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    preferred: Float[Array, " n"],
    damping: float,
) -> tuple[Float[Array, " n"], Index]:
    """preferred + A^T r / damping at the minimum, and how many steps it took.

    Where it lies beyond a bound, that bound holds.
    """

    def newton(
        state: tuple[Index, Float[Array, " m"], Float[Array, " n"], Flag],
    ) -> tuple[Index, Float[Array, " m"], Float[Array, " n"], Flag]:
        k, r, y, _ = state
        x, free = jnp.clip(y, lower, upper), (y > lower) & (y < upper)
        d = solution(_slope(A, free, damping), b - A @ x - r)
        dy = A.T @ d / damping
        t = _minimum_along(d, r - b, y, dy, lower, upper, damping)
        after = y + t * dy
        # Every y moves one way: where both ends lie on the same piece, so does all between, and the step was exact.
        same = (free == ((after > lower) & (after < upper))) & ((y >= upper) == (after >= upper))
        return k + 1, r + t * d, after, jnp.all(same)

    def unsettled(state: tuple[Index, Float[Array, " m"], Float[Array, " n"], Flag]) -> Flag:
        return (state[0] < MOST_STEPS) & ~state[3]

    start = jnp.zeros((), dtype=int), jnp.zeros_like(b), preferred, jnp.zeros((), dtype=bool)
    steps, _, y, _ = jax.lax.while_loop(unsettled, newton, start)
    return y, steps


def _slope(A: Float[Array, "m n"], free: Bool[Array, " n"], damping: float) -> Float[Array, "m m"]:
    """d(r + A x(r))/dr: the identity plus a positive semi-definite matrix, so that no pivot is below 1."""
    # In this loop a fifth quicker than `product`; a library's call would leave the loop (docs/performance.md).
    return jnp.eye(A.shape[0]) + summed_product(A * free, A.T) / damping


def _minimum_along(
    d: Float[Array, " m"],
    r_b: Float[Array, " m"],
    y: Float[Array, " n"],
    dy: Float[Array, " n"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    damping: float,
) -> Scalar:
    """Length t of the step along d to the least value: the zero of a rising function with known kinks.

    Args:
        d: Direction.
        r_b: r - b.
        y: preferred + A^T r / damping.
        dy: Its change along d.
        lower: Bounds of x.
        upper: The same.
        damping: See the module.
    """
    curvature, offset = d @ d, d @ r_b
    moving = dy != 0.0
    kinks = (jnp.concatenate([lower, upper]) - jnp.tile(y, 2)) / jnp.tile(jnp.where(moving, dy, 1.0), 2)
    t = jnp.where(jnp.tile(moving, 2) & (kinks > 0.0), kinks, 0.0)
    x = jnp.clip(y + t[:, None] * dy, lower, upper)
    slope = offset + t * curvature + jnp.sum(x * (damping * dy), axis=1)
    start = offset + jnp.sum(jnp.clip(y, lower, upper) * (damping * dy))
    before, beyond = slope <= 0.0, slope > 0.0
    t0, s0 = jnp.max(jnp.where(before, t, 0.0)), jnp.max(jnp.where(before, slope, start))
    t1, s1 = jnp.min(jnp.where(beyond, t, jnp.inf)), jnp.min(jnp.where(beyond, slope, jnp.inf))
    last = jnp.isinf(t1)  # beyond the last kink only the curvature is left
    width, rise = jnp.where(last, 1.0, t1 - t0), jnp.where(last, curvature, s1 - s0)
    return t0 - s0 * width / jnp.where(rise > 0.0, rise, 1.0)
