"""What a vehicle makes of our sticks, as far as it says: its pilot's gains and the version of its ArduSub."""

from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.links.mavlink.firmware.pilot import EXTENDED_SINCE, Sticks, sticks_of_axes
from rovtwin.links.mavlink.wire import number, text_of

GAIN, THROTTLE = "JS_GAIN_DEFAULT", "JS_THR_GAIN"
IN_FORCE = "PilotGain"  # what buttons have made of the gain, sent all the time
LEAST_GAIN, MOST_THROTTLE = 0.05, 10.0  # what is beyond them is no gain
CHANGED = 0.01  # of a gain: a smaller change is none


class Steering:
    """Sticks for axes, once the vehicle has said what it makes of them.

    Attributes:
        gain: Share of full command that full stick gives, or None while it is not known.
        in_force: Whether that is the gain of now and not only the one that it starts with.
        throttle: JS_THR_GAIN, more of it up and down, or None while it is not known.
        firmware: Major and minor version of ArduSub, or None while it is not known.
    """

    def __init__(self, gain: float | None, throttle: float | None, firmware: tuple[int, int] | None):
        """What somebody gives counts, whatever the vehicle says."""
        self.gain, self.throttle, self.firmware = gain, throttle, firmware
        self.in_force = self._given = gain is not None
        self._doubted = False
        self._throttle_given = throttle is not None

    @property
    def unknown(self) -> str:
        """What the vehicle has not said yet and how to do without; empty where all is known."""
        if self.gain is None:
            return f"it does not say {GAIN} (or give `gain`)"
        if self.throttle is None:
            return f"it does not say {THROTTLE} (or give `throttle_gain`)"
        return "it does not say AUTOPILOT_VERSION (or give `firmware`)" if self.firmware is None else ""

    def take(self, kind: str, message: Any) -> str:
        """A message of the autopilot, which may say something of it; what a user should know of it, or nothing."""
        if kind == "AUTOPILOT_VERSION":
            version = message.flight_sw_version
            if version and self.firmware is None:
                self.firmware = version >> 24 & 0xFF, version >> 16 & 0xFF
        elif kind == "PARAM_VALUE":
            self._take_parameter(text_of(message.param_id), number(message.param_value))
        elif kind == "NAMED_VALUE_FLOAT" and text_of(message.name) == IN_FORCE:
            return self._take_gain(number(message.value))
        return ""

    def _take_parameter(self, name: str, value: float) -> None:
        if name == THROTTLE and not self._throttle_given and LEAST_GAIN <= value <= MOST_THROTTLE:
            self.throttle = value
        elif name == GAIN and self.gain is None and LEAST_GAIN <= value <= 1.0:
            self.gain = value

    def _take_gain(self, value: float) -> str:
        """The gain in force, which buttons of a ground station change in flight."""
        if not LEAST_GAIN <= value <= 1.0:
            return ""
        before, known = self.gain, self.in_force
        changed = before is not None and abs(value - before) > CHANGED
        if self._given:
            first, self._doubted = changed and not self._doubted, self._doubted or changed
            return f"it says that the pilot's gain is {value:g}; {before:g}, which was given, counts" if first else ""
        self.gain, self.in_force = value, True
        return f"the pilot's gain is {value:g} now, {before:g} before" if known and changed else ""

    @property
    def extended(self) -> bool:
        """Whether the vehicle is known to take s and t."""
        return self.firmware is not None and self.firmware >= EXTENDED_SINCE

    def sticks(self, axes: Float[np.ndarray, "6"]) -> Sticks:
        """MANUAL_CONTROL for axes."""
        return sticks_of_axes(axes, self.gain or 1.0, self.throttle or 1.0, self.extended)

    @property
    def reach(self) -> float:
        """Share of full command along an axis that sticks can ask for at most."""
        gain = self.gain or 1.0
        return min(gain, gain * (self.throttle or 1.0), 1.0)

    def limits(self) -> list[str]:
        """What sticks cannot ask of this vehicle, and what of it is not sure."""
        found, gain, deep = [], self.gain or 1.0, (self.gain or 1.0) * (self.throttle or 1.0)
        if self.firmware is not None and not self.extended:
            found.append(
                f"ArduSub {self.firmware[0]}.{self.firmware[1]} does not roll and pitch by MANUAL_CONTROL "
                f"({EXTENDED_SINCE[0]}.{EXTENDED_SINCE[1]} and later do): what is commanded there is not given"
            )
        if gain < 1.0:
            down = "" if deep >= 1.0 else ", down" if deep == gain else f", {deep:g} of it down"
            found.append(
                f"the pilot's gain is {gain:g}: no more than that share of full command ahead, to the side{down} and "
                f"in yaw; raise {GAIN} and start the vehicle anew, or the gain by the joystick's button"
            )
        elif deep < 1.0:
            found.append(f"the throttle has a gain of {deep:g}: no more than that share arrives down; raise {THROTTLE}")
        if not self.in_force:
            found.append(
                f"it does not say the gain in force ({IN_FORCE}): {GAIN}, {gain:g}, is taken, which buttons and "
                "JS_GAIN_MIN and JS_GAIN_MAX may have changed"
            )
        return found
