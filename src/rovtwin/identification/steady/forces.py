"""Forces on a vehicle along a test: thrust of its commands, weight and ballast, Coriolis terms of its motion."""

import numpy as np

from rovtwin.core.numerics import as_array, jax
from rovtwin.identification.logs.record import Record
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force


def forces(model: Model, record: Record, t: np.ndarray, linear: bool = False) -> np.ndarray:
    """Wrench of the thrusters at times t, b at CO, shape (len(t), 6) [N, N m], without their lag.

    Args:
        model: Thrust curves and configuration.
        record: Its commands hold until the next one.
        t: [s], shape (m,).
        linear: Force linear in the command, as the thesis takes it (3.6).
    """
    levels, row = np.unique(record.command_at(t), axis=0, return_inverse=True)
    full = [np.asarray(static_force(model.thrusters, as_array(np.full(levels.shape[1], u)))) for u in (-1.0, 1.0)]
    if linear:
        force = np.where(levels >= 0, full[1], -full[0]) * np.clip(levels, -1, 1)
    else:
        force = np.asarray(jax.jit(jax.vmap(lambda u: static_force(model.thrusters, u)))(as_array(levels)))
    return (force @ np.asarray(model.thrusters.configuration).T)[np.reshape(row, -1)]


def weights(model: Model, record: Record, attitude: np.ndarray) -> np.ndarray:
    """Force of weight and buoyancy, ballast of the test included, b, shape (m, 3) [N]."""
    net = float(model.weight - model.buoyancy)
    density = record.water_density or 1000.0
    net += GRAVITY * sum(piece.mass - density * piece.volume for piece in record.ballast)
    phi, theta = attitude[:, 0], attitude[:, 1]
    return net * np.stack([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)], axis=1)


def full_thrust(model: Model) -> np.ndarray:
    """Force of each thruster at full command, the larger of ahead and astern [N], shape (n,)."""
    both = [static_force(model.thrusters, as_array(np.full(model.thrusters.count, u))) for u in (-1.0, 1.0)]
    return np.max(np.abs(np.asarray(both)), axis=0)


def coriolis(mass: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """C(nu) nu from the momentum, shape (m, 6). Fossen (2021), eq. 3.63."""
    momentum = nu @ mass.T
    v, omega, linear, angular = nu[:, :3], nu[:, 3:], momentum[:, :3], momentum[:, 3:]
    return np.concatenate([np.cross(omega, linear), np.cross(v, linear) + np.cross(omega, angular)], axis=1)
