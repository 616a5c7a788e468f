"""What must hold for totals to be a vehicle: inertia that resists, damping that takes energy."""

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.assembly import Assembly
from rovtwin.vehicle.hydrodynamics import Damping
from rovtwin.vehicle.rigid_body import MassProperties, skew

NAMES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


def rigid_body_matrix(solid: MassProperties) -> np.ndarray:
    """M_RB at the origin, shape (6, 6). Fossen (2021), eq. 3.49."""
    S = skew(solid.center_of_gravity)
    inertia = solid.inertia_about(np.zeros(3))
    return np.block([[solid.mass * np.eye(3), -solid.mass * S], [solid.mass * S, inertia]])


def require_sound(total: Assembly, where: str) -> None:
    """ConfigError when M is not symmetric positive definite or the damping can drive the vehicle."""
    if total.solid.mass <= 0:
        raise ConfigError(f"{where}: no part has a mass; give 'mass' [kg] to parts, or rigid_body.mass")
    if not np.allclose(total.added_mass, total.added_mass.T, rtol=1e-6, atol=1e-9):
        raise ConfigError(f"{where}: hydrodynamics.added_mass is not symmetric; potential flow makes it so")
    M = rigid_body_matrix(total.solid) + total.added_mass
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    if values[0] <= 1e-9 * values[-1]:
        axis = NAMES[int(np.abs(vectors[:, 0]).argmax())]
        raise ConfigError(
            f"{where}: the inertia M = M_RB + M_A is not positive definite (eigenvalue {values[0]:.3g}, mostly {axis})"
            "; give parts an inertia or a shape, or check the added mass"
        )
    found = driving_velocity(total.damping())
    if found is not None:
        nu, power = found
        raise ConfigError(
            f"{where}: the damping adds energy: at nu = [{', '.join(f'{v:.2f}' for v in nu)}] it delivers {power:.3g} W"
            "; check the off-diagonal terms of hydrodynamics.linear_damping and quadratic_damping"
        )


def driving_velocity(damping: Damping, samples: int = 4000) -> tuple[np.ndarray, float] | None:
    """A velocity at which nu . D(nu) nu < 0, with the power delivered [W], or None.

    Diagonal damping of one sign is dissipative by construction. For coupled matrices there is no simple criterion
    (quadratic, ahead unlike astern), so random directions at several speeds are tried, from a fixed seed.
    """
    matrices = damping.matrices()
    if all(np.count_nonzero(m - np.diag(np.diag(m))) == 0 and (np.diag(m) >= 0).all() for m in matrices):
        return None
    rng = np.random.default_rng(0)
    nu = rng.normal(size=(samples, 6))
    # A third of the directions in a plane of two velocities: couplings are pairwise.
    pair = rng.integers(0, 6, size=(samples // 3, 2))
    mask = np.zeros((samples // 3, 6))
    rows = np.arange(samples // 3)
    mask[rows, pair[:, 0]] = mask[rows, pair[:, 1]] = 1
    nu[: samples // 3] *= mask
    speed = rng.choice([0.01, 0.1, 0.5, 1.0, 3.0], size=(samples, 1))
    nu *= speed / np.maximum(np.linalg.norm(nu, axis=1, keepdims=True), 1e-9)
    la, lb, qa, qb = matrices
    ahead, astern = np.maximum(nu, 0), np.maximum(-nu, 0)
    wrench = ahead @ la.T - astern @ lb.T + ahead**2 @ qa.T - astern**2 @ qb.T
    power = np.sum(nu * wrench, axis=1)
    scale = np.sum(np.abs(nu) * np.abs(wrench), axis=1)
    worst = int(np.argmin(power / np.maximum(scale, 1e-12)))
    if power[worst] < -1e-9 * max(scale[worst], 1e-12):
        return nu[worst], -float(power[worst])
    return None
