"""Whether a mission can go on with the thrusters that are left: a table, computed once, of what may be lost."""

from itertools import combinations

import equinox as eqx
import numpy as np

from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.gnc.attainable import Remaining, remaining
from rovtwin.gnc.heave_feedback import TILTS
from rovtwin.vehicle.model import Model
from rovtwin.vehicle.reach import RANK_TOLERANCE, configuration_about_cg
from rovtwin.vehicle.trim import hang

FINE, UNABLE, HEAVE_LOST = range(3)

LEAST = 0.2  # of a sound vehicle's wrench along surge, sway, heave and yaw, either way, that has to be left
AT_ONCE = 2  # thrusters lost together that the table knows; more are too many
HEAVE, PITCH = 2, 4
UPRIGHT = (0, 1, 2, 5)  # axes of a vehicle that its restoring moment keeps level


class Ability(eqx.Module):
    """What the loss of thrusters leaves.

    Attributes:
        heave: Share of all heave that each thruster gives, shape (n,).
        lost: Thrusters, 1 where lost, shape (k, n).
        verdict: FINE: the mission can go on. UNABLE: it cannot, but the vehicle can come up. HEAVE_LOST: not even that.
            Shape (k,), int.
        upright: Whether roll and pitch can still be controlled by themselves, shape (k, 2), bool.
    """

    heave: Array
    lost: Array
    verdict: Array
    upright: Array

    @classmethod
    def of(cls, model: Model, units: tuple[tuple[int, ...], ...] = ()) -> "Ability":
        """Every thruster, every two of them, and every unit that fails as one (numbers of its thrusters)."""
        n = model.thrusters.count
        groups = [group for size in range(AT_ONCE + 1) for group in combinations(range(n), size)]
        rows = sorted({*groups, *(tuple(sorted(unit)) for unit in units)}, key=lambda row: (len(row), row))
        lost = np.array([np.isin(np.arange(n), row) for row in rows], dtype=float)
        left: Remaining = _remaining(model.thrusters, as_array(1.0 - lost))
        sound = left.either[0]
        enough = np.asarray((left.either >= LEAST * sound) | (sound <= 0.0))
        # Roll and pitch right themselves.
        able = enough[:, UPRIGHT].all(axis=1)
        # A vehicle that needed its pitch control and pitches by every push up or down swings: it had better come up.
        doubtful = able & ~enough[:, PITCH]
        most = np.asarray(left.either[:, HEAVE])
        able &= ~np.array([doubt and _pitches(model, *row) for doubt, *row in zip(doubtful, lost, most, strict=True)])
        verdict = np.where(able, FINE, np.where(enough[:, HEAVE], UNABLE, HEAVE_LOST))
        heave = np.abs(np.asarray(model.thrusters.configuration)[HEAVE])
        share = as_array(heave / max(heave.sum(), 1e-12))
        return cls(share, as_array(lost), jnp.asarray(verdict), jnp.asarray(enough[:, 3:5]))

    def judged(self, health: Array) -> Array:
        """FINE, UNABLE or HEAVE_LOST, int, for a health of 1 or 0 of each thruster, shape (n,)."""
        known = jnp.all(self.lost == (health < 0.5), axis=1)
        # More than the table knows: no mission, but up as long as there is some heave.
        beyond = jnp.where(self.heave @ health >= LEAST, UNABLE, HEAVE_LOST)
        return jnp.where(jnp.any(known), jnp.max(jnp.where(known, self.verdict, FINE)), beyond)

    def axes(self, health: Array) -> Array:
        """0 along roll and pitch where what is left cannot push alone: nothing may be asked for; else 1, shape (6,).

        A fore and an aft thruster control depth and pitch; one of them alone would trade the one for the other.
        """
        known = jnp.all(self.lost == (health < 0.5), axis=1)
        upright = jnp.any(known[:, None] & self.upright, axis=0)
        return jnp.ones(6).at[3:5].set(jnp.where(upright, 1.0, 0.0))


def _pitches(model: Model, lost: np.ndarray, heave: float) -> bool:
    """Whether full heave thrust [N] of what is left pitches the vehicle by more than TILTS; `lost` has shape (n,)."""
    T = configuration_about_cg(model) * (1.0 - lost)
    moment = heave * float(T[PITCH] @ np.linalg.pinv(T[list(UPRIGHT)], rcond=RANK_TOLERANCE)[:, HEAVE])
    return bool(abs(moment) > np.tan(TILTS) * max(float(hang(model).stiffness[1]), 0.0))


_remaining = jax.jit(jax.vmap(remaining, in_axes=(None, 0)))
