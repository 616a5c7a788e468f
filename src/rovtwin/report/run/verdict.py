"""The scores of a run as a table and in plain sentences."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovtwin.core.flow import FAIL_SAFE_PHASES
from rovtwin.core.user_files.quantity import is_number
from rovtwin.report.flight import Flight
from rovtwin.report.parts.verdict import Score, Verdict

# key: name, unit, factor from SI, digits, what it means
_SCORES: dict[str, tuple[str, str, float, int, str]] = {
    "duration_s": ("Duration", "s", 1, 0, "from arming to the end"),
    "cross_track_rms_m": ("Cross-track error, rms", "m", 1, 3, "true distance to the commanded path, on legs"),
    "cross_track_max_m": ("Cross-track error, largest", "m", 1, 3, "after the first dive"),
    "depth_rms_m": ("Depth error, rms", "m", 1, 4, "truth against command, after the first dive"),
    "altitude_rms_m": ("Altitude error, rms", "m", 1, 3, "true distance to the floor against the desired one, on legs"),
    "station_rms_m": ("Distance to the station, rms", "m", 1, 3, "while holding it"),
    "station_max_m": ("Distance to the station, largest", "m", 1, 3, "while holding it"),
    "position_error_rms_m": ("Position error, rms (north, east)", "m", 1, 3, "estimate minus truth, whole run"),
    "nees_position_mean": ("NEES of horizontal position, mean", "-", 1, 2, "2 is expected of an honest observer"),
    "effort_n2s": ("Effort", "N² s", 1, 0, "integral of the summed squared thruster forces"),
    "energy_wh": ("Energy", "Wh", 1, 2, "taken from the batteries, hotel load included"),
    "saturated_share": ("Share of time saturated", "%", 100, 1, "a limit cut what the controller asked for"),
    "thruster_activity_n_per_s": ("Thruster activity", "N/s", 1, 2, "rms rate of change of the forces: wear and noise"),
}  # fmt: skip
HEADLINE = 60  # longest reason that stands in a headline [characters]
_BESIDE = {
    "position_error_rms_m": ("bound_position_m", "bound (surge, sway)"),
    "nees_position_mean": ("nees_position_interval", "95 % range"),
}


def verdict(flight: Flight) -> Verdict:
    """The verdict on a run from its summary, or, without one, from its phases."""
    summary = flight.summary
    good = summary.get("completed")
    good = good if isinstance(good, bool) else _completed(flight)
    sentences = [
        *_why(summary, good),
        *_about_decisions(summary),
        *[f"It {line}." for line in summary.get("touched") or []],
        *_sentences(summary, good is not False),
        *_about_supply(flight),
        *_about_place(flight),
    ]
    return Verdict(good, _headline(flight, good), sentences, scores(summary))


def scores(summary: Mapping[str, Any]) -> list[Score]:
    """The rows of the score table that the summary has figures for."""
    rows = []
    for key, (name, unit, factor, digits, meaning) in _SCORES.items():
        if (found := _numbers(summary.get(key))) is not None:
            other, label = _BESIDE.get(key, ("", ""))
            beside = _numbers(summary.get(other))
            label = "bound" if beside and len(beside) == 1 else label
            text = f"{label} {_format(beside, factor, digits, ' to ' if 'range' in label else ', ')}" if beside else ""
            rows.append(Score(name, _format(found, factor, digits), unit, text, meaning))
    return rows


def _completed(flight: Flight) -> bool | None:
    last = flight.phases[-1].phase if flight.phases else ""
    return {"finished": True, "aborted": False}.get(last)


def _headline(flight: Flight, good: bool | None) -> str:
    summary, (start, end) = flight.summary, flight.span
    seconds = _one(summary.get("duration_s"))
    seconds = end - start if seconds is None else seconds
    if summary.get("interrupted"):
        return f"Interrupted after {seconds:.0f} s"
    reason = _reason(summary)
    reason = reason if len(reason) <= HEADLINE else ""  # a long one is the first sentence below
    phase = str(summary.get("phase") or (flight.phases[-1].phase if flight.phases else ""))
    if good and summary.get("test"):
        return f"Test done in {seconds:.0f} s"
    if good:
        unmet = len(summary.get("unmet") or [])
        rest = f", {unmet} heading{'s' if unmet > 1 else ''} unmet" if unmet else ""
        return f"Completed in {seconds:.0f} s{rest}"
    if good is None:
        return f"Recording of {seconds:.0f} s"
    if phase in FAIL_SAFE_PHASES:
        return f"{phase.capitalize()} after {seconds:.0f} s: {reason or 'no reason given'}"
    tail = f" in phase “{phase}”" if phase else ""
    return f"Not completed: stopped after {seconds:.0f} s{tail}" + (f": {reason}" if reason else "")


def _reason(summary: Mapping[str, Any]) -> str:
    reason = str(summary.get("reason") or "")
    return reason.partition(": ")[2] if reason.startswith("not finished") else reason


def _why(summary: Mapping[str, Any], good: bool | None) -> list[str]:
    """The reason of a run that was not completed, where it is too long for the headline."""
    reason = str(summary.get("why") or "")
    if reason and not good:
        return [f"{reason[0].upper()}{reason[1:]}."]
    reason = _reason(summary)
    return [] if good or len(reason) <= HEADLINE else [f"{reason[0].upper()}{reason[1:]}."]


def _sentences(summary: Mapping[str, Any], good: bool) -> list[str]:
    found = (_about_path(summary), _about_position(summary, good), _about_nees(summary), _about_thrusters(summary))
    return [sentence for sentence in found if sentence]


def _about_decisions(summary: Mapping[str, Any]) -> list[str]:
    """What the autopilot decided on the way, one sentence each; of what comes again and again, when and how often."""
    known = [one for one in summary.get("decisions") or [] if {"t", "what", "cause"} <= set(one)]
    times: dict[str, list[float]] = {}
    for one in known:
        times.setdefault(_kind(one), []).append(one["t"])
    sentences = []
    for one in known:
        first, *again = times[_kind(one)]
        if one["t"] == first:
            more = "; again at " + ", ".join(f"{t:.0f}" for t in again) + " s" if again else ""
            sentences.append(f"At {one['t']:.1f} s: {one['what']} ({one['cause']}){more}.")
    return sentences


def _kind(one: Mapping[str, Any]) -> str:
    """What is the same in what is said of it each time; stalls are distinguished by whether thrusters may be weak."""
    if one["what"].startswith("no headway"):
        return f"no headway {'thrusters that give less' in one['cause']}"
    return f"{one['what']} ({one['cause']})"


def _about_path(summary: Mapping[str, Any]) -> str:
    rms, most, depth = (_one(summary.get(f"{key}_m")) for key in ("cross_track_rms", "cross_track_max", "depth_rms"))
    if rms is None or most is None:
        return ""
    text = f"On its legs the vehicle stayed within {most:.2f} m of the commanded path ({rms:.2f} m rms)"
    return text + (f" and held its depth to {_length(depth)} rms." if depth is not None else ".")


def _about_position(summary: Mapping[str, Any], good: bool) -> str:
    """Its error beside the bound; what is good of that only of a run that was not broken off."""
    error, bound = _numbers(summary.get("position_error_rms_m")), _numbers(summary.get("bound_position_m"))
    if error is None:
        return ""
    text = f"It knew its horizontal position to {_lengths(error)} rms (north and east)"
    if not bound or not all(np.isfinite(bound)) or min(bound) <= 0:
        return text + "."
    ratio = float(np.sqrt(np.mean(np.square(error)) / np.mean(np.square(bound))))
    against = f"the steady-state bound for this vehicle, sensors and disturbance is {_lengths(bound)}"
    if ratio < 1.3 and not good:
        return f"{text}; {against}."
    if ratio < 0.8:
        return f"{text}; {against}: this run was luckier than the average, or less disturbed than the bound assumes."
    if ratio < 1.3:
        return f"{text}; {against}, so the observer makes about the best of what it is given."
    return f"{text}; {against}, the error, start included, is {ratio:.1f} times the bound."


def overconfident(summary: Mapping[str, Any]) -> str:
    """That errors are larger than the filter's covariance says, where NEES lies above its interval; else nothing."""
    mean, interval = _one(summary.get("nees_position_mean")), _numbers(summary.get("nees_position_interval"))
    if mean is None or not np.isfinite(mean) or mean <= (interval or (1.0, 4.0))[1]:
        return ""
    return (
        f"the filter is overconfident, its errors are {float(np.sqrt(mean / 2)):.1f} times as large as its covariance "
        "says: a thruster, a sensor or the water may not be as described ('rovtwin watch' compares runs)"
    )


def _about_nees(summary: Mapping[str, Any]) -> str:
    mean = _one(summary.get("nees_position_mean"))
    if mean is None or not np.isfinite(mean) or mean <= 0:
        return ""
    low = (_numbers(summary.get("nees_position_interval")) or (1.0, 4.0))[0]
    start = f"NEES of the position is {mean:.3g} on average, 2 is expected"
    if above := overconfident(summary):
        return f"{start}: {above}."
    if mean < low:
        factor = float(np.sqrt(max(mean, 1e-12) / 2))
        return (
            f"{start}: the filter is too cautious, its errors are only {factor:.2f} times as large as its "
            "covariance says."
        )
    return f"{start}: the filter is as sure of itself as it may be."


def _about_thrusters(summary: Mapping[str, Any]) -> str:
    share = _one(summary.get("saturated_share"))
    if share is None:
        return ""
    if share < 0.005:
        return "The thrusters were practically never at their limits."
    return f"The thrusters could not give all that was asked for during {100 * share:.1f} % of the time" + (
        ": the mission asks for more than the vehicle has." if share > 0.25 else "."
    )


def _about_supply(flight: Flight) -> list[str]:
    """Batteries that ran empty, and the largest pull of a tether."""
    from rovtwin.report.run import supply  # with matplotlib, which the table after a flight does without

    empty = [f"Battery {name} empty at {t:.0f} s." for name, t in flight.emptied.items()]
    return empty + ([supply.about_tethers(flight)] if flight.tethers else [])


def _about_place(flight: Flight) -> list[str]:
    if flight.datum is None or not flight.start_on_map:
        return []
    return [f"On the map it began at {flight.start_on_map} (WGS 84); the clock's zero is {flight.datum.utc_start}."]


def _length(value: float) -> str:
    if value < 0.01:
        return f"{1000 * value:.1f} mm"
    return f"{1000 * value:.0f} mm" if value < 0.1 else f"{value:.2f} m"


def _lengths(values: list[float]) -> str:
    return " and ".join(_length(value) for value in values)


def _numbers(value: Any) -> list[float] | None:
    """A number or a list of numbers as a list; None when it is neither."""
    items = list(value) if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    if not items or not all(is_number(v) for v in items):
        return None
    return [float(v) for v in items]


def _one(value: Any) -> float | None:
    numbers = _numbers(value)
    return numbers[0] if numbers and len(numbers) == 1 else None


def _format(values: list[float], factor: float, digits: int, between: str = ", ") -> str:
    return between.join(_digits(factor * v, digits) for v in values)


def _digits(value: float, digits: int) -> str:
    if not np.isfinite(value):
        return "not a number" if np.isnan(value) else "infinite"
    if value and abs(value) < 10.0 ** -max(digits, 1) and abs(value) >= 1e-6:
        return np.format_float_positional(value, precision=3, fractional=False, trim="-")
    if abs(value) >= 1e9 or (value and abs(value) < 1e-6):
        return f"{value:.2e}"
    return f"{value:,.{digits}f}".replace(",", " ")
