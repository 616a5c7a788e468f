"""Bands of flights that differ by chance, and whether one more flight is one of them.

N flights of the twin are drawn; the vehicle's own is the one more. If the model is true, all N + 1 are alike, and at
any instant the vehicle's is as likely to be the least, the second, .. or the largest of them. The band from the r-th
least to the r-th largest of the N therefore holds it with probability (N + 1 - 2 r) / (N + 1), exactly and for any
distribution (order statistics; Wilks 1941): 95 % with r = 2 and N = 79.

Samples of one flight are correlated: a vehicle that is outside now is outside for a while. So the share of samples
inside scatters about 95 % far more than that many independent samples would. How much, the drawn flights say: each
of the N + 1 is held against the band of the N others, and the vehicle's share is judged by its rank among theirs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from rovtwin.commission.proving.missions import CLEAR, FIRST
from rovtwin.runs.scoring.scores import Flown

LEVEL = 0.95
DRAWS, RANK = 79, 2  # the band from the second least to the second largest of 79 holds an 80th with 95 %
AXES = ("north", "east", "depth", "heading")
UNITS = ("m", "m", "m", "deg")
RATE = 10.0  # [1/s]
ALARM = 0.05  # chance that a true model is called untrue, all axes together
# Beyond a band by no more than that a flight is near it [m, deg]: half of the room that missions keep to walls. The
# better a vehicle is known, the narrower its bands, down to millimetres; what no parameter stands for (a firmware's
# dead zone, delays) then puts a good flight beside them.
NEAR = (0.5 * CLEAR, 0.5 * CLEAR, 0.5 * CLEAR, 5.0)
Verdict = Literal["inside", "near", "outside"]


@dataclass(frozen=True)
class Track:
    """Estimates of a flight from when it left the first corner.

    Attributes:
        t: Times [s], RATE samples a second from 0.
        pose: North, east, depth [m] and heading, unwrapped [deg].
        began: Time of the flight that is 0 here [s].
    """

    t: Float[np.ndarray, " n"]
    pose: Float[np.ndarray, "n 4"]
    began: float


def track_of(
    t: Float[np.ndarray, " n"], eta: Float[np.ndarray, "n 6"], waypoint: Float[np.ndarray, " n"]
) -> Track | None:
    """From what was logged; None where the first corner was never left.

    Args:
        t: Times [s].
        eta: Estimated pose [m, rad].
        waypoint: Number of the one that is approached, from 0.
    """
    left = np.flatnonzero(waypoint >= FIRST + 1)
    if not left.size or left[0] == len(t) - 1:
        return None
    began = float(t[left[0]])
    grid = np.arange(0.0, t[-1] - began + 1e-6, 1.0 / RATE)
    psi = np.degrees(np.unwrap(eta[left[0] :, 5]))
    values = [*eta[left[0] :, :3].T, psi]
    pose = np.column_stack([np.interp(grid, t[left[0] :] - began, one) for one in values])
    return Track(grid, pose, began)


def track_of_flown(flown: Flown) -> Track | None:
    """Of a flight of the twin: what its filter estimates, which is what the log of a vehicle has."""
    return track_of(flown.t, flown.eta_hat, flown.mode[:, 2])


@dataclass(frozen=True)
class Band:
    """What N flights predict.

    Attributes:
        t: Times from leaving the first corner [s].
        drawn: All N flights [m, m, m, deg].
        low, high: The band.
        middle: The median flight.
        level: Chance that one more flight lies inside at an instant.
    """

    t: Float[np.ndarray, " n"]
    drawn: Float[np.ndarray, "N n 4"]
    low: Float[np.ndarray, "n 4"]
    high: Float[np.ndarray, "n 4"]
    middle: Float[np.ndarray, "n 4"]
    level: float


def band_of(tracks: Sequence[Track], rank: int = RANK) -> Band:
    """The band of drawn flights, up to the end of the shortest."""
    n = min(len(track.t) for track in tracks)
    drawn = np.stack([track.pose[:n] for track in tracks])
    drawn[:, :, 3] = _near(drawn[:, :, 3], drawn[0, :, 3])
    ordered = np.sort(drawn, axis=0)
    level = (len(tracks) + 1 - 2 * rank) / (len(tracks) + 1)
    return Band(tracks[0].t[:n], drawn, ordered[rank - 1], ordered[-rank], np.median(drawn, axis=0), level)


def _near(heading: Float[np.ndarray, "*axes n"], reference: Float[np.ndarray, " n"]) -> Float[np.ndarray, "*axes n"]:
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
    """

    axis: str
    inside: float
    samples: int
    effective: float
    usual: tuple[float, float]
    chance: float
    outside_by: float
    beyond: float

    @property
    def verdict(self) -> Verdict:
        """Inside as a flight of a true model is; near: not so, but by little; or outside."""
        if self.agrees:
            return "inside"
        return "near" if self.beyond <= NEAR[AXES.index(self.axis)] else "outside"

    @property
    def agrees(self) -> bool:
        """Whether the model may be true, by this axis; one of four, so each has a fourth of the alarms."""
        return self.chance > ALARM / len(AXES) + 1e-9


def held(band: Band, flight: Track, rank: int = RANK) -> list[Held]:
    """Each axis of a flight against the band of the drawn ones, over the time that both have."""
    n = min(len(band.t), len(flight.t))
    pose = flight.pose[:n].copy()
    pose[:, 3] = _near(pose[:, 3], band.middle[:n, 3])
    found = []
    for i, axis in enumerate(AXES):
        every = np.concatenate([band.drawn[:, :n, i], pose[None, :, i]])
        shares = shares_inside(every, rank)
        inside = float(np.mean((pose[:, i] >= band.low[:n, i]) & (pose[:, i] <= band.high[:n, i])))
        found.append(
            Held(
                axis,
                inside,
                n,
                effective_of(shares, band.level, n),
                (float(np.quantile(shares[:-1], 0.025)), float(np.quantile(shares[:-1], 0.975))),
                float(np.mean(shares <= shares[-1] + 1e-12)),
                *_outside_by(pose[:, i], band.low[:n, i], band.high[:n, i]),
            )
        )
    return found


def shares_inside(curves: Float[np.ndarray, "N n"], rank: int = RANK) -> Float[np.ndarray, " N"]:
    """Share of time that each curve is inside the band of all others."""
    order = np.argsort(np.argsort(curves, axis=0, kind="stable"), axis=0, kind="stable") + 1
    return np.mean((order > rank) & (order <= len(curves) - rank), axis=1)


def effective_of(shares: Float[np.ndarray, " N"], level: float, samples: int) -> float:
    """As how many independent samples shares of time vary: level (1 - level) over their variance, 1 to `samples`."""
    spread = float(np.var(shares, ddof=1))
    return float(np.clip(level * (1.0 - level) / max(spread, 1e-12), 1.0, samples))


def _outside_by(
    values: Float[np.ndarray, " n"], low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]
) -> tuple[float, float]:
    """Largest distance from the band, in its half-widths there and in its own unit."""
    away = np.maximum(np.maximum(low - values, values - high), 0.0)
    half = np.maximum(0.5 * (high - low), 1e-9)
    return float(np.max(away / half, initial=0.0)), float(np.max(away, initial=0.0))
