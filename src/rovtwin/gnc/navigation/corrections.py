"""From innovations to a corrected state, and what is done about readings that are rejected."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import Measurements, Slot
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Scalar
from rovtwin.gnc.navigation.measurements import Innovation
from rovtwin.gnc.navigation.state import (
    ATTITUDE,
    ERRORS,
    FORCE_N,
    POSITION,
    VELOCITY,
    WAVE_PLACE,
    WAVE_VELOCITY,
    NavigationState,
)
from rovtwin.gnc.navigation.wave_estimator import SeaState
from rovtwin.vehicle.physics.model import Model

STRONGEST = 1.0  # acceleration that an unknown force may cause [m/s2]
NEWEST = 0.1  # share of the newest reading in the mean of innovations of depth
BIASED = 25.0  # largest square of that mean, by its variance if they are white: five standard deviations
# Among the errors, as vectors, for a tick with a scatter by indices is not compiled in one piece (`in_one_piece`).
DOWN, WAVE_DOWN, FORCE_DOWN = np.eye(ERRORS)[[POSITION.stop - 1, WAVE_PLACE.stop - 1, FORCE_N.stop - 1]]
SWAPPED = DOWN - WAVE_DOWN  # depth that was taken for waves, or waves for depth: their sum is the same


class InnovationTest(NamedTuple):
    """How innovations of one sensor lie to what was expected of them.

    Attributes:
        squares: Sum of the squared normalised ones.
        number: How many were used.
        normal: Each by its own standard deviation, no number where it was not used.
    """

    squares: Scalar
    number: Scalar
    normal: Float[Array, " n"]

    @classmethod
    def none(cls) -> "InnovationTest":
        """Of a sensor that did not speak."""
        return cls(jnp.zeros(()), jnp.zeros(()), jnp.zeros(0))


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


def covariance_inflation(
    kind: str, residual: Float[Array, " n"], x: NavigationState, model: Model
) -> Float[Array, "31 31"]:
    """Covariance given back to what a sensor tells of when the filter must be wrong about it.

    A disagreement with the accelerometer that lasts is a force: a tether that is caught, a thruster that is gone. One
    that no thruster or tether could make is a broken sensor, and stays rejected.
    """
    square, none = residual**2, jnp.zeros(ERRORS)
    if kind == "accelerometer":
        force = rotation_from_quaternion(x.attitude) @ (model.inertia[:3, :3] @ residual)
        return jnp.diag(jnp.where(jnp.sum(square) < STRONGEST**2, none.at[FORCE_N].set(force**2), 0.0))
    if kind == "attitude":
        return jnp.diag(none.at[ATTITUDE].set(square))
    if kind == "dvl":
        return jnp.diag(none.at[VELOCITY].set(square))
    mistaken = taken_for_wave(x, residual[0])
    return (square[0] - mistaken**2) * np.outer(DOWN, DOWN) + mistaken**2 * np.outer(SWAPPED, SWAPPED)


def taken_for_wave(x: NavigationState, residual: Scalar) -> Scalar:
    """How much of the waves' displacement may be slow motion instead [m].

    What it has in common with the residual of the slow depth that a pressure sensor tells, which is blind to waves:
    none where they point in opposite ways.
    """
    wave = x.wave_place[2]
    return jnp.where(wave * residual > 0.0, jnp.minimum(jnp.abs(wave), jnp.abs(residual)), 0.0)


def inflated_for_waves(
    found: Innovation,
    P: Float[Array, "31 31"],
    depth_bias: Scalar,
    x: NavigationState,
    sea: SeaState,
    model: Model,
    gate: Scalar,
) -> tuple[Float[Array, "31 31"], Scalar]:
    """P, opened where the depths measured lie to one side for long, and how far they lie there.

    A force that comes at once (a thruster that is gone) is first taken for a wave, for it walks slowly and waves do
    not. The pressure, which is blind to waves, tells them apart, but by a little in each reading. So a mean of
    innovations is kept, which should be zero; once it is not, what was taken for waves may be motion and force.
    The sum of both stays as well known as it was: nothing doubts the depth itself.

    Args:
        found: Innovation of the pressure.
        P: Covariance.
        depth_bias: Mean of the normalised innovations, over the last ones.
        x: State.
        sea: What is assumed of the waves.
        model: Of the vehicle.
        gate: Squared normalised innovation accepted.
    """
    slope, residual = found.slope[0], found.residual[0]
    normal = residual / jnp.sqrt(slope @ jnp.sum(P * slope, axis=1) + found.variance[0])
    # What counts as an outlier says nothing.
    usable = found.used[0] & (normal**2 < gate)
    depth_bias = depth_bias + jnp.where(usable, NEWEST * (normal - depth_bias), 0.0)
    # White innovations of variance 1 leave NEWEST / (2 - NEWEST) behind the mean.
    wrong = usable & (depth_bias**2 * (2.0 - NEWEST) / NEWEST > BIASED)
    down_b, none = rotation_from_quaternion(x.attitude)[2], jnp.zeros(ERRORS)
    swapped = jnp.concatenate([none[: VELOCITY.start], down_b, none[VELOCITY.stop :]])
    swapped = jnp.concatenate([swapped[: WAVE_VELOCITY.stop - 1], -jnp.ones(1), swapped[WAVE_VELOCITY.stop :]])
    force = model.inertia[2, 2] ** 2 * ((down_b * down_b) @ jnp.maximum(sea.acceleration_variance, 0.0))
    opened = force * np.outer(FORCE_DOWN, FORCE_DOWN) + x.wave_velocity[2] ** 2 * jnp.outer(swapped, swapped)
    opened = opened + taken_for_wave(x, residual) ** 2 * np.outer(SWAPPED, SWAPPED)
    return P + jnp.where(wrong, 1.0, 0.0) * opened, jnp.where(wrong, 0.0, depth_bias)


def corrected(
    x: NavigationState, P: Float[Array, "31 31"], found: Innovation
) -> tuple[NavigationState, Float[Array, "31 31"], InnovationTest]:
    """State and covariance after scalar measurements one by one, and how those lay to what was expected.

    Joseph form multiplied out: P stays symmetric and positive for any gain. Bar-Shalom, Li and Kirubarajan (2001).
    """

    def one(
        carry: tuple[Float[Array, "31"], Float[Array, "31 31"]], scalar: Innovation
    ) -> tuple[tuple[Float[Array, "31"], Float[Array, "31 31"]], tuple[Scalar, Scalar]]:
        error, P = carry
        column = jnp.sum(P * scalar.slope, axis=1)
        innovation = scalar.residual - scalar.slope @ error
        S = scalar.slope @ column + scalar.variance
        K = jnp.where(scalar.used, column / S, 0.0)
        error = error + K * innovation
        P = P - (K[:, None] * column + column[:, None] * K) + S * (K[:, None] * K)
        square = jnp.where(scalar.used, innovation * innovation / S, 0.0)
        return (error, P), (square, jnp.where(scalar.used, innovation / jnp.sqrt(S), jnp.nan))

    (error, P), (squares, normal) = jax.lax.scan(one, (jnp.zeros(ERRORS), P), found)
    return x.corrected(error), P, InnovationTest(squares.sum(), found.used.sum().astype(P.dtype), normal)
