"""Where the water ends: the surface, at which buoyancy fades, and walls, which push back.

Both are forces of the state alone, evaluated inside the integration step, so that a floating vehicle keeps its energy
and a wall never gives any.

References: Fossen (2021), sec. 4.2 (surface vessels); Hunt and Crossley (1975), J. Appl. Mech. 42(2) (contact).
"""

from rovtwin.core.flow import Walls
from rovtwin.core.frames import cross
from rovtwin.core.numerics import Array, jnp
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.model import Model

# A corner in contact swings against the vehicle's mass at this rate: 2 cm deep at 0.5 m/s, 13 steps of 2 ms a radian.
CONTACT_RATE = 25.0  # [rad/s]
CONTACT_SPEED = 0.1  # closing speed that doubles the force; leaving faster than that, nothing is given back [m/s]
FRICTION, SLIDING_SPEED = 0.3, 0.02  # wet plastic on concrete; speed above which it slides rather than creeps [m/s]


def dryness(model: Model, z: Array, down_b: Array, surface: Array) -> Array:
    """How much of each buoyancy element is out of the water, 0 to 1, shape (n,).

    Args:
        model: Uses `hull` and `center_of_buoyancy`.
        z: Depth of CO in n [m].
        down_b: Direction of gravity seen in b, shape (3,).
        surface: Depth of the surface in n [m].
    """
    return jnp.clip(0.5 - 0.5 * _height(model, z, down_b, surface), 0.0, 1.0)


def _height(model: Model, z: Array, down_b: Array, surface: Array) -> Array:
    """Depth of the elements below the surface, in halves of their own height, shape (n,)."""
    below = z + (model.center_of_buoyancy @ down_b) - surface
    return (below + model.hull.offsets @ down_b) / model.hull.reach


def lost_buoyancy(model: Model, dry: Array, down_b: Array) -> Array:
    """Wrench of the buoyancy that the dry elements do not have, b at CO, shape (6,); it pulls down.

    Args:
        model: The vehicle.
        dry: From `dryness`, shape (n,).
        down_b: Direction of gravity seen in b, shape (3,).
    """
    weights = model.buoyancy * model.hull.shares * dry
    force = jnp.sum(weights)
    lever = force * model.center_of_buoyancy + weights @ model.hull.offsets
    return jnp.concatenate([force * down_b, cross(lever, down_b)])


def surface_energy(model: Model, z: Array, down_b: Array, surface: Array) -> Array:
    """Potential energy of `lost_buoyancy` [J]: zero under water, the work done to lift the hull out of it."""
    height = _height(model, z, down_b, surface)
    rise = jnp.where(height < -1.0, -height, 0.25 * (1.0 - jnp.minimum(height, 1.0)) ** 2)
    return jnp.sum(model.buoyancy * model.hull.shares * model.hull.reach * rise)


def contact_wrench(model: Model, position: Array, R_nb: Array, nu: Array, walls: Walls) -> Array:
    """Wrench of walls on the hull's corners, b at CO, shape (6,).

    Normal to the wall F = k delta (1 + delta_dot / v), never pulling (Hunt and Crossley 1975); along it friction that
    is smooth through zero speed. With v > 0 no cycle of going in and out gains energy.

    Args:
        model: Uses `hull.corners` and the weight.
        position: CO in n [m], shape (3,).
        R_nb: Shape (3, 3).
        nu: Velocity over ground, b at CO, shape (6,).
        walls: Planes.
    """
    corners = model.hull.corners
    omega = nu[3:]
    turning = jnp.stack([cross(omega, r) for r in corners])
    points = position + corners @ R_nb.T
    velocities = (nu[:3] + turning) @ R_nb.T
    depth = points @ walls.normals.T - walls.offsets
    closing = velocities @ walls.normals.T
    stiffness = model.weight / GRAVITY * CONTACT_RATE**2
    push = stiffness * jnp.maximum(depth, 0.0) * jnp.maximum(1.0 + closing / CONTACT_SPEED, 0.0)
    along = velocities[:, None, :] - closing[:, :, None] * walls.normals
    slowness = FRICTION / jnp.sqrt(jnp.sum(along**2, axis=-1) + SLIDING_SPEED**2)
    force_n = -push @ walls.normals - jnp.sum((push * slowness)[:, :, None] * along, axis=1)
    force = force_n @ R_nb
    moment = jnp.stack([cross(r, f) for r, f in zip(corners, force, strict=True)])
    return jnp.concatenate([jnp.sum(force, axis=0), jnp.sum(moment, axis=0)])
