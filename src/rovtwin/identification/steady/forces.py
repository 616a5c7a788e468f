"""Forces on a vehicle along a test: thrust of its commands, weight and ballast, Coriolis terms of its motion."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import as_array, jax
from rovtwin.identification.logs.record import Record
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force


def forces(model: Model, record: Record, t: Float[np.ndarray, " m"], linear: bool = False) -> Float[np.ndarray, "m 6"]:
    """Wrench of the thrusters at times t, b at CO, shape (len(t), 6) [N, N m], without their lag.

    Args:
        model: Thrust curves and configuration.
        record: Its commands hold until the next one.
        t: [s].
        linear: Force linear in the command, as the thesis takes it (3.6).
    """
    levels, row = np.unique(record.command_at(t), axis=0, return_inverse=True)
    full = [np.asarray(static_force(model.thrusters, as_array(np.full(levels.shape[1], u)))) for u in (-1.0, 1.0)]
    if linear:
        force = np.where(levels >= 0, full[1], -full[0]) * np.clip(levels, -1, 1)
    else:
        force = np.asarray(jax.jit(jax.vmap(lambda u: static_force(model.thrusters, u)))(as_array(levels)))
    return (force @ np.asarray(model.thrusters.configuration).T)[np.reshape(row, -1)]


def weights(model: Model, record: Record, attitude: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Force of weight and buoyancy, ballast of the test included, b [N]."""
    net = float(model.weight - model.buoyancy)
    density = record.water_density or 1000.0
    net += GRAVITY * sum(piece.mass - density * piece.volume for piece in record.ballast)
    phi, theta = attitude[:, 0], attitude[:, 1]
    return net * np.stack([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)], axis=1)


def full_thrust(model: Model) -> Float[np.ndarray, " n"]:
    """Force of each thruster at full command, the larger of ahead and astern [N]."""
    both = [static_force(model.thrusters, as_array(np.full(model.thrusters.count, u))) for u in (-1.0, 1.0)]
    return np.max(np.abs(np.asarray(both)), axis=0)


def coriolis(mass: Float[np.ndarray, "6 6"], nu: Float[np.ndarray, "m 6"]) -> Float[np.ndarray, "m 6"]:
    """C(nu) nu from the momentum. Fossen (2021), eq. 3.63."""
    momentum = nu @ mass.T
    v, omega, linear, angular = nu[:, :3], nu[:, 3:], momentum[:, :3], momentum[:, 3:]
    return np.concatenate([np.cross(omega, linear), np.cross(v, linear) + np.cross(omega, angular)], axis=1)
