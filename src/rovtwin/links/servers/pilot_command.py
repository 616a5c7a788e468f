"""PilotCommand: what a client asks of a vehicle's own controller, whatever protocol it came by."""

import math
from dataclasses import dataclass

MOTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class PilotCommand:
    """What one drone shall do until the next command.

    Attributes:
        drone: Its name, one of `ServedVehicle.drones`.
        armed: Whether its thrusters may turn at all.
        motion: Surge, sway, heave, roll, pitch, yaw (FRD: heave down, yaw clockwise), each a share of the largest force
            or moment, -1 to 1, shape (6,). With a hold on, the share of the largest rate of what is held.
        hold_depth, hold_heading, hold_level, hold_position: what the vehicle keeps by itself, at the value that it
            had when the hold came on or the stick was let go.
        target: Place in n and heading [m, m, m, rad] to go to and keep, or None.
        lights: 0 to 1.
    """

    drone: str = ""
    armed: bool = False
    motion: tuple[float, ...] = (0.0,) * 6
    hold_depth: bool = False
    hold_heading: bool = False
    hold_level: bool = False
    hold_position: bool = False
    target: tuple[float, float, float, float] | None = None
    lights: float = 0.0

    def __post_init__(self) -> None:
        # What is no number commands nothing: a client's mistake must not move a vehicle.
        clean = tuple(min(1.0, max(-1.0, float(m))) if math.isfinite(m) else 0.0 for m in self.motion)
        object.__setattr__(self, "motion", clean)
        object.__setattr__(self, "lights", min(1.0, max(0.0, self.lights)) if math.isfinite(self.lights) else 0.0)
        if self.target is not None and not all(math.isfinite(x) for x in self.target):
            object.__setattr__(self, "target", None)
