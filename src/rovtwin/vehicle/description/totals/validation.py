"""What must hold for totals to be a vehicle: inertia that resists, damping that takes energy."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.description.totals.assembly import Assembly
from rovtwin.vehicle.description.totals.drag import Damping, coupling_load


def require_distinct_in_logs(names: list[str], where: str, what: str = "thrusters") -> None:
    """ConfigError when two things of a kind have one name in logs, where dots between parts become _."""
    seen: dict[str, str] = {}
    for name in names:
        other = seen.setdefault(name.replace(".", "_"), name)
        if other != name:
            raise ConfigError(
                f"{where}: the {what} '{other}' and '{name}' are both '{name.replace('.', '_')}' in logs; rename one"
            )


def require_sound(total: Assembly, rigid_body_mass: Float[np.ndarray, "6 6"], where: str) -> None:
    """ConfigError when M = M_RB + M_A is no inertia or the damping can drive the vehicle."""
    if total.solid.mass <= 0:
        raise ConfigError(f"{where}: no part has a mass; give 'mass' [kg] to parts, or rigid_body.mass")
    if not np.allclose(total.added_mass, total.added_mass.T, rtol=1e-6, atol=1e-9):
        raise ConfigError(f"{where}: hydrodynamics.added_mass is not symmetric; potential flow makes it so")
    M = rigid_body_mass + total.added_mass
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    if values[0] <= 1e-9 * values[-1]:
        axis = AXES[int(np.abs(vectors[:, 0]).argmax())]
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


def driving_velocity(damping: Damping, samples: int = 4000) -> tuple[Float[np.ndarray, "6"], float] | None:
    """A velocity at which nu . D(nu) nu < 0, with the power delivered [W], or None.

    Weak couplings are dissipative by `coupling_load`. For others there is no simple criterion (quadratic, ahead unlike
    astern): velocities are tried at random, from a fixed seed, and the worst of them made worse step by step.
    """
    la, lb, qa, qb = damping.matrices()
    if coupling_load(la, lb, 1).max() <= 1 + 1e-9 and coupling_load(qa, qb, 2).max() <= 1 + 1e-9:
        return None
    rng = np.random.default_rng(0)
    nu = rng.normal(size=(samples, 6)) * rng.choice([0.01, 0.1, 0.5, 1.0, 3.0], size=(samples, 1))
    # Couplings are pairwise: a third of the velocities lie in the plane of two.
    third = samples // 3
    pair = rng.integers(0, 6, size=(third, 2))
    nu[:third] *= (np.arange(6) == pair[:, :1]) | (np.arange(6) == pair[:, 1:])
    for step in (0.5, 0.5, 0.3, 0.3, 0.2, 0.2, 0.1, 0.1, 0.05):
        worst = nu[np.argsort(_share_lost(damping, nu))[:100]]
        nearby = worst[:, None, :] * (1 + step * rng.normal(size=(100, 20, 6)))
        nu = np.concatenate([worst, nearby.reshape(-1, 6)])
    share = _share_lost(damping, nu)
    found = nu[int(np.argmin(share))]
    if share.min() < -1e-9:
        return found, float(-_power(damping, found[None])[0][0])
    return None


def _power(damping: Damping, nu: Float[np.ndarray, "n 6"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """nu . D(nu) nu [W], and the same with all terms counted positive, of velocities."""
    la, lb, qa, qb = damping.matrices()
    ahead, astern = np.maximum(nu, 0), np.maximum(-nu, 0)
    wrench = ahead @ la.T - astern @ lb.T + ahead**2 @ qa.T - astern**2 @ qb.T
    return np.sum(nu * wrench, axis=1), np.sum(np.abs(nu * wrench), axis=1)


def _share_lost(damping: Damping, nu: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, " n"]:
    power, scale = _power(damping, nu)
    return power / np.maximum(scale, 1e-12)
