"""The lists that clients upload, a mission and a fence: they are kept and sent, the mission is not flown here.

The protocol is MAVLink's: a count, items asked for one after the other, an acknowledgement. A list takes the place of
the one before when it is whole and right, not sooner.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

MISSION, FENCE, RALLY = 0, 1, 2  # MAV_MISSION_TYPE
# MAV_MISSION_RESULT
ACCEPTED, ERROR, BAD_FRAME, UNSUPPORTED, NO_SPACE = 0, 1, 2, 3, 4
BAD_LATITUDE, BAD_LONGITUDE, BAD_HEIGHT, BAD_ORDER, DENIED, CANCELLED = 10, 11, 12, 13, 14, 15
MOST = 500  # items of a list
SILENT = 8.0  # an upload whose client is silent for longer is given up, as ArduPilot does [s]
ASK_AGAIN = 1.0  # an item that did not come is asked for again after this [s]
ON_MAP, NO_FRAME = (0, 3, 5, 6), 2  # MAV_FRAME: latitude and longitude, heights over ellipsoid or home; no place
LAST_COMMAND = 252  # of those that stand in missions: NAV_, CONDITION_ and DO_
RETURN_POINT, POLYGONS, CIRCLES = 5000, (5001, 5002), (5003, 5004)  # MAV_CMD of a fence
RALLY_POINT = 5100  # MAV_CMD
WITHOUT_INT = {5: 0, 6: 3}  # MAV_FRAME of whole numbers and the frame that ArduPilot keeps an item in
CORNERS = 3  # of a polygon, at least
WHOLE = range(-(2**31), 2**31)  # what x and y of a MISSION_ITEM_INT hold

Client = tuple[int, int]  # system and component


@dataclass(frozen=True)
class Item:
    """One item: fields of MISSION_ITEM_INT."""

    frame: int
    command: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float

    @classmethod
    def of(cls, message: Any) -> "Item":
        """From a MISSION_ITEM_INT or a MISSION_ITEM, whose coordinates are degrees where they are a place's.

        Coordinates that are no numbers become one that no list takes.
        """
        x, y = message.x, message.y
        if message.get_type() == "MISSION_ITEM":
            scale = 1e7 if message.frame in ON_MAP else 1.0
            x, y = (round(v * scale) if math.isfinite(v * scale) else WHOLE.stop for v in (x, y))
        params = (message.param1, message.param2, message.param3, message.param4)
        frame = WITHOUT_INT[message.frame] if message.frame in WITHOUT_INT else message.frame
        return cls(frame, message.command, message.autocontinue, *params, x, y, message.z)


@dataclass
class Upload:
    """A list under way: who sends which, how long it shall be, what has come, and when somebody spoke last [s]."""

    kind: int
    client: Client
    count: int
    active_at: float
    asked_at: float
    items: list[Item] = field(default_factory=list)


@dataclass
class Missions:
    """The lists that are kept, and the one that comes.

    Attributes:
        current: Item of the mission that would be flown next.
        upload: The list under way, or None.
    """

    current: int = 0
    upload: Upload | None = None
    _lists: dict[int, list[Item]] = field(default_factory=lambda: {MISSION: [], FENCE: [], RALLY: []})

    def items(self, kind: int) -> Sequence[Item]:
        """The items of a list; none where there is no such list."""
        return self._lists.get(kind, [])

    def knows(self, kind: int) -> bool:
        """Whether there are lists of a kind."""
        return kind in self._lists

    def begin(self, kind: int, client: Client, count: int, now: float) -> int:
        """A client wants to upload a list; MAV_MISSION_RESULT. An accepted list of no items clears at once."""
        if not self.knows(kind):
            return UNSUPPORTED
        if self.upload is not None and self.upload.client != client:
            return DENIED
        if count > MOST:
            return NO_SPACE
        self.upload = Upload(kind, client, count, now, now) if count else None
        return ACCEPTED if count else self.clear(kind)

    def take(self, item: Item, kind: int, sequence: int, client: Client, known: bool, now: float) -> int | None:
        """An item of the upload; MAV_MISSION_RESULT, None where the next item shall come.

        Args:
            item: The item.
            kind: The list it is for; one for another list changes nothing.
            sequence: Its number.
            client: Who sends it.
            known: Whether its command is one of MAVLink's.
            now: Real time [s].
        """
        upload = self.upload
        if upload is None or upload.kind != kind:
            return ERROR
        if upload.client != client:
            return DENIED
        if sequence != len(upload.items):
            return BAD_ORDER
        if fault := _fault(upload.kind, item, known):
            self.upload = None
            return fault
        upload.items.append(item)
        upload.active_at = upload.asked_at = now
        if len(upload.items) < upload.count:
            return None
        self.upload = None
        if upload.kind == FENCE and fence_fault(upload.items):
            return ERROR
        self._lists[upload.kind] = upload.items
        self.current = self.current if upload.kind != MISSION else 0
        return ACCEPTED

    def clear(self, kind: int) -> int:
        """Empty a list; MAV_MISSION_RESULT."""
        if not self.knows(kind):
            return UNSUPPORTED
        self._lists[kind] = []
        self.current = self.current if kind != MISSION else 0
        return ACCEPTED

    def choose(self, sequence: int) -> bool:
        """Set the item that comes next; whether there is one."""
        if not 0 <= sequence < len(self._lists[MISSION]):
            return False
        self.current = sequence
        return True


def _fault(kind: int, item: Item, known: bool) -> int:
    """MAV_MISSION_RESULT of an item that cannot be taken, ACCEPTED of one that can."""
    if item.frame not in ON_MAP and not (kind == MISSION and item.frame == NO_FRAME):
        return BAD_FRAME
    if kind == FENCE and item.command not in (RETURN_POINT, *POLYGONS, *CIRCLES):
        return UNSUPPORTED
    if kind == RALLY and item.command != RALLY_POINT:
        return UNSUPPORTED
    if kind == MISSION and not (known and item.command <= LAST_COMMAND):
        return UNSUPPORTED
    on_map = item.frame in ON_MAP
    if item.x not in WHOLE or (on_map and abs(item.x) > 90e7):
        return BAD_LATITUDE
    if item.y not in WHOLE or (on_map and abs(item.y) > 180e7):
        return BAD_LONGITUDE
    return BAD_HEIGHT if on_map and not math.isfinite(item.z) else ACCEPTED


def fence_fault(items: Sequence[Item]) -> str:
    """What is wrong with a fence, empty where nothing is."""
    at = 0
    while at < len(items):
        item = items[at]
        if item.command in CIRCLES and not item.param1 > 0.0:
            return f"circle of radius {item.param1:g} m"
        corners = int(item.param1) if item.command in POLYGONS and math.isfinite(item.param1) else 1
        same = [one.command == item.command and one.param1 == item.param1 for one in items[at : at + corners]]
        if item.command in POLYGONS and (corners < CORNERS or len(same) < corners or not all(same)):
            return f"polygon of {sum(same)} corners, {item.param1:g} named"
        at += corners
    return ""
