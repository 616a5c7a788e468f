"""Bands of flights that differ by chance, and whether one more flight is one of them.

N flights of the twin are drawn; the vehicle's own is the one more. If the model is true, all N + 1 are alike, and at
any instant the vehicle's is as likely to be the least, the second, .. or the largest of them. The band from the r-th
least to the r-th largest of the N therefore holds it with probability (N + 1 - 2 r) / (N + 1), exactly and for any
distribution (order statistics; Wilks 1941): 95 % with r = 2 and N = 79, or with r = 1 and N = 39.

Samples of one flight are correlated: a vehicle that is outside now is outside for a while. So the share of samples
inside scatters about 95 % far more than that many independent samples would. How much, the drawn flights say: each
of the N + 1 is held against the band of the N others, and the vehicle's share is judged by its rank among theirs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

Verdict = Literal["inside", "near", "outside"]


class Axis(NamedTuple):
    """What a band is of: its name, its unit, and up to what distance from the band a flight counts as near it."""

    name: str
    unit: str
    near: float


@dataclass(frozen=True)
class Band:
    """What N flights predict.

    Attributes:
        drawn: All N flights on k axes, sampled alike.
        low, high: The band.
        middle: The median flight.
        level: Chance that one more flight lies inside at an instant.
        rank: r.
    """

    drawn: Float[np.ndarray, "N n k"]
    low: Float[np.ndarray, "n k"]
    high: Float[np.ndarray, "n k"]
    middle: Float[np.ndarray, "n k"]
    level: float
    rank: int


def band_between(drawn: Float[np.ndarray, "N n k"], rank: int) -> Band:
    """The band from the `rank`-th least to the `rank`-th largest of drawn flights."""
    ordered = np.sort(drawn, axis=0)
    return Band(drawn, ordered[rank - 1], ordered[-rank], np.median(drawn, axis=0), level_of(len(drawn), rank), rank)


def level_of(count: int, rank: int) -> float:
    """Chance that one more is between the `rank`-th least and the `rank`-th largest of so many."""
    return (count + 1 - 2 * rank) / (count + 1)


def unwrapped_to(
    heading: Float[np.ndarray, "*axes n"], reference: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "*axes n"]:
    """Headings [deg] with whole turns added so that they lie within half a turn of a reference."""
    return reference + (heading - reference + 180.0) % 360.0 - 180.0


@dataclass(frozen=True)
class Held:
    """One axis of a flight against the band.

    Attributes:
        axis: Its name.
        inside: Share of samples inside.
        samples: How many.
        effective: As how many independent samples they vary.
        usual: Least and largest share that 95 % of the drawn flights have, held against each other.
        chance: Of a share this low or lower if the model is true.
        outside_by: Largest distance from the band, in its half-widths.
        beyond: The same in the axis's unit [m, deg].
        near: Distance up to which it counts as near the band [m, deg].
        alarm: Chance up to which the model is called untrue by this axis.
    """

    axis: str
    inside: float
    samples: int
    effective: float
    usual: tuple[float, float]
    chance: float
    outside_by: float
    beyond: float
    near: float
    alarm: float

    @property
    def verdict(self) -> Verdict:
        """Inside as a flight of a true model is; near: not so, but by little; or outside."""
        return "inside" if self.agrees else "near" if self.beyond <= self.near else "outside"

    @property
    def agrees(self) -> bool:
        """Whether the model may be true, by this axis."""
        return self.chance > self.alarm + 1e-9


def held_against(band: Band, flight: Float[np.ndarray, "n k"], axes: Sequence[Axis], alarm: float) -> list[Held]:
    """Each axis of a flight against the band of the drawn ones; `alarm` as in `Held`."""
    n, rows = len(flight), []
    for i, axis in enumerate(axes):
        every = np.concatenate([band.drawn[:, :n, i], flight[None, :, i]])
        shares = shares_inside(every, band.rank)
        low, high, value = band.low[:n, i], band.high[:n, i], flight[:, i]
        rows.append(
            Held(
                axis.name,
                float(np.mean((value >= low) & (value <= high))),
                n,
                effective_of(shares, band.level, n),
                (float(np.quantile(shares[:-1], 0.025)), float(np.quantile(shares[:-1], 0.975))),
                float(np.mean(shares <= shares[-1] + 1e-12)),
                *outside_by(value, low, high),
                axis.near,
                alarm,
            )
        )
    return rows


def chance_together(band: Band, flight: Float[np.ndarray, "n k"]) -> float:
    """Chance of a flight as unlikely as this one on all axes together, if the model is true.

    The logarithms of its chances on each axis are added (Fisher 1932), and the sum is ranked among those of the drawn
    flights: axes are correlated, so that no chi-square is taken.
    """
    n = len(flight)
    every = np.concatenate([band.drawn[:, :n], flight[None]])
    shares = np.stack([shares_inside(every[:, :, i], band.rank) for i in range(every.shape[2])])
    chances = np.mean(shares[:, None, :] <= shares[:, :, None] + 1e-12, axis=2)
    total = np.sum(np.log(chances), axis=0)
    return float(np.mean(total <= total[-1] + 1e-9))


def shares_inside(curves: Float[np.ndarray, "N n"], rank: int) -> Float[np.ndarray, " N"]:
    """Share of time that each curve is inside the band of all others."""
    return np.mean(inside_others(curves, rank), axis=1)


def inside_others(curves: Float[np.ndarray, "N n"], rank: int) -> Bool[np.ndarray, "N n"]:
    """Whether each curve is inside the band of all others, at each instant."""
    order = np.argsort(np.argsort(curves, axis=0, kind="stable"), axis=0, kind="stable") + 1
    return (order > rank) & (order <= len(curves) - rank)


def effective_of(shares: Float[np.ndarray, " N"], level: float, samples: int) -> float:
    """As how many independent samples shares of time vary: level (1 - level) over their variance, 1 to `samples`."""
    spread = float(np.var(shares, ddof=1))
    return float(np.clip(level * (1.0 - level) / max(spread, 1e-12), 1.0, samples))


def outside_by(
    values: Float[np.ndarray, " n"], low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]
) -> tuple[float, float]:
    """Largest distance from the band, in its half-widths there and in its own unit."""
    away = np.maximum(np.maximum(low - values, values - high), 0.0)
    half = np.maximum(0.5 * (high - low), 1e-9)
    return float(np.max(away / half, initial=0.0)), float(np.max(away, initial=0.0))
