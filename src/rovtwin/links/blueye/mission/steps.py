"""A Blueye mission as steps to fly, and what a drone can do of one."""

import math
from dataclasses import dataclass

from rovtwin.core.datum import Datum
from rovtwin.core.errors import LinkError
from rovtwin.links.blueye.mission import notes

SPEED, HEAVE = 0.3, 0.2  # ahead, and up and down, where a mission gives none [m/s]
ACCEPTANCE = 1.0  # radius around a way-point, where a mission gives none [m]


class Refused(LinkError):
    """A mission that cannot be done; `notification` is the protocol's number for why."""

    def __init__(self, text: str, notification: int = notes.FAILED_TO_LOAD):
        super().__init__(text)
        self.notification = notification


@dataclass(frozen=True)
class Step:
    """One thing to do.

    Attributes:
        number: Of its instruction in the mission, from 0; a survey has many steps of one instruction.
        id: Of the instruction, as the client has it.
        begins, ends: Notifications when it begins and is done; 0: none.
        place: North and east to go to [m], or None.
        depth: To go to [m], or None.
        altitude: Above the floor to go to [m], or None.
        speed, heave: Ahead, and up and down [m/s].
        acceptance: Radius around the place [m].
        wait: How long nothing else is done [s].
        tilt: Of the camera from then on [deg], or None.
        modes: The drone's modes, on or off, from then on.
        skipped: Why it is left out; empty where it is not.
    """

    number: int
    id: int
    begins: int = 0
    ends: int = notes.INSTRUCTION_COMPLETE
    place: tuple[float, float] | None = None
    depth: float | None = None
    altitude: float | None = None
    speed: float = SPEED
    heave: float = HEAVE
    acceptance: float = ACCEPTANCE
    wait: float = 0.0
    tilt: float | None = None
    modes: tuple[tuple[str, bool], ...] = ()
    skipped: str = ""

    @property
    def moves(self) -> bool:
        return self.place is not None or self.depth is not None or self.altitude is not None


@dataclass(frozen=True)
class Able:
    """What a drone can do.

    Attributes:
        datum: Where n is on the map, or None: no way-points then.
        position: Whether it knows and keeps its place.
        altitude: Whether it measures its distance to the floor.
        here: Where it is, north and east [m], or None.
        fastest: Speeds that it reaches ahead, and up and down [m/s].
    """

    datum: Datum | None
    position: bool
    altitude: bool
    here: tuple[float, float] | None
    fastest: tuple[float, float] = (math.inf, math.inf)
