"""Roll and pitch decay: inertia, damping and restoring from one release, as far as motion alone can tell.

A vehicle that is inclined and let go obeys (Fossen 2021, sec. 6.4, 4.1; thesis (2.22) with quadratic damping):

    J x'' + D_L x' + D_Q |x'| x' + k sin(x) = 0,   x = angle - offset,   k = W BG

J is the inertia with added mass. Multiplying J, D_L, D_Q and k by one factor changes nothing that can be seen: a
decay gives c = k/J, b = D_L/J and a = D_Q/J. Their scale comes from a known stiffness, a known inertia, or a second
decay with a known weight (`decay_scale.from_ballast`), and the result says which.
"""

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from rovtwin.core.arrays.correlation import neighbours
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.decay.motion import swing, window
from rovtwin.identification.decay.scale import RATIOS, Decay, scaled
from rovtwin.identification.known import Known

LEAST_SWING = np.radians(2.0)  # a smaller one is nearer to the noise of a compass than to a test
LARGEST_ANGLE = 1.7  # [rad], 97 deg: nobody inclines a vehicle further, but 20 deg read as radians is beyond
WORST_FIT = 0.12  # rms of what is left over the first angle: a bad compass leaves 0.03
WIDEST = 0.25  # standard deviation of k/J over its value: beyond it a record is no decay


def fit_decay(
    t: Float[np.ndarray, " n"],
    angle: Float[np.ndarray, " n"],
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
        t: Times [s], increasing.
        angle: Roll or pitch [rad]; may hold the time before the release, when the vehicle is held.
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
        whiteness=neighbours(residual),
        moments=None,
        notes=(*notes, *_remarks(p, covariance, residual, t)),
        t=t,
        angle=angle,
        fitted=angle + residual,
    )
    return scaled(result, stiffness=stiffness, inertia=inertia)


def _fit(
    t: Float[np.ndarray, " n"], angle: Float[np.ndarray, " n"], guess: Float[np.ndarray, "6"], held: tuple[int, ...]
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6 6"], Float[np.ndarray, " n"]]:
    """Parameters (c, b, a, offset, angle, rate), their covariance and the residuals; those `held` are 0."""
    step = 0.1 / np.sqrt(guess[0])  # of RK4: its error is 1e-7 of the angle, far below any sensor's
    free = np.array([i for i in range(6) if i not in held])

    def filled(q: Float[np.ndarray, " q"]) -> Float[np.ndarray, "6"]:
        p = np.zeros(6)
        p[free] = q
        return p

    def error(q: Float[np.ndarray, " q"]) -> Float[np.ndarray, " n"]:
        c, b, a, offset, x, rate = filled(q)
        return offset + swing(t, (x, rate), c, b, a, step) - angle

    found = least_squares(error, guess[free], x_scale=np.maximum(np.abs(guess), 0.1)[free])
    n, k = found.jac.shape
    variance = float(found.fun @ found.fun) / max(n - k, 1) * neighbours(found.fun)
    covariance = np.zeros((6, 6))
    covariance[np.ix_(free, free)] = np.linalg.pinv(found.jac.T @ found.jac) * variance
    return filled(found.x), covariance, found.fun


def _believable(
    p: Float[np.ndarray, "6"], covariance: Float[np.ndarray, "6 6"], residual: Float[np.ndarray, " n"], source: str
) -> None:
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


def checked(
    t: Float[np.ndarray, " n"], angle: Float[np.ndarray, " n"], source: str
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
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


def _remarks(
    p: Float[np.ndarray, "6"],
    covariance: Float[np.ndarray, "6 6"],
    residual: Float[np.ndarray, " n"],
    t: Float[np.ndarray, " n"],
) -> list[str]:
    """What a reader must know about a fit."""
    notes = []
    if covariance[1, 1] and covariance[2, 2]:
        r = covariance[1, 2] / np.sqrt(covariance[1, 1] * covariance[2, 2])
        if (np.sqrt(np.diag(covariance))[1:3] > 0.3 * p[1:3]).any():
            notes.append(
                f"linear and quadratic damping: their sum is known, each alone is not (correlation {r:.2f}); "
                "swings of more different size would part them"
            )
    if (count := neighbours(residual)) > 3:
        notes.append(f"residuals are not white ({count:.0f} neighbours count as one): intervals are widened for it")
    turns = np.sqrt(p[0]) * (t[-1] - t[0]) / (2 * np.pi)
    if turns < 1:
        notes.append(f"only {turns:.2g} natural periods after the release: record until the vehicle is still")
    return notes
