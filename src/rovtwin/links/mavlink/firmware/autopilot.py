"""What an ArduSub decides: mode, armed or not, who is connected, when it lets go. No sockets; times are given."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from rovtwin.links.mavlink.firmware.guided import Order, Place
from rovtwin.links.mavlink.firmware.missions import Missions
from rovtwin.links.mavlink.firmware.parameters import Parameters
from rovtwin.links.mavlink.mixing import Mixer, clean_axes
from rovtwin.links.mavlink.modes import ALT_HOLD, GUIDED, MANUAL, MODES, SURFACE, Mode, refusal
from rovtwin.links.servers.pilot_command import PilotCommand

EMERGENCY, CRITICAL, WARNING, INFO = 0, 2, 4, 6  # MAV_SEVERITY
SURFACE_DEPTH = 0.1  # from here on it is at the surface, ArduSub's parameter of that name [m]
VELOCITY_LIFE = 3.0  # a velocity set-point older than this stops the vehicle [s]; as ArduSub's GUIDED does

Say = Callable[[int, str], None]  # severity and text of a STATUSTEXT


@dataclass
class Autopilot:
    """State of the vehicle's autopilot as its clients see it.

    Attributes:
        parameters: Time-outs, gain and whose input counts.
        say: Takes what ArduSub would put into a STATUSTEXT.
        mixer: Turns axes into shares of the largest force; None takes axes for shares.
        fastest: Largest velocity ahead, to the right, down [m/s] and turn rate [rad/s] that a share of 1 of a held
            motion stands for.
        drone: Name for its commands.
        missions: The lists that clients uploaded.
        knows_place: Whether the vehicle knows where it is now, which modes that hold a place and SURFACE need.
    """

    parameters: Parameters
    say: Say
    mixer: Mixer | None = None
    fastest: tuple[float, float, float, float] = (1.0, 1.0, 0.5, 1.0)
    drone: str = ""
    mode: Mode = MANUAL
    armed: bool = False
    axes: Float[np.ndarray, "6"] = field(default_factory=lambda: np.zeros(6))
    target: Place | None = None
    missions: Missions = field(default_factory=Missions)
    knows_place: Callable[[], bool] = lambda: True
    _velocity: tuple[float, float, float, float] | None = None
    _velocity_at: float = 0.0
    _input_at: float = -np.inf
    _received_at: float = -np.inf
    _armed_by: int = 0
    _steered: bool = False
    _neutral_reported: bool = False
    _refused: str = ""

    def arm(self, by: int, now: float, ready: str) -> bool:
        """Arm for system `by`; `ready` says what is missing, if anything is. Whether it is armed now."""
        if ready:
            self.say(CRITICAL, f"Arm: {ready}")
            return False
        if not self.armed:
            self.armed, self._armed_by = True, by
            # Both fail-safes count from here: an ArduSub that never received anything would not let go at all.
            self._input_at = self._received_at = now
            self._let_go()
            self.say(INFO, "Arming motors")
        return True

    def disarm(self) -> None:
        """Disarm; nothing of what was asked before is left."""
        if self.armed:
            self.say(INFO, "Disarming motors")
        self.armed = False
        self._let_go()

    def set_mode(self, number: int) -> bool:
        """Change mode; whether it could be."""
        if number not in MODES:
            self.say(WARNING, f"Mode refused: {refusal(number)}")
            return False
        if MODES[number].needs_place and not self.knows_place():
            self.say(WARNING, f"Mode change failed: {MODES[number].name} requires position")
            return False
        if MODES[number] != self.mode:
            self.mode = MODES[number]
            self._let_go()
        return True

    def arrive(self, depth: float) -> None:
        """SURFACE ends at the surface: from there on the depth is held. `depth` in [m]."""
        if self.armed and self.mode is SURFACE and depth <= SURFACE_DEPTH:
            self.set_mode(ALT_HOLD.number)

    def lose_depth(self) -> None:
        """Without a depth SURFACE would push up for ever: the vehicle goes to MANUAL, with neutral sticks."""
        if self.armed and self.mode is SURFACE:
            self.say(CRITICAL, "Depth lost: SURFACE ended")
            self.axes = np.zeros(6)
            self.set_mode(MANUAL.number)

    def is_pilot(self, system: int) -> bool:
        """Whether a system is the one whose silence disarms: SYSID_MYGCS, or who armed."""
        return system in (int(self.parameters["SYSID_MYGCS"]), self._armed_by)

    def has_pilot(self, now: float) -> bool:
        """Whether that system has spoken lately."""
        return now - self._received_at <= self.parameters["FS_GCS_TIMEOUT"]

    def heartbeat(self, system: int, now: float) -> None:
        """A ground station is there."""
        if self.is_pilot(system):
            self._received_at = now

    def steer(self, system: int, axes: Float[np.ndarray, "6"] | None, now: float) -> bool:
        """A pilot's input; whether it counts: it must come from SYSID_MYGCS and be whole."""
        if system != int(self.parameters["SYSID_MYGCS"]) or axes is None:
            return False
        self.axes = clean_axes(axes)
        self._input_at = self._received_at = now
        self._steered, self._neutral_reported = True, False
        return True

    def obey(self, system: int, order: Order, now: float) -> bool:
        """An order of GUIDED, from any system; whether it counts."""
        if self.mode is not GUIDED:
            return False
        if order.refusal:
            if order.refusal != self._refused:  # set-points come many times a second
                self.say(WARNING, f"Set-point refused: {order.refusal}")
            self._refused = order.refusal
            return False
        self._refused = ""
        self.heartbeat(system, now)  # set-points of others do not keep the fail-safe from acting
        self.target, self._velocity, self._velocity_at = order.target, order.velocity, now
        return True

    def check(self, now: float) -> None:
        """Fail-safes: a pilot or a ground station that is silent.

        Sticks that came and ceased count in every mode, also in GUIDED; where none ever came, GUIDED does without.
        """
        late = now - self._input_at > self.parameters["FS_PILOT_TIMEOUT"]
        if not self.armed:
            self._steered = self._steered and not late
            return
        if not self.has_pilot(now):
            self.say(CRITICAL, "MYGCS: heartbeat lost")
            self.disarm()
        elif late and (self._steered or self.mode is not GUIDED):
            if not self._neutral_reported:
                self.say(CRITICAL, "Lost manual control")
            self._neutral_reported, self._steered = True, False
            self.axes, self.target = np.zeros(6), None
            if self.parameters["FS_PILOT_INPUT"] == 2:
                self.disarm()

    @property
    def failing(self) -> bool:
        """Whether a fail-safe acts: the pilot is silent."""
        return self.armed and self._neutral_reported

    def command(self, now: float) -> PilotCommand:
        """What the vehicle shall do now."""
        if not self.armed:
            return PilotCommand(self.drone)
        mode = self.mode
        return PilotCommand(
            self.drone,
            armed=True,
            motion=tuple(float(m) for m in self._motion(now)),
            hold_depth=mode.hold_depth,
            hold_heading=mode.hold_heading,
            hold_level=mode.hold_level,
            hold_position=mode.hold_position,
            target=self.target if mode is GUIDED else None,
        )

    def _motion(self, now: float) -> Float[np.ndarray, "6"]:
        if self.mode is GUIDED:
            return self._kept_velocity(now)
        held = np.array(self.mode.held)
        axes = self.axes.copy()
        if self.mode is SURFACE:
            axes[2] = -1.0  # up
        # Sticks of what is held are rates; the others go through ArduSub's mixing.
        free = np.where(held, 0.0, axes)
        shares = free if self.mixer is None else self.mixer.motion(free)
        return np.where(held, axes, shares)

    def _kept_velocity(self, now: float) -> Float[np.ndarray, "6"]:
        if self._velocity is None or now - self._velocity_at > VELOCITY_LIFE:
            return np.zeros(6)
        ahead, right, down, turn = np.clip(np.array(self._velocity) / self.fastest, -1.0, 1.0)
        return np.array([ahead, right, down, 0.0, 0.0, turn])

    def _let_go(self) -> None:
        self.axes, self.target, self._velocity = np.zeros(6), None, None
        self._neutral_reported = False
