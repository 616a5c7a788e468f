"""Steady windows of a record, found automatically.

A window is steady when each third of it has the mean of the whole, but for the tolerance and what noise explains:

    |mean of a third - mean| <= tolerance x max(|mean|, rest) + 2 standard errors

and its first and last block too, within 3. Three thirds see a slope as well as an exponential tail, which a straight
line through a window averages away; the ends keep ramps out. Noise is estimated from differences of neighbouring
blocks, which no slow motion enters. The longest steady window is taken first, then the longest in what is left; one
that lies beside a longer window and hardly differs from it is the end of its transient and left out.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.arrays.stretches import stretches
from rovtwin.core.errors import IdentificationError

REST = 0.1  # share of the largest speed below which a window counts as rest, where nothing else is said
TAIL = 0.2  # a window beside a longer one whose mean differs by less than this share is the end of its transient
BLOCKS = 9  # of the shortest window: three in each third
MOST_BLOCKS, MOST_WINDOWS = 6000, 400_000  # of a record; how many are tried, the longest left out


@dataclass(frozen=True)
class Window:
    """A steady part of a record.

    Attributes:
        start: [s]
        end: [s]
        mean: Of the velocity.
        std: Standard deviation of the mean, from the scatter of the blocks.
        drift: Mean of the last third less that of the first.
        force: Mean of the force, if one was given; NaN else.
        force_std: Standard deviation of that mean; NaN else.
        rest: Whether the vehicle stands still, so that the force is the tare.
    """

    start: float
    end: float
    mean: float
    std: float
    drift: float
    force: float = np.nan
    force_std: float = np.nan
    rest: bool = False

    @property
    def duration(self) -> float:
        """[s]"""
        return self.end - self.start


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Means over blocks of equal duration, and running sums of them."""

    edges: Float[np.ndarray, " edges"]
    mean: Float[np.ndarray, " blocks"]
    sums: Float[np.ndarray, " edges"]
    noise: float

    @classmethod
    def of(
        cls, t: Float[np.ndarray, " n"], value: Float[np.ndarray, " n"], edges: Float[np.ndarray, " edges"]
    ) -> "_Blocks":
        row = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(edges) - 2)
        count = np.bincount(row, minlength=len(edges) - 1)
        with np.errstate(invalid="ignore"):
            mean = np.where(count > 0, np.bincount(row, value, len(edges) - 1) / np.maximum(count, 1), np.nan)
        steps = np.diff(mean[np.isfinite(mean)])
        noise = 1.4826 * float(np.median(np.abs(steps - np.median(steps)))) / np.sqrt(2) if len(steps) else 0.0
        return cls(edges, mean, np.concatenate([[0.0], np.cumsum(mean)]), noise)

    def means(self, first: Int[np.ndarray, " w"], last: Int[np.ndarray, " w"]) -> Float[np.ndarray, " w"]:
        """Mean of the blocks first to last - 1."""
        return (self.sums[last] - self.sums[first]) / np.maximum(last - first, 1)

    def steady(
        self, first: Int[np.ndarray, " w"], last: Int[np.ndarray, " w"], tolerance: float, least: float, slow: float
    ) -> Bool[np.ndarray, " w"]:
        """The criterion, for many windows at once."""
        length = last - first
        cut, end = first + length // 3, last - length // 3
        mean = self.means(first, last)
        allowed = tolerance * np.maximum(np.abs(mean), least)
        thinner = np.sqrt(np.maximum(length // 3, 1))
        third = allowed + 2 * np.hypot(self.noise, slow) / thinner
        block = allowed + 3 * np.hypot(self.noise, slow)
        thirds = [(first, cut), (cut, end), (end, last)]
        within = [np.abs(self.means(a, b) - mean) <= third for a, b in thirds]
        return np.all([*within, *(np.abs(self.mean[i] - mean) <= block for i in (first, last - 1))], axis=0)


def steady_windows(
    t: Float[np.ndarray, " n"],
    velocity: Float[np.ndarray, " n"],
    force: Float[np.ndarray, " n"] | None = None,
    *,
    shortest: float = 2.0,
    tolerance: float = 0.01,
    force_tolerance: float = 0.05,
    rest: float | None = None,
    slow: float = 0.0,
    name: str = "record",
) -> list[Window]:
    """Steady windows in order of time, rest included.

    Args:
        t: Times [s], increasing.
        velocity: In one direction; NaN where nothing is known: no window crosses it.
        force: That holds it; where given it must be steady too.
        shortest: Duration of the shortest window [s].
        tolerance: Of the velocity, as a share of its mean.
        force_tolerance: The same of the force.
        slow: Standard deviation of velocity errors that neighbouring blocks share, as of a smoother: of the mean of a
            block. They do not show in the differences of blocks.
        rest: Speed up to which a window counts as rest; None takes a tenth of the largest.
        name: For messages.

    Raises:
        IdentificationError: Shapes that differ, times that do not increase, or a record shorter than one window.
    """
    t, velocity = np.asarray(t, float), np.asarray(velocity, float)
    others = [] if force is None else [np.asarray(force, float)]
    if t.ndim != 1 or any(x.shape != t.shape for x in (velocity, *others)):
        raise IdentificationError(f"{name}: times, velocities and forces must be as many; found {t.shape} times")
    if len(t) < 2 * BLOCKS or not np.all(np.diff(t) > 0):
        raise IdentificationError(f"{name}: expected at least {2 * BLOCKS} readings at increasing times")
    if t[-1] - t[0] < shortest:
        raise IdentificationError(
            f"{name}: lasts {t[-1] - t[0]:.3g} s, shorter than the shortest steady window, {shortest:g} s"
        )
    block = max(shortest / BLOCKS, (t[-1] - t[0]) / MOST_BLOCKS, 2 * float(np.median(np.diff(t))))
    edges = np.linspace(t[0], t[-1], max(int((t[-1] - t[0]) / block + 1e-9), 1) + 1)
    fewest = max(int(np.ceil(shortest / (edges[1] - edges[0]) - 1e-9)), 3)
    known = np.all([np.isfinite(x) for x in (velocity, *others)], axis=0)
    if not known.any():
        return []
    windows = []
    signals = [velocity, *others]
    least = [REST * float(np.quantile(np.abs(x[known]), 0.98)) for x in signals]
    if rest is not None:
        least[0] = rest
    criteria = list(zip((tolerance, force_tolerance), least, (slow, 0.0), strict=False))
    for a, b in stretches(_filled(t[known], edges)):
        inside = known & (t >= edges[a]) & (t <= edges[b])
        windows += _search(t[inside], [x[inside] for x in signals], edges[a : b + 1], fewest, criteria)
    return sorted(windows, key=lambda w: w.start)


def window_over(
    t: Float[np.ndarray, " n"],
    velocity: Float[np.ndarray, " n"],
    force: Float[np.ndarray, " n"],
    start: float,
    end: float,
    rest: float = 0.0,
) -> Window:
    """What a record says between two times, taken as steady; arguments as of `steady_windows`."""
    inside = (t >= start) & (t <= end)
    edges = np.linspace(start, end, BLOCKS + 1)
    blocks = [_Blocks.of(t[inside], x[inside], edges) for x in (velocity, force)]
    return _window(t, [velocity, force], blocks, 0, BLOCKS, rest)


def _filled(t: Float[np.ndarray, " n"], edges: Float[np.ndarray, " edges"]) -> Bool[np.ndarray, " blocks"]:
    """Which blocks hold readings, shape (len(edges) - 1,)."""
    return np.histogram(t, edges)[0] > 0


def _search(
    t: Float[np.ndarray, " n"],
    signals: list[Float[np.ndarray, " n"]],
    edges: Float[np.ndarray, " edges"],
    fewest: int,
    criteria: list[tuple[float, float, float]],
) -> list[Window]:
    """Longest first, in one stretch without gaps; criteria are tolerance, least mean and slow error of each signal."""
    count = len(edges) - 1
    if count < fewest:
        return []
    blocks = [_Blocks.of(t, x, edges) for x in signals]
    longest = max(MOST_WINDOWS // count, 4 * fewest)
    length = np.arange(fewest, min(longest, count) + 1)
    first, last = (
        x.ravel() for x in np.broadcast_arrays(np.arange(count)[:, None], np.arange(count)[:, None] + length)
    )
    first, last = first[last <= count], last[last <= count]
    good = np.all(
        [b.steady(first, last, *criterion) for b, criterion in zip(blocks, criteria, strict=True)],
        axis=0,
    )
    first, last = first[good], last[good]
    found = []
    while len(first):
        best = int(np.argmax(last - first))
        a, b = int(first[best]), int(last[best])
        one = _window(t, signals, blocks, a, b, criteria[0][1])
        if not any(_tail(one, other, fewest * (edges[1] - edges[0])) for other in found):
            found.append(one)
        apart = (last <= a) | (first >= b)
        first, last = first[apart], last[apart]
    return found


def _tail(window: Window, longer: Window, reach: float) -> bool:
    """Whether a window is but the last of the way to a longer one that lies beside it."""
    apart = max(window.start - longer.end, longer.start - window.end)
    return bool(apart < reach and abs(window.mean - longer.mean) < TAIL * abs(longer.mean))


def _window(
    t: Float[np.ndarray, " n"],
    signals: list[Float[np.ndarray, " n"]],
    blocks: list[_Blocks],
    a: int,
    b: int,
    least: float,
) -> Window:
    edges = blocks[0].edges
    third = (b - a) // 3
    inside = (t >= edges[a]) & (t <= edges[b])
    means = [float(np.mean(x[inside])) for x in signals]
    stds = [float(np.std(x.mean[a:b], ddof=1) / np.sqrt(b - a)) for x in blocks]
    drift = float(np.mean(blocks[0].mean[b - third : b]) - np.mean(blocks[0].mean[a : a + third]))
    force = (means[1], stds[1]) if len(signals) > 1 else (np.nan, np.nan)
    rest = abs(means[0]) <= least
    return Window(float(edges[a]), float(edges[b]), means[0], stds[0], drift, *force, rest=rest)
