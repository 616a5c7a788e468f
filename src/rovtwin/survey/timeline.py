"""Where a vehicle is at every instant of a planned way, and which line it is on."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rovtwin.survey.pace import Pace
from rovtwin.survey.route import Path

MOST_STEPS = 4000
FINEST = 0.25  # of the steps [s]


@dataclass(frozen=True, eq=False)
class Timeline:
    """A way by time, step after step of equal length.

    Attributes:
        step: Length of a step [s].
        place: At the end of each step, n [m].
        heading: In each step [rad].
        speed: In each step, ahead [m/s]; 0 where the vehicle stands, speeds up, slows down or turns.
        line: Number of the leg that sees, counted along the way; -1 on all other legs and while the vehicle turns.
    """

    step: float
    place: Float[np.ndarray, "n 2"]
    heading: Float[np.ndarray, " n"]
    speed: Float[np.ndarray, " n"]
    line: Int[np.ndarray, " n"]

    @property
    def seconds(self) -> float:
        return self.step * len(self.heading)


def timeline_of(path: Path, pace: Pace, before: float = 0.0) -> Timeline:
    """The way of a plan.

    A leg is flown at the survey's speed; what speeding up and slowing down take beyond that, and turns, the vehicle
    stands at the corner before it.

    Args:
        path: Of the vehicle or of what it sees with.
        pace: How it moves.
        before: Time at the first point before the way begins, diving for instance [s].
    """
    legs = np.diff(path.points, axis=0)
    length = np.linalg.norm(legs, axis=1)
    heading = np.arctan2(legs[:, 1], legs[:, 0])
    bends = np.r_[True, np.abs(np.angle(np.exp(1j * np.diff(heading)))) > 1e-4]
    turning = np.r_[0.0, pace.turn(np.angle(np.exp(1j * np.diff(heading))))]
    ramps = float(pace.leg(np.array(1e3 * pace.speed)) - 1e3)
    waiting = np.where(bends, turning + ramps, 0.0)
    waiting[0] += before
    moving = length / pace.speed
    step = max(FINEST, float(waiting.sum() + moving.sum()) / MOST_STEPS)
    parts = []
    for i, leg in enumerate(legs):
        still, on = (max(round(t / step), least) for t, least in ((waiting[i], 0), (moving[i], 1)))
        share = np.r_[np.zeros(still), (np.arange(on) + 1.0) / on]
        seeing = np.r_[np.full(still, -1), np.full(on, np.sum(path.sees[: i + 1]) - 1 if path.sees[i] else -1)]
        parts.append(
            (path.points[i] + share[:, None] * leg, np.full(still + on, heading[i]),
             np.where(np.arange(still + on) < still, 0.0, pace.speed), seeing)
        )  # fmt: skip
    place, angle, speed, line = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Timeline(step, place, angle, speed, line.astype(int))
