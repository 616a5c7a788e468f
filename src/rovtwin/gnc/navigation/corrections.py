"""From innovations to a corrected state, and what is done about readings that are rejected."""

from rovtwin.core.flow import Measurements, Slot
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.gnc.navigation.readings import Innovation
from rovtwin.gnc.navigation.state import ATTITUDE, ERRORS, FORCE_N, POSITION, VELOCITY, NavigationState
from rovtwin.vehicle.model import Model

STRONGEST = 1.0  # acceleration that an unknown force may cause [m/s2]


def finite(slots: Measurements) -> Measurements:
    """The same without what is not a number: instruments say so when they have nothing to say."""
    return {
        name: Slot(
            jnp.where(jnp.isfinite(slot.value), slot.value, 0.0),
            slot.valid & jnp.all(jnp.isfinite(slot.value), axis=1) & jnp.isfinite(slot.t_valid),
            jnp.where(jnp.isfinite(slot.t_valid), slot.t_valid, 0.0),
        )
        for name, slot in slots.items()
    }


def opening(name: str, residual: Array, R_nb: Array, model: Model) -> Array:
    """Variance given back to what a sensor tells of when the filter must be wrong about it, shape (31,).

    A disagreement with the accelerometer that lasts is a force: a tether that is caught, a thruster that is gone. One
    that no thruster or tether could make is a broken sensor, and stays rejected.
    """
    square, none = residual**2, jnp.zeros(ERRORS)
    if name == "accelerometer":
        force = R_nb @ (model.mass[:3, :3] @ residual)
        return jnp.where(jnp.sum(square) < STRONGEST**2, none.at[FORCE_N].set(force**2), 0.0)
    if name == "attitude":
        return none.at[ATTITUDE].set(square)
    if name == "dvl":
        return none.at[VELOCITY].set(square)
    return none.at[POSITION.stop - 1].set(square[0])


def corrected(x: NavigationState, P: Array, found: Innovation) -> tuple[NavigationState, Array, tuple[Array, Array]]:
    """State and covariance after scalar measurements one by one; sum of squared normalised innovations, their number.

    Joseph form multiplied out: P stays symmetric and positive for any gain. Bar-Shalom, Li and Kirubarajan (2001).
    """

    def one(carry: tuple[Array, Array], scalar: Innovation) -> tuple[tuple[Array, Array], Array]:
        error, P = carry
        column = jnp.sum(P * scalar.slope, axis=1)
        innovation = scalar.residual - scalar.slope @ error
        S = scalar.slope @ column + scalar.variance
        K = jnp.where(scalar.used, column / S, 0.0)
        error = error + K * innovation
        P = P - (K[:, None] * column + column[:, None] * K) + S * (K[:, None] * K)
        return (error, P), jnp.where(scalar.used, innovation * innovation / S, 0.0)

    (error, P), squares = jax.lax.scan(one, (jnp.zeros(ERRORS), P), found)
    return x.corrected(error), P, (squares.sum(), found.used.sum().astype(P.dtype))
