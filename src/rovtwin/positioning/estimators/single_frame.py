"""Position at each frame from that frame alone: corners, measured attitude and a map that is taken as known.

What identification wants: readings whose errors have nothing to do with each other, unlike those of a filtered track.
"""

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.frames import rotation_from_vector
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Index, Matrix3, Matrix6, Vector3, Vector6
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.images.camera_model import Eyes, see
from rovtwin.positioning.images.observations import Frames, Sightings

_ROUNDS = 4
_NOTHING = 1e-6  # information about the position beside the markers' [1/m2]
_BLOCK = 64  # frames at a time, so that it is compiled once


def fixes(
    eyes: Eyes,
    tuning: SlamTuning,
    sizes: Float[Array, " ids"],
    frames: Frames,
    R_meas: Float[np.ndarray, "n 3 3"],
    near: Float[np.ndarray, "n 3"],
    position: Float[np.ndarray, "n slots 3"],
    R_nm: Float[np.ndarray, "n slots 3 3"],
    used: Bool[np.ndarray, "n slots"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Fits to single frames.

    Args:
        eyes: The cameras.
        tuning: Noise of corners and attitude.
        sizes: Sides of markers by id [m].
        frames: The recording.
        R_meas: Measured attitude with its estimated offset taken out.
        near: Where the vehicle is, nearly [m].
        position: Of the marker in each slot [m].
        R_nm: Its attitude.
        used: Which slots to use.

    Returns:
        Positions of CO in n [m], and their standard deviations; NaN where no slot is used.
    """
    columns = (frames.sightings, R_meas, near, position, R_nm, used)
    parts = []
    for begin in range(0, len(frames), _BLOCK):
        rows = jax.tree.map(lambda leaf, b=begin: np.asarray(leaf)[b : b + _BLOCK], columns)
        n = len(rows[1])
        padded = jax.tree.map(lambda leaf, n=n: np.concatenate([leaf, np.repeat(leaf[:1], _BLOCK - n, axis=0)]), rows)
        parts.append([np.asarray(out)[:n] for out in _fit(eyes, tuning, sizes, *padded)])
    p, std = (np.concatenate(part) for part in zip(*parts, strict=True))
    p[~used.any(axis=1)] = std[~used.any(axis=1)] = np.nan
    return p, std


@jax.jit
def _fit(eyes: Eyes, tuning: SlamTuning, sizes: Float[Array, " ids"], *columns):
    def one(
        slots: Sightings,
        R_meas: Matrix3,
        near: Vector3,
        position: Float[Array, "slots 3"],
        R_nm: Float[Array, "slots 3 3"],
        used: Bool[Array, " slots"],
    ):
        weight = jnp.where(used, tuning.pixel**-2, 0.0)
        prior = jnp.concatenate([jnp.full(3, _NOTHING), tuning.attitude**-2])

        def again(_: Index, guess: tuple[Vector6, Matrix6]) -> tuple[Vector6, Matrix6]:
            x, _P = guess  # position and noise of the attitude
            R_nb = R_meas @ rotation_from_vector(x[3:])
            seen = jax.vmap(lambda c, p, R, i: see(eyes[c], x[:3], R_nb, p, R, sizes[i]))(
                slots.camera, position, R_nm, slots.ids
            )
            J = jnp.concatenate([seen.by_position, seen.by_noise], axis=-1)  # (slots, 8, 6)
            information = jnp.einsum("s,ski,skj->ij", weight, J, J) + jnp.diag(prior)
            pull = jnp.einsum("s,ski,sk->i", weight, J, slots.corners - seen.pixels)
            covariance = jnp.linalg.inv(information)
            return x + covariance @ (pull - prior * x.at[:3].set(0.0)), covariance

        start = jnp.concatenate([near, jnp.zeros(3)]), jnp.eye(6)
        x, covariance = jax.lax.fori_loop(0, _ROUNDS, again, start)
        return x[:3], jnp.sqrt(jnp.diagonal(covariance)[:3])

    return jax.vmap(one)(*columns)
