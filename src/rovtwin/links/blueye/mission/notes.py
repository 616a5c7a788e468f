"""What a Blueye drone says while it flies a mission: notifications by the protocol's numbers (notification.proto)."""

from dataclasses import dataclass

INFO, WARNING, ERROR = 1, 2, 3  # NotificationLevel
UNSPECIFIED = 0  # for what the protocol has no number
NONE_LOADED, LOADED, FAILED_TO_LOAD, COMPLETE = 4, 5, 6, 7
STARTED, PAUSED_NOW, RESUMED, ABORTED_NOW, STUCK, SKIPPED = 21, 22, 23, 24, 25, 30
UNKNOWN_POSITION, TOO_FAR, TOO_DEEP = 2, 12, 13
# Which begins an instruction, which ends it
GO_HOME, GO_SURFACE, GO_SEABED, GO_WAYPOINT, GO_DEPTH, GO_WAYPOINT_DEPTH = 15, 16, 17, 18, 19, 20
WAIT, CAMERA, SET_TILT, SET_MULTIBEAM = 26, 27, 28, 29
WAYPOINT_REACHED, DEPTH_REACHED, ALTITUDE_REACHED, INSTRUCTION_COMPLETE = 9, 10, 11, 8


@dataclass(frozen=True)
class Note:
    """Something for clients and the user: number of the notification, its level, and words."""

    kind: int
    level: int
    text: str = ""
