"""The motion behind a decay test: a damped swing, and where in a record it begins."""

from collections.abc import Sequence
from math import sin, sqrt

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline

from rovtwin.core.errors import IdentificationError

# Shares of the largest angle: where a swing is as good as over; near rest; far from it.
STILL, NEAR_REST, FAR = 0.05, 0.15, 0.5
GROWS = 1.6  # largest over the one before: below it may be a rest that is not yet known
LINGERS = 0.6  # share of the way from far to far on the other side spent near rest: 0.3 in a swing, more after a stop


def swing(
    t: Float[np.ndarray, " n"], state: Sequence[float], c: float, b: float, a: float, step: float
) -> Float[np.ndarray, " n"]:
    """Angle of x'' + b x' + a |x'| x' + c sin(x) = 0.

    RK4 in plain floats (a scalar equation is quickest so), then cubic Hermite between the steps.

    Args:
        t: Times [s], increasing; the state holds at t[0].
        state: Angle [rad] and rate [rad/s].
        c: Stiffness over inertia [1/s2].
        b: Linear damping over inertia [1/s].
        a: Quadratic damping over inertia [1/rad].
        step: Longest step [s].

    Returns:
        Angle [rad].
    """
    count = max(int(np.ceil((t[-1] - t[0]) / step)), 1)
    h = float(t[-1] - t[0]) / count
    x, v = float(state[0]), float(state[1])
    xs, vs = [x], [v]
    for _ in range(count):
        a1 = -(b + a * abs(v)) * v - c * sin(x)
        v2 = v + h / 2 * a1
        a2 = -(b + a * abs(v2)) * v2 - c * sin(x + h / 2 * v)
        v3 = v + h / 2 * a2
        a3 = -(b + a * abs(v3)) * v3 - c * sin(x + h / 2 * v2)
        v4 = v + h * a3
        a4 = -(b + a * abs(v4)) * v4 - c * sin(x + h * v3)
        x += h / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        if not abs(x) < 1e3:  # a trial of the optimiser that runs away: far off, but finite
            x, v = 1e3, 0.0
        xs.append(x)
        vs.append(v)
    grid = t[0] + h * np.arange(count + 1)
    return CubicHermiteSpline(grid, xs, vs)(t)


def releases(t: Float[np.ndarray, " n"], angle: Float[np.ndarray, " n"]) -> list[slice]:
    """The parts of a recording that hold one release each, in their order.

    A free swing passes through rest quickly, to the other side, and never further than before. Where the angle is far
    from rest again in another way, somebody has tilted the vehicle anew: a part ends before that and the next begins.

    Args:
        t: Times [s].
        angle: [rad].
    """
    x = angle - float(np.median(angle))
    top = float(np.abs(x).max())
    tilts = _far_from_rest(x, top)
    parts, begin = [], 0
    for (first, last), (again, until) in zip(tilts, tilts[1:], strict=False):
        between = np.abs(x[last:again]) < NEAR_REST * top
        same_side = x[first] * x[again] > 0
        grows = np.abs(x[again:until]).max() > GROWS * np.abs(x[first:last]).max()
        if same_side or grows or between.mean() > LINGERS:
            still = last + int(np.flatnonzero(between)[-1])
            still = int(np.searchsorted(t, t[still] - 0.1 * (t[still] - t[last])))  # before the hand touches it
            parts.append(slice(begin, still))
            begin = still
    return [*parts, slice(begin, len(t))]


def _far_from_rest(x: Float[np.ndarray, " n"], top: float) -> list[tuple[int, int]]:
    """First and one after the last sample of each stretch beyond FAR that does not come near rest between."""
    stretches: list[tuple[int, int]] = []
    apart = True
    for i, value in enumerate(np.abs(x) / top):
        if value > FAR:
            first = i if apart else stretches.pop()[0]
            stretches.append((first, i + 1))
            apart = False
        elif value < NEAR_REST:
            apart = True
    return stretches


def window(t: Float[np.ndarray, " n"], angle: Float[np.ndarray, " n"], source: str) -> tuple[slice, tuple[float, ...]]:
    """Where the free swing begins, and a first guess of its parameters.

    The vehicle is held on one side until it is let go. Its first passage through rest is found, and the swing begins
    where the angle has fallen to 90 % of what was held: surely after the release, which no one has to time.

    Args:
        t: Times [s].
        angle: [rad].
        source: For messages.

    Returns:
        The part of the record to fit, and the guess (c, b, a, offset, angle from the offset, rate).

    Raises:
        IdentificationError: No release is found.
    """
    rest = float(np.median(angle[t > t[-1] - 0.2 * (t[-1] - t[0])]))
    noise = 1.4826 * float(np.median(np.abs(np.diff(angle, 2)))) / sqrt(6) + 1e-9
    side = float(np.sign((angle - rest)[np.abs(angle - rest).argmax()]))
    x = side * (angle - rest)
    top = int(x.argmax())
    beyond = np.flatnonzero((x < -max(4 * noise, 0.02 * x[top])) & (np.arange(len(x)) > top))
    if not len(beyond):
        return _without_overshoot(t, x, angle, rest, top, source)
    crossing = top + int(np.flatnonzero(x[top : beyond[0]] > 0)[-1])
    quarter = _half_period(t, x, crossing, noise) / 2
    near = (t > t[crossing] - 1.7 * quarter) & (t <= t[crossing])
    held = float(np.quantile(x[near], 0.95)) if near.any() else float(x[top])
    begin = int(np.flatnonzero((x >= 0.9 * held) & (t <= t[crossing]))[-1])
    if begin + 20 > len(t):
        raise IdentificationError(
            f"{source}: the release is found at {t[begin]:.4g} s and only {len(t) - begin} readings follow, expected 20"
            " or more; record until the vehicle is still"
        )
    c = 1.1 * (np.pi / (2 * quarter)) ** 2
    rate = -0.4 * side * held * sqrt(c)
    return slice(begin, _over(t, x, begin, held, noise, quarter)), (
        c,
        0.3 * sqrt(c),
        0.1,
        rest,
        float(angle[begin] - rest),
        rate,
    )


def _over(
    t: Float[np.ndarray, " n"], x: Float[np.ndarray, " n"], begin: int, held: float, noise: float, quarter: float
) -> int:
    """Where the swing is over, with rest enough to know the offset: what comes later is not of this test."""
    last = begin + int(np.flatnonzero(np.abs(x[begin:]) > max(STILL * held, 4 * noise))[-1])
    return int(np.searchsorted(t, t[last] + 0.5 * (t[last] - t[begin]) + 8 * quarter))


def _half_period(t: Float[np.ndarray, " n"], x: Float[np.ndarray, " n"], crossing: int, noise: float) -> float:
    """From the first passage to the next one back; twice the fall before it where there is no second [s]."""
    trough = crossing + int(np.argmin(x[crossing:]))
    back = np.flatnonzero(x[trough:] > noise)
    fall = np.flatnonzero(x[: crossing + 1] >= 0.7 * x[: crossing + 1].max())
    fallen = 3 * float(t[crossing] - t[fall[-1]])
    return float(t[trough + back[0]] - t[crossing]) if len(back) else max(2 * float(t[trough] - t[crossing]), fallen)


def _without_overshoot(
    t: Float[np.ndarray, " n"],
    x: Float[np.ndarray, " n"],
    angle: Float[np.ndarray, " n"],
    rest: float,
    top: int,
    source: str,
) -> tuple[slice, tuple[float, ...]]:
    """A vehicle that creeps back: damped too much to swing through."""
    if x[-1] > 0.2 * x[top] or top >= len(t) - 20:
        raise IdentificationError(
            f"{source}: no release is found: the angle never returns from {np.degrees(x[top]):.3g} deg beside its rest;"
            " record from before the release until the vehicle is still"
        )
    begin = int(np.flatnonzero(x >= 0.9 * x[top])[-1])
    below = begin + int(np.flatnonzero(x[begin:] < 0.33 * x[top])[0])
    c = (1.5 / max(float(t[below] - t[begin]), 1e-3)) ** 2
    return slice(begin, None), (c, 2 * sqrt(c), 0.1, rest, float(angle[begin] - rest), 0.0)
