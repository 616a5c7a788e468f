"""What flights of drawn vehicles predict of a mission, as plain data: for a page, for a file, for the comparison.

docs/console.md lists what is in it.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import as_array, jax
from rovtwin.runs.compose.world import relief_of
from rovtwin.runs.ensemble.bands import Band, band_between, inside_others, level_of
from rovtwin.runs.ensemble.course import AXES, BEGINS, GOES, REACHED, headings_near
from rovtwin.runs.ensemble.efforts import foreseen
from rovtwin.runs.ensemble.rehearsal import RANK, Figures, Rehearsal
from rovtwin.runs.ensemble.remarks import remarks
from rovtwin.scenario.schema import Scenario

FEWEST = 9  # drawn flights that a band is made of: 80 %
WATT_HOUR = 3600.0  # [J]
PRIVATE = ("inside", "bands")  # what only the comparison needs


def forecast(rehearsal: Rehearsal, nominal: Figures, drawn: Sequence[Figures] = ()) -> dict[str, Any]:
    """What is predicted, from the nominal flight alone or with drawn ones.

    Intervals and bands are those of the drawn flights that come as far as the nominal one.
    """
    reached = nominal.completed
    alike = [one for one in drawn if one.completed >= reached and (bool(one.ended) == bool(nominal.ended))]
    n = reached * rehearsal.course.each
    band = _band(nominal, alike, n)
    return {
        "vehicle": rehearsal.base.vehicle.name,
        "identified": rehearsal.base.vehicle.file.identified is not None,
        "drawn_from": rehearsal.plants.description,
        "draws": len(drawn),
        "alike": len(alike),
        "level": None if band is None else level_of(len(alike), RANK),
        "completed": not nominal.ended,
        "ended": nominal.ended,
        "places": rehearsal.course.places.round(3).tolist(),
        "track": _track(rehearsal, nominal, band, n),
        "profile": _profile(rehearsal, nominal, alike if band is not None else [], band, n),
        "points": _points(nominal, alike if band is not None else []),
        "time_s": _interval(nominal.lasting, [one.lasting for one in alike], band),
        "energy_wh": _interval(nominal.whole / WATT_HOUR, [one.whole / WATT_HOUR for one in alike], band),
        "charge": _charge(rehearsal, nominal, alike, band),
        "margin": _least(nominal, alike),
        "nearest_m": {name: _least_of(name, nominal, alike) for name in nominal.nearest},
        "remarks": [asdict(one) for one in remarks(nominal, drawn)],
        "effort": [vars(one) for one in foreseen([one.effort for one in alike])] if band is not None else [],
        "bands": None if band is None else {"low": _thin(band.low), "high": _thin(band.high)},
        "inside": _inside(band, rehearsal.course.each),
    }


def for_page(data: dict[str, Any]) -> dict[str, Any]:
    """What a page shows of it."""
    return {name: value for name, value in data.items() if name not in PRIVATE}


def _band(nominal: Figures, alike: Sequence[Figures], n: int) -> Band | None:
    if len(alike) < FEWEST or not n:
        return None
    curves = np.stack([one.curves[:n] for one in alike])
    return band_between(headings_near(curves, nominal.curves[:n]), RANK)


def _inside(band: Band | None, each: int) -> dict[str, list[list[int]]]:
    """Of each axis: how many of the `each` samples of each way-point a drawn flight is inside the band of the others.

    One list a flight. Counts, so that a flight of only a part of the way is compared with the same part of theirs.
    """
    if band is None:
        return {}
    rows = {axis.name: inside_others(band.drawn[:, :, i], RANK) for i, axis in enumerate(AXES)}
    return {name: inside.reshape(len(inside), -1, each).sum(axis=2).tolist() for name, inside in rows.items()}


def _track(rehearsal: Rehearsal, nominal: Figures, band: Band | None, n: int) -> dict[str, Any]:
    """The nominal path, and the edges of the corridor: places [m]."""
    place = nominal.place[:n]
    edges = {} if band is None else {"port": band.low[:, 0], "starboard": band.high[:, 0]}
    sides = {name: _thin(rehearsal.course.beside(place, across)) for name, across in edges.items()}
    return {"place": _thin(place)} | sides


def _profile(
    rehearsal: Rehearsal, nominal: Figures, alike: Sequence[Figures], band: Band | None, n: int
) -> dict[str, Any]:
    """Depths along the way, over the time of the nominal flight: planned, flown, its band, of hull and floor [m]."""
    course = rehearsal.course
    t = course.instants(nominal.times)[:n]
    depths = course.places[: nominal.completed + 1, 2]
    whens = nominal.times[: nominal.completed, [BEGINS, GOES, REACHED]]
    planned = np.stack([whens, np.stack([depths[:-1], depths[1:], depths[1:]], axis=1)], axis=2).reshape(-1, 2)
    profile = {"t": _thin(t, 1), "depth": _thin(nominal.curves[:n, 1]), "planned": _thin(planned, 2)}
    if band is not None:
        profile |= {"low": _thin(band.low[:, 1]), "high": _thin(band.high[:, 1])}
    if nominal.clearance is not None:
        floor = _floor_at(rehearsal.scenario, nominal.place[:n])
        least = [one.clearance[:n] for one in (nominal, *alike) if one.clearance is not None]
        profile |= {"floor": _thin(floor), "hull": _thin(floor - np.min(least, axis=0))}
    return profile


def _floor_at(scenario: Scenario, place: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Depth of the floor under places [m]."""
    relief = relief_of(scenario.world)
    if relief is None or not len(place):
        return np.full(len(place), float(scenario.world.floor or 0.0))
    return np.asarray(jax.vmap(lambda at: relief.under(at)[0])(as_array(place)))


def _points(nominal: Figures, alike: Sequence[Figures]) -> list[dict[str, Any]]:
    """Of each way-point that is reached: when [s], and the least margin of thrust on the way."""
    rows = []
    for k in range(nominal.completed):
        times = [float(one.times[k, REACHED]) for one in alike]
        row: dict[str, Any] = {"reached": round(float(nominal.times[k, REACHED]), 2)}
        row |= {"margin": round(float(nominal.margin[k]), 4)}
        if times:
            least = min(float(one.margin[k]) for one in alike)
            row |= {"early": round(min(times), 2), "late": round(max(times), 2), "least_margin": round(least, 4)}
        if nominal.left is not None:
            row["left"] = round(float(nominal.left[k]), 4)
        rows.append(row)
    return rows


def _interval(value: float, others: Sequence[float], band: Band | None) -> dict[str, float]:
    """A value, and the least and largest of those of drawn flights."""
    row = {"value": round(value, 4)}
    return row if band is None else row | {"low": round(min(others), 4), "high": round(max(others), 4)}


def _charge(
    rehearsal: Rehearsal, nominal: Figures, alike: Sequence[Figures], band: Band | None
) -> dict[str, float] | None:
    """Share of the battery at the start and at the end; None without one."""
    if nominal.remains is None:
        return None
    ends = [one.remains for one in alike if one.remains is not None]
    return {"start": rehearsal.charge} | _interval(nominal.remains, ends, band)


def _least(nominal: Figures, alike: Sequence[Figures]) -> float | None:
    """Least margin of thrust of all flights; None where no way-point was reached."""
    every = np.concatenate([one.margin for one in (nominal, *alike)])
    return float(np.nanmin(every)) if np.isfinite(every).any() else None


def _least_of(name: str, nominal: Figures, alike: Sequence[Figures]) -> float:
    return round(min(one.nearest[name] for one in (nominal, *alike)), 3)


def _thin(values: Float[np.ndarray, "..."], decimals: int = 3) -> list[Any]:
    return np.round(values, decimals).tolist()
