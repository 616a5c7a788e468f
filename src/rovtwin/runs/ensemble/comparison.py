"""A flight held against what was predicted of it: its path in the corridor, its time, energy and effort."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Real

from rovtwin.core.errors import LogError
from rovtwin.core.flow import ENDS, FINISHED, HELD, PAUSED, PILOTED
from rovtwin.core.log import Log
from rovtwin.core.log.missions import missions_of
from rovtwin.core.numerics import as_array, jax
from rovtwin.runs.ensemble.bands import Verdict, outside_by
from rovtwin.runs.ensemble.course import AXES, LEFT, Course, headings_near, times_of
from rovtwin.runs.ensemble.efforts import Foreseen, agrees, effort
from rovtwin.runs.ensemble.exertion import Supply
from rovtwin.runs.ensemble.forecast import WATT_HOUR
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.constants import AXES as DIRECTIONS
from rovtwin.vehicle.physics.thrusters import lag, static_force

ELSEWHERE = 0.5  # the first leg does not count where it began farther than that from where it was rehearsed [m]
BY_HAND = (PAUSED, PILOTED)
OVER = (*ENDS, HELD)  # phases after which the mission is not gone on with


@dataclass(frozen=True)
class Sortie:
    """A mission as it was flown, from when it was started.

    Attributes:
        t: From its start [s].
        eta: Estimated pose [m, rad].
        nu: Estimated velocity [m/s, rad/s].
        tau: Wrench asked for [N, N m].
        mode: phase, reason, waypoint, on_leg.
        command: Of the thrusters, -1 to 1.
        power: Measured from the batteries [W]; None where nothing measures it.
    """

    t: Float[np.ndarray, " n"]
    eta: Float[np.ndarray, "n 6"]
    nu: Float[np.ndarray, "n 6"]
    tau: Float[np.ndarray, "n 6"]
    mode: Real[np.ndarray, "n 4"]
    command: Float[np.ndarray, "n thrusters"]
    power: Float[np.ndarray, " n"] | None = None

    @property
    def by_hand(self) -> bool:
        """Whether somebody paused or piloted it."""
        return bool(np.isin(self.mode[:, 0], BY_HAND).any())


def sortie_of(log: Log, places: Sequence[Sequence[float]]) -> Sortie:
    """Of the last mission in a log that was started with these way-points [m].

    Raises:
        LogError: There is none, or the log has no flight of it.
    """
    number, missions = -1, missions_of(log.metadata)
    for i, mission in enumerate(missions):
        points = [point.get("position") for point in mission.waypoints]
        if len(points) == len(places) and np.allclose(np.array(points, float), np.array(places, float), atol=2e-3):
            number = i
    if number < 0:
        raise LogError(f"found {len(missions)} missions in the log, expected the one that was rehearsed")
    began = max(missions[number].t, log["autopilot/eta"].t[0])
    ended = missions[number + 1].t if number + 1 < len(missions) else np.inf
    t = log["autopilot/eta"].t
    t = t[(t >= began - 1e-6) & (t < ended)]
    if len(t) < 2:
        raise LogError("found no flight of the mission in the log")
    mode = _at(log, "autopilot/mode", t, False)
    over = np.flatnonzero(np.isin(mode[:, 0], OVER))
    last = int(over[0]) + 1 if over.size else len(t)
    rows = t[:last]
    power = None
    if "sensor/battery" in log and len(log["sensor/battery"]):
        power = np.interp(rows, log["sensor/battery"].t, log.field("sensor/battery", "power"))
    return Sortie(
        rows - began,
        _at(log, "autopilot/eta", rows),
        _at(log, "autopilot/nu", rows),
        _at(log, "autopilot/tau", rows),
        mode[:last],
        _at(log, "autopilot/command", rows, False),
        power,
    )


def _at(log: Log, name: str, t: Float[np.ndarray, " n"], between: bool = True) -> Float[np.ndarray, "n _"]:
    """A channel's fields at times: between samples, or the sample before."""
    series = log[name]
    values = np.column_stack([series[field] for field in series.channel.fields]).astype(float)
    if between and name == "autopilot/eta":
        values[:, 3:] = np.unwrap(values[:, 3:], axis=0)
    if between:
        return np.column_stack([np.interp(t, series.t, one) for one in values.T])
    return values[np.clip(np.searchsorted(series.t, t + 1e-9, side="right") - 1, 0, len(series.t) - 1)]


def compared(predicted: Mapping[str, Any], flown: Sortie, vehicle: Vehicle, heading: float) -> dict[str, Any]:
    """A flight beside its forecast (`forecast.forecast`); `heading` [rad] is that at the forecast's start."""
    course = Course.of(np.array(predicted["places"]), heading)
    times = times_of(flown.t, flown.mode, course.count)
    away = float(np.linalg.norm(flown.eta[0, :3] - course.places[0]))
    first = 1 if away > ELSEWHERE and course.count > 1 else 0
    rows = _axes(predicted, course, times, course.sampled(flown.t, flown.eta, times), first)
    timed = not flown.by_hand and not first
    efforts = [] if flown.by_hand else _efforts(predicted, flown)
    verdicts = [one["verdict"] for one in (*rows, *efforts)]
    completed = bool(np.any(flown.mode[:, 0] == FINISHED))
    at = course.instants(times)
    place = [np.interp(at[np.isfinite(at)], flown.t, flown.eta[:, i]) for i in (0, 1)]
    depth = np.interp(at[np.isfinite(at)], flown.t, flown.eta[:, 2])
    return {
        "completed": completed,
        "reached": int(np.sum(np.isfinite(times[:, LEFT]))),
        "axes": rows,
        "effort": efforts,
        "time_s": _beside(predicted["time_s"], float(flown.t[-1])) if completed and timed else None,
        "energy_wh": _energy(predicted, flown, vehicle) if completed and timed else None,
        "verdict": next((word for word in ("outside", "near", "inside") if word in verdicts), "unknown"),
        "notes": _notes(flown, away, first, completed),
        "track": {"place": np.round(np.column_stack(place), 3).tolist(), "depth": np.round(depth, 3).tolist()},
    }


def _notes(flown: Sortie, away: float, first: int, completed: bool) -> list[str]:
    """What the comparison leaves out, and why."""
    notes = []
    if first:
        notes.append(f"it began {away:.1f} m from where it was rehearsed: the first leg, time and energy do not count")
    if flown.by_hand:
        notes.append("it was paused or piloted: time, energy and effort do not count")
    if not completed:
        notes.append("the mission was not completed: only the way-points that were reached count")
    return notes


def _axes(
    predicted: Mapping[str, Any],
    course: Course,
    times: Float[np.ndarray, "count 4"],
    curves: Float[np.ndarray, "n 3"],
    first: int,
) -> list[dict[str, Any]]:
    """Each axis of the path against its band, from way-point `first` on, as far as both come."""
    if predicted["bands"] is None:
        return []
    low, high = (np.array(predicted["bands"][name]).reshape(-1, 3) for name in ("low", "high"))
    reached = int(np.sum(np.isfinite(times[:, LEFT])))
    span = slice(first * course.each, min(reached * course.each, len(low)))
    if span.stop <= span.start:
        return []
    curves = headings_near(curves[span], 0.5 * (low[span] + high[span]))
    rows = []
    for i, axis in enumerate(AXES):
        inside = float(np.mean((curves[:, i] >= low[span, i]) & (curves[:, i] <= high[span, i])))
        counts = np.array(predicted["inside"][axis.name])[:, first : span.stop // course.each]
        shares = counts.sum(axis=1) / (span.stop - span.start)
        chance = float((1 + np.sum(shares <= inside + 1e-12)) / (1 + len(shares)))
        _, beyond = outside_by(curves[:, i], low[span, i], high[span, i])
        verdict: Verdict = "inside"
        if chance <= 1.0 / (1 + len(shares)) + 1e-9:  # less than any of the drawn ones
            verdict = "near" if beyond <= axis.near else "outside"
        row = {"axis": axis.name, "unit": axis.unit, "inside": inside, "least_usual": float(shares.min())}
        rows.append(row | {"chance": chance, "beyond": beyond, "verdict": verdict})
    return rows


def _efforts(predicted: Mapping[str, Any], flown: Sortie) -> list[dict[str, Any]]:
    """The effort along each axis that drawn flights agree about, as a ratio to the predicted one."""
    known, rows = [Foreseen(**one) for one in predicted["effort"]], []
    each = effort(flown.nu, flown.tau)
    for one in known:
        value = float(each[DIRECTIONS.index(one.axis)])
        verdict = "inside" if agrees(one, value, len(known)) else "outside"
        row = {"axis": one.axis, "ratio": value / one.middle, "interval_95": list(one.ratio()), "verdict": verdict}
        rows.append(row | {"chance": one.chance(value)})
    return rows


def _energy(predicted: Mapping[str, Any], flown: Sortie, vehicle: Vehicle) -> dict[str, Any]:
    """Energy used beside what was predicted [Wh], and what it is known by."""
    if flown.power is not None and vehicle.power_sources:  # else what is predicted has no loads beside the thrusters
        used, by = float(np.trapezoid(flown.power, flown.t)), "the battery's own power"
    else:
        supply, force = Supply.of(vehicle), _forces(flown, vehicle.model())
        used, by = float(supply.used(force, float(np.median(np.diff(flown.t))))[-1].sum()), "the thrusters' commands"
    return _beside(predicted["energy_wh"], used / WATT_HOUR) | {"by": by}


def _forces(flown: Sortie, model: Model) -> Float[np.ndarray, "n thrusters"]:
    """Forces that thrusters settle at by their commands, behind them by their lag [N]."""
    targets = jax.vmap(partial(static_force, model.thrusters))(as_array(flown.command))

    def follow(force: Any, step: Any) -> tuple[Any, Any]:
        after = lag(model.thrusters, force, *step)
        return after, after

    _, forces = jax.lax.scan(follow, targets[0], (targets[:-1], as_array(np.diff(flown.t))))
    return np.concatenate([np.asarray(targets[:1]), np.asarray(forces)])


def _beside(predicted: Mapping[str, float], value: float) -> dict[str, Any]:
    """A value that was flown, and whether it is in the interval that was predicted."""
    low, high = predicted.get("low"), predicted.get("high")
    inside = None if low is None or high is None else bool(low <= value <= high)
    return {"predicted": predicted["value"], "flown": value, "inside": inside}
