"""The four corners as tracks over time, and the bands that drawn ones make (`runs.ensemble.bands`)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.commission.proving.missions import CLEAR, FIRST
from rovtwin.runs.ensemble.bands import Axis, Band, Held, band_between, chance_together, held_against, unwrapped_to
from rovtwin.runs.scoring.scores import Flown

DRAWS, RANK = 79, 2  # the band from the second least to the second largest of 79 holds an 80th with 95 %
RATE = 10.0  # [1/s]
ALARM = 0.05  # chance that a true model is called untrue by one of the axes
TOGETHER = 0.025  # and by all of them together: the two least likely of 80
# Beyond a band by no more than that a flight is near it [m, deg]: half of the room that missions keep to walls. The
# better a vehicle is known, the narrower its bands, down to millimetres; what no parameter stands for (a firmware's
# dead zone, delays) then puts a good flight beside them.
TRACK = (*(Axis(name, "m", 0.5 * CLEAR) for name in ("north", "east", "depth")), Axis("heading", "deg", 5.0))
AXES, UNITS = tuple(axis.name for axis in TRACK), tuple(axis.unit for axis in TRACK)


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
class Corridor(Band):
    """The band of drawn tracks, with its times from leaving the first corner [s]."""

    t: Float[np.ndarray, " n"]


def band_of(tracks: Sequence[Track], rank: int = RANK) -> Corridor:
    """The band of drawn flights, up to the end of the shortest."""
    n = min(len(track.t) for track in tracks)
    drawn = np.stack([track.pose[:n] for track in tracks])
    drawn[:, :, 3] = unwrapped_to(drawn[:, :, 3], drawn[0, :, 3])
    return Corridor(**vars(band_between(drawn, rank)), t=tracks[0].t[:n])


def held(band: Corridor, flight: Track) -> list[Held]:
    """Each axis of a flight against the band of the drawn ones, over the time that both have."""
    return held_against(band, _alike(band, flight), TRACK, ALARM / len(TRACK))


def together(band: Corridor, flight: Track) -> float:
    """Chance of a flight as unlikely as this one on all axes together, see `chance_together`."""
    return chance_together(band, _alike(band, flight))


def _alike(band: Corridor, flight: Track) -> Float[np.ndarray, "n 4"]:
    """The pose of a flight over the time that it has in common with the band, headings unwrapped alike."""
    n = min(len(band.t), len(flight.t))
    pose = flight.pose[:n].copy()
    pose[:, 3] = unwrapped_to(pose[:, 3], band.middle[:n, 3])
    return pose
