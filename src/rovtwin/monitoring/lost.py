"""A thruster that is dead or pushes the wrong way, from some time of a record on: which, since when, and what is left.

Factors are logarithms and hold for all of a record. A thruster that is reversed half-way is neither: no factor gets
negative, so that what it does is put down to whatever resembles it, as more added mass in yaw. So such a thruster is
found first, and the factors with it applied: its force before its factor is multiplied by what is left of it.

Whether to look is seen in the evidence of each second: a jump of a thruster's factor at some time is one more unknown,

    Delta = u / I,    u = sum_after (s_t - A_t theta),    I = B_kk - B_k (C^-1 + A)^-1 B_k',    B = sum_after A_t

Which one it is and whether it is dead or reversed the filter says, which goes over the record as if, for these are too
far for one linearisation: the likeliest of all, with the factors integrated out.

Reference: Willsky and Jones (1976), A generalized likelihood ratio approach to the detection and estimation of jumps;
Kass and Raftery (1995), Bayes factors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.monitoring.evidence import marginal
from rovtwin.monitoring.filter import Gathered, Memory, MotionFilter, Seen

FIRST = 12  # factor of the first thruster
SUSPECT = 3.0  # standard deviations of a jump from which on it is looked at more closely
DEAD, REVERSED = 0.0, -1.0  # what is left of the force of such a thruster
CLOSER = 4  # hypotheses of a dead thruster, the likeliest, that are looked at again as one that is reversed
FALSE_ALARMS = 0.01  # of records in which no thruster is lost
SPAN = 60  # after the time from which a thruster may be lost that is looked at to tell which [s]
STEPS = (8, 4, 2, 1)  # by which the time is moved until it fits no better [s]
AT_START = 2.0  # after the start of a record, within which it was lost before [s]


@dataclass(frozen=True)
class Lost:
    """A thruster that is dead or reversed.

    Attributes:
        number: Of the thruster.
        name: Its name.
        since: Time in the log [s]; None: from its start.
        left: 0 of a dead one, -1 of a reversed one.
    """

    number: int
    name: str
    since: float | None
    left: float

    def __str__(self) -> str:
        """As in `port pushes the wrong way from 20 s on`."""
        when = "all the time" if self.since is None else f"from {self.since:.0f} s on"
        return f"{self.name} {'pushes the wrong way' if self.left < 0.0 else 'does not push'} {when}"

    @property
    def look(self) -> str:
        """Where to look, and what may have happened."""
        if self.left < 0.0:
            return f"look at {self.name}: propeller, wires or sign of the command may be the wrong way round"
        return f"look at {self.name}: a propeller that has come off or is blocked, or no supply"


def with_lost(readings: Seen, lost: Lost, begun: float, h: float) -> Seen:
    """Readings of which the thruster's force is what is left of it."""
    first = 0 if lost.since is None else round((lost.since - begun) / h)
    return _scaled(readings, lost.number, first, lost.left)


def suspect(
    gathered: Sequence[Gathered], theta: Float[np.ndarray, " p"], prior: Float[np.ndarray, "p p"], n: int
) -> bool:
    """Whether a thruster's factor seems to jump at some time of a record, or any factor is far from what was thought.

    Args:
        gathered: Of each second.
        theta: What was found.
        prior: Covariance of the factors before.
        n: How many thrusters there are.
    """
    far = np.abs(theta) / np.sqrt(np.diag(prior))
    return bool(max(far.max(), np.max(np.abs(_jumps(gathered, prior, n)), initial=0.0)) > SUSPECT)


@dataclass(frozen=True, eq=False)
class Search:
    """Looks for the thruster that is lost in a record.

    Attributes:
        filter: Of the vehicle.
        prior: Covariance of its factors before.
        position, attitude: At the start, in n [m] and Euler angles [rad].
        begun: When it starts, in the log's time [s].
        names: Of the thrusters.
    """

    filter: MotionFilter
    prior: Float[np.ndarray, "p p"]
    position: Float[np.ndarray, "3"]
    attitude: Float[np.ndarray, "3"]
    begun: float
    names: Sequence[str]

    def least(self, readings: Seen) -> float:
        """Logarithm of a likelihood ratio that a hypothesis has to reach: there are many of them."""
        many = len(self.names) * 2 * len(readings.target) * self.filter.h
        return float(np.log(many / FALSE_ALARMS))

    def most_likely(self, readings: Seen) -> Lost | None:
        """The likeliest of all, None where nothing of the kind makes the record likelier."""
        as_is = _AsIs(self, readings)
        jumps = _jumps(as_is.gathered, self.prior, len(self.names))
        onset, tried = _onset(as_is.gathered), []
        for k in range(len(self.names)):
            for second in {0, onset, int(np.argmin(jumps[k]))}:
                tried.append((as_is.gain(k, second, DEAD), k, second, DEAD))
        # One that pushes the wrong way is likelier to be dead, too, than to push as it should.
        tried = sorted(tried, reverse=True)[:CLOSER]
        tried += [(as_is.gain(k, second, REVERSED), k, second, REVERSED) for _, k, second, _ in tried]
        best = max(tried)
        if best[0] <= 0.0:
            return None
        _, k, second, left = as_is.timed(best)
        since = None if second <= AT_START else self.begun + second
        return Lost(k, self.names[k], since, left)


class _AsIs:
    """The record at the factors of the description, from any second of which a hypothesis goes on."""

    def __init__(self, search: Search, readings: Seen):
        self._search, self._readings = search, readings
        self._a_second = round(1.0 / search.filter.h)
        self._rest = np.zeros(len(search.prior))
        start = jnp.asarray(search.position, float), quaternion_from_euler(jnp.asarray(search.attitude, float))
        self._memories, self.gathered = self._over(search.filter.start(*start), readings, 0, None)

    def gain(self, k: int, second: int, left: float, end: int | None = None) -> float:
        """By how much likelier, as a logarithm, the record is if a thruster is lost from a second on.

        Args:
            k: Thruster.
            second: From which it is lost.
            left: Of its force.
            end: Up to which second it is looked at; None: SPAN after it is lost.
        """
        end = min(second + SPAN, len(self.gathered)) if end is None else end
        scaled = _scaled(self._readings, k, second * self._a_second, left)
        _, after = self._over(self._memories[second], scaled, second, end)
        return self._likelihood([*self.gathered[:second], *after]) - self._likelihood(self.gathered[:end])

    def timed(self, best: tuple[float, int, int, float]) -> tuple[float, int, int, float]:
        """The same thruster, lost when it fits best."""
        _, k, second, left = best
        end = min(second + SPAN, len(self.gathered))
        best = (self.gain(k, second, left, end), k, second, left)
        for by in STEPS:
            moved = True
            while moved:
                near = [at for at in (best[2] - by, best[2] + by) if 0 <= at < end]
                better = max([best, *((self.gain(k, at, left, end), k, at, left) for at in near)])
                moved, best = better != best, better
        return best

    def _over(
        self, memory: Memory, readings: Seen, second: int, end: int | None
    ) -> tuple[list[Memory], list[Gathered]]:
        """Through seconds from one on: the memory before each, and what each says."""
        a, memories, gathered = self._a_second, [], []
        for k in range(second, len(readings.target) // a if end is None else end):
            part = jax.tree.map(lambda leaf, k=k: leaf[k * a : (k + 1) * a], readings)
            memories.append(memory)
            memory, one = self._search.filter.over(memory, jnp.asarray(self._rest), part)
            gathered.append(jax.tree.map(np.asarray, one))
        return memories, gathered

    def _likelihood(self, gathered: Sequence[Gathered]) -> float:
        fit, A, s = (np.sum([getattr(one, name) for one in gathered], axis=0) for name in ("fit", "A", "s"))
        return marginal(float(fit), A, s, self._rest, self._search.prior)


def _scaled(readings: Seen, k: int, first: int, left: float) -> Seen:
    target = np.array(readings.target)
    target[first:, k] *= left
    return eqx.tree_at(lambda seen: seen.target, readings, target)


def _jumps(gathered: Sequence[Gathered], prior: Float[np.ndarray, "p p"], n: int) -> Float[np.ndarray, "n seconds"]:
    """Delta of each thruster's factor from each second on, in standard deviations."""
    A, s = (np.stack([getattr(one, name) for one in gathered]) for name in ("A", "s"))
    P = np.linalg.inv(np.linalg.inv(prior) + A.sum(axis=0))
    rest = s - A @ (P @ s.sum(axis=0))
    B, u = (np.cumsum(x[::-1], axis=0)[::-1][:, FIRST : FIRST + n] for x in (A, rest))
    known = np.einsum("tkk->tk", B[:, :, FIRST : FIRST + n]) - np.einsum("tkp,pq,tkq->tk", B, P, B)
    return np.where(known > 0.0, u / np.sqrt(np.where(known > 0.0, known, 1.0)), 0.0).T


def _onset(gathered: Sequence[Gathered]) -> int:
    """The second from which on the record is less likely than before: two levels, by least squares."""
    fit = np.array([float(one.fit) for one in gathered])
    count = np.arange(1, len(fit))
    before = np.cumsum(fit)[:-1] / count
    after = (fit.sum() - np.cumsum(fit)[:-1]) / (len(fit) - count)
    return int(count[np.argmax(np.maximum(before - after, 0.0) ** 2 * count * (len(fit) - count))])
