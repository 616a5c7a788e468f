"""Mission: the supervisor of a drone that flies a client's mission, instruction by instruction. No sockets here.

The vehicle's own controller keeps a target (`PilotCommand.target`); the supervisor moves that target at the speed that
the instruction asks for, and waits where the vehicle does not follow. Times are the vehicle's.
"""

import math
from dataclasses import dataclass
from typing import Any

from rovtwin.links.blueye.mission import notes
from rovtwin.links.blueye.mission.instructions import steps_of, too_fast
from rovtwin.links.blueye.mission.notes import ERROR, INFO, WARNING, Note
from rovtwin.links.blueye.mission.status import status_of
from rovtwin.links.blueye.mission.steps import Able, Refused, Step

INACTIVE, READY, RUNNING, PAUSED, COMPLETED, ABORTED, FAILED_TO_LOAD, FAILED_TO_START = range(1, 9)  # MissionState
LEAD = DIVE_LEAD = 0.5  # of the target before the vehicle, level and in depth: no hold pulls harder by more [m]
CLOSE = 0.3  # a depth is reached within this [m]
PROGRESS, PATIENCE = 0.1, 30.0  # a vehicle that comes no nearer than this in that time is stuck [m, s]
BLIND = 5.0  # without an altitude, or a position, for so long: the mission ends [s]
LONGEST_STEP = 1.0  # of time between two looks that counts [s]


@dataclass(frozen=True)
class Here:
    """Where a drone is.

    Attributes:
        t: Time [s].
        place: North and east [m], or None while it does not know.
        depth: [m], or None.
        heading: [rad], or None.
        altitude: Above the floor [m], or None while it does not see it.
    """

    t: float
    place: tuple[float, float] | None = None
    depth: float | None = None
    heading: float | None = None
    altitude: float | None = None


class Supervisor:
    """Flies missions.

    Attributes:
        state: MissionState of the protocol.
        message: The mission as the client sent it, or None.
        target: Where the vehicle shall be: north, east, down [m], heading [rad]; None while no mission moves it.
        velocity: At which the vehicle shall go: north, east, down [m/s]. That of the target, also while it waits for
            the vehicle: a hold alone pulls no harder than its reach lets it, and the vehicle would be slow.
        tilt: Of the camera [deg].
        modes: Modes of the drone that an instruction switched, for the drone to take.
        notes: What has happened since they were last taken.
    """

    def __init__(self) -> None:
        self.state = INACTIVE
        self.message: Any = None
        self.target: tuple[float, float, float, float] | None = None
        self.velocity = (0.0, 0.0, 0.0)
        self.tilt = 0.0
        self.modes: list[tuple[str, bool]] = []
        self.notes: list[Note] = []
        self._steps: list[Step] = []
        self._at = 0
        self._began = self._elapsed = 0.0
        self._t = -math.inf
        self._best, self._best_at, self._blind_since = math.inf, 0.0, math.inf
        self._left = 0.0
        self._positions = False

    # What clients ask

    def load(self, mission: Any, able: Able) -> None:
        """A client sends a mission."""
        if self.state in (RUNNING, PAUSED):
            self._note(notes.FAILED_TO_LOAD, ERROR, "a mission is under way: clear it first")
            return
        self.clear()
        try:
            self._steps = steps_of(mission, able)
        except Refused as refused:
            self.state = FAILED_TO_LOAD
            for kind in dict.fromkeys((refused.notification, notes.FAILED_TO_LOAD)):
                self._note(kind, ERROR, str(refused))
            return
        self.message, self.state, self._positions = mission, READY, able.position
        self._note(notes.LOADED, INFO, f"{mission.name[:40]!r}: {len(mission.instructions)} instructions")
        for text in too_fast(self._steps, able):
            self._note(notes.UNSPECIFIED, WARNING, text)

    def run(self, here: Here, armed: bool) -> None:
        """A client starts the mission, or lets it go on."""
        if self.state not in (READY, PAUSED):
            self._note(notes.NONE_LOADED, WARNING, "no mission is ready to run")
            return
        lacking = self._lacking(here, armed)
        if lacking is not None:
            self.state = FAILED_TO_START if self.state == READY else PAUSED
            self.notes.append(lacking)
            return
        self._note(notes.STARTED if self.state == READY else notes.RESUMED, INFO)
        if self.state == READY:
            self._at, self._elapsed = 0, 0.0
        self.state, self._t = RUNNING, here.t
        self._begin(here)

    def _lacking(self, here: Here, armed: bool) -> Note | None:
        if not armed:
            return Note(notes.ABORTED_NOW, ERROR, "thrusters are off: feed the watchdog")
        moving = [step for step in self._steps if step.moves and not step.skipped]
        if moving and self._positions and here.place is None:
            return Note(notes.UNKNOWN_POSITION, ERROR, "the drone does not know its position")
        if moving and (here.depth is None or here.heading is None):
            return Note(notes.ABORTED_NOW, ERROR, "the drone does not know its depth and heading")
        return None

    def pause(self, why: str = "") -> None:
        """The mission waits; the vehicle stays where it is."""
        if self.state == RUNNING:
            self.state = PAUSED
            self._hold()
            self._note(notes.PAUSED_NOW, INFO, why)

    def clear(self) -> None:
        """No mission any more."""
        if self.state == RUNNING:
            self._hold()
        self.state, self.message, self._steps, self._at = INACTIVE, None, [], 0

    def abort(self, why: str, kind: int = notes.ABORTED_NOW, hold: bool = True) -> None:
        """The mission ends here, and says why."""
        if self.state not in (RUNNING, PAUSED):
            return
        self.state = ABORTED
        if hold:
            self._hold()
        self.target = None
        if kind != notes.ABORTED_NOW:
            self._note(kind, ERROR, why)
        self._note(notes.ABORTED_NOW, ERROR, why)

    # What the vehicle does

    def look(self, here: Here) -> None:
        """Time has passed: move the target, and go on to the next instruction where one is done."""
        dt = min(max(here.t - self._t, 0.0), LONGEST_STEP)
        self._t = here.t
        if self.state != RUNNING:
            return
        self._elapsed += dt
        step = self._steps[self._at]
        if step.moves and not self._sees(step, here):
            self.velocity = (0.0, 0.0, 0.0)
            return
        if step.moves:
            self._aim(here)
            self._move(step, here, dt)
        done = here.t - self._began >= step.wait if not step.moves else self._left <= 0.0
        if done:
            self._finish(step, here)
        elif step.moves and here.t - self._best_at > PATIENCE:
            self.abort(f"instruction {step.number + 1}: no progress for {PATIENCE:g} s", notes.STUCK)

    def _sees(self, step: Step, here: Here) -> bool:
        """Whether the vehicle knows what the step needs; the mission ends where it has not for a while."""
        knows = self._knows(here)
        knows = knows and (step.place is None or here.place is not None)
        knows = knows and (step.altitude is None or here.altitude is not None)
        if knows:
            self._blind_since = math.inf
            return True
        self._blind_since = min(self._blind_since, here.t)
        if here.t - self._blind_since > BLIND:
            self.abort(f"instruction {step.number + 1}: position, depth or altitude unknown for {BLIND:g} s")
        return False

    def _begin(self, here: Here) -> None:
        step = self._steps[self._at]
        self._began = self._best_at = here.t
        self._best, self._blind_since, self._left = math.inf, math.inf, math.inf
        self.velocity = (0.0, 0.0, 0.0)
        if step.skipped:
            self._note(notes.SKIPPED, WARNING, f"instruction {step.number + 1}: {step.skipped}")
        elif step.begins:
            self._note(step.begins, INFO)
        if step.moves and self._knows(here):
            self._aim(here)
        if step.tilt is not None:
            self.tilt = step.tilt
        if step.modes:
            self.target = None
            self.modes += step.modes

    def _knows(self, here: Here) -> bool:
        """Whether there is a pose to begin from. Half of a pair never knows its place, and moves up and down only."""
        return here.depth is not None and here.heading is not None and (here.place is not None or not self._positions)

    def _aim(self, here: Here) -> None:
        """A target where the vehicle is, if it has none."""
        assert here.depth is not None and here.heading is not None
        if self.target is None:
            north, east = here.place or (0.0, 0.0)
            self.target = north, east, here.depth, here.heading

    def _move(self, step: Step, here: Here, dt: float) -> None:
        """The target goes on towards where the step leads."""
        assert self.target is not None and here.depth is not None and here.heading is not None
        north, east, down, heading = self.target
        depth = step.depth if step.altitude is None else here.depth + (here.altitude or 0.0) - step.altitude
        depth = down if depth is None else max(0.0, depth)
        level, ahead = 0.0, (0.0, 0.0)
        if step.place is not None and here.place is not None:
            level = math.dist(here.place, step.place)
            away = step.place[0] - north, step.place[1] - east
            under_way = level > step.acceptance and math.hypot(*away) > 1e-6
            if under_way:
                heading = math.atan2(away[1], away[0])
            speed = step.speed * max(0.0, math.cos(heading - here.heading))
            if under_way:
                ahead = _velocity(away, speed, dt)
            near = math.dist(here.place, (north, east)) < LEAD
            north, east = _towards((north, east), step.place, speed * dt if near else 0.0)
        (sinking,) = _velocity((depth - down,), step.heave, dt)
        if abs(here.depth - down) < DIVE_LEAD:
            (down,) = _towards((down,), (depth,), step.heave * dt)
        self.target = north, east, down, heading
        if dt > 0.0:
            self.velocity = (*ahead, sinking)
        sunk = abs(here.depth - depth) if step.depth is not None or step.altitude is not None else 0.0
        self._left = max(0.0, level - step.acceptance) + max(0.0, sunk - CLOSE)
        turned = abs(math.remainder(heading - here.heading, math.tau))
        if self._left + turned < self._best - PROGRESS:
            self._best, self._best_at = self._left + turned, here.t

    def _finish(self, step: Step, here: Here) -> None:
        last = self._at + 1 == len(self._steps)
        if not step.skipped and (last or self._steps[self._at + 1].number != step.number):
            self._note(step.ends, INFO, f"instruction {step.number + 1}")
        if last:
            self.state = COMPLETED
            self._hold()
            self._at += 1
            self._note(notes.COMPLETE, INFO)
        else:
            self._at += 1
            self._begin(here)

    def _hold(self) -> None:
        """Whatever comes, the vehicle stays where it is by its own modes, which the pilot can switch off."""
        if self.target is not None:
            self.modes += [("auto_depth", True), ("auto_heading", True), ("station_keeping", True)]
        self.target = None

    def status(self) -> dict[str, Any]:
        """Fields of MissionStatus."""
        id = 0 if self.message is None else self.message.id
        return {"state": self.state, "id": id, **status_of(self._steps, self._at, self._elapsed)}

    def taken_notes(self) -> list[Note]:
        """What has happened, once."""
        notes, self.notes = self.notes, []
        return notes

    def _note(self, kind: int, level: int, text: str = "") -> None:
        self.notes.append(Note(kind, level, text))


def _velocity(way: tuple[float, ...], speed: float, dt: float) -> tuple[float, ...]:
    """Velocity along a way at a speed, or at that which makes the rest of it within a look [m/s]."""
    left = math.hypot(*way)
    share = min(speed, left / dt) / left if left > 0.0 and dt > 0.0 else 0.0
    return tuple(share * part for part in way)


def _towards(here: tuple[float, ...], there: tuple[float, ...], way: float) -> tuple[float, ...]:
    """A point so far on from here on the straight way there, and no further than there."""
    left = math.dist(here, there)
    share = 1.0 if left <= way else way / left
    return tuple(a + share * (b - a) for a, b in zip(here, there, strict=True))
