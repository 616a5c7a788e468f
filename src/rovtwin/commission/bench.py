"""Bench: link, sensors, clocks, noise at rest, battery and leak, thrusters off.

Noise is judged from differences of neighbouring readings, sd(x_k+1 - x_k) / sqrt(2), which a hand or a draught hardly
moves; the Allan deviation at 1 s tells what is left after averaging (IEEE Std 952-1997, annex C). A vehicle at rest
feels gravity only: the accelerometer's direction must be that of the attitude's vertical.
"""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.log import Log
from rovtwin.core.sensors import ESSENTIAL, SENSORS, kind_of
from rovtwin.live.record import record
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.sensors import rotated, sensors_of
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.vehicle.constants import GRAVITY

SECONDS = 15.0  # of readings at rest
WHOLE = 0.8  # of that time, below which it was interrupted
SLOWER, FASTER = 0.7, 1.5  # rates over the file's
NOISIER = 3.0  # noise over the file's, from which on it is no matter of chance
SILENT_NOISE = 0.1  # and below which the file asks for too much
OLD, AHEAD = 0.25, -0.05  # age of readings [s]
TILTED_APART = np.radians(6.0)  # between the verticals of accelerometer and attitude
LOW, EMPTY = 0.5, 0.25  # charge, share
STILL = 0.05  # rate of turn, below which it counts as at rest [rad/s]


def run(work: Work) -> Outcome:
    """The page of the vehicle at rest."""
    scenario = work.scenario({})
    vehicle = vehicle_of(scenario)
    sensors = sensors_of(scenario, vehicle)
    with work.connected(scenario, observe=True) as there:
        seconds = SECONDS
        work.person.say(f"Hands off for {seconds:g} s: readings at rest are recorded; thrusters stay off.")
        log = work.folder / "log.mcap"
        notes: list[str] = []
        record(
            scenario,
            there.link,
            there.sources,
            there.clock,
            log,
            seconds,
            lambda t: work.person.progress("recording readings at rest", t / seconds),
            notes.append,
        )
        age = there.link.age
    recorded = Log.read(log)
    found = {name: Readings.of(recorded, name) for name in sensors}
    # A protocol may tell these though the file has no such part.
    besides = {name: Readings.of(recorded, name) for name in ("battery", "leak") if name not in found}
    checks = [Check("note", "sensors", line) for line in notes]
    checks += [Check("stop", "link", f"silent for {age:.1f} s.", "Check the cable, then repeat.")] if age > 1.0 else []
    assumed = {"position"} if work.positions() is not None else set()  # no part of the vehicle: nothing to compare with
    too_busy = work.request.too_busy
    checks += [c for name, one in found.items() for c in _sensor(name, sensors[name], one, name in assumed, too_busy)]
    turned = {name: np.asarray(R) for name, R in rotated(sensors).items()}
    checks += [*_gravity(found, turned), *_state(found | besides, work.request.room.depth)]
    last = max((float(one.arrived[-1]) for one in found.values() if len(one.arrived)), default=0.0)
    if 0.0 < last < WHOLE * seconds:
        checks.append(Check("stop", "bench", f"it ended after {last:.0f} of {seconds:g} s.", "Repeat this stage."))
    return Outcome(
        tuple(checks), {"log": log.name, "sensors": [_measured(n, o) for n, o in found.items()]}, (log.name,), seconds
    )


class Readings:
    """Readings of one sensor at rest.

    Attributes:
        arrived: When they came [s], shape (n,).
        valid: When they were true, by their own stamp [s], shape (n,).
        value: What they were.
    """

    def __init__(
        self, arrived: Float[np.ndarray, " n"], valid: Float[np.ndarray, " n"], value: Float[np.ndarray, "n k"]
    ):
        self.arrived, self.valid, self.value = arrived, valid, value

    @classmethod
    def of(cls, log: Log, name: str) -> "Readings":
        """Of a log's channel; none where it has none."""
        channel = f"sensor/{name}"
        if channel not in log or not len(log[channel]):
            return cls(np.zeros(0), np.zeros(0), np.zeros((0, SENSORS[kind_of(name)].size)))
        series = log[channel]
        return cls(series.t, series["t_valid"], series.values[:, :-1])

    @property
    def rate(self) -> float:
        """Readings a second [Hz], 0 where there are fewer than two."""
        spread = float(np.ptp(self.valid)) if len(self.valid) > 1 else 0.0
        return (len(self.valid) - 1) / spread if spread > 0.0 else 0.0

    @property
    def age(self) -> float:
        """Median of how old readings are when they come [s]."""
        return float(np.median(self.arrived - self.valid)) if len(self.valid) else np.nan

    @property
    def noise(self) -> Float[np.ndarray, " k"]:
        """Standard deviation of white noise, from neighbouring differences; NaN of fewer than ten."""
        if len(self.value) < 10:
            return np.full(self.value.shape[1], np.nan)
        return np.asarray(np.diff(_unwrapped(self.value), axis=0).std(axis=0) / np.sqrt(2.0))

    @property
    def mean(self) -> Float[np.ndarray, " k"]:
        """Of each component."""
        return self.value.mean(axis=0)

    def allan(self, seconds: float = 1.0) -> Float[np.ndarray, " k"]:
        """Allan deviation over averages of so long; NaN where there are fewer than four of them."""
        each = max(1, round(seconds * self.rate))
        whole = len(self.value) // each
        if whole < 4:
            return np.full(self.value.shape[1], np.nan)
        means = _unwrapped(self.value)[: whole * each].reshape(whole, each, -1).mean(axis=1)
        return np.asarray(np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0)))


def _unwrapped(value: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Angles do not jump by a turn; nothing else jumps by that much at rest either."""
    return np.unwrap(value, axis=0) if value.shape[1] == 3 else value


def _sensor(name: str, sensor: Sensor, found: Readings, assumed: bool = False, too_busy: str = "") -> Iterator[Check]:
    """Whether it speaks, how often, how late, how noisy; of an assumed one the file says nothing.

    A twin that this machine cannot compute as fast as its clock runs falls behind it: `too_busy`, in words.
    """
    kind, rate = SENSORS[kind_of(name)], sensor.rate / 1000.0
    if not len(found.valid):
        verdict = "stop" if kind_of(name) in ESSENTIAL and kind_of(name) != "position" else "warning"
        fix = "Switch it on, or take it out of the vehicle file."
        fix = "The tests come home by positions: --sensor qtm://HOST/BODY or ugps://HOST." if assumed else fix
        expected = "some" if assumed else f"{rate:.3g} Hz"
        yield Check(verdict, name, f"no readings within {SECONDS:g} s, expected {expected}.", fix)
        return
    if not assumed and rate >= 0.5 and not SLOWER * rate <= found.rate <= FASTER * rate:
        text = f"{found.rate:.3g} Hz, expected {rate:.3g} Hz as the file has it."
        yield Check("warning", f"{name} rate", text, "Set its rate in the vehicle, or write the true one in the file.")
    declared, noise = np.broadcast_to(np.asarray(sensor.noise, dtype=float), found.noise.shape), found.noise
    declared = np.zeros_like(declared) if assumed else declared
    if not np.isfinite(found.value).all():
        yield Check("stop", name, "readings that are no numbers.", "Check its driver.")
    elif len(found.value) > 20 and (np.ptp(found.value, axis=0) == 0.0).all() and np.any(declared > 0.0):
        yield Check("stop", name, "every reading is the same: it hangs.", "Restart it.")
    elif np.any(bad := (noise > NOISIER * declared) & (declared > 0.0)):
        i = int(np.argmax(np.where(bad, noise / np.maximum(declared, 1e-12), 0.0)))
        text = f"noise of {noise[i]:.2g} {kind.units[i]} in {kind.fields[i]}, the file has {declared[i]:.2g}."
        yield Check("warning", f"{name} noise", text, "Write what was measured, or look for what shakes it.")
    if found.age > OLD or found.age < AHEAD:
        late = f"{found.age:.2f} s old when they come" if found.age > 0 else f"stamped {-found.age:.2f} s in the future"
        fix = "Set the vehicle's clock (NTP), or write the delay as its latency in the file."
        fix = too_busy if too_busy and found.age > OLD else fix
        verdict = "stop" if found.age < AHEAD or found.age > 2 * OLD + float(sensor.latency_steps) * 2e-3 else "warning"
        yield Check(verdict, f"{name} clock", f"readings are {late}.", fix)
    if (found.age <= OLD and found.age >= AHEAD) or not len(found.valid):
        digits = (
            "" if not np.isfinite(noise).any() else f", noise {', '.join(f'{x:.2g}' for x in noise)} {kind.units[0]}"
        )
        yield Check("ok", name, f"{found.rate:.3g} Hz, {1e3 * found.age:.0f} ms old{digits}")


def _gravity(found: dict[str, Readings], turned: dict[str, Float[np.ndarray, "3 3"]]) -> Iterator[Check]:
    """At rest the accelerometer feels -g along the attitude's vertical; axes that are not as written show."""
    force, attitude, gyro = (found.get(name) for name in ("accelerometer", "attitude", "gyro"))
    turning = 0.0 if gyro is None or not len(gyro.value) else float(np.abs(gyro.mean).max())
    if turning > STILL:
        text = f"it turns by {np.degrees(turning):.1f} deg/s while it should be at rest, or its gyro is biased."
        yield Check("warning", "gyro", text, "Keep hands off, then repeat this stage.")
    if force is None or attitude is None or not len(force.value) or not len(attitude.value):
        return
    size = float(np.linalg.norm(force.mean))
    if not 0.9 * GRAVITY < size < 1.1 * GRAVITY:
        text = f"specific force is {size:.3g} m/s2 at rest, expected {GRAVITY:g}."
        yield Check("stop", "accelerometer", text, "Check its unit (g, mm/s2) and scale.")
        return
    R_ns = rotation_from_euler(attitude.value[len(attitude.value) // 2][None])[0]
    vertical = R_ns @ turned.get("attitude", np.eye(3)).T  # R_nb
    expected = turned.get("accelerometer", np.eye(3)).T @ (vertical.T @ np.array([0.0, 0.0, -1.0]))
    apart = _angle(force.mean, expected)
    if apart <= TILTED_APART:
        yield Check("ok", "vertical", f"accelerometer and attitude agree to {np.degrees(apart):.1f} deg")
        return
    ways = [(words, _angle(order @ force.mean, expected)) for words, order in _orders()]
    words, left = min(ways, key=lambda way: way[1])
    guess = f" It fits ({np.degrees(left):.0f} deg) if {words}." if left < 0.5 * apart else ""
    text = f"accelerometer and attitude put the vertical {np.degrees(apart):.0f} deg apart.{guess}"
    yield Check("stop", "vertical", text, "Check how both are mounted (`attitude_deg`), and their frames (NED, FRD).")


def _angle(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> float:
    return float(np.arccos(np.clip(a @ b / (np.linalg.norm(a) * np.linalg.norm(b) + 1e-12), -1.0, 1.0)))


def _orders() -> Iterator[tuple[str, Float[np.ndarray, "3 3"]]]:
    """What may have happened to three axes, the simplest first: signs, then swaps."""
    yield "all its axes have the other sign", -np.eye(3)
    for signs in itertools.product((1.0, -1.0), repeat=3):
        if -3.0 < sum(signs) < 3.0:
            wrong = ", ".join(axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0)
            yield f"its {wrong} has the other sign", np.diag(signs)
    for order in itertools.permutations(range(3)):
        if order != (0, 1, 2):
            yield f"its axes x, y, z are {', '.join('xyz'[i] for i in order)}", np.eye(3)[list(order)]


def _state(found: dict[str, Readings], deepest: float) -> Iterator[Check]:
    """Battery, leak, depth."""
    for name, one in found.items():
        if not len(one.value):
            continue
        last = float(one.value[-1, 0])
        if kind_of(name) == "battery":
            words = f"charged to {100 * last:.0f} %"
            if last < EMPTY:
                yield Check("stop", name, f"{words}, expected {100 * EMPTY:.0f} % or more.", "Charge it.")
            elif last < LOW:
                text = f"{words}: thrust falls with voltage, and the tests take long."
                yield Check("warning", name, text, "Charge it first.")
            else:
                yield Check("ok", name, words)
        elif kind_of(name) == "leak" and last > 0.5:
            yield Check("stop", name, "it reports water.", "Take it out of the water, open and dry it.")
        elif kind_of(name) == "pressure" and not -0.5 < last < deepest + 0.2:
            text = f"depth reads {last:.2f} m, expected 0 to {deepest:g} m: of this tank."
            fix = "Check its unit (m, feet, mbar), its zero, and the tank's depth."
            yield Check("stop", name, text, fix)


def _measured(name: str, found: Readings) -> dict[str, Any]:
    kind = SENSORS[kind_of(name)]
    return {
        "name": name,
        "rate_hz": found.rate,
        "age_s": found.age,
        "units": list(kind.units),
        "noise": found.noise.tolist(),
        "allan_1s": found.allan().tolist(),
        "mean": found.mean.tolist() if len(found.value) else [],
    }
