"""The thesis's observer (6.1-6.6): constant velocity, markers as points, three fixed gains. The baseline.

As printed it diverges as soon as it sees two markers: (6.5) adds L (Z_k - Z_measured), which with L_3 > 0 drives what
the landmarks disagree on away by a factor of 1 + L_3 in each step. It also rotates velocities that (6.1) names as those
of the world, adds measurements to the map unrotated (6.3), and compares with the position of the step before (6.4).
Corrected: velocities are the body's, measurements are turned into n, landmarks move towards what is measured.

Nothing tells the map as a whole from the vehicle: with L_3 > 0 both wander together. And L_2 = 0.001 takes some
hundred steps to learn a velocity; until then the position lags.

Reference: Thesis ch. 6, table 6.1.
"""

from collections.abc import Sequence

import equinox as eqx
from jaxtyping import Float, Int

from rovtwin.core.block import Block, Start
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Matrix3, PRNGKey, Scalar, ScalarLike, Vector3
from rovtwin.positioning.images.camera_model import Eyes
from rovtwin.positioning.images.observations import SightInput
from rovtwin.vehicle.description.cameras import Camera

NOBODY = -1


class Gains(eqx.Module):
    """Per step: position L_1, to be divided by the number of landmarks seen; velocity L_2 [1/s]; landmarks L_3."""

    position: Scalar
    velocity: Scalar
    landmark: Scalar

    @classmethod
    def thesis(cls) -> "Gains":
        """Table 6.1."""
        return cls(as_array(0.3), as_array(1e-3), as_array(0.1))

    @classmethod
    def tuned(cls) -> "Gains":
        """At 10 frames a second: velocity is learnt within a second, the map hardly follows the vehicle's errors."""
        return cls(as_array(0.2), as_array(0.3), as_array(0.005))


class LuenbergerMemory(eqx.Module):
    """Position in n, velocity in b, ids of the landmarks and their places in n."""

    position: Vector3
    velocity: Vector3
    ids: Int[Array, " capacity"]
    landmarks: Float[Array, "capacity 3"]


class LuenbergerOutput(eqx.Module):
    """Position and velocity in n; ids and landmarks of the map."""

    position: Vector3
    velocity: Vector3
    ids: Int[Array, " capacity"]
    landmarks: Float[Array, "capacity 3"]


class MarkerLuenberger(Block):
    """The observer; takes a `SightInput` each frame.

    Attributes:
        eyes: The cameras.
        gains: See `Gains`.
        capacity: Largest number of landmarks.
        as_printed: Whether to keep the thesis's mistakes (errata 33, 34).
    """

    eyes: Eyes
    gains: Gains
    capacity: int = eqx.field(static=True, default=8)
    as_printed: bool = eqx.field(static=True, default=False)

    @classmethod
    def of(cls, cameras: Sequence[Camera], gains: Gains | None = None, **options) -> "MarkerLuenberger":
        """For these cameras; with the thesis's gains if none are given."""
        return cls(Eyes.of(cameras), gains or Gains.thesis(), **options)

    def init(self, key: PRNGKey, start: Start) -> LuenbergerMemory:
        """At the start, with an empty map; `key` is not used."""
        ids = jnp.full(self.capacity, NOBODY)
        return LuenbergerMemory(start.position, start.velocity[:3], ids, jnp.zeros((self.capacity, 3)))

    def step(
        self, memory: LuenbergerMemory, input: SightInput, dt: ScalarLike
    ) -> tuple[LuenbergerMemory, LuenbergerOutput]:
        """Predict over dt to the frame's time, then correct by the landmarks it shows."""
        R_nb, seen = rotation_from_quaternion(input.attitude), input.sightings
        turn = _about_down(R_nb)
        before = memory.position
        position = before + dt * turn @ memory.velocity
        from_b = jax.vmap(lambda camera, t: self.eyes[camera].position + self.eyes[camera].R_bc @ t)
        measured = from_b(seen.camera, seen.t_cm)
        if not self.as_printed:
            measured = measured @ R_nb.T
        seat = before if self.as_printed else position
        same = (memory.ids[:, None] == seen.ids) & seen.valid & seen.single  # (capacity, slots)
        shown = same.any(axis=1)
        to = jnp.where(same[..., None], measured, 0.0).sum(axis=1) / jnp.maximum(same.sum(axis=1), 1)[:, None]
        # Z_measured - Z_k of each landmark that was known and is seen.
        e = jnp.where(shown[:, None], to - (memory.landmarks - seat), 0.0)
        total = e.sum(axis=0)
        n = jnp.maximum(shown.sum(), 1)
        position = position - self.gains.position / n * total
        velocity = memory.velocity - self.gains.velocity * (total if self.as_printed else turn.T @ total)
        landmarks = memory.landmarks + self.gains.landmark * (-e if self.as_printed else e)
        ids, landmarks = self._with_new(memory.ids, landmarks, seen, position + measured)
        after = LuenbergerMemory(position, velocity, ids, landmarks)
        return after, LuenbergerOutput(position, turn @ velocity, ids, landmarks)

    def _with_new(
        self, ids: Int[Array, " capacity"], landmarks: Float[Array, "capacity 3"], seen, places: Float[Array, "slots 3"]
    ) -> tuple[Int[Array, " capacity"], Float[Array, "capacity 3"]]:
        """(6.3): what is seen for the first time goes where it is seen."""

        def one(
            table: tuple[Int[Array, " capacity"], Float[Array, "capacity 3"]], item
        ) -> tuple[tuple[Int[Array, " capacity"], Float[Array, "capacity 3"]], None]:
            ids, landmarks = table
            valid, number, place = item
            free = ids == NOBODY
            new = valid & ~(ids == number).any() & free.any()
            here = (jnp.arange(self.capacity) == jnp.argmax(free)) & new
            return (jnp.where(here, number, ids), jnp.where(here[:, None], place, landmarks)), None

        (ids, landmarks), _ = jax.lax.scan(one, (ids, landmarks), (seen.valid & seen.single, seen.ids, places))
        return ids, landmarks


def _about_down(R_nb: Matrix3) -> Matrix3:
    """The part of an attitude that turns about the vertical."""
    length = jnp.hypot(R_nb[0, 0], R_nb[1, 0])
    c, s = R_nb[0, 0] / length, R_nb[1, 0] / length
    zero, one = jnp.zeros_like(c), jnp.ones_like(c)
    return jnp.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])
