"""Error-state filter that places the vehicle among printed markers and the markers around it.

State: position, velocity and acceleration in n; offset and noise of the attitude (see `sight`); pose of each marker.
The attitude comes from the vehicle's sensors: its noise is common to all corners of a frame and new in the next, so
it is a state that each frame starts afresh. Corners are compared as the lens shows them, a marker at a time, each step
repeated from where it led (iterated filter), because a marker that comes back into view may be far from where it was
expected. A marker of unknown place becomes part of the state where it is first seen, with the covariance that its
corners give.

Without a marker of known place the frame is fixed by the start pose.

Reference: Bell and Cathey (1993), The iterated Kalman filter update as a Gauss-Newton method, IEEE Trans. Automatic
Control 38(2); Dissanayake et al. (2001), A solution to the simultaneous localization and map building problem, IEEE
Trans. Robotics and Automation 17(3).
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.block import Block, Start
from rovtwin.core.frames import quaternion_from_rotation, rotation_from_quaternion
from rovtwin.core.markers import Layout
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Flag, Index, Matrix6, PRNGKey, Quaternion, Scalar, ScalarLike, Vector3, Vector6
from rovtwin.positioning.estimators.ekf_steps import (
    EMPTY,
    NOBODY,
    OFFSET,
    POSITION,
    REJECTED,
    USED,
    VEHICLE,
    VELOCITY,
    WAITING,
    Given,
    MarkerMap,
    State,
    Vote,
    add_marker,
    deviation,
    forget,
    predict,
    take_position,
    update,
    vote,
)
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.images.camera_model import Eyes, sizes_of
from rovtwin.positioning.images.observations import SightInput
from rovtwin.vehicle.description.cameras import Camera


class SlamMemory(eqx.Module):
    """Memory of the filter: its state, and for how many frames in a row nothing of the map was where it should be."""

    state: State
    lost: Index


class SlamOutput(eqx.Module):
    """The filter's estimate after a frame.

    Attributes:
        position: CO in n [m].
        velocity: Its velocity in n [m/s].
        covariance: Of both.
        attitude: Quaternion R_nb with the estimated error taken out.
        offset: Of the measured attitude [rad], axes of n.
        offset_std: Its standard deviation [rad].
        ids: Of the map; -1 is a free place.
        marker_position: In n [m].
        marker_attitude: Quaternions R_nm.
        marker_variance: Of its shift [m2] and turn [rad2].
        status: What became of each slot, an index of `ekf_steps.STATUS`.
        nis: Squared normalised innovation of each slot that was used, 8 degrees of freedom.
        moved: Markers taken out of the map in this frame because they contradicted the others.
        afresh: Whether the position was taken afresh, as at the start or after losing it.
    """

    position: Vector3
    velocity: Vector3
    covariance: Matrix6
    attitude: Quaternion
    offset: Vector3
    offset_std: Vector3
    ids: Int[Array, " capacity"]
    marker_position: Float[Array, "capacity 3"]
    marker_attitude: Float[Array, "capacity 4"]
    marker_variance: Float[Array, "capacity 6"]
    status: Int[Array, " slots"]
    nis: Float[Array, " slots"]
    moved: Bool[Array, " capacity"]
    afresh: Flag


class MarkerEkf(Block):
    """The filter; a Block that takes a `SightInput` each frame.

    Attributes:
        eyes: The cameras.
        tuning: See `SlamTuning`.
        sizes: Side of each marker by its id [m].
        layout: Markers of known place, the rest of the capacity free.
        layout_variance: Of the six errors of a known marker.
    """

    eyes: Eyes
    tuning: SlamTuning
    sizes: Float[Array, " ids"]
    layout: MarkerMap
    layout_variance: Vector6

    @classmethod
    def of(
        cls,
        cameras: Sequence[Camera],
        tuning: SlamTuning | None = None,
        layout: Layout | None = None,
        capacity: int = 8,
        layout_std: tuple[float, float] = (0.0, 0.0),
        sizes: Float[Array, " ids"] | None = None,
    ) -> "MarkerEkf":
        """For these cameras.

        Args:
            cameras: Of the vehicle, in the order of the sightings' camera numbers.
            tuning: Default: as `SlamTuning.of`, the position unknown at the start if there is a layout.
            layout: Markers of known place; others may be seen too.
            capacity: Largest number of markers in the map; at least that of the layout.
            layout_std: How well a known marker's place [m] and attitude [rad] are known.
            sizes: Side of each marker by its id [m], as the poses of the sightings were made with; None: the layout's,
                else that of the thesis.
        """
        markers = layout.markers if layout else []
        capacity = max(capacity, len(markers))
        ids, position, R = np.full(capacity, NOBODY), np.zeros((capacity, 3)), np.tile(np.eye(3), (capacity, 1, 1))
        for k, marker in enumerate(markers):
            ids[k], position[k], R[k] = marker.id, marker.position, marker.R_nm
        known = MarkerMap(
            as_array(ids, dtype=int), as_array(position), as_array(R), as_array(np.zeros(capacity), dtype=int)
        )
        if sizes is None:
            sizes = sizes_of({marker.id: marker.size for marker in markers})
        variance = as_array(np.repeat(np.square(layout_std), 3))
        chosen = tuning or SlamTuning.of(start_position=10.0 if markers else 0.0)
        return cls(Eyes.of(cameras), chosen, sizes, known, variance)

    def init(self, key: PRNGKey, start: Start) -> SlamMemory:
        """At the start pose, as sure of it as the tuning says; `key` is not used."""
        tuning, capacity = self.tuning, self.layout.ids.shape[0]
        vehicle = jnp.concatenate(
            [
                jnp.full(3, tuning.start_position**2),
                jnp.full(3, tuning.start_velocity**2),
                tuning.acceleration**2,
                tuning.offset**2,
                tuning.attitude**2,
            ]
        )
        known = jnp.where(self.layout.ids == NOBODY, 0.0, 1.0)
        markers = (known[:, None] * self.layout_variance).reshape(-1)
        velocity = rotation_from_quaternion(start.attitude) @ start.velocity[:3]
        x = jnp.concatenate([start.position, velocity, jnp.zeros(VEHICLE - 6)])
        state = State(x, jnp.diag(jnp.concatenate([vehicle, markers])), self.layout)
        return SlamMemory(state, jnp.zeros((), dtype=int) * capacity)

    def step(self, memory: SlamMemory, input: SightInput, dt: ScalarLike) -> tuple[SlamMemory, SlamOutput]:
        """Predict over dt to the frame's time, then take in what it shows."""
        tuning, slots = self.tuning, input.sightings
        given = Given(tuning, self.eyes, self.sizes, rotation_from_quaternion(input.attitude))
        state = predict(tuning, memory.state, jnp.asarray(dt, dtype=float))
        unsure = (memory.lost >= tuning.patience) | self._wide(state)
        chosen = vote(given, state, slots)
        afresh = unsure & chosen.there
        state = jax.lax.cond(afresh, lambda s: take_position(given, s, chosen), lambda s: s, state)
        state, (status, nis) = self._corrected(given, state, slots, chosen, unsure)
        fits, against = self._word(state, slots, status)
        state, moved = self._contradictions(state, fits, against)
        state, status = self._new_markers(given, state, slots, status, ~self._wide(state))
        used = (status == USED).any()
        # Few that fit against many that do not: the vehicle may sit where a copy or a moved marker put it.
        borne_out = used & (fits.sum() >= against.sum())
        lost = jnp.where(borne_out, 0, memory.lost + (status == REJECTED).any())
        # Taken afresh from a marker that does not fit either: wait for as many frames again.
        lost = jnp.where(afresh, 0, lost).astype(memory.lost.dtype)
        return SlamMemory(state, lost), self._output(given, state, status, nis, moved, afresh)

    def _wide(self, state: State) -> Flag:
        return (jnp.diagonal(state.P)[POSITION] > self.tuning.wide**2).any()

    def _corrected(
        self, given: Given, state: State, slots, chosen: Vote, unsure: Flag
    ) -> tuple[State, tuple[Int[Array, " slots"], Float[Array, " slots"]]]:
        """Takes in the slots: first those that bear each other out, then the rest by what is known after that.

        Of several prints of one id in one image the one that fits is used, if it is the only one; none as long as the
        vehicle's place is not known.
        """
        known = slots.valid & jax.vmap(lambda number: state.map.find(number)[1])(slots.ids)
        first = known & slots.single & chosen.agree
        state, (status, nis) = self._in_turn(given, state, slots, first)
        waiting = known & ~slots.single & unsure
        rest = known & ~first & ~waiting

        def others(state: State) -> tuple[State, tuple[Int[Array, " slots"], Float[Array, " slots"]]]:
            statuses, _ = jax.vmap(lambda slot: update(given, state, slot)[1])(slots)
            fits = rest & (statuses == USED)
            same = (slots.ids[:, None] == slots.ids) & (slots.camera[:, None] == slots.camera)
            rivals = (same & fits).sum(axis=1) > 1
            state, (now, nis_now) = self._in_turn(given, state, slots, rest & ~(fits & rivals))
            return state, (jnp.where(fits & rivals, WAITING, now), nis_now)

        none = jnp.full(status.shape, EMPTY), jnp.zeros(nis.shape)
        state, (late, late_nis) = jax.lax.cond(rest.any(), others, lambda s: (s, none), state)
        status = jnp.where(waiting, WAITING, jnp.where(rest, late, status))
        return state, (status, jnp.where(rest, late_nis, nis))

    def _in_turn(
        self, given: Given, state: State, slots, chosen: Bool[Array, " slots"]
    ) -> tuple[State, tuple[Int[Array, " slots"], Float[Array, " slots"]]]:
        nothing = jnp.asarray(EMPTY), jnp.zeros(())

        def one(state: State, item) -> tuple[State, tuple[Index, Scalar]]:
            slot, take = item
            return jax.lax.cond(take, lambda s: update(given, s, slot), lambda s: (s, nothing), state)

        return jax.lax.scan(one, state, (slots, chosen))

    def _word(
        self, state: State, slots, status: Int[Array, " slots"]
    ) -> tuple[Bool[Array, " capacity"], Bool[Array, " capacity"]]:
        """Which markers of the map fit, and which contradict; one of several prints says nothing."""
        same = state.map.ids[:, None] == jnp.where(slots.valid, slots.ids, NOBODY - 1)
        fits = (same & (status == USED)).any(axis=1)
        return fits, (same & slots.single & (status == REJECTED)).any(axis=1) & ~fits

    def _contradictions(
        self, state: State, fits: Bool[Array, " capacity"], against: Bool[Array, " capacity"]
    ) -> tuple[State, Bool[Array, " capacity"]]:
        """Counts who contradicts a majority, and takes out who does so for too long.

        Somebody measured the places of the layout: one marker alone does not contradict them.
        """
        measured = (self.layout.ids != NOBODY) & (self.layout.ids == state.map.ids)
        credible = (fits.sum() > against.sum()) & (~measured | (fits.sum() > 1))
        counts = jnp.where(fits, 0, state.map.contradicted + (against & credible))
        gone = counts >= self.tuning.patience
        counted = MarkerMap(state.map.ids, state.map.position, state.map.R_nm, counts)
        return forget(State(state.x, state.P, counted), gone), gone

    def _new_markers(
        self, given: Given, state: State, slots, status: Int[Array, " slots"], sure: Flag
    ) -> tuple[State, Int[Array, " slots"]]:
        def one(state: State, item) -> tuple[State, Index]:
            slot, status = item
            _, known = state.map.find(slot.ids)
            unknown = slot.valid & ~known & (status == EMPTY)
            chosen = unknown & slot.single & slot.clear & sure
            kept = jnp.where(unknown, WAITING, status)
            return jax.lax.cond(
                chosen, lambda s: add_marker(given, s, slot, chosen), lambda s: (s, kept.astype(int)), state
            )

        return jax.lax.scan(one, state, (slots, status))

    def _output(
        self,
        given: Given,
        state: State,
        status: Int[Array, " slots"],
        nis: Float[Array, " slots"],
        moved: Bool[Array, " capacity"],
        afresh: Flag,
    ) -> SlamOutput:
        both = slice(POSITION.start, VELOCITY.stop)
        return SlamOutput(
            position=state.x[POSITION],
            velocity=state.x[VELOCITY],
            covariance=state.P[both, both],
            attitude=quaternion_from_rotation(given.attitude(state.x)),
            offset=state.x[OFFSET],
            offset_std=deviation(jnp.diagonal(state.P)[OFFSET]),
            ids=state.map.ids,
            marker_position=state.map.position,
            marker_attitude=jax.vmap(quaternion_from_rotation)(state.map.R_nm),
            marker_variance=jnp.diagonal(state.P)[VEHICLE:].reshape(-1, 6),
            status=status,
            nis=nis,
            moved=moved,
            afresh=afresh,
        )
