"""A cut line of a protocol that allows one line only: the vehicle is looked at again over a new one.

A new line may itself keep a vehicle going (a ground station's heartbeat does), so it is opened only when the vehicle
has to be at rest. While thrusters push on a turn gets faster or stays as it is; it gets slower once they are off. So
only a bound of the time is told.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.commission.drill.exercises import CUT, REST, Push
from rovtwin.commission.work import Work
from rovtwin.core.errors import IdentificationError
from rovtwin.core.log import Log
from rovtwin.live.pulses import Pulsed
from rovtwin.live.record import record
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle.constants import AXES

LATEST, MEAN = "again.mcap", 0.5  # log of the new line; time over which a rate is averaged [s]
LATER = 6.0  # until a new line is open and read [s]
SLOWER = 0.7  # of its rate at the cut, below which nothing pushes any more
FELT, LEAST = 5.0, 0.02  # standard deviations of its rate at rest, and rate [rad/s], that a push has to exceed


@dataclass(frozen=True)
class Again:
    """What is seen over the new line.

    Attributes:
        within: Time after the cut by which it was slower, or until which it was looked at [s].
        before: Rate of turn at the cut [rad/s].
        after: Rate of turn at the end [rad/s].
        felt: Whether the push turned it at all.
    """

    within: float
    before: float
    after: float
    felt: bool

    @property
    def off(self) -> bool:
        """Whether thrusters are off."""
        return self.felt and self.after < SLOWER * self.before


def may_look_again(push: Push) -> bool:
    """Whether the push can be recognised over a new line: only a turn can."""
    return push.axis in AXES[3:]


def look_again(work: Work, scenario: Scenario, pulsed: Pulsed, push: Push, cut_at: float) -> Again:
    """Wait until it has to be at rest, open a new line, and look at the rate of turn.

    Args:
        work: Of the stage.
        scenario: Of the push.
        pulsed: The push and its log.
        push: What turned it.
        cut_at: When the line was cut [s, monotonic].

    Raises:
        LinkError: Nobody answers on the new line.
        IdentificationError: There are no rates of turn before or after.
    """
    axis = AXES.index(push.axis) - 3
    rest, before = _rates(pulsed.log, axis, 0.0, REST), _rates(pulsed.log, axis, pulsed.spans[1][1] - MEAN, np.inf)
    while (left := CUT.within - (time.monotonic() - cut_at)) > 0.0:
        work.person.progress(f"waiting {left:.0f} s for the vehicle's own watchdog")
        time.sleep(min(left, 0.5))
    with work.connected(scenario, observe=True) as there:
        record(scenario, there.link, (), there.clock, work.folder / CUT.name / LATEST, 2.0 * MEAN)
    after = _rates(work.folder / CUT.name / LATEST, axis, 0.0, np.inf)
    speed = abs(before.mean() - rest.mean())
    felt = speed > max(FELT * rest.std() / np.sqrt(len(before)), LEAST)
    return Again(time.monotonic() - cut_at, float(speed), float(abs(after.mean() - rest.mean())), bool(felt))


def _rates(path: Path, axis: int, start: float, end: float) -> Float[np.ndarray, " n"]:
    """Rates of turn about an axis between two times of a log [rad/s]."""
    log = Log.read(path)
    gyro = log["sensor/gyro"] if "sensor/gyro" in log else None
    found = np.zeros(0) if gyro is None else gyro.values[(gyro.t >= start) & (gyro.t <= end), axis]
    if len(found) < 5:
        raise IdentificationError(f"{path}: found no rates of turn, expected some beside the cut line")
    return np.asarray(found)
