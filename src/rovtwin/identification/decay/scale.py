"""What a decay says: ratios, and coefficients with units once something from outside gives their scale."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy import stats

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.known import Known

RATIOS = ("stiffness", "linear damping", "quadratic damping")  # each over inertia


@dataclass(frozen=True, eq=False)
class Moments:
    """The coefficients of the equation of motion.

    Attributes:
        values: Inertia with added mass J [kg m2], stiffness k = W BG [N m/rad], D_L [N m s/rad], D_Q [N m s2/rad2].
        covariance: Of `values`.
        scale: Where the scale comes from, in words.
    """

    values: Float[np.ndarray, "4"]
    covariance: Float[np.ndarray, "4 4"]
    scale: str

    @property
    def sd(self) -> Float[np.ndarray, "4"]:
        """Standard deviations of `values`."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class Decay:
    """What one decay says.

    Attributes:
        ratios: c = k/J [1/s2], b = D_L/J [1/s], a = D_Q/J [1/rad].
        covariance: Of `ratios`, widened for residuals that are not white.
        offset: Angle at rest: trim and sensor offset together, which motion cannot tell apart [rad].
        offset_sd: Its standard deviation [rad].
        start: When the fit begins, just after the release [s]; `end`: when it ends.
        state: Angle from the offset [rad] and rate [rad/s] at `start`.
        rms: Of the residuals [rad].
        whiteness: How many neighbouring residuals count as one (1: white noise).
        moments: Coefficients with units, or None: ratios only.
        notes: What a reader must know, one line each.
        t, angle, fitted: The window: times [s], measured and fitted angle [rad].
    """

    ratios: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "3 3"]
    offset: float
    offset_sd: float
    start: float
    end: float
    state: Float[np.ndarray, "2"]
    rms: float
    whiteness: float
    moments: Moments | None
    notes: tuple[str, ...]
    t: Float[np.ndarray, " n"]
    angle: Float[np.ndarray, " n"]
    fitted: Float[np.ndarray, " n"]

    @property
    def sd(self) -> Float[np.ndarray, "3"]:
        """Standard deviations of `ratios`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def verdict(self) -> str:
        """What the scale rests on, in words."""
        if self.moments is None:
            return "ratios only: no stiffness, inertia or ballast was given, and motion alone has no scale"
        return f"scale from {self.moments.scale}"


def scaled(decay: Decay, *, stiffness: Known | None = None, inertia: Known | None = None) -> Decay:
    """The same decay with units, from a known stiffness W BG [N m/rad] or inertia with added mass [kg m2]."""
    known = stiffness or inertia
    if known is None:
        return replace(decay, moments=None)
    if not (known.value > 0 and known.sd >= 0):
        raise IdentificationError(
            f"decay: found a known value of {known.value:g} +- {known.sd:g}, expected more than 0, its width 0 or more"
        )
    c, b, a = decay.ratios
    if stiffness is not None:
        J = known.value / c
        values = J * np.array([1.0, c, b, a])
        by_ratio = J * np.array([[-1 / c, 0, 0], [0, 0, 0], [-b / c, 1, 0], [-a / c, 0, 1]])
        scale = f"the stiffness given, {known.value:.4g} N m/rad"
    else:
        values = known.value * np.array([1.0, c, b, a])
        by_ratio = known.value * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        scale = f"the inertia given, {known.value:.4g} kg m2 with added mass"
    by_known = values / known.value
    covariance = by_ratio @ decay.covariance @ by_ratio.T + known.sd**2 * np.outer(by_known, by_known)
    return replace(decay, moments=Moments(values, covariance, scale))


def from_ballast(decay: Decay, ballasted: Decay, added_stiffness: float, added_inertia: float) -> Decay:
    """The scale of a decay from a second one with a known weight fixed to the vehicle.

    c = k/J and c' = (k + dk)/(J + dJ), hence J = (dk - c' dJ) / (c' - c): nothing is assumed about W BG.

    Args:
        decay: Without the weight.
        ballasted: With it.
        added_stiffness: dk = (mass - density volume) g z, z below the axis [N m/rad].
        added_inertia: dJ = mass r^2 and the added mass of the piece, r from the axis [kg m2].

    Raises:
        IdentificationError: The two decays do not differ by more than their uncertainty.
    """
    c, with_it = decay.ratios[0], ballasted.ratios[0]
    variance, of_it = decay.covariance[0, 0], ballasted.covariance[0, 0]
    gap = with_it - c
    J = (added_stiffness - with_it * added_inertia) / gap if gap else np.inf
    if not (0 < J < np.inf) or abs(gap) < 2 * np.sqrt(variance + of_it):
        raise IdentificationError(
            f"decay: k/J is {c:.4g} +- {np.sqrt(variance):.2g} without and {with_it:.4g} +- {np.sqrt(of_it):.2g} 1/s2 "
            f"with the weight, which adds {added_stiffness:g} N m/rad and {added_inertia:g} kg m2; no inertia follows."
            " Use more weight, further below the axis"
        )
    # J depends on this decay's own c: first order, by the values J (1, c, b, a).
    by_c, by_it = J / gap, -(J + added_inertia) / gap
    values = J * np.array([1.0, *decay.ratios])
    jacobian = np.zeros((4, 3))
    jacobian[1:] = J * np.eye(3)
    jacobian[:, 0] += values / J * by_c
    covariance = jacobian @ decay.covariance @ jacobian.T + of_it * by_it**2 * np.outer(values, values) / J**2
    text = f"a second decay with a known weight ({added_stiffness:.3g} N m/rad, {added_inertia:.3g} kg m2)"
    return replace(decay, moments=Moments(values, covariance, text))


def pooled(decays: list[Decay]) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Ratios of several decays of the same vehicle and axis together.

    Args:
        decays: Each with its ratios and covariance.

    Returns:
        Ratios, shape (3,), their covariance, shape (3, 3), and what a reader must know. Where the decays differ by more
        than their own uncertainty, the covariance is widened by as much (Birge 1932, Physical Review 40, 207).
    """
    free = np.array([any(d.covariance[i, i] > 0 for d in decays) for i in range(3)])
    information, weighted = np.zeros((3, 3)), np.zeros(3)
    for one in decays:
        weight = np.linalg.pinv(one.covariance)
        information += weight
        weighted += weight @ one.ratios
    covariance = np.linalg.pinv(information)
    ratios = np.where(free, covariance @ weighted, 0.0)
    apart = [one.ratios - ratios for one in decays]
    chi2 = sum(float(x @ np.linalg.pinv(d.covariance) @ x) for x, d in zip(apart, decays, strict=True))
    left = int(free.sum()) * (len(decays) - 1)
    if left and stats.chi2.sf(chi2, left) < 0.01:
        factor = chi2 / left
        text = f"the decays differ {np.sqrt(factor):.1f} times more than each says: intervals are widened by that"
        return ratios, covariance * factor, (text,)
    return ratios, covariance, ()


def together(
    decays: list[Decay],
    *,
    stiffness: Known | None = None,
    inertia: Known | None = None,
    ballasted: Decay | None = None,
    weight: tuple[float, float] | None = None,
) -> Decay:
    """One or several decays as one, with a scale if there is one.

    Args:
        decays: Of the same vehicle and axis; the first one's window is kept.
        stiffness: Known W BG [N m/rad].
        inertia: Known, with added mass [kg m2].
        ballasted: A decay with a known weight.
        weight: What it adds: stiffness [N m/rad] and inertia [kg m2].
    """
    one = decays[0]
    if len(decays) > 1:
        ratios, covariance, notes = pooled(decays)
        one = replace(one, ratios=ratios, covariance=covariance, notes=notes)
    if ballasted is not None and weight is not None:
        return from_ballast(one, ballasted, *weight)
    return scaled(one, stiffness=stiffness, inertia=inertia)
