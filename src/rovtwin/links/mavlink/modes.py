"""ArduSub's flight modes, and what each asks of the vehicle's own controller.

Numbers: ArduSub's `custom_mode`, as in the project's table of verified wire facts.
"""

from dataclasses import dataclass

from rovtwin.links.servers.pilot_command import MOTIONS


@dataclass(frozen=True)
class Mode:
    """A mode that is flown here, with the holds of `links.servers.pilot_command.PilotCommand` that it stands for."""

    number: int
    name: str
    hold_level: bool = False
    hold_heading: bool = False
    hold_depth: bool = False
    hold_position: bool = False

    @property
    def needs_place(self) -> bool:
        """Whether the vehicle must know where it is; ArduSub 4.5 asks it of SURFACE too, 4.7 does not."""
        return self.hold_position or self.name == "SURFACE"

    @property
    def held(self) -> tuple[bool, ...]:
        """Which of surge, sway, heave, roll, pitch, yaw the vehicle keeps by itself, shape (6,)."""
        plane, level = self.hold_position, self.hold_level
        held = {"surge": plane, "sway": plane, "heave": self.hold_depth, "roll": level, "pitch": level}
        return tuple((held | {"yaw": self.hold_heading})[motion] for motion in MOTIONS)


MANUAL = Mode(19, "MANUAL")
ACRO = Mode(1, "ACRO")
STABILIZE = Mode(0, "STABILIZE", hold_level=True, hold_heading=True)
ALT_HOLD = Mode(2, "ALT_HOLD", hold_level=True, hold_heading=True, hold_depth=True)
POSHOLD = Mode(16, "POSHOLD", True, True, True, True)
GUIDED = Mode(4, "GUIDED", True, True, True, True)
SURFACE = Mode(9, "SURFACE", hold_level=True, hold_heading=True, hold_depth=True)  # it comes up by itself

MODES = {mode.number: mode for mode in (MANUAL, ACRO, STABILIZE, ALT_HOLD, POSHOLD, GUIDED, SURFACE)}

REFUSED = {
    3: "AUTO: missions are flown by the autopilot of rovtwin, not by this endpoint",
    7: "CIRCLE is not part of the twin",
    20: "MOTOR_DETECT is not part of the twin",
    21: "SURFTRAK is not part of the twin: use ALT_HOLD",
}


def refusal(number: int) -> str:
    """Why a mode that is not in MODES cannot be flown, for a STATUSTEXT."""
    return REFUSED.get(number, f"mode {number} is not one of ArduSub's")
