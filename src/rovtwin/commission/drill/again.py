"""A cut line of a protocol that allows one line only: the vehicle is looked at again over a new one.

While thrusters push on a turn gets faster or stays as it is; it gets slower once they are off. So only a bound of the
time is told.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovtwin.commission.drill.exercises import CUT, Push
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.log import Log
from rovtwin.live.pulses import Pulsed
from rovtwin.live.record import record
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle.constants import AXES

LATEST, MEAN = "again.mcap", 0.5  # log of the new line; time over which a rate is averaged [s]
SLOWER = 0.7  # of its rate at the cut, below which nothing pushes any more


@dataclass(frozen=True)
class Again:
    """What is seen over the new line.

    Attributes:
        within: Time after the cut by which it was slower, or until which it was looked at [s].
        before: Rate of turn at the cut [rad/s].
        after: Rate of turn at the end [rad/s].
    """

    within: float
    before: float
    after: float

    @property
    def off(self) -> bool:
        """Whether thrusters are off."""
        return self.after < SLOWER * self.before


def require_turn(push: Push) -> None:
    """ConfigError where the push is no turn."""
    if push.axis not in AXES[3:]:
        raise ConfigError("no thruster turns it, and only a turn can be recognised over a new line")


def look_again(work: Work, scenario: Scenario, pulsed: Pulsed, push: Push, cut_at: float) -> Again:
    """Open a new line, which steers nothing, and look at the rate of turn.

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
    before = _rate(pulsed.log, axis)
    with work.connected(scenario, observe=True) as there:
        left = max(CUT.within - (time.monotonic() - cut_at), 2.0 * MEAN)
        record(scenario, there.link, (), there.clock, work.folder / CUT.name / LATEST, left)
    within = time.monotonic() - cut_at
    after = _rate(work.folder / CUT.name / LATEST, axis)
    return Again(within, before, after)


def _rate(path: Path, axis: int) -> float:
    """Size of the rate of turn at the end of a log [rad/s]."""
    log = Log.read(path)
    if "sensor/gyro" not in log or len(log["sensor/gyro"]) < 5:
        raise IdentificationError(f"{path}: found no rates of turn, expected some beside the cut line")
    gyro = log["sensor/gyro"]
    late = gyro.t > gyro.t[-1] - MEAN
    return float(abs(np.mean(gyro.values[late, axis])))
