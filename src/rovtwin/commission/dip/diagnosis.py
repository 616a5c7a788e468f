"""From measured columns to words: which thruster or axis is not as the file says.

An axis may answer more or less than the file says, for masses are not identified yet: so measured columns are divided
by a factor for each axis first, that of the thrusters that push it most. What is left are patterns: a thruster's column
points the other way, is too short, is another's, or points elsewhere; or rows of all thrusters have changed places.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.commission.dip.response import LAGS, Columns, columns
from rovtwin.identification.logs.motion import Motion
from rovtwin.identification.logs.record import Record
from rovtwin.vehicle.physics.model import Model

DEAD, WEAK, STRONG = 0.2, 0.75, 1.4  # of the force of the others
ALIKE, OPPOSITE = 0.8, -0.8  # cosine of two columns
BETTER = 0.3  # by which another explanation must fit better, as a cosine
SEEN = 3.0  # standard deviations of a column from which on it is seen at all
GOOD = 0.8  # cosine of the row of an axis over all thrusters, from which on nothing is wrong with it
UNSURE = 0.3  # standard deviation over the largest expected answer of an axis, up to which it counts
KNOWN = 0.05  # standard deviation over the largest answer, beyond which an axis counts the less, the less it is known
PUSHED = 0.15  # of an axis' largest expected answer, from which on a thruster counts for it


@dataclass(frozen=True)
class Verdict:
    """What is found of one thruster.

    Attributes:
        name: Of it.
        what: ok, reversed, dead, weak, strong, swapped, rotated, unseen.
        gain: Its force over what the file says, as a share of the others'.
        alike: Cosine of its column to the file's.
        other: The one that it is swapped with.
        direction: Of the force for a positive command, b, where it is rotated.
    """

    name: str
    what: str
    gain: float
    alike: float
    other: str = ""
    direction: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class AxisMistake:
    """Rows that have changed places or sign for all thrusters alike: a sensor's axes.

    Attributes:
        sensor: `gyro` or `accelerometer`, whose axes it is.
        words: What was done to them.
        before: Least cosine of the rows of axes as written, and after they are put right.
        after: See `before`.
    """

    sensor: str
    words: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All that pushes tell.

    Attributes:
        columns: With sensors' axes put right.
        axes: Mistakes of these.
        thrusters: What is found of each.
    """

    columns: Columns
    axes: list[AxisMistake]
    thrusters: list[Verdict]


def diagnose(model: Model, record: Record, names: list[str], floor: float = np.inf) -> Diagnosis:
    """From a record of pushes, one thruster at a time, to what is wrong; the gyro's axes first, all else needs them."""
    mistakes, lags = [], LAGS
    for sensor, rows in (("gyro", slice(3, 6)), ("accelerometer", slice(0, 3))):
        found = columns(model, record, floor, lags)
        lags = (found.lag,)
        # A gyro is so quiet that an axis which it does not feel move is an answer, too.
        right = (_pushed(found) if sensor == "gyro" else _judged(found))[rows]
        if sensor not in record.signals or not np.isfinite(found.measured[rows]).all() or not right.any():
            continue
        before = _likeness(found.measured[rows], found.expected[rows], right)
        if before > GOOD:
            continue
        likeness = partial(_refitted, model, record, found, sensor, rows=rows, floor=floor)
        tried = [(words, order, likeness(order)) for words, order in _orders()]
        words, order, after = max(tried, key=lambda one: one[2])
        rival = max(_likeness(found.measured[rows], one[rows], right) for one in _mixed_up(found.expected))
        if sensor == "gyro" and _agrees_better(record, order):
            rival = 0.0  # the attitude, which no thruster changes, says so too
        if after > max(GOOD, before + BETTER, rival):
            mistakes.append(AxisMistake(sensor, words, before, after))
            record = _turned(record, sensor, order)
    found = columns(model, record, floor, lags)
    return Diagnosis(found, mistakes, verdicts(found, names))


def _refitted(
    model: Model,
    record: Record,
    found: Columns,
    sensor: str,
    order: Float[np.ndarray, "3 3"],
    rows: slice,
    floor: float,
) -> float:
    """How alike columns are if a sensor's axes are put in this order; gravity is taken off anew where it counts."""
    if sensor == "accelerometer":
        found = columns(model, _turned(record, sensor, order), floor, [found.lag])
        return _likeness(found.measured[rows], found.expected[rows], _judged(found)[rows])
    measured = order @ np.nan_to_num(found.measured[rows])
    return _likeness(measured, found.expected[rows], _pushed(found)[rows])


def _agrees_better(record: Record, order: Float[np.ndarray, "3 3"]) -> bool:
    """Whether the gyro agrees better with the rate of the attitude if its axes are put in this order."""
    motion = Motion.of(record)
    gyro, rate = motion.values("gyro"), motion.rate_of_attitude
    if gyro is None or rate is None:
        return False
    good = np.isfinite(gyro[0]).all(axis=1) & np.isfinite(rate).all(axis=1)
    a, b = gyro[0][good], rate[good]
    return bool(((a @ order.T) * b).sum() > (a * b).sum() + BETTER * np.sqrt((a**2).sum() * (b**2).sum()))


def _mixed_up(expected: Float[np.ndarray, "r n"]) -> Iterator[Float[np.ndarray, "r n"]]:
    """Expected columns with one thruster reversed or two swapped: what may look like a mistake of axes and is none."""
    count = expected.shape[1]
    for i in range(count):
        yield np.where(np.arange(count) == i, -expected, expected)
        for k in range(i):
            order = np.arange(count)
            order[[i, k]] = k, i
            yield expected[:, order]


def _turned(record: Record, sensor: str, order: Float[np.ndarray, "3 3"]) -> Record:
    signal = record.signals[sensor]
    return replace(record, signals=record.signals | {sensor: replace(signal, value=signal.value @ order.T)})


def _pushed(found: Columns) -> Bool[np.ndarray, "6"]:
    """Axes that thrusters push by more than by the way, linear and angular apart."""
    largest = np.abs(found.expected).max(axis=1)
    most = np.repeat([largest[:3].max(), largest[3:].max()], 3)
    return largest > PUSHED * np.maximum(most, 1e-12)


def _judged(found: Columns) -> Bool[np.ndarray, "6"]:
    """Axes that thrusters push and sensors tell well enough to judge columns by them."""
    unsure = np.median(found.std, axis=1) / np.maximum(np.abs(found.expected).max(axis=1), 1e-12)
    return _pushed(found) & np.isfinite(found.measured).all(axis=1) & (unsure < UNSURE)


def _likeness(
    measured: Float[np.ndarray, "r n"], expected: Float[np.ndarray, "r n"], counts: Bool[np.ndarray, " n"]
) -> float:
    """How alike rows are whatever the scale of each, 1 if they are: the least cosine of those that count."""
    norm = np.linalg.norm(measured, axis=1) * np.linalg.norm(expected, axis=1)
    cosine = np.einsum("an,an->a", measured, expected) / np.maximum(norm, 1e-12)
    return float(np.min(cosine[counts])) if counts.any() else 1.0


def _orders() -> Iterator[tuple[str, Float[np.ndarray, "3 3"]]]:
    """Signed permutations of three axes but the identity, the simplest first; each puts right what its words say."""
    for signs in sorted(itertools.product((1.0, -1.0), repeat=3), key=lambda s: -sum(s))[1:]:
        wrong = [axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0]
        yield f"{' and '.join(wrong)} {'has' if len(wrong) == 1 else 'have'} the wrong sign", np.diag(signs)
    for order in itertools.permutations(range(3)):
        if order == (0, 1, 2):
            continue
        for signs in sorted(itertools.product((1.0, -1.0), repeat=3), key=lambda s: -sum(s)):
            P = np.diag(signs) @ np.eye(3)[list(order)]
            named = ", ".join(f"{'-' if sign < 0 else ''}{'xyz'[i]}" for i, sign in zip(order, signs, strict=True))
            yield f"its x, y, z read as {named} would be right", P


def verdicts(found: Columns, names: list[str]) -> list[Verdict]:
    """What is found of each thruster; `unseen` where sensors tell no axis well enough."""
    if not _judged(found).any():
        return [Verdict(name, "unseen", float("nan"), float("nan")) for name in names]
    compared = _Compared.of(found)
    return [compared.verdict(i, names) for i in range(len(names))]


@dataclass(frozen=True, eq=False)
class _Compared:
    """Measured and expected columns, each axis over its largest expected answer, the measured over its factor too.

    Attributes:
        b: Measured.
        B: Expected.
        cosine: Of each measured column, row, to each expected one, column.
        length: Of each measured column over the expected, as a share of the others'.
        gain: The part of it along the expected, as a share of the others'.
        unsure: One standard deviation of the length.
        turned: From a direction of a thruster's force to its column here, by thruster.
    """

    b: Float[np.ndarray, "a n"]
    B: Float[np.ndarray, "a n"]
    cosine: Float[np.ndarray, "n n"]
    length: Float[np.ndarray, " n"]
    gain: Float[np.ndarray, " n"]
    unsure: Float[np.ndarray, " n"]
    turned: Float[np.ndarray, "n a 3"]

    @classmethod
    def of(cls, found: Columns) -> "_Compared":
        axes = _judged(found)
        largest = np.abs(found.expected[axes]).max(axis=1, keepdims=True)
        B = found.expected[axes] / largest
        factor = _factors(found.measured[axes] / largest, B)[:, None]
        b, std = found.measured[axes] / largest / factor, found.std[axes] / largest / factor
        weight = 1.0 / np.sqrt(1.0 + (np.median(std, axis=1, keepdims=True) / KNOWN) ** 2)
        b, B, std, largest = b * weight, B * weight, std * weight, largest / weight
        size = np.maximum(np.linalg.norm(B, axis=0), 1e-12)
        gain = np.einsum("ai,ai->i", b, B) / size**2
        cosine = (b.T @ B) / np.maximum(np.linalg.norm(b, axis=0)[:, None] * size[None, :], 1e-12)
        sound = np.diag(cosine) > ALIKE
        usual = float(np.median(gain[sound])) if sound.any() else 1.0
        turned = np.stack([found.inverse[axes] @ _wrench_of(column) for column in found.configuration.T]) / largest
        length = np.linalg.norm(b, axis=0) / size
        return cls(b, B, cosine, length / usual, gain / usual, np.linalg.norm(std, axis=0) / size / usual, turned)

    def verdict(self, i: int, names: list[str]) -> Verdict:
        """Of one thruster."""
        own, length, name = float(self.cosine[i, i]), float(self.length[i]), names[i]
        if length < DEAD or SEEN * self.unsure[i] > length:
            return Verdict(name, "dead" if self.unsure[i] < DEAD else "unseen", length, own)
        if (k := self._swapped_with(i)) is not None:
            return Verdict(name, "swapped", length, own, names[k])
        if own < OPPOSITE:
            return Verdict(name, "reversed", length, own)
        if own > ALIKE:
            gain = float(self.gain[i])
            sure = abs(gain - 1.0) > SEEN * float(self.unsure[i])
            what = "weak" if sure and gain < WEAK else "strong" if sure and gain > STRONG else "ok"
            return Verdict(name, what, gain, own)
        return Verdict(name, "rotated", length, own, direction=self._direction(i))

    def _swapped_with(self, i: int) -> int | None:
        """The thruster that does what this one should, while this one does what that one should."""
        c = self.cosine
        gains = {k: c[i, k] + c[k, i] - c[i, i] - c[k, k] for k in range(len(c)) if k != i}
        fits = {k: gain for k, gain in gains.items() if min(c[i, k], c[k, i]) > ALIKE and gain > 2 * BETTER}
        return max(fits, key=lambda k: fits[k]) if fits else None

    def _direction(self, i: int) -> tuple[float, float, float]:
        """Of a force through the nearest point of its line to CO that fits the measured column best."""
        d = np.linalg.lstsq(self.turned[i], self.b[:, i], rcond=None)[0]
        north, east, down = d / max(float(np.linalg.norm(d)), 1e-12)
        return float(north), float(east), float(down)


def _wrench_of(column: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6 3"]:
    """From a direction of force to its wrench, at the place nearest to CO on the line of a unit wrench, (6, 3)."""
    force = column[:3] / max(float(np.linalg.norm(column[:3])), 1e-12)
    x, y, z = np.cross(force, column[3:])
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.concatenate([np.eye(3), lever])


def _factors(b: Float[np.ndarray, "a n"], B: Float[np.ndarray, "a n"]) -> Float[np.ndarray, " a"]:
    """By how much each axis answers more than the file says: of the thrusters that push it, the upper ones.

    Sizes alone count, so that one that pushes the wrong way counts, too; the upper ones, so that a dead one does not.
    """
    factors = np.ones(len(b))
    for axis in range(len(b)):
        pushing = np.abs(B[axis]) > PUSHED
        if pushing.any():
            ratio = np.abs(b[axis, pushing] / B[axis, pushing])
            factors[axis] = max(float(np.quantile(ratio, 0.7, method="nearest")), 1e-3)
    return factors
