"""Sensors of a later dive against those of the certified flight: rate, age, noise, and whether the filter agrees.

Both are flights, so that vibration of thrusters is in both; motion differs, and noise is what neighbouring readings do
not explain by a straight line. What no part of the vehicle measures, as motion capture in a tank and acoustics at sea,
is another instrument in each place: it is noted, never warned of. The filter's innovations, normalised, have a mean
square of 1 where its model of a sensor is right.
"""

from collections.abc import Collection, Iterator

import numpy as np
from jaxtyping import Float

from rovtwin.commission.bench import Readings
from rovtwin.commission.stage import Check
from rovtwin.core.log import Log
from rovtwin.core.sensors import SENSORS, kind_of

SLOWER = 0.7  # rate over that of then
LATER = 0.1  # age beyond that of then [s]
NOISIER = 2.0  # noise over that of then
SURPRISED = 2.0  # mean square of normalised innovations over that of then, or over 1 if that is larger
LEAST = 50  # readings, and scalar innovations, below which nothing is judged
BLOCK = 25  # readings over which noise is averaged; a turn or a start is in few of them
LOOK = "Look at how it is mounted, its cable and its water."
BESIDE = "an instrument beside the vehicle, not compared"


def compared(now: Log, then: Log, beside: Collection[str] = ()) -> Iterator[Check]:
    """A line for each sensor of then: ok, a warning that says what is other, or a note.

    Args:
        now: The dive.
        then: The certified flight.
        beside: Kinds of sensors that no part of the vehicle is.
    """
    for channel in then:
        name = channel.removeprefix("sensor/")
        if channel == name or kind_of(name) not in SENSORS or kind_of(name) in ("battery", "leak"):
            continue
        before, found = Readings.of(then, name), Readings.of(now, name)
        if kind_of(name) in beside:
            yield Check("note", name, f"{BESIDE}: {_rate(found)}, then {_rate(before)}.")
        elif len(before.valid) >= LEAST:
            yield _sensor(name, found, before)
    for check in _consistent(now, then):
        other = kind_of(check.what.removeprefix("filter, ")) in beside
        yield Check("note", check.what, f"{check.text} {BESIDE[0].upper()}{BESIDE[1:]}.") if other else check


def _rate(readings: Readings) -> str:
    return f"{readings.rate:.3g} Hz" if len(readings.valid) > 1 else "no readings"


def _sensor(name: str, now: Readings, then: Readings) -> Check:
    if len(now.valid) < 2:
        return Check("warning", name, "no readings in this dive, in the certified flight there were some.")
    rates = f"{_rate(now)}, then {_rate(then)}"
    if now.rate < SLOWER * then.rate:
        return Check("warning", name, f"slower: {rates}.")
    ages = f"{1e3 * now.age:.0f} ms old, then {1e3 * then.age:.0f}"
    if now.age > then.age + LATER:
        return Check("warning", name, f"later: {ages}.", "Look at the link and the clocks.")
    least = _resolution(now, then) / np.sqrt(12.0)
    noise, before = (np.maximum(noise_of(kind_of(name), one), least) for one in (now, then))
    ratios = np.divide(noise, before, out=np.ones_like(noise), where=before > 0.0)
    if not np.isfinite(ratios).all():
        return Check("ok", name, f"{rates}; {ages}; noise not judged")
    i = int(np.argmax(ratios))
    if ratios[i] > NOISIER:
        text = f"noise {noise[i]:.2g} {SENSORS[kind_of(name)].units[i]}, then {before[i]:.2g} ({ratios[i]:.1f} times)."
        return Check("warning", name, text, LOOK)
    return Check("ok", name, f"{rates}; {ages}; noise {ratios[i]:.2f} times")


def noise_of(kind: str, readings: Readings) -> Float[np.ndarray, " k"]:
    """Standard deviation of white noise: of each reading beside the line through its two neighbours.

    The median over blocks, so that what is not straight for a moment does not count. NaN of fewer than LEAST readings.
    """
    finite = np.isfinite(readings.value).all(axis=1)
    t, value = readings.valid[finite], readings.value[finite]
    later = t > np.concatenate([[-np.inf], np.maximum.accumulate(t)[:-1]])[: len(t)]
    t, value = t[later], value[later]
    if len(value) < LEAST:
        return np.full(readings.value.shape[1], np.nan)
    value = np.unwrap(value, axis=0) if kind == "attitude" else value
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    beside = value[1:-1] - (1.0 - share) * value[:-2] - share * value[2:]
    squares = beside**2 / (1.0 + (1.0 - share) ** 2 + share**2)
    blocks = np.array_split(squares, max(1, len(squares) // BLOCK))
    return np.asarray(np.sqrt(np.median([block.mean(axis=0) for block in blocks], axis=0)))


def _resolution(now: Readings, then: Readings) -> Float[np.ndarray, " k"]:
    """Smallest step between neighbouring readings of both flights; 0 where there is none."""
    steps = np.abs(np.concatenate([np.diff(one.value, axis=0) for one in (now, then)]))
    smallest = np.min(np.where(steps > 0.0, steps, np.inf), axis=0)
    return np.where(np.isfinite(smallest), smallest, 0.0)


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
