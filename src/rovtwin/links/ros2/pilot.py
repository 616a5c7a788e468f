"""Who steers: what clients of ROS 2 sent last, and the command that follows from it."""

from dataclasses import dataclass, field

from rovtwin.links.servers.pilot_command import PilotCommand


@dataclass
class Pilot:
    """One drone's client side. Times are of the host's steady clock [s].

    The vehicle arms when `arm` says so and stays armed while its client sends: the wrench, the way-point or `arm`
    must come again within `life`. A wrench overrides and forgets a way-point. When a client that steers by wrench falls
    silent, or all of them do, one disarmed command goes out; then `arm` must be sent anew.

    Attributes:
        drone: Its name.
        life: How long what was received counts [s].
    """

    drone: str
    life: float
    armed: bool = False
    motion: tuple[float, ...] | None = None
    target: tuple[float, float, float, float] | None = None
    _received_at: float = field(default=-1e9, repr=False)
    _steered: float = field(default=-1e9, repr=False)
    _owed: bool = field(default=False, repr=False)

    def receive_arm(self, now: float, requested: bool) -> None:
        """`arm`: true arms or keeps armed, false disarms at once."""
        self._received_at = now
        if requested:
            self.armed = True
        else:
            self._disarm()

    def receive_motion(self, now: float, motion: tuple[float, ...]) -> bool:
        """A wrench as shares of the largest; whether it counts: not before arming."""
        if self.armed:
            self._received_at = self._steered = now
            self.motion, self.target = motion, None
        return self.armed

    def receive_target(self, now: float, target: tuple[float, float, float, float]) -> bool:
        """A way-point; whether it counts: not before arming, nor while somebody steers by wrench."""
        if self.armed and self.motion is None:
            self._received_at, self.target = now, target
            return True
        return False

    def command(self, now: float) -> PilotCommand | None:
        """What the vehicle shall do now, or None where nobody wants anything."""
        silent = now - self._received_at > self.life or (self.motion is not None and now - self._steered > self.life)
        if self.armed and silent:
            self._disarm()
        if self.armed:
            return PilotCommand(self.drone, True, self.motion or (0.0,) * 6, target=self.target)
        if self._owed:
            self._owed = False
            return PilotCommand(self.drone)
        return None

    def end(self) -> PilotCommand | None:
        """The last command, when the server ends: disarmed, if anything is left to disarm."""
        if not (self.armed or self._owed):
            return None
        self._disarm()
        self._owed = False
        return PilotCommand(self.drone)

    def _disarm(self) -> None:
        # A client that sends `false` gets its command even where nothing was armed by us.
        self.armed, self.motion, self.target, self._owed = False, None, None, True
