"""Sensors of a later dive against those of the certified flight: rate, age, noise, and whether the filter agrees.

Both are flights, so that motion and vibration of thrusters are in both. Noise is that of neighbouring differences, as
on the bench. The filter's innovations, normalised, have a mean square of 1 where its model of a sensor is right.
"""

from collections.abc import Iterator

import numpy as np

from rovtwin.commission.bench import Readings
from rovtwin.commission.stage import Check
from rovtwin.core.log import Log
from rovtwin.core.sensors import SENSORS, kind_of

SLOWER = 0.7  # rate over that of then
LATER = 0.1  # age beyond that of then [s]
NOISIER = 2.0  # noise over that of then
SURPRISED = 2.0  # mean square of normalised innovations over that of then, or over 1 if that is larger
LEAST = 50  # readings, and scalar innovations, below which nothing is judged
LOOK = "look at how it is mounted, its cable and its water"


def compared(now: Log, then: Log) -> Iterator[Check]:
    """A line for each sensor of then: ok, or a warning that says what is other."""
    for channel in then:
        name = channel.removeprefix("sensor/")
        if channel == name or kind_of(name) not in SENSORS or kind_of(name) in ("battery", "leak"):
            continue
        before, found = Readings.of(then, name), Readings.of(now, name)
        if len(before.valid) >= LEAST:
            yield _sensor(name, found, before)
    yield from _consistent(now, then)


def _sensor(name: str, now: Readings, then: Readings) -> Check:
    if len(now.valid) < 2:
        return Check("warning", name, "no readings in this dive, in the certified flight there were some.")
    rates = f"{now.rate:.3g} Hz, then {then.rate:.3g} Hz"
    if now.rate < SLOWER * then.rate:
        return Check("warning", name, f"slower: {rates}.")
    ages = f"{1e3 * now.age:.0f} ms old, then {1e3 * then.age:.0f}"
    if now.age > then.age + LATER:
        return Check("warning", name, f"later: {ages}.", "Look at the link and the clocks.")
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = float(np.nanmax(now.noise / then.noise)) if len(now.value) >= LEAST else np.nan
    if ratio > NOISIER:
        unit = SENSORS[kind_of(name)].units[0]
        text = f"noise {np.nanmax(now.noise):.2g} {unit}, then {np.nanmax(then.noise):.2g} ({ratio:.1f} times)."
        return Check("warning", name, text, f"{LOOK[:1].upper()}{LOOK[1:]}.")
    return Check("ok", name, f"{rates}; {ages}; noise {ratio:.2f} times")


def _consistent(now: Log, then: Log) -> Iterator[Check]:
    """A line for each sensor whose innovations the filter is surprised by."""
    before = _mean_squares(then)
    for name, square in _mean_squares(now).items():
        known = before.get(name)
        if known is not None and square > SURPRISED * max(known, 1.0):
            text = f"the filter is surprised: mean square of innovations {square:.2g}, then {known:.2g}, expected 1."
            yield Check("warning", f"filter, {name}", text, "Sensor or model is not as certified.")


def _mean_squares(log: Log) -> dict[str, float]:
    """Of normalised innovations, by sensor."""
    if "autopilot/nis" not in log or "autopilot/nis_dof" not in log:
        return {}
    squares, numbers = log["autopilot/nis"], log["autopilot/nis_dof"]
    found = {}
    for i, name in enumerate(squares.channel.fields):
        number = float(numbers.values[:, i].sum())
        if number >= LEAST:
            found[name] = float(squares.values[:, i].sum()) / number
    return found
