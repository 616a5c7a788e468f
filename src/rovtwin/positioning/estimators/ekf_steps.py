"""The steps of the marker filter: its state, prediction, one marker's corners taken in, a new marker, a new start.

Errors of the state in order: position, velocity, acceleration, attitude offset o, attitude noise d (3 each), then for
each marker its shift e and turn f (6).
"""

import equinox as eqx
from jaxtyping import Bool, Float, Int

from rovtwin.core.arrays.small_matrices import eliminated, summed_product
from rovtwin.core.frames import rotation_from_vector, skew
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Flag, Index, Matrix3, Scalar, Vector3
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.estimators.motion import process_noise, transition
from rovtwin.positioning.images.camera_model import CORNERS, Eyes, see
from rovtwin.positioning.images.detection import pose_slope
from rovtwin.positioning.images.observations import Sightings

VEHICLE = 15  # states before those of the markers
POSITION, VELOCITY, ACCELERATION, OFFSET, NOISE = (slice(3 * k, 3 * k + 3) for k in range(5))
NOBODY = -1  # id of a free place in the map
STATUS = ("empty", "used", "new", "rejected", "waiting", "map full")
EMPTY, USED, NEW, REJECTED, WAITING, FULL = range(len(STATUS))
_ROUNDS = 3  # linearisations of one update
_NOTHING = 1e-12  # rounding of what is known exactly [m2, rad2]


class MarkerMap(eqx.Module):
    """The markers of a map, of fixed capacity.

    Attributes:
        ids: Of each; NOBODY where a place is free.
        position: In n [m].
        R_nm: Map m to n.
        contradicted: Frames in a row in which each did not fit what others said.
    """

    ids: Int[Array, " capacity"]
    position: Float[Array, "capacity 3"]
    R_nm: Float[Array, "capacity 3 3"]
    contradicted: Int[Array, " capacity"]

    def find(self, number: Index) -> tuple[Index, Flag]:
        """Place of a marker by its id, and whether it is in the map."""
        same = self.ids == number
        return jnp.argmax(same), same.any()


class State(eqx.Module):
    """What the filter knows: x, the covariance P of its errors and the map's, the map."""

    x: Float[Array, "15"]
    P: Float[Array, "n n"]
    map: MarkerMap


class Given(eqx.Module):
    """What holds for all steps of a frame: tuning, cameras, sizes of markers by id, measured attitude."""

    tuning: SlamTuning
    eyes: Eyes
    sizes: Float[Array, " ids"]
    R_meas: Matrix3

    def attitude(self, x: Float[Array, "15"]) -> Matrix3:
        """R_nb of a state."""
        return rotation_from_vector(x[OFFSET]) @ self.R_meas @ rotation_from_vector(x[NOISE])


def predict(tuning: SlamTuning, state: State, dt: Scalar) -> State:
    """To the next frame; the attitude's noise is drawn afresh."""
    F, Q = transition(dt, tuning.correlation), process_noise(dt, tuning.correlation)
    moving = state.x[:9].reshape(3, 3)
    x = jnp.concatenate([summed_product(F, moving).reshape(9), state.x[OFFSET], jnp.zeros(3)])
    P = _moved(F, _moved(F, state.P).T)
    n = P.shape[0]
    gained = (Q[:, None, :, None] * jnp.diag(tuning.acceleration**2)[None, :, None, :]).reshape(9, 9)
    old = jnp.ones(n).at[NOISE].set(0.0)
    P = P * old[:, None] * old
    P = P.at[:9, :9].add(gained)
    P = P.at[OFFSET, OFFSET].add(dt * jnp.diag(tuning.offset_walk**2))
    return State(x, P.at[NOISE, NOISE].set(jnp.diag(tuning.attitude**2)), state.map)


def _moved(F: Matrix3, P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The rows of the vehicle's motion multiplied by F on each axis."""
    rows = summed_product(F, P[:9].reshape(3, -1))
    return jnp.concatenate([rows.reshape(9, -1), P[9:]])


def update(given: Given, state: State, slot: Sightings) -> tuple[State, tuple[Index, Scalar]]:
    """Takes in one slot's corners if its marker is in the map; its status and squared normalised innovation (8)."""
    place, known = state.map.find(slot.ids)
    n = state.P.shape[0]

    def again(
        _: Index, step: tuple[Float[Array, " n"], Float[Array, "8"], Float[Array, "8 m"], Flag]
    ) -> tuple[Float[Array, " n"], Float[Array, "8"], Float[Array, "8 m"], Flag]:
        pivots, rows, visible = _innovation(given, state, slot, place, step[0])
        return (rows[:, :1] * rows[:, 1:] / pivots[:, None]).sum(axis=0), pivots, rows, step[3] & visible

    start = jnp.zeros(n), jnp.ones(8), jnp.zeros((8, n + 1)), jnp.asarray(True)
    dx, pivots, rows, visible = jax.lax.fori_loop(0, _ROUNDS, again, start)
    nis = (rows[:, 0] ** 2 / pivots).sum()
    # Of a linear step dx' P^-1 dx is at most nis. What goes further has lost its way between linearisations: next to
    # the camera derivatives are so large that S, rounded, is not positive any more (a nis of -3e8 has been seen).
    straight = (dx**2 <= given.tuning.gate * jnp.diagonal(state.P) + _NOTHING).all() & (pivots > 0.0).all()
    fits = slot.valid & known & visible & (nis < given.tuning.gate) & straight
    gain = rows[:, 1:] / pivots[:, None]
    P = state.P - jnp.where(fits, (rows[:, 1:, None] * gain[:, None, :]).sum(axis=0), 0.0)
    dx = jnp.where(fits, dx, 0.0)
    turns = dx[VEHICLE:].reshape(-1, 6)
    position, R_nm = state.map.position + turns[:, :3], state.map.R_nm @ jax.vmap(rotation_from_vector)(turns[:, 3:])
    moved = MarkerMap(state.map.ids, position, R_nm, state.map.contradicted)
    status = jnp.where(fits, USED, jnp.where(slot.valid & known, REJECTED, EMPTY))
    return State(state.x + dx[:VEHICLE], P, moved), (status, jnp.where(fits, nis, 0.0))


def _innovation(
    given: Given, state: State, slot: Sightings, place: Index, dx: Float[Array, " n"]
) -> tuple[Float[Array, "8"], Float[Array, "8 m"], Flag]:
    """What a slot's corners say about the state, linear about state + dx.

    With the innovation's covariance S = L diag(pivots) L': pivots, L^-1 [innovation, H P], and
    whether the marker is before the camera.
    """
    begin = VEHICLE + 6 * place
    x, turn = state.x + dx[:VEHICLE], jax.lax.dynamic_slice(dx, (begin,), (6,))
    p_nm, R_nm = state.map.position[place] + turn[:3], state.map.R_nm[place] @ rotation_from_vector(turn[3:])
    seen = see(given.eyes[slot.camera], x[POSITION], given.attitude(x), p_nm, R_nm, given.sizes[slot.ids])
    of_marker = jax.lax.dynamic_slice(state.P, (0, begin), (state.P.shape[0], 6))
    vehicle = ((seen.by_position, POSITION), (seen.by_offset, OFFSET), (seen.by_noise, NOISE))
    HP = summed_product(seen.by_marker, of_marker.T)
    e = slot.corners - seen.pixels + (seen.by_marker * turn).sum(axis=1)
    for H, where in vehicle:
        HP = HP + summed_product(H, state.P[where])
        e = e + (H * dx[where]).sum(axis=1)
    S = summed_product(jax.lax.dynamic_slice(HP, (0, begin), (8, 6)), seen.by_marker.T)
    for H, where in vehicle:
        S = S + summed_product(HP[:, where], H.T)
    turns = jax.lax.dynamic_slice(of_marker, (begin + 3, 3), (3, 3))
    variance = given.tuning.pixel**2 + _bend(slot.corners, turns)
    return *eliminated(S + variance * jnp.eye(8), jnp.concatenate([e[:, None], HP], axis=1)), seen.visible


def _bend(corners: Float[Array, "8"], turn: Matrix3) -> Scalar:
    """Variance of what a tilt that is uncertain does to corners beyond its linear part [px2].

    A side of L pixels tilted by f is shorter by L f^2 / 2, each of its ends is off by half of that.
    """
    sides = corners.reshape(4, 2) - jnp.roll(corners.reshape(4, 2), 1, axis=0)
    return (jnp.max((sides**2).sum(axis=1)) / 16.0) * (turn[0, 0] + turn[1, 1]) ** 2


def add_marker(given: Given, state: State, slot: Sightings, chosen: Flag) -> tuple[State, Index]:
    """Puts a slot's marker on the first free place of the map if `chosen`; status of the slot."""
    free = state.map.ids == NOBODY
    place, room = jnp.argmax(free), free.any()
    eye, size = given.eyes[slot.camera], given.sizes[slot.ids]
    R_nb = given.attitude(state.x)
    from_b = eye.position + eye.R_bc @ slot.t_cm
    R_bm = eye.R_bc @ slot.R_cm
    p_nm = state.x[POSITION] + R_nb @ from_b
    # By the vehicle's error: marker's shift e, then turn f.
    zero = jnp.zeros((3, 3))
    shift = [jnp.eye(3), zero, zero, -skew(R_nb @ from_b), -R_nb @ skew(from_b)]
    turn = [zero, zero, zero, (R_nb @ R_bm).T, R_bm.T]
    J = jnp.concatenate([jnp.concatenate(shift, axis=1), jnp.concatenate(turn, axis=1)])
    slope = pose_slope(eye.lens, size * jnp.asarray(CORNERS), slot.t_cm, slot.R_cm)
    prior = jnp.concatenate([jnp.zeros(3), jnp.full(3, given.tuning.tilt**-2)])
    seen = jnp.linalg.inv(slope.T @ slope / given.tuning.pixel**2 + jnp.diag(prior))
    G = jax.scipy.linalg.block_diag(R_nb @ eye.R_bc, jnp.eye(3))
    rows = summed_product(J, state.P[:VEHICLE])
    own = summed_product(rows[:, :VEHICLE], J.T) + G @ seen @ G.T
    begin = VEHICLE + 6 * place
    P = jax.lax.dynamic_update_slice(state.P, rows, (begin, 0))
    P = jax.lax.dynamic_update_slice(P, rows.T, (0, begin))
    P = jax.lax.dynamic_update_slice(P, own, (begin, begin))
    added = State(
        state.x,
        P,
        MarkerMap(
            state.map.ids.at[place].set(slot.ids.astype(state.map.ids.dtype)),
            state.map.position.at[place].set(p_nm),
            state.map.R_nm.at[place].set(R_nb @ R_bm),
            state.map.contradicted.at[place].set(0),
        ),
    )
    after = jax.tree.map(lambda new, old: jnp.where(chosen & room, new, old), added, state)
    return after, jnp.where(chosen & room, NEW, FULL)


class Vote(eqx.Module):
    """Where the markers of one frame say the vehicle is.

    Attributes:
        slot: The one that most markers of the map agree with, a scalar; it is the only one of its id in its image.
        there: Whether there is such a slot.
        agree: Slots of the map that put the vehicle where that one does.
        position: Where that is, n [m].
        std: How well a single marker tells it [m].
    """

    slot: Index
    there: Flag
    agree: Bool[Array, " slots"]
    position: Vector3
    std: Scalar


def vote(given: Given, state: State, slots: Sightings) -> Vote:
    """Each slot of the map says where the vehicle is; which of them the most markers bear out.

    A second print of a marker may hang anywhere and be the largest in the image. Of the pose only the middle is used,
    which hardly depends on which of two solutions is right: a clear one only breaks ties.
    """
    same = (state.map.ids == slots.ids[:, None]) & slots.valid[:, None]  # (slots, capacity)
    mapped = same.any(axis=1)
    place = state.map.position[jnp.argmax(same, axis=1)]
    from_b = jax.vmap(lambda camera, t: given.eyes.position[camera] + given.eyes.R_bc[camera] @ t)
    at = place - from_b(slots.camera, slots.t_cm) @ given.attitude(state.x).T
    distance = jnp.abs(slots.t_cm[:, 2])
    turn = deviation(jnp.trace(state.P[OFFSET, OFFSET]))  # an offset of the compass moves them against each other
    apart = jnp.linalg.norm(place[:, None] - place, axis=-1)
    bound = 0.1 + 0.05 * jnp.maximum(distance[:, None], distance) + 2.0 * turn * apart
    agree = (jnp.linalg.norm(at[:, None] - at, axis=-1) < bound) & mapped
    markers = (agree[:, :, None] & same).any(axis=1).sum(axis=1)  # not slots: two cameras see the same print
    able = mapped & slots.single
    best = jnp.argmax(jnp.where(able, 2 * markers + slots.clear, -1))
    std = jnp.hypot(0.1 + 0.2 * distance[best], turn * distance[best])
    return Vote(best, able.any(), agree[best] & able.any(), at[best], std)


def take_position(given: Given, state: State, chosen: Vote) -> State:
    """Puts the vehicle where the markers that are seen say; what was estimated of its motion is dropped."""
    tuning = given.tuning
    variance = jnp.concatenate(
        [jnp.full(3, chosen.std**2), jnp.full(3, tuning.start_velocity**2), tuning.acceleration**2]
    )
    x = state.x.at[POSITION].set(chosen.position).at[VELOCITY].set(0.0).at[ACCELERATION].set(0.0)
    kept = jnp.ones(state.P.shape[0]).at[:9].set(0.0)
    P = state.P * kept[:, None] * kept + jnp.diag(jnp.zeros(state.P.shape[0]).at[:9].set(variance))
    return State(x, P, state.map)


def forget(state: State, gone: Bool[Array, " capacity"]) -> State:
    """Takes markers that are gone out of the map."""
    kept = jnp.concatenate([jnp.ones(VEHICLE), jnp.repeat(jnp.where(gone, 0.0, 1.0), 6)])
    ids = jnp.where(gone, NOBODY, state.map.ids)
    counts = jnp.where(gone, 0, state.map.contradicted)
    return State(state.x, state.P * kept[:, None] * kept, MarkerMap(ids, state.map.position, state.map.R_nm, counts))


def deviation(variance: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    """Standard deviation of a variance, any shape; zero of one that is not positive."""
    # A root's slope at zero is infinite, which spoils gradients even where it is not used; an offset of the attitude
    # that is known exactly stays at zero variance.
    none = variance <= 0.0
    return jnp.where(none, 0.0, jnp.sqrt(jnp.where(none, 1.0, variance)))
