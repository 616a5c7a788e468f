"""The monitor of one vehicle: a filter that is fed second by second, and the factors that it has found so far."""

from collections.abc import Callable, Sequence
from copy import copy

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.navigation.tuning import disturbance_levels
from rovtwin.gnc.scales import VehicleScales
from rovtwin.identification.logs.record import Record
from rovtwin.monitoring.evidence import Block, Estimated, estimated, marginal
from rovtwin.monitoring.factors import AXES, Factors
from rovtwin.monitoring.filter import MOST_NOISE, Gathered, Levers, Memory, MotionFilter, Noise, Seen
from rovtwin.monitoring.lost import FIRST, SUSPECT, Lost, Search, suspect, with_lost
from rovtwin.monitoring.readings import ROWS, levers_of, seen, usable
from rovtwin.vehicle.physics.model import Model

BLOCK = 10  # of evidence [s]
RELINEARISE = 0.05  # factors that are held so far from what is found move there, in standard deviations before a flight
FARTHEST = 5.0  # factors are held no further than that from the description, in the same
STEP, QUICKEST = 0.02, 0.2  # longest step [s]; largest step times a rate of the vehicle
FORGOTTEN = 10.0  # blocks older than so many times the fading are let go
LATE = 60.0  # a sensor that speaks so long after the others is not waited for [s]
PASSES = 2  # through a whole record: in the second all of it is linearised about what the first has found
FEW = 2  # blocks of evidence below which nothing is called implausible
MOST_LOST = 2  # thrusters that are looked for in one record
SHORTEST = 2.0 * BLOCK  # record that is looked at [s]
NEEDED = ("attitude", "gyro")
STRANGE = 0.03  # share of readings far from what is foreseen, beyond which what is found is doubted


class Monitor:
    """Finds what has changed of a vehicle, from its commands and sensors.

    Attributes:
        factors: What is found.
        filter: See `MotionFilter`.
        blocks: Evidence so far.
        time: That has been seen [s].
        lost: Thrusters that were found dead or reversed in a whole record, with which all else was found.
    """

    def __init__(self, model: Model, thrusters: Sequence[str], levers: Levers, fading: float = np.inf):
        """For a vehicle as it is assumed to be.

        Args:
            model: The vehicle.
            thrusters: Their names.
            levers: Places of its sensors.
            fading: Time in which what was seen loses half of its weight [s].
        """
        self._fading = fading
        scales = VehicleScales.of(model)
        self.factors = Factors.of(model, thrusters, scales.length)
        self.filter = MotionFilter(model, _noise(model, scales), levers, len(self.factors.each), step_of(model, scales))
        self.blocks: list[Block] = []
        self.time = 0.0
        self._far, self._count, self._fit = np.zeros(12), np.zeros(12), 0.0
        self._held = np.zeros(len(self.factors.each))
        self.lost: tuple[Lost, ...] = ()
        self._memory: Memory | None = None
        self._open: list[Gathered] = []

    def begin(
        self,
        position: Float[np.ndarray, "3"],
        attitude: Float[np.ndarray, "3"],
        held: Float[np.ndarray, " p"] | None = None,
    ) -> None:
        """Begin with no evidence.

        Args:
            position: Of the vehicle in n [m].
            attitude: Euler angles [rad].
            held: Factors about which to linearise all of it; None: those of the description at first, then what has
                been found.
        """
        at = jnp.asarray(position, float), quaternion_from_euler(jnp.asarray(attitude, float))
        self._memory, self.blocks, self.time, self._open = self.filter.start(*at), [], 0.0, []
        self._far, self._count, self._fit = np.zeros(12), np.zeros(12), 0.0
        self._held = np.zeros(len(self.factors.each)) if held is None else self._within(held)
        self._follow = held is None

    def second(self, readings: Seen) -> Gathered:
        """Take in the steps of one second, and what they say; every BLOCK of them is closed into evidence."""
        assert self._memory is not None, "begin() comes first"
        self._memory, gathered = self.filter.over(self._memory, jnp.asarray(self._held), readings)
        self._open.append(jax.tree.map(np.asarray, gathered))
        newest = self._open[-1]
        self.time += 1.0
        if len(self._open) == BLOCK:
            self._close()
        return newest

    def found(self) -> Estimated:
        """The factors now."""
        return estimated(self.blocks, self.factors.covariance, self._fading)

    @property
    def likelihood(self) -> float:
        """Logarithm of the likelihood of all blocks, whatever the factors: comparable between passes of one record."""
        A, s = (np.sum([getattr(block, name) for block in self.blocks], axis=0) for name in ("A", "s"))
        return marginal(self._fit, A, s, self._held, self.factors.covariance)

    @property
    def far(self) -> float:
        """Share of its readings that the model did not foresee within four standard deviations, of the worst sensor."""
        far, count = ([float(np.sum(x[rows])) for rows in ROWS.values()] for x in (self._far, self._count))
        return max(a / max(b, 1.0) for a, b in zip(far, count, strict=True))

    @property
    def unexplained(self) -> list[str]:
        """Axes along which it moves in ways that no factors explain: the noise learnt there is near its limit."""
        if self._memory is None:
            return []
        noise = np.asarray(self._memory.log_noise)
        return [axis for axis, learnt in zip(AXES, noise, strict=True) if learnt > MOST_NOISE - 0.5]

    @property
    def implausible(self) -> list[str]:
        """Drag and added mass that come out surely and far from what was thought: something else leaks into them."""
        if len(self.blocks) < FEW:
            return []
        found, prior = self.found(), np.sqrt(np.diag(self.factors.covariance))
        far = np.abs(found.theta[:FIRST]) > SUSPECT * np.maximum(prior, found.std)[:FIRST]
        return [f"{kind} in {AXES[i % 6]}" for i, kind in enumerate(["drag"] * 6 + ["added mass"] * 6) if far[i]]

    @property
    def doubts(self) -> list[str]:
        """Why what it finds is not to be relied on, in words; nothing where nothing speaks against it."""
        lines = []
        if self.far > STRANGE:
            lines.append(
                f"{self.far:.0%} of its readings are far from what the description foresees: a sign, an axis or the "
                "clock may be wrong; look at it with rovtwin evidence check"
            )
        if self.unexplained:
            lines.append(
                f"it moves in {', '.join(self.unexplained)} in ways that no factors explain: what it tells "
                "is not to be relied on"
            )
        if self.implausible:
            lines.append(
                f"{', '.join(self.implausible)} would be far beyond what drag or added mass do: a thruster may be dead "
                "or push the wrong way, or the description be wrong; what else it tells is not to be relied on"
            )
        return lines

    def hold(self, theta: Float[np.ndarray, " p"]) -> None:
        """Linearise about these factors from now on; the motion that was found moves as they say."""
        assert self._memory is not None, "begin() comes first"
        self._memory = self.filter.held_at(self._memory, jnp.asarray(theta - self._held))
        self._held = theta

    def _within(self, theta: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """Factors about which it may be linearised."""
        std = np.sqrt(np.diag(self.factors.covariance))
        return np.clip(theta, -FARTHEST * std, FARTHEST * std)

    def _close(self) -> None:
        self._far += np.sum([one.far for one in self._open], axis=0)
        self._count += np.sum([one.count for one in self._open], axis=0)
        self._fit += float(np.sum([one.fit for one in self._open]))
        A, s = (np.sum([getattr(one, name) for one in self._open], axis=0) for name in ("A", "s"))
        self._open = []
        if not (np.isfinite(A).all() and np.isfinite(s).all()):
            raise IdentificationError(
                f"the monitor lost the vehicle within {self.time:.0f} s: its model does not move as the log does. Look "
                "at the log with: rovtwin evidence check"
            )
        oldest = self.time - FORGOTTEN * self._fading
        self.blocks = [block for block in self.blocks if block.end >= oldest] + [Block(self.time, A, s)]
        if not self._follow:
            return
        std = np.sqrt(np.diag(self.factors.covariance))
        target = self._within(self.found().theta)
        if np.max(np.abs(target - self._held) / std) > RELINEARISE:
            self.hold(target)


def watched(
    model: Model,
    thrusters: Sequence[str],
    record: Record,
    progress: Callable[[float], None] = lambda share: None,
) -> Monitor:
    """A monitor after a whole record.

    Args:
        model: The vehicle as it is assumed to be.
        thrusters: Their names.
        record: Commands and readings.
        progress: Told the share that is done.

    Raises:
        IdentificationError: It has no attitude or no gyro, is too short, or the filter lost the vehicle.
    """
    signals = usable(record)
    if missing := [name for name in NEEDED if name not in signals]:
        raise IdentificationError(
            f"{record.source}: found {', '.join(sorted(signals)) or 'no signals'}, expected {' and '.join(NEEDED)} "
            f"too: without {missing[0]} nothing tells how the vehicle turns"
        )
    turning = max(signals[name].t[0] for name in NEEDED)
    first = [signals[name].t[0] for name in ("depth", "horizontal") if name in signals]
    begun = max([turning, *(t for t in first if t < turning + LATE)])
    if record.end - max(begun, record.start) < SHORTEST:
        raise IdentificationError(
            f"{record.source}: {record.end - max(begun, record.start):.0f} s with readings, expected {SHORTEST:g} s or "
            "more: less says nothing of a vehicle"
        )
    record = record.cut(begun, record.end) if begun > record.start else record
    signals = usable(record)
    monitor = Monitor(model, thrusters, levers_of(signals))
    position = np.zeros(3)
    if "horizontal" in signals:
        position[:2] = signals["horizontal"].value[0]
    if "depth" in signals:
        position[2] = signals["depth"].value[0, 0]
    start = position, signals["attitude"].value[0]
    return _with_lost(monitor, start, record.start, seen(model, record, monitor.filter.h), thrusters, progress)


def _with_lost(
    monitor: Monitor,
    start: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    begun: float,
    readings: Seen,
    thrusters: Sequence[str],
    progress: Callable[[float], None],
) -> Monitor:
    """After passes through readings, and again with each thruster that is lost in them."""
    prior, n = monitor.factors.covariance, len(thrusters)
    search = Search(monitor.filter, prior, *start, begun, thrusters)
    gathered, other = _passes(monitor, start, readings, progress), monitor
    while suspect(gathered, other.found().theta, prior, n) and len(other.lost) < MOST_LOST:
        lost = search.most_likely(readings)
        if lost is None or lost.name in [one.name for one in other.lost]:
            return monitor
        before, other = other, copy(other)
        readings = with_lost(readings, lost, begun, monitor.filter.h)
        gathered = _passes(other, start, readings, lambda share: None)
        if other.likelihood - before.likelihood < search.least(readings):
            return monitor
        other.lost = (*before.lost, lost)
    # If something still seems to jump, it is another change, which a lost thruster resembles.
    return monitor if suspect(gathered, other.found().theta, prior, n) else other


def _passes(
    monitor: Monitor,
    start: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    readings: Seen,
    progress: Callable[[float], None],
) -> list[Gathered]:
    """Through all readings, PASSES times; what each second of the first said."""
    a_second = round(1.0 / monitor.filter.h)
    firsts, held, gathered = range(0, len(readings.target) - a_second + 1, a_second), None, []
    for turn in range(PASSES):
        monitor.begin(*start, held)
        for k, first in enumerate(firsts):
            one = monitor.second(jax.tree.map(lambda leaf, i=first: leaf[i : i + a_second], readings))
            if turn == 0:
                gathered.append(one)
            if k % BLOCK == 0:
                progress((turn + k / len(firsts)) / PASSES)
        held = monitor.found().theta
    return gathered


def step_of(model: Model, scales: VehicleScales) -> float:
    """Step of the filter [s]: a whole number of them is a second, and none of the vehicle's rates is too quick."""
    M = np.diag(np.asarray(model.inertia))
    drag = np.diag(np.asarray(model.linear_damping_ahead))
    drag = drag + 2.0 * np.diag(np.asarray(model.quadratic_damping_ahead)) * np.where(
        np.isfinite(scales.top), scales.top, 0
    )
    lever = np.asarray(model.center_of_gravity - model.center_of_buoyancy)[2]
    swing = np.sqrt(max(float(model.weight) * lever, 0.0) / M[3:5].min())
    quickest = max(float(np.max(drag / M)), swing)
    return float(1.0 / np.ceil(1.0 / min(STEP, QUICKEST / max(quickest, 1e-9))))


def _noise(model: Model, scales: VehicleScales) -> Noise:
    """Beliefs by the vehicle's size; those of the motion's noise are only where learning starts."""
    own, M = disturbance_levels(model), np.diag(np.asarray(model.inertia))
    speed = own["current_std"]
    lightest, strongest = 0.01 * scales.weight, max(scales.force[:3].max(), 0.01 * scales.weight)
    # Moments of a vehicle are badly known: who trusts them reads the speed through the water off them.
    moment = 0.03 * strongest * scales.length
    push = np.maximum(scales.acceleration, strongest * np.array([0.1] * 3 + [0.3 * scales.length] * 3) / M)
    initial = np.concatenate(
        [
            *([0.5, 0.5, 0.05], [0.05] * 3, [speed] * 3, [0.1] * 3),
            *([own["force_std"]] * 2, [0.1 * lightest], [moment] * 3, [speed] * 2, [2e-3] * 3),
        ]
    )
    walk = np.concatenate(
        [
            *(np.zeros(6), 0.05 * push),
            *([own["force_walk"]] * 3, [scales.length * own["force_walk"]] * 3),
            *([0.01414 * speed * np.sqrt(scales.level_bandwidth)] * 2, [1e-5] * 3),
        ]
    )
    return Noise(initial, walk)
