"""Roll and pitch decay: inertia, damping and restoring from one release, as far as motion alone can tell.

A vehicle that is inclined and let go obeys (Fossen 2021, sec. 6.4, 4.1; thesis (2.22) with quadratic damping):

    J x'' + D_L x' + D_Q |x'| x' + k sin(x) = 0,   x = angle - offset,   k = W BG

J is the inertia with added mass. Multiplying J, D_L, D_Q and k by one factor changes nothing that can be seen: a
decay gives c = k/J, b = D_L/J and a = D_Q/J. Their scale comes from a known stiffness, a known inertia, or a second
decay with a known weight (`from_ballast`), and the result says which.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.decay_motion import swing, window
from rovtwin.identification.known import Known

LEAST_SWING = np.radians(2.0)  # a smaller one is nearer to the noise of a compass than to a test
LARGEST_ANGLE = 1.7  # [rad], 97 deg: nobody inclines a vehicle further, but 20 deg read as radians is beyond
WORST_FIT = 0.12  # rms of what is left over the first angle: a bad compass leaves 0.03
WIDEST = 0.25  # standard deviation of k/J over its value: beyond it a record is no decay
RATIOS = ("stiffness", "linear damping", "quadratic damping")  # each over inertia


@dataclass(frozen=True, eq=False)
class Moments:
    """The coefficients of the equation of motion.

    Attributes:
        values: Inertia with added mass J [kg m2], stiffness k = W BG [N m/rad], D_L [N m s/rad], D_Q [N m s2/rad2],
            shape (4,).
        covariance: Of `values`, shape (4, 4).
        scale: Where the scale comes from, in words.
    """

    values: np.ndarray
    covariance: np.ndarray
    scale: str

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of `values`, shape (4,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class Decay:
    """What one decay says.

    Attributes:
        ratios: c = k/J [1/s2], b = D_L/J [1/s], a = D_Q/J [1/rad], shape (3,).
        covariance: Of `ratios`, shape (3, 3), widened for residuals that are not white.
        offset: Angle at rest: trim and sensor offset together, which motion cannot tell apart [rad].
        offset_sd: Its standard deviation [rad].
        start: When the fit begins, just after the release [s]; `end`: when it ends.
        state: Angle from the offset [rad] and rate [rad/s] at `start`, shape (2,).
        rms: Of the residuals [rad].
        whiteness: How many neighbouring residuals count as one (1: white noise).
        moments: Coefficients with units, or None: ratios only.
        notes: What a reader must know, one line each.
        t, angle, fitted: The window: times [s], measured and fitted angle [rad], shape (n,).
    """

    ratios: np.ndarray
    covariance: np.ndarray
    offset: float
    offset_sd: float
    start: float
    end: float
    state: np.ndarray
    rms: float
    whiteness: float
    moments: Moments | None
    notes: tuple[str, ...]
    t: np.ndarray
    angle: np.ndarray
    fitted: np.ndarray

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of `ratios`, shape (3,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def verdict(self) -> str:
        """What the scale rests on, in words."""
        if self.moments is None:
            return "ratios only: no stiffness, inertia or ballast was given, and motion alone has no scale"
        return f"scale from {self.moments.scale}"


def fit_decay(
    t: np.ndarray,
    angle: np.ndarray,
    *,
    stiffness: Known | None = None,
    inertia: Known | None = None,
    quadratic: bool = True,
    source: str = "decay",
) -> Decay:
    """Fit the equation of motion to the angle after a release.

    The release is found by itself; angle and rate where the fit begins are free, so that neither rest nor a phase is
    assumed. Least squares on the angle, which is taken to have independent noise of one size.

    Args:
        t: Times [s], increasing, shape (n,).
        angle: Roll or pitch [rad], shape (n,); may hold the time before the release, when the vehicle is held.
        stiffness: W BG [N m/rad], W in newtons.
        inertia: About the axis, with added mass [kg m2].
        quadratic: Whether to fit quadratic damping too.
        source: For messages.

    Returns:
        Ratios, and coefficients with units where `stiffness` or `inertia` gives their scale (one of them, not both).

    Raises:
        IdentificationError: Too few readings, degrees, no release, no swing, or both scales given.
    """
    if stiffness is not None and inertia is not None:
        raise IdentificationError(f"{source}: found a stiffness and an inertia, expected one: a decay has their ratio")
    t, angle = checked(t, angle, source)
    part, guess = window(t, angle, source)
    t, angle = t[part], angle[part]
    held: tuple[int, ...] = () if quadratic else (2,)
    p, covariance, residual = _fit(t, angle, np.array(guess), held)
    notes: list[str] = []
    for i in (2, 1):  # a negative coefficient of damping is noise: the twin must not gain energy from it
        if p[i] < 0 and i not in held:
            sd = np.sqrt(covariance[i, i])
            notes.append(f"{RATIOS[i]}: fitted {p[i]:.3g} +- {sd:.2g}, not positive; taken as 0")
            held = (*held, i)
            p, covariance, residual = _fit(t, angle, np.array(guess), held)
    _believable(p, covariance, residual, source)
    result = Decay(
        ratios=p[:3],
        covariance=covariance[:3, :3],
        offset=float(p[3]),
        offset_sd=float(np.sqrt(covariance[3, 3])),
        start=float(t[0]),
        end=float(t[-1]),
        state=p[4:],
        rms=float(np.sqrt(np.mean(residual**2))),
        whiteness=correlated(residual),
        moments=None,
        notes=(*notes, *_remarks(p, covariance, residual, t)),
        t=t,
        angle=angle,
        fitted=angle + residual,
    )
    return scaled(result, stiffness=stiffness, inertia=inertia)


def _fit(
    t: np.ndarray, angle: np.ndarray, guess: np.ndarray, held: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters (c, b, a, offset, angle, rate), their covariance and the residuals; those `held` are 0."""
    step = 0.1 / np.sqrt(guess[0])  # of RK4: its error is 1e-7 of the angle, far below any sensor's
    free = np.array([i for i in range(6) if i not in held])

    def filled(q: np.ndarray) -> np.ndarray:
        p = np.zeros(6)
        p[free] = q
        return p

    def error(q: np.ndarray) -> np.ndarray:
        c, b, a, offset, x, rate = filled(q)
        return offset + swing(t, (x, rate), c, b, a, step) - angle

    found = least_squares(error, guess[free], x_scale=np.maximum(np.abs(guess), 0.1)[free])
    n, k = found.jac.shape
    variance = float(found.fun @ found.fun) / max(n - k, 1) * correlated(found.fun)
    covariance = np.zeros((6, 6))
    covariance[np.ix_(free, free)] = np.linalg.pinv(found.jac.T @ found.jac) * variance
    return filled(found.x), covariance, found.fun


def _believable(p: np.ndarray, covariance: np.ndarray, residual: np.ndarray, source: str) -> None:
    """Raise where what was fitted is no swing back from a tilt, or says nothing of it."""
    missed = float(np.sqrt(np.mean(residual**2))) / max(abs(p[4]), 1e-9)
    if p[0] <= 0 or missed > WORST_FIT:
        raise IdentificationError(
            f"{source}: no free swing fits: {100 * missed:.0f} % of the first angle is left, k/J is {p[0]:.3g} 1/s2; "
            "expected a tilt, a release, and nobody touching the vehicle after it"
        )
    if np.sqrt(covariance[0, 0]) > WIDEST * p[0]:
        raise IdentificationError(
            f"{source}: k/J is {p[0]:.3g} +- {np.sqrt(covariance[0, 0]):.2g} 1/s2: too little of a swing is seen; tilt "
            "further and record until the vehicle is still"
        )


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
    said = f"a second decay with a known weight ({added_stiffness:.3g} N m/rad, {added_inertia:.3g} kg m2)"
    return replace(decay, moments=Moments(values, covariance, said))


def checked(t: np.ndarray, angle: np.ndarray, source: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and angle as float arrays, in radians and increasing, or an error that says what is wrong."""
    t, angle = np.asarray(t, float), np.asarray(angle, float)
    if t.ndim != 1 or t.shape != angle.shape:
        raise IdentificationError(f"{source}: times {t.shape} and angles {angle.shape}, expected two equal columns")
    keep = np.isfinite(t) & np.isfinite(angle)
    t, angle = t[keep], angle[keep]
    if len(t) < 20:
        raise IdentificationError(f"{source}: found {len(t)} readings, expected at least 20 over two or more swings")
    if (np.diff(t) <= 0).any():
        at = int(np.argmax(np.diff(t) <= 0))
        raise IdentificationError(f"{source}: time goes from {t[at]:g} to {t[at + 1]:g} s, expected it to increase")
    angle = np.unwrap(angle) if np.abs(angle).max() <= np.pi else angle
    if np.abs(angle - np.median(angle)).max() > LARGEST_ANGLE:
        raise IdentificationError(
            f"{source}: an angle of {np.abs(angle).max():.3g} rad looks like degrees; name the column ..._deg "
            "or convert it to radians"
        )
    if np.ptp(angle) < LEAST_SWING:
        raise IdentificationError(
            f"{source}: the angle moves {np.degrees(np.ptp(angle)):.2g} deg in all, expected a release from 5 deg up"
        )
    return t, angle


def correlated(residual: np.ndarray) -> float:
    """How many neighbouring residuals count as one: 1 + 2 sum of the autocorrelation up to its first small value."""
    n = len(residual)
    x = residual - residual.mean()
    power = float(x @ x)
    if n < 10 or power == 0:
        return 1.0
    total = 1.0
    for lag in range(1, n // 4):
        r = float(x[lag:] @ x[:-lag]) / power
        if r < 2 / np.sqrt(n):
            break
        total += 2 * r
    return total


def _remarks(p: np.ndarray, covariance: np.ndarray, residual: np.ndarray, t: np.ndarray) -> list[str]:
    """What a reader must know about a fit."""
    notes = []
    if covariance[1, 1] and covariance[2, 2]:
        r = covariance[1, 2] / np.sqrt(covariance[1, 1] * covariance[2, 2])
        if (np.sqrt(np.diag(covariance))[1:3] > 0.3 * p[1:3]).any():
            notes.append(
                f"linear and quadratic damping: their sum is known, each alone is not (correlation {r:.2f}); "
                "swings of more different size would part them"
            )
    if (count := correlated(residual)) > 3:
        notes.append(f"residuals are not white ({count:.0f} neighbours count as one): intervals are widened for it")
    turns = np.sqrt(p[0]) * (t[-1] - t[0]) / (2 * np.pi)
    if turns < 1:
        notes.append(f"only {turns:.2g} natural periods after the release: record until the vehicle is still")
    return notes
