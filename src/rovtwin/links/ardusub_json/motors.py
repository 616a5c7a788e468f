"""ArduSub's motor outputs as commands of our thrusters.

Order and signs of the BlueROV2 Heavy: ArduPilot, libraries/AP_Motors/AP_Motors6DOF.cpp, frame SUB_FRAME_VECTORED_6DOF
(FRAME_CONFIG 2). Motors 1 to 4 are horizontal: front right, front left, rear right, rear left; 5 to 8 vertical in the
same order. A positive output of a motor gives, by the signs of its factors, the opposite of the thruster's direction
in our vehicle file, for all eight: motor 1 pushes backward and to the right, motor 5 downward. MOT_n_DIRECTION is 1 in
ArduPilot's simulation; on a vehicle it makes up for the sense of the propeller.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError

LOWEST, NEUTRAL, HIGHEST = 1100, 1500, 1900  # [us]


@dataclass(frozen=True)
class Motors:
    """Which output drives which thruster.

    Attributes:
        names: Thrusters, in the order of ArduSub's motors, from output 1.
        signs: 1 where a pulse above neutral pushes along the thruster's direction, else -1.
    """

    names: tuple[str, ...]
    signs: tuple[int, ...]

    def commands(self, pwm: Sequence[int], thrusters: Sequence[str]) -> Float[np.ndarray, " n"]:
        """u in the order of `thrusters`, within +-1; off where a pulse is none (0 or out of range).

        Raises:
            LinkError: A thruster has no motor, or there are fewer outputs than motors.
        """
        if len(pwm) < len(self.names):
            raise LinkError(f"ardusub-json: {len(pwm)} outputs for {len(self.names)} motors")
        missing = [name for name in thrusters if name not in self.names]
        if missing:
            raise LinkError(f"ardusub-json: thruster {missing[0]} has no motor; expected {', '.join(self.names)}")
        by_name = {n: s * command(p) for n, s, p in zip(self.names, self.signs, pwm, strict=False)}
        return np.array([by_name[name] for name in thrusters])


def command(pulse: int) -> float:
    """u of a pulse width [us]: 1100 to 1900 is -1 to 1; anything else is off."""
    return (pulse - NEUTRAL) / (HIGHEST - NEUTRAL) if LOWEST <= pulse <= HIGHEST else 0.0


BLUEROV2_HEAVY = Motors(
    (
        *("front_starboard", "front_port", "rear_starboard", "rear_port"),
        *("vertical_front_starboard", "vertical_front_port", "vertical_rear_starboard", "vertical_rear_port"),
    ),
    (-1,) * 8,
)
