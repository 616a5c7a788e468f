"""Where the vehicle was in an earlier dive, for the chart. For a worker: to read a log takes time."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.datum import FARTHEST, Datum, datum_of
from rovtwin.core.errors import LogError
from rovtwin.core.log import Log
from rovtwin.core.log.info import log_of
from rovtwin.core.log.maps import places, tracks_in

MOST = 1500  # points of a dive
STEP = 0.1  # between two of them at least [m]
GAP = 5.0  # without a reading for so long, the line is broken [s]
PREFERRED = ("autopilot/eta", "truth/eta")  # what the vehicle estimated is what a plan was flown by


def track_of(folder: Path, datum: Datum, is_given: bool) -> dict[str, Any]:
    """Lines of [north, east] [m] in the plane of a datum.

    Args:
        folder: Of the run.
        datum: Of the chart.
        is_given: Whether that is a place, and not the default.

    Raises:
        LogError: It has no track, or lies about another datum than the chart.
    """
    log = Log.read(log_of(folder))
    name = next((one for one in PREFERRED if one in tracks_in(log)), None)
    if name is None or not len(log[name]):
        raise LogError(f"{folder.name}: has neither {' nor '.join(PREFERRED)}: there is no track to show")
    t, at = log[name].t, places(log[name])
    known = np.isfinite(at).all(axis=1)
    if not known.any():
        raise LogError(f"{folder.name}: {name} holds no place that is known: there is no track to show")
    here = _beside(at[known], datum_of(log.metadata), datum, is_given, folder.name)
    kept = thinned(here[:, :2])
    breaks = np.flatnonzero(np.diff(t[known][kept]) > GAP) + 1
    # A vehicle that stood still for a while has not gone out of sight.
    breaks = [k for k in breaks if _silent(t[known], kept[k - 1], kept[k])]
    return {"lines": [np.round(line, 2).tolist() for line in np.split(here[kept][:, :2], breaks)]}


def _silent(t: np.ndarray, first: int, last: int) -> bool:
    return bool(np.diff(t[first : last + 1]).max() > GAP)


def thinned(at: Float[np.ndarray, "n 2"]) -> np.ndarray:
    """Numbers of the points to keep: the first, the last, and one for each step of the way."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))])
    step = max(STEP, along[-1] / MOST)
    return np.unique(np.append(np.flatnonzero(np.diff(np.floor(along / step), prepend=-1.0)), len(at) - 1))


def _beside(
    at: Float[np.ndarray, "n 3"], own: Datum | None, datum: Datum, is_given: bool, name: str
) -> Float[np.ndarray, "n 3"]:
    """Places about a log's own datum as places about the chart's."""
    if own is None or (own.latitude, own.longitude) == (datum.latitude, datum.longitude):
        return at
    away = float(datum.distance(own.latitude, own.longitude))
    default = Datum()
    if not is_given or (own.latitude, own.longitude) == (default.latitude, default.longitude) or away > FARTHEST:
        raise LogError(
            f"{name}: its metres count from {own.latitude:.6f}, {own.longitude:.6f}, those of the chart from "
            f"{datum.latitude:.6f}, {datum.longitude:.6f}; expected both given, at most {FARTHEST / 1000:.0f} km apart"
        )
    latitude, longitude, _ = own.geodetic(at)
    return datum.position(latitude, longitude, at[:, 2])
