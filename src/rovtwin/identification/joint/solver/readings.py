"""Readings of a segment: what sensors would read along a path, less what they read, and the squares of that.

Readings lie between the grid points of a path; see `vehicle.physics.measurement` for the sensors' equations.
"""

from typing import Any

from jaxtyping import Float, Int

from rovtwin.core.frames import cross, quaternion_normalise, rotation_between, rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Quaternion, Scalar, Vector3, Vector6
from rovtwin.identification.joint.model.nodes import Nodes
from rovtwin.identification.joint.model.parameters import Sensing
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.measurement import acceleration_of_point, velocity_of_point

HUBER = 3.0  # residuals beyond so many sigma count linearly


def gaps_along(
    path: Nodes,
    rates: Float[Array, "points 6"] | None,
    own: dict[str, Any],
    levers: dict[str, Any],
    step: float,
    sensing: Sensing,
) -> dict[str, Float[Array, "_ _"]]:
    """Prediction less reading by signal.

    Args:
        path: States at the grid points of a segment, leading axis K + 1.
        rates: nu_dot there, where an accelerometer needs it.
        own: The segment's readings, see `Segments.arrays`.
        levers: By signal.
        step: Of the grid [s].
        sensing: Of the sensors.
    """
    gaps = {}
    for name, lever in levers.items():
        row, share = own[name]["row"], own[name]["share"]
        if name in sensing.delays:
            row, share = _earlier(row, share, sensing.delays[name] / step, path.nu.shape[0] - 2)
        x, nu_dot = jax.tree.map(lambda x, row=row, share=share: _between(x, row, share), (path, rates))
        x = x._replace(position=_place_between(path, row, share, step))
        gaps[name] = _gap(name, x, nu_dot, jnp.asarray(lever), own[name]["value"], sensing.mounting)
    return gaps


def _earlier(
    row: Int[Array, " R"], share: Float[Array, " R"], steps: Scalar, last: int
) -> tuple[Int[Array, " R"], Float[Array, " R"]]:
    """Places on the grid so many steps before; beyond the segment's ends its first or last step goes on."""
    place = row + share - steps
    before = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)), 0, last).astype(int)
    return before, place - before


def _between(
    x: Float[Array, " points *axes"], row: Int[Array, " R"], share: Float[Array, " R"]
) -> Float[Array, " R *axes"]:
    """Values between grid points row and row + 1."""
    extra = x.ndim - 1
    weight = share.reshape(share.shape + (1,) * extra)
    return x[row] + weight * (x[row + 1] - x[row])


def _place_between(path: Nodes, row: Int[Array, " R"], share: Float[Array, " R"], step: float) -> Float[Array, "R 3"]:
    """Position between grid points, by a cubic through places and velocities at both.

    A straight line would be off by an eighth of acceleration times step squared, a tenth of a pressure sensor's noise.
    """

    def one(p0: Vector3, q0: Quaternion, nu0: Vector6, p1: Vector3, q1: Quaternion, nu1: Vector6, s: Scalar) -> Vector3:
        v0, v1 = rotation_from_quaternion(q0) @ nu0[:3], rotation_from_quaternion(q1) @ nu1[:3]
        along = s * s * (3.0 - 2.0 * s)
        return p0 + along * (p1 - p0) + step * s * (1.0 - s) * ((1.0 - s) * v0 - s * v1)

    a, b = (jax.tree.map(lambda x, k=k: x[k], path) for k in (row, row + 1))
    return jax.vmap(one)(a.position, a.attitude, a.nu, b.position, b.attitude, b.nu, share)


def _gap(
    name: str,
    x: Nodes,
    rates: Float[Array, "R 6"] | None,
    lever: Vector3,
    value: Float[Array, "R _"],
    mounting: Vector3 | None = None,
) -> Float[Array, "R k"]:
    """What a sensor would read along a path less what it read; of an attitude the small rotation in b.

    See `vehicle.physics.measurement` for the equations.
    """

    def predicted(position: Vector3, attitude: Quaternion, nu: Vector6, nu_dot: Vector6 | None) -> Float[Array, " k"]:
        q = quaternion_normalise(attitude)
        R_nb, omega = rotation_from_quaternion(q), nu[3:]
        if name in ("position", "horizontal", "depth"):
            place = position + R_nb @ lever
            return {"position": place, "horizontal": place[:2], "depth": place[2:]}[name]
        if name == "attitude":
            return q
        if name == "gyro":
            return omega if mounting is None else omega - cross(mounting, omega)
        if name == "velocity":
            return velocity_of_point(nu, lever)
        assert nu_dot is not None
        return acceleration_of_point(nu, nu_dot, lever) - GRAVITY * R_nb[2]

    if rates is None:
        reading = jax.vmap(lambda p, q, nu: predicted(p, q, nu, None))(x.position, x.attitude, x.nu)
    else:
        reading = jax.vmap(predicted)(x.position, x.attitude, x.nu, rates)
    return jax.vmap(rotation_between)(reading, value) if name == "attitude" else reading - value


def offsets_by_signal(
    names: list[str], gaps: dict[str, Float[Array, "_ _"]], offsets: Float[Array, " G"]
) -> dict[str, Float[Array, " _"]]:
    """Offsets of all components, by signal."""
    out, start = {}, 0
    for name in names:
        size = gaps[name].shape[-1]
        out[name] = offsets[start : start + size]
        start += size
    return out


def squared(
    names: list[str],
    gaps: dict[str, Float[Array, "_ _"]],
    columns: dict[str, Float[Array, "_ _ _"]],
    own: dict[str, Any],
    offsets: Float[Array, " G"],
    sigma: Float[Array, " G"],
) -> tuple[Float[Array, "G m m"], Float[Array, "G m"], Float[Array, " G"], Float[Array, " G"]]:
    """J'WJ, J'Wr, sum w r^2 and sum w of every signal component, with weights of Huber (1964)."""
    split = offsets_by_signal(names, gaps, offsets)
    parts, group, total = [], 0, offsets.shape[0]
    for name in names:
        residual = gaps[name] + split[name]
        for i in range(residual.shape[-1]):
            r = residual[:, i]
            far = jnp.abs(r) / sigma[group]
            w = own[name]["used"] * jnp.where(far > HUBER, HUBER / jnp.where(far > 0, far, 1.0), 1.0)
            J = columns[name][:, i, :]
            one_hot = jnp.zeros((J.shape[0], total)).at[:, group].set(1.0)
            J = jnp.concatenate([J, one_hot], axis=1)
            weighted = w[:, None] * J
            parts.append((J.T @ weighted, weighted.T @ r, jnp.sum(w * r * r), jnp.sum(w)))
            group += 1
    readings, slopes, squares, weights = zip(*parts, strict=True)
    return jnp.stack(readings), jnp.stack(slopes), jnp.stack(squares), jnp.stack(weights)
