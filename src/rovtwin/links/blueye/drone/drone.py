"""What a Blueye drone keeps in mind between messages: clients, watchdog, motion, modes, lights. No sockets here."""

import math
import time
from dataclasses import dataclass, field

import numpy as np

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.links.blueye import wire
from rovtwin.links.blueye.drone.clients import Clients
from rovtwin.links.blueye.mission.notes import ABORTED_NOW, UNSPECIFIED, WARNING, Note
from rovtwin.links.blueye.mission.supervisor import READY, RUNNING, Here, Supervisor
from rovtwin.links.servers.pilot_command import PilotCommand

FASTEST = (0.5, 0.5, 0.3)  # of a served vehicle's own controller, which says so itself when it is served [m/s]
FORGET = 10.0  # a client silent for so long is no longer connected, and the next one gets control [s]
AFRESH = 0.5  # a pilot whose watchdog had run out lives again when it has sent for so long [s]
STARTS = 5.0  # so long a mission waits for thrusters: the SDK feeds its first watchdog a second after connecting [s]
AGAIN = 10.0  # between two notifications that somebody is not in control [s]
DEAD = 0.02  # a stick within this is let go, as the vehicle's own controller has it
OBEYED = ("auto_depth", "auto_heading")  # modes that every vehicle can keep; station keeping needs positions


@dataclass(frozen=True)
class About:
    """What a drone says of itself.

    Attributes:
        software: Version of its software. 3.3 and later answer requests for telemetry; from 4.0.5 on the SDK asks for
            missions.
        serial, hardware: Serial number and id of its computer; a drone of a pair gets its place added.
        water_temperature: What it says of the water [degrees Celsius]; the twin's water has none.
        features: Names, separated by commas.
    """

    software: str = "4.0.5-rovtwin"
    serial: str = "ROVTWIN000"
    hardware: str = "00000000000000000000000000rovtwin"
    water_temperature: float = 8.0
    features: str = ""


@dataclass
class Drone:
    """A drone's state as the protocol sees it. `now` is real time [s] of one steady clock.

    Attributes:
        name: One of ServedVehicle.drones.
        about: What it says of itself.
        watchdog_s: Time without the pilot's watchdog after which the thrusters are off [s].
        fastest: Rates ahead, to starboard and down that full sticks ask of what is held [m/s].
        reaches: Steady speeds ahead and down at its largest force [m/s].
        can_keep_position: Whether there are positions, so that station keeping can come on.
        here: Where it is, by its own readings.
        mission: Flies missions.
    """

    name: str
    about: About
    watchdog_s: float
    fastest: tuple[float, float, float] = FASTEST
    reaches: tuple[float, float] = (math.inf, math.inf)
    can_keep_position: bool = False
    clients: Clients = field(default_factory=Clients)
    here: Here = field(default_factory=lambda: Here(-math.inf))
    mission: Supervisor = field(default_factory=Supervisor)
    motion: tuple[float, ...] = wire.STILL
    modes: set[str] = field(default_factory=set)
    lights: float = 0.0
    odometer: float = 0.0  # level way since this was last set to zero [m]
    density: float = 1025.0  # g/l; kept, not used: the twin's depth is a depth already
    armed: bool = False
    time_offset: float = 0.0  # of its clock against the computer's, as SyncTime set it [s]
    dropped: int = 0  # messages that could not be parsed, or came from somebody who may not
    _refused_at: float = -math.inf  # when somebody was last notified of not being in control [s]
    _start_asked: float = -math.inf  # when a mission was to start before thrusters were on [s]
    _afresh: float = -math.inf  # when the pilot sent again after its watchdog had run out [s]

    def still(self) -> None:
        """No motion, no modes and no mission, until somebody asks for them again."""
        self.motion = wire.STILL
        self.modes.clear()
        self._start_asked = -math.inf
        self.mission.abort("the pilot is gone, or another has taken control", hold=False)

    def obey(self, control: wire.Control, address: str, now: float) -> bool:
        """Take a control message that came from a network address; whether telemetry has something new to tell."""
        if isinstance(control, wire.Watchdog):
            before = self._silence(now)
            if self.clients.feed(control.client, now):
                self._arm(before, now)
            return False
        if not self.may_command(address, now):
            return False
        before = (set(self.modes), self.lights)
        if isinstance(control, wire.Motion):
            self.motion = control.share
            if any(abs(share) > DEAD for share in control.share):
                self.mission.pause("the pilot steers")
                self._take_modes()
        elif isinstance(control, wire.Mode):
            self._switch(control)
        elif isinstance(control, wire.Lights):
            self.lights = control.value
        elif isinstance(control, wire.WaterDensity):
            self.density = control.value
        elif isinstance(control, wire.ResetOdometer):
            self.odometer = 0.0
        elif isinstance(control, wire.MissionOrder):
            self._order(control.name, now)
        return before != (self.modes, self.lights)

    def may_command(self, address: str, now: float) -> bool:
        """Whether what came from a network address counts: it does from the pilot's. Else it is dropped, with a note.

        The protocol does not name the client in what it commands; only its watchdog does.
        """
        pilot = self.clients.pilot
        if pilot is not None and not (address and pilot.address and address != pilot.address):
            return True
        self.dropped += 1
        if now - self._refused_at >= AGAIN:
            self._refused_at = now
            who = f"client {pilot.id} is" if pilot else "connect first: nobody is"
            text = f"a command from {address or 'somewhere'} was dropped: not in control ({who})"
            self.mission.notes.append(Note(UNSPECIFIED, WARNING, text))
        return False

    def _order(self, name: str, now: float) -> None:
        self._start_asked = -math.inf
        alive = self._silence(now) <= self.watchdog_s
        if name == "run" and not self.armed and alive and not math.isfinite(self._afresh):
            self._start_asked = now  # before the pilot's first watchdog: `_arm` starts it, or `look` gives up
        elif name == "run":
            # After a silence this may be old, from a client that has died meanwhile: it starts nothing, now or later.
            self.mission.run(self.here, armed=self.armed and alive)
        elif name == "pause":
            self.mission.pause()
        else:
            self.mission.clear()
        self._take_modes()

    def fly(self, here: Here) -> bool:
        """Time has passed, and the drone is there; whether its modes have changed."""
        self.here = here
        if self.armed:
            self.mission.look(here)
        return self._take_modes()

    def _take_modes(self) -> bool:
        """Modes that a mission has switched."""
        before = set(self.modes)
        for name, on in self.mission.modes:
            self._switch(wire.Mode(name, on))
        self.mission.modes.clear()
        return before != self.modes

    def _silence(self, now: float) -> float:
        """Time since the pilot sent anything [s]; infinite without one."""
        pilot = self.clients.pilot
        return now - pilot.last_at if pilot else math.inf

    def _arm(self, silence: float, now: float) -> None:
        """Thrusters on for a watchdog of the pilot, who had been silent before it [s].

        What was sent while the line was down comes all at once when it is whole again, also from a client that has
        died meanwhile, for nothing in the protocol tells how old a message is. So the first watchdog after one that
        ran out does not arm: another must come in its own time, which only the living send.
        """
        if silence > self.watchdog_s:
            if self.armed:  # nobody has looked since it ran out
                self._let_go()
            self._afresh = now
        self.armed = now - self._afresh >= AFRESH
        if self.armed and now - self._start_asked <= STARTS:
            self._order("run", now)

    def _let_go(self) -> None:
        self.armed = False
        self.still()
        self.lights = 0.0  # as the drone does, control.proto

    def _switch(self, mode: wire.Mode) -> None:
        able = mode.name in OBEYED or (mode.name == "station_keeping" and self.can_keep_position)
        if mode.on and able:
            self.modes.add(mode.name)
        elif not mode.on:
            self.modes.discard(mode.name)

    def connect(self, client: wire.Client, address: str, now: float) -> int:
        """A new client and its id. Whenever control changes hands the drone holds still."""
        pilot = self.clients.in_control
        given = self.clients.connect(client, address, now, self.watchdog_s)
        self._handed_over(pilot)
        return given

    def disconnect(self, client_id: int) -> None:
        """A client goes, or is sent away."""
        pilot = self.clients.in_control
        self.clients.disconnect(client_id)
        self._handed_over(pilot)

    def _handed_over(self, pilot: int) -> None:
        if self.clients.in_control != pilot:
            self.still()
            if self.mission.state == READY:  # the next pilot starts only what it has loaded itself
                self.mission.clear()
                self.mission.notes.append(
                    Note(ABORTED_NOW, WARNING, "control has changed hands: load the mission again")
                )
            self.armed, self._afresh = False, -math.inf  # until the new pilot's watchdog comes
            if not self.clients.in_control:
                self.lights = 0.0

    def look(self, now: float) -> str:
        """Watch over the watchdog; says what became of the pilot, or nothing."""
        ended = ""
        pilot = self.clients.pilot
        if self.armed and self._silence(now) > self.watchdog_s:
            ended = f"{pilot.client.name if pilot else 'the pilot'} is silent: thrusters off"
            self._let_go()
        if math.isfinite(self._start_asked) and not self.armed and now - self._start_asked > STARTS:
            self._start_asked = -math.inf
            self.mission.run(self.here, armed=False)
        before = self.clients.in_control
        self.clients.forget(now, max(FORGET, self.watchdog_s))
        self._handed_over(before)
        return ended

    def command(self) -> PilotCommand:
        """What the vehicle shall do now."""
        if self.armed and self.mission.state == RUNNING and self.mission.target is not None:
            motion = (*self._ahead_of_target(), 0.0, 0.0, 0.0)
            return PilotCommand(
                drone=self.name, armed=True, motion=motion, target=self.mission.target, lights=self.lights
            )
        return PilotCommand(
            drone=self.name,
            armed=self.armed,
            motion=self.motion if self.armed else wire.STILL,
            hold_depth=self.armed and "auto_depth" in self.modes,
            hold_heading=self.armed and "auto_heading" in self.modes,
            hold_position=self.armed and "station_keeping" in self.modes,
            lights=self.lights,
        )

    def _ahead_of_target(self) -> tuple[float, float, float]:
        """The target's own velocity as sticks: what is held follows it at its speed, and not only by its distance."""
        north, east, down = self.mission.velocity
        along = (*(np.array([north, east]) @ heading_rotation(self.here.heading or 0.0)).tolist(), down)
        surge, sway, heave = (v / most if most > 0.0 else 0.0 for v, most in zip(along, self.fastest, strict=True))
        most = max(1.0, abs(surge), abs(sway))  # both alike: cut one by one they would lead off the way
        return surge / most, sway / most, heave

    def clock(self) -> float:
        """Its real-time clock: seconds since 1970."""
        return time.time() + self.time_offset
