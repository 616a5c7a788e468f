"""Whether a mission can go on with the thrusters that are left: a table, computed once, of what may be lost."""

from itertools import combinations

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.programs.compiled import jit_once
from rovtwin.core.programs.values import once_and_for_all
from rovtwin.core.types import Index, PerThruster, Vector6
from rovtwin.gnc.allocation.attainable_wrench import RemainingWrench, remaining
from rovtwin.gnc.control.heave_feedback import TILTS
from rovtwin.vehicle.analysis.stability import hang
from rovtwin.vehicle.physics.actuation import RANK_TOLERANCE, configuration_about_cg
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import Thrusters, force_limits

FINE, UNABLE, HEAVE_LOST = range(3)

LEAST = 0.2  # of a sound vehicle's wrench along surge, sway, heave and yaw, either way, that has to be left
AT_ONCE = 2  # thrusters lost together that the table knows; more are too many
HEAVE, PITCH = 2, 4
ANGLES = (3, 4)
UPRIGHT = (0, 1, 2, 5)  # axes of a vehicle that its restoring moment keeps level


class ControlAuthority(eqx.Module):
    """What the loss of thrusters leaves.

    Attributes:
        heave: Share of all heave that each thruster gives.
        lost: Thrusters, 1 where lost.
        verdict: FINE: the mission can go on. UNABLE: it cannot, but the vehicle can come up. HEAVE_LOST: not even that.
        upright: Whether roll and pitch can still be controlled by themselves.
    """

    heave: PerThruster
    lost: Float[Array, "k n"]
    verdict: Int[Array, " k"]
    upright: Bool[Array, "k 2"]

    @classmethod
    def of(cls, model: Model, units: tuple[tuple[int, ...], ...] = ()) -> "ControlAuthority":
        """Every thruster, every two of them, and every unit that fails as one (numbers of its thrusters)."""
        return _authority_of(model, units)

    @classmethod
    def _of(cls, model: Model, units: tuple[tuple[int, ...], ...]) -> "ControlAuthority":
        n = model.thrusters.count
        groups = [group for size in range(AT_ONCE + 1) for group in combinations(range(n), size)]
        rows = sorted({*groups, *(tuple(sorted(unit)) for unit in units)}, key=lambda row: (len(row), row))
        lost = np.array([np.isin(np.arange(n), row) for row in rows], dtype=float)
        remaining: RemainingWrench = _remaining(model.thrusters, as_array(1.0 - lost))
        left = np.asarray(remaining.either)
        sound = left[0]
        enough = (left >= LEAST * sound) | (sound <= 0.0)
        # Roll and pitch right themselves.
        able = enough[:, UPRIGHT].all(axis=1)
        apart = _apart(model.thrusters, lost)
        # Each of them alone trades the other: two vertical thrusters that are left have one moment beside heave.
        upright = enough[:, ANGLES] & (apart[:, None] | ~enough[:, ANGLES].all(axis=1, keepdims=True))
        # A vehicle that needed its pitch control and pitches by every push up or down swings: it had better come up.
        doubtful = able & ~upright[:, 1]
        most = left[:, HEAVE]
        able &= ~np.array([doubt and _pitches(model, *row) for doubt, *row in zip(doubtful, lost, most, strict=True)])
        verdict = np.where(able, FINE, np.where(enough[:, HEAVE], UNABLE, HEAVE_LOST))
        heave = np.abs(np.asarray(model.thrusters.configuration)[HEAVE])
        share = as_array(heave / max(heave.sum(), 1e-12))
        return cls(share, as_array(lost), jnp.asarray(verdict), jnp.asarray(upright))

    def judged(self, health: PerThruster) -> Index:
        """FINE, UNABLE or HEAVE_LOST, for a health of 1 or 0 of each thruster."""
        known = jnp.all(self.lost == (health < 0.5), axis=1)
        # More than the table knows: no mission, but up as long as there is some heave.
        beyond = jnp.where(self.heave @ health >= LEAST, UNABLE, HEAVE_LOST)
        return jnp.where(jnp.any(known), jnp.max(jnp.where(known, self.verdict, FINE)), beyond)

    def axes(self, health: PerThruster) -> Vector6:
        """0 along roll and pitch where what is left cannot push alone: nothing may be asked for; else 1.

        A fore and an aft thruster control depth and pitch; one of them alone would trade the one for the other. So
        would a fore and a starboard one with roll and pitch, and what they lack for both the allocation would make with
        thrusters a little below CO, which throw the vehicle sideways. The righting moment has to do.
        """
        known = jnp.all(self.lost == (health < 0.5), axis=1)
        upright = jnp.any(known[:, None] & self.upright, axis=0)
        return jnp.ones(6).at[3:5].set(jnp.where(upright, 1.0, 0.0))


def _apart(thrusters: Thrusters, lost: Float[np.ndarray, "k n"]) -> Bool[np.ndarray, " k"]:
    """Whether roll and pitch can each be pushed without the other and without force or yaw.

    True, too, of a vehicle that never could. Forces that make no surge, sway, heave and yaw are a subspace; the smaller
    singular value of their moments is what is left of the two apart, and LEAST of a sound vehicle's is enough.
    """
    from scipy.linalg import null_space

    largest = np.max(np.abs(np.stack([np.asarray(limit) for limit in force_limits(thrusters)])), axis=0)
    T = np.asarray(thrusters.configuration) * largest
    span = np.linalg.norm(T[list(ANGLES)], axis=1)
    if not span.all():
        return np.ones(len(lost), dtype=bool)

    def both(health: Float[np.ndarray, " n"]) -> float:
        left = T * health
        moments = left[list(ANGLES)] / span[:, None] @ null_space(left[list(UPRIGHT)], rcond=RANK_TOLERANCE)
        return float(np.linalg.svd(moments, compute_uv=False)[-1]) if moments.shape[1] >= 2 else 0.0

    sound = both(np.ones(thrusters.count))
    return np.array([both(1.0 - row) >= LEAST * sound for row in lost])


def _pitches(model: Model, lost: Float[np.ndarray, " n"], heave: float) -> bool:
    """Whether full heave thrust [N] of what is left pitches the vehicle by more than TILTS."""
    T = configuration_about_cg(model) * (1.0 - lost)
    moment = heave * float(T[PITCH] @ np.linalg.pinv(T[list(UPRIGHT)], rcond=RANK_TOLERANCE)[:, HEAVE])
    return bool(abs(moment) > np.tan(TILTS) * max(float(hang(model).stiffness[1]), 0.0))


_remaining = jit_once(jax.vmap(remaining, in_axes=(None, 0)))
_authority_of = once_and_for_all(ControlAuthority._of)
