"""Where the water ends: the surface, at which buoyancy fades, and walls, which push back.

Both are forces of the state alone, evaluated inside the integration step, so that a floating vehicle keeps its energy
and a wall never gives any. Far from both nothing is computed. Products are written as broadcast and sum: as matrix
products of these shapes they would take ten times as long inside a scan.

References: Fossen (2021), sec. 4.2 (surface vessels); Hunt and Crossley (1975), J. Appl. Mech. 42(2) (contact).
"""

from jaxtyping import Float

from rovtwin.core.flow import Environment, Walls
from rovtwin.core.frames import cross
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Matrix3, Scalar, ScalarLike, Vector3, Vector6
from rovtwin.vehicle.constants import FRICTION, GRAVITY, SLIDING_SPEED
from rovtwin.vehicle.physics.model import Model

# A corner in contact swings against the vehicle's mass at this rate: 2 cm deep at 0.5 m/s, 13 steps of 2 ms a radian.
CONTACT_RATE = 25.0  # [rad/s]
CONTACT_SPEED = 0.1  # closing speed that doubles the force; leaving faster than that, nothing is given back [m/s]


def surroundings_wrench(
    model: Model, position: Vector3, R_nb: Matrix3, nu: Vector6, environment: Environment
) -> tuple[Vector6, ScalarLike]:
    """Wrench of surface and walls on the hull, b at CO, and which share of the hull is wet, 0 to 1.

    Args:
        model: Uses `hull`, the buoyancy and its centre, and the weight.
        position: CO in n [m].
        R_nb: Attitude.
        nu: Velocity over ground, b at CO.
        environment: Uses `surface` and `walls`.
    """
    nothing = jnp.zeros_like(nu)
    wrench, wet = nothing, 1.0
    hull, down_b = model.hull, R_nb[2]
    if environment.surface is not None:
        surface = environment.surface

        def at_surface() -> tuple[Vector6, Scalar]:
            dry = dryness(model, position[2], down_b, surface)
            return lost_buoyancy(model, dry, down_b), 1.0 - jnp.sum(dry * hull.shares)

        near = position[2] + jnp.sum(model.center_of_buoyancy * down_b) - surface < hull.radius
        wrench, wet = jax.lax.cond(near, at_surface, lambda: (nothing, jnp.ones_like(surface)))
    if environment.walls is not None:
        walls = environment.walls
        near = jnp.max(_dot(walls.normals, position) - walls.offsets) > -hull.radius
        wrench = wrench + jax.lax.cond(near, lambda: contact_wrench(model, position, R_nb, nu, walls), lambda: nothing)
    return wrench, wet


def _dot(rows: Float[Array, "k 3"], vector: Vector3) -> Float[Array, " k"]:
    """rows @ vector."""
    return rows[:, 0] * vector[0] + rows[:, 1] * vector[1] + rows[:, 2] * vector[2]


def dryness(model: Model, z: Scalar, down_b: Vector3, surface: Scalar) -> Float[Array, " n"]:
    """How much of each buoyancy element is out of the water, 0 to 1.

    Args:
        model: Uses `hull` and `center_of_buoyancy`.
        z: Depth of CO in n [m].
        down_b: Direction of gravity seen in b.
        surface: Depth of the surface in n [m].
    """
    return jnp.clip(0.5 - 0.5 * _height(model, z, down_b, surface), 0.0, 1.0)


def _height(model: Model, z: Scalar, down_b: Vector3, surface: Scalar) -> Float[Array, " n"]:
    """Depth of the elements below the surface, in halves of their own height."""
    below = z + jnp.sum(model.center_of_buoyancy * down_b) - surface
    return (below + _dot(model.hull.offsets, down_b)) / model.hull.reach


def lost_buoyancy(model: Model, dry: Float[Array, " n"], down_b: Vector3) -> Vector6:
    """Wrench of the buoyancy that the dry elements do not have, b at CO; it pulls down.

    Args:
        model: The vehicle.
        dry: From `dryness`.
        down_b: Direction of gravity seen in b.
    """
    weights = model.buoyancy * model.hull.shares * dry
    force = jnp.sum(weights)
    lever = force * model.center_of_buoyancy + jnp.sum(weights[:, None] * model.hull.offsets, axis=0)
    return jnp.concatenate([force * down_b, cross(lever, down_b)])


def surface_energy(model: Model, z: Scalar, down_b: Vector3, surface: Scalar) -> Scalar:
    """Potential energy of `lost_buoyancy` [J]: zero under water, the work done to lift the hull out of it."""
    height = _height(model, z, down_b, surface)
    rise = jnp.where(height < -1.0, -height, 0.25 * (1.0 - jnp.minimum(height, 1.0)) ** 2)
    return jnp.sum(model.buoyancy * model.hull.shares * model.hull.reach * rise)


def contact_wrench(model: Model, position: Vector3, R_nb: Matrix3, nu: Vector6, walls: Walls) -> Vector6:
    """Wrench of walls on the hull's corners, b at CO.

    Normal to the wall F = k delta (1 + delta_dot / v), never pulling (Hunt and Crossley 1975); along it friction that
    is smooth through zero speed. With v > 0 no cycle of going in and out gains energy.

    Args:
        model: Uses `hull.corners` and the weight.
        position: CO in n [m].
        R_nb: Attitude.
        nu: Velocity over ground, b at CO.
        walls: Planes.
    """
    # All in b, with corners in rows and walls in columns: shapes (m, k), and (m, 1) or (k,) before they meet.
    x, y, z = (model.hull.corners[:, i, None] for i in range(3))
    (u, v, w), (p, q, r) = nu[:3], nu[3:]
    moving = u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
    normal = [_dot(walls.normals, R_nb[:, i]) for i in range(3)]
    inside = walls.offsets - _dot(walls.normals, position)
    depth = x * normal[0] + y * normal[1] + z * normal[2] - inside
    closing = moving[0] * normal[0] + moving[1] * normal[1] + moving[2] * normal[2]
    stiffness = model.weight / GRAVITY * CONTACT_RATE**2
    push = stiffness * jnp.maximum(depth, 0.0) * jnp.maximum(1.0 + closing / CONTACT_SPEED, 0.0)
    along = [m - closing * n for m, n in zip(moving, normal, strict=True)]
    grip = push * FRICTION / jnp.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2 + SLIDING_SPEED**2)
    X, Y, Z = (-push * n - grip * a for n, a in zip(normal, along, strict=True))
    return jnp.stack([jnp.sum(f) for f in (X, Y, Z, y * Z - z * Y, z * X - x * Z, x * Y - y * X)])
