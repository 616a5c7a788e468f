"""How far a mission has come, as the protocol's MissionStatus has it."""

import math
from collections.abc import Sequence
from typing import Any

from rovtwin.links.blueye.mission.steps import Step

LARGEST = 2**32 - 1  # of the protocol's numbers


def status_of(steps: Sequence[Step], at: int, elapsed: float) -> dict[str, Any]:
    """Fields of MissionStatus but for state and id; no number is larger than the protocol can carry.

    Args:
        steps: Of the whole mission.
        at: The one that is flown now, from 0.
        elapsed: Time since it began [s].
    """
    ahead = steps[at:]
    ways = _ways(ahead)
    time = sum(step.wait + way / step.speed for way, step in zip(ways, ahead, strict=True))
    done = {step.number for step in steps[:at]} - {step.number for step in ahead}
    ids = {step.number: step.id for step in steps}
    return {
        "time_elapsed": _count(elapsed),
        "estimated_time_to_complete": _count(time),
        "distance_to_complete": _count(sum(ways)),
        "completed_instruction_ids": [ids[number] for number in sorted(done)],
        "total_number_of_instructions": len(ids),
    }


def _count(value: float) -> int:
    return int(min(max(value, 0.0), LARGEST))


def _ways(steps: Sequence[Step]) -> list[float]:
    """Level distance of each step from the place before [m]; the first has none."""
    ways, before = [], None
    for step in steps:
        ways.append(0.0 if step.place is None or before is None else math.dist(before, step.place))
        before = step.place or before
    return ways
