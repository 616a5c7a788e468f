"""What a vehicle makes of our sticks, as far as it says: its pilot's gain and the version of its ArduSub."""

from typing import Any

import numpy as np

from rovtwin.links.mavlink.pilot import EXTENDED_SINCE, Sticks, sticks_of_axes
from rovtwin.links.mavlink.wire import number

GAIN, THROTTLE = "JS_GAIN_DEFAULT", "JS_THR_GAIN"
LEAST_GAIN, MOST_THROTTLE = 0.05, 10.0  # what is beyond them is no gain


class Steering:
    """Sticks for axes, once the vehicle has said what it makes of them.

    Attributes:
        gain: Share of full command that full stick gives, or None while it is not known.
        throttle: JS_THR_GAIN: more of it up and down.
        firmware: Major and minor version of ArduSub, or None while it is not known.
    """

    def __init__(self, gain: float | None, firmware: tuple[int, int] | None):
        """What somebody gives is not asked for."""
        self.gain, self.throttle, self.firmware = gain, 1.0, firmware
        self._given = gain is not None

    @property
    def unknown(self) -> str:
        """What the vehicle has not said yet and how to do without; empty where all is known."""
        if self.gain is None:
            return f"it does not say {GAIN} (or give `gain`)"
        return "it does not say AUTOPILOT_VERSION (or give `firmware`)" if self.firmware is None else ""

    def take(self, kind: str, message: Any) -> None:
        """A message of the autopilot, which may say something of it."""
        if kind == "AUTOPILOT_VERSION":
            version = message.flight_sw_version
            self.firmware = self.firmware or (version >> 24 & 0xFF, version >> 16 & 0xFF)
        elif kind == "PARAM_VALUE":
            self._take_value(_text(message.param_id), number(message.param_value))
        elif kind == "NAMED_VALUE_FLOAT":
            self._take_value(_text(message.name), number(message.value))

    def _take_value(self, name: str, value: float) -> None:
        if name == THROTTLE and LEAST_GAIN <= value <= MOST_THROTTLE:
            self.throttle = value
        # Buttons of a ground station change the gain in flight: PilotGain is that of now.
        if name in ("PilotGain", GAIN) and not self._given and LEAST_GAIN <= value <= 1.0:
            if name == "PilotGain" or self.gain is None:
                self.gain = value

    @property
    def extended(self) -> bool:
        """Whether the vehicle is known to take s and t."""
        return self.firmware is not None and self.firmware >= EXTENDED_SINCE

    def sticks(self, axes: np.ndarray) -> Sticks:
        """MANUAL_CONTROL for axes, shape (6,)."""
        return sticks_of_axes(axes, self.gain or 1.0, self.throttle, self.extended)

    def limits(self) -> list[str]:
        """What sticks cannot ask of this vehicle."""
        found = []
        if self.firmware is not None and not self.extended:
            found.append(
                f"ArduSub {self.firmware[0]}.{self.firmware[1]} does not roll and pitch by MANUAL_CONTROL "
                f"({EXTENDED_SINCE[0]}.{EXTENDED_SINCE[1]} and later do): what is commanded there is not given"
            )
        if self.gain is not None and self.gain < 1.0:
            found.append(
                f"the pilot's gain is {self.gain:g}: no more than that share of full command ahead, to the side, down "
                f"and in yaw; raise {GAIN} and start the vehicle anew, or the gain by the joystick's button"
            )
        return found


def _text(name: bytes | str) -> str:
    return name.decode("ascii", "replace") if isinstance(name, bytes) else str(name)
