"""The loop: a tick of the autopilot each control period, twenty states a second, and orders as they come."""

import os
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.console.engine.alerts import alerts, alerts_of_link
from rovtwin.console.engine.flights import FlightLog
from rovtwin.console.engine.helm import Helm
from rovtwin.console.engine.manoeuvres import Manoeuvres
from rovtwin.console.engine.setup import setup_of
from rovtwin.console.engine.state import Consistency, Hearing, flown
from rovtwin.console.engine.telling import Teller
from rovtwin.console.engine.trial_helm import TrialHelm
from rovtwin.console.engine.vessel import Shipyard, Vessel, Wanted
from rovtwin.core.errors import ConfigError, LinkError, RovtwinError
from rovtwin.core.flow import Mission
from rovtwin.core.urgent import urgent
from rovtwin.scenario.flight import run_folder
from rovtwin.scenario.pace import SLIP, Pace
from rovtwin.scenario.realtime import NO_WISH
from rovtwin.scenario.schema import MissionSection, Scenario, Waypoint

WISH_LIFE = 0.3  # of a pilot's sticks [s]
SOON = 1e-3  # wait for a world that is computed [s]
CATCH_UP = 20  # ticks at most before orders are heard again


class Engine:
    """A vehicle, its autopilot and its log; `Bridge` gives it orders.

    Attributes:
        armed, arming: Whether commands go to the vehicle, and whether it is being asked to take them.
        stopped: Whether STOP was pressed since it was last armed.
        plan, submitted: Way-points that a start flies, and whether an operator gave them.
        count: Way-points of the mission that was started.
        over: Whether to end.
        test: That is flown in place of a mission, or None.
    """

    def __init__(self, wanted: Wanted, news: str, speed: float = 1.0, runs: str | Path = "runs"):
        """Publishes at the address `news`; logs of flights go into the folder `runs`."""
        self._wanted, self._runs = wanted, Path(runs)
        self._dt = wanted.scenario.control_dt
        self._teller = Teller(news)
        self._stage, self._note = "connecting", ""
        self._yard = Shipyard(wanted, speed, self._say)
        self._running = True
        self._vessel: Vessel | None = None
        self.armed = self.arming = self.stopped = self.over = False
        self._flight: FlightLog | None = None
        self._opening: Future[FlightLog | None] | None = None
        self._ready: FlightLog | None = None
        self._beside = ThreadPoolExecutor(1)
        self.test = Manoeuvres(wanted.scenario) if wanted.scenario.test else None
        self.plan: list[Waypoint] = list(wanted.scenario.waypoints)
        self.submitted, self.count = False, 0
        self._heard_operator = time.monotonic()
        self._wish, self._wished_at = NO_WISH, -np.inf
        self._asked_at = -np.inf  # when arming was asked for
        self._k, self._began, self._pace = 0, 0.0, Pace()
        self._before = ("", "")
        self._urgent = ExitStack()

    def run(self, obey: Callable[[], None], wait: Callable[[float], None]) -> None:
        """Until `over`; `obey` gives orders that came, `wait` waits for more, so many seconds at most."""
        self._yard.begin()
        self._keep_time()
        try:
            while not self.over:
                obey()
                self._take_over(self._yard.ready())
                for _ in range(CATCH_UP):
                    if self._rests() > 0.0 or not self._tick():
                        break
                self._tell()
                wait(min(self._teller.state_rests(), max(self._rests(), SOON)))
        finally:
            self._urgent.close()
            self._let_go("ended")
            self._teller.close()

    # The vehicle

    @property
    def vessel(self) -> Vessel:
        """Raises ConfigError while there is none."""
        if self._vessel is None:
            raise ConfigError(f"no vehicle yet ({self._stage}): wait until its sensors are heard")
        return self._vessel

    @property
    def is_twin(self) -> bool:
        return self._wanted.is_twin

    @property
    def may_arm(self) -> bool:
        """Whether the link takes commands again; that of a real vehicle does not once it was stopped."""
        return self.is_twin or not self.vessel.link.stopped

    def arm(self, asked_at: float) -> None:
        """Ask the vehicle to take commands, as the operator asked [s, monotonic]; what came of it is an event."""
        vessel = self.vessel
        self.operator_heard()
        vessel.helm.idle()
        # It takes some tenths of a second, in which ticks go on. A test has one of its own each time.
        self._opening = self._beside.submit(self._new_flight if self.test is None else lambda: None)
        self.arming, self._asked_at = True, asked_at

    def disarm(self) -> None:
        """Thrusters off, the log closed."""
        self.vessel.link.stop()
        self.vessel.helm.idle()
        was, self.armed, self.arming = self.armed, False, False
        if was:
            self.event("info", "disarmed: thrusters off")
        self._close_flight("disarmed")

    def stop(self) -> None:
        """The operator's STOP, which the link's host may have obeyed before we hear of it."""
        if self._vessel is not None:
            self._vessel.link.stop()
            self._vessel.helm.idle()
        if not self.stopped or self.armed or self.arming:
            self.event("danger", "STOP: thrusters off")
        self.armed, self.arming, self.stopped = False, False, True
        self._close_flight("stopped by the operator")

    def reconnect(self) -> None:
        """Let go of the vehicle and look for it anew."""
        self._let_go("reconnecting")
        self._yard.begin()

    def fly(self, helm: Helm, mission: Mission, count: int) -> None:
        """Start a mission of so many way-points."""
        helm.start(mission)
        self.count = count

    def fly_test(self, helm: TrialHelm, test: Manoeuvres) -> None:
        """Start the test; its log begins with it, so that their times are the same."""
        self._begin_flight(self._new_flight())
        helm.start()
        test.begin()
        self.count = test.count
        self._tell_hand(self._began + self._k * self._dt)

    def submit(self, waypoints: list[Waypoint]) -> None:
        """What the next start flies."""
        self.plan, self.submitted = list(waypoints), True
        self._teller.publish(self._plan_told())
        self.event("info", f"plan submitted: {len(self.plan)} way-points")

    def scenario_with(self, waypoints: list[Waypoint]) -> Scenario:
        """The scenario, with these way-points for its mission; a test's as it is."""
        if self.test is not None:
            return self._wanted.scenario
        return self._wanted.scenario.model_copy(update={"mission": MissionSection(waypoints=waypoints)})

    def wish(self, velocity: np.ndarray) -> None:
        """What the pilot wants now: surge, sway, heave [m/s], turn rate [rad/s], shape (4,)."""
        self.operator_heard()
        self._wish, self._wished_at = tuple(velocity), time.monotonic()

    def operator_heard(self) -> None:
        """A sign of life of who is in control."""
        self._heard_operator = time.monotonic()

    def run_at(self, speed: float | None, running: bool | None) -> None:
        """Let simulated time run so fast, or stand; None leaves it as it is."""
        vessel = self.vessel
        self._yard.speed = speed or self._yard.speed
        self._running = self._running if running is None else running
        vessel.link.tell(("pace", *self._yard.clock.run(self._yard.speed if self._running else 0.0)))
        self._keep_time()

    def _keep_time(self) -> None:
        """Run before others where time is real; faster simulation takes what is left."""
        self._urgent.close()
        self._urgent.enter_context(urgent(self._yard.speed <= 1.0))

    def event(self, level: str, text: str) -> None:
        """Tell that something happened; `level` is info, warning or danger."""
        self._teller.event(level, text, self._k * self._dt)

    # The loop

    def _rests(self) -> float:
        """Until the next tick is due [s]."""
        if self._vessel is None or not self._running:
            return np.inf
        return (self._began + self._k * self._dt - self._yard.clock()) / self._yard.clock.speed

    def _tick(self) -> bool:
        """One tick; False where the world has not come so far, or the vehicle is lost."""
        vessel, clock = self.vessel, self._yard.clock
        try:
            self._hearing.hear(vessel.ears.read())
        except LinkError as error:
            self.event("danger", f"link lost: {error}")
            self._let_go(f"link lost: {error}")
            self._say("lost", str(error))
            return False
        fast, t = clock.speed > 1.0, self._k * self._dt
        if fast:  # in step with the world: neither outruns the other
            vessel.link.tell(("reached", self._began + t))
            if self._hearing.told_until < t - 0.5 * self._dt:
                return False
        readings = self._hearing.news(t, t + 0.5 * self._dt if fast else np.inf)
        late = self._pace.wait(self._began + t, clock, clock.speed)
        if fast and late > SLIP:  # as fast as the computer can, then
            vessel.link.tell(("pace", *clock.slip(late * clock.speed)))
        if (self.armed or self.arming) and vessel.link.stopped_at > self._asked_at:
            self.stop()
        now = time.monotonic()
        # Ages by our own time; faster than real time nothing is too late.
        ages = vessel.link.age, now - self._heard_operator, 0.0 if fast else late / self._dt
        command = vessel.helm.tick(readings, ages, self._wish if now - self._wished_at < WISH_LIFE else NO_WISH)
        if self.armed:
            vessel.link.send(command)
        self._consistency.take(t, vessel.helm.output)
        if self.armed and self._flight is not None:
            self._flight.add(1e3 * late, vessel.link.age)
        if self.test is not None and self.test.running:
            self._go_on(self.test, vessel)
        self._late = max(self._late, late)
        self._k += 1
        if self.arming:
            self._go_on_arming(vessel)
        return True

    def _go_on(self, test: Manoeuvres, vessel: Vessel) -> None:
        """What the test's own time brings, and its end."""
        if vessel.helm.is_over:
            done = flown(vessel.helm.output, 0)
            self._close_flight(done["reason"] or done["phase"])
            return
        for cue in test.tick():
            if not cue.text.isdigit():
                self.event("warning" if cue.hand else "info", cue.text)

    def _take_over(self, vessel: Vessel | None) -> None:
        """Begin to tick with a vehicle that is heard."""
        if vessel is None:
            return
        self._vessel, self._running = vessel, True
        vessel.ears.drain()
        vessel.helm.restart(vessel.readiness.start)
        self._k, self._began, self._pace, self._late = 0, self._yard.clock(), Pace(), 0.0
        vessel.ears.zero = self._began
        names = vessel.composed.sensor_names
        self._hearing, self._consistency = Hearing(names), Consistency(names)
        self._say("ready", "")
        missing = ", ".join(vessel.readiness.missing)
        self.event("info", f"heard {self._wanted.link}{f'; flying without {missing}' if missing else ''}")
        self._teller.publish(self._setup_told())

    def _let_go(self, ending: str) -> None:
        self._close_flight(ending)
        self.armed = self.arming = False
        if self._vessel is not None:
            self._vessel.close()
            self._vessel = None

    def _go_on_arming(self, vessel: Vessel) -> None:
        """First the log is opened, then the vehicle is asked; what came of it is an event."""
        if self._opening is not None:
            if not self._opening.done():
                return
            opening, self._opening = self._opening, None
            try:
                self._ready = opening.result()
            except RovtwinError as error:
                self._refuse(f"no log: {error}")
                return
            vessel.link.begin_arming(self._asked_at)
        elif (refused := vessel.link.refused) is not None:
            if refused:
                self._refuse(refused)
                return
            self.armed, self.arming, self.stopped = True, False, False
            self.event("info", "armed")
            if self._ready is not None:
                self._begin_flight(self._ready)

    def _refuse(self, why: str) -> None:
        self.arming = False
        self.event("danger", f"not armed: {why}")
        self._close_flight("not armed")

    def _new_flight(self) -> FlightLog:
        folder = run_folder(self._wanted.scenario.name, self._runs)
        return FlightLog(self.scenario_with(self.plan), self.vessel.composed, self.vessel.helm, folder)

    def _begin_flight(self, flight: FlightLog) -> None:
        """From now on it is written."""
        flight.began = self._k * self._dt
        self._flight, self._ready = flight, None
        self.event("info", f"logged in {flight.folder}")

    def _tell_hand(self, began: float) -> None:
        """Tell a simulated hand when the test began [s]; inf: it does not."""
        if self.is_twin and self._vessel is not None:
            self._vessel.link.tell(("test", began))

    def _close_flight(self, ending: str) -> None:
        if self._opening is not None:
            opening, self._opening = self._opening, None
            opening.add_done_callback(lambda done: _close(done, ending))
        if self._ready is not None:
            ready, self._ready = self._ready, None
            ready.close(ending)
        if self.test is not None and self.test.running:
            self.test.end(ending)
            self._tell_hand(np.inf)
        if self._flight is not None:
            flight, self._flight = self._flight, None
            flight.close(ending)
            self.event("info", f"log closed: {flight.folder}")

    # What is told

    def _say(self, stage: str, note: str) -> None:
        self._stage, self._note = stage, note

    def _tell(self) -> None:
        if not self._teller.state_due():
            return
        self._teller.publish(self._state())
        if self._teller.all_due():
            self._teller.publish({"kind": "history", "events": self._teller.events})
            self._teller.publish(self._plan_told())
            if self._vessel is not None:
                self._teller.publish(self._setup_told())

    def _state(self) -> dict[str, Any]:
        now = time.monotonic()
        state: dict[str, Any] = {
            "kind": "state",
            "sent": now,
            "pid": os.getpid(),
            "stage": self._stage,
            "note": self._note,
            "scenario": self._wanted.scenario.name,
            "link": self._wanted.link,
            "speed": self._yard.speed,
            "running": self._running,
            "armed": self.armed,
            "arming": self.arming,
            "stopped": self.stopped,
            "operator_age": now - self._heard_operator,
            "submitted": self.submitted,
            "folder": "" if self._flight is None else str(self._flight.folder),
        }
        vessel = self._vessel
        if vessel is None or self._k == 0:
            return state | {"alerts": alerts_of_link(self._stage, self._note)}
        t, truth = (self._k - 1) * self._dt, self._hearing.truth
        state |= flown(vessel.helm.output, self.count) | {
            "t": t,
            "sensors": self._hearing.told(t),
            "nis": self._consistency.told(t),
            "link_age": vessel.link.age,
            "late_ms": 1e3 * self._late,
            "truth": None if truth is None else truth[:6],
            "current": None if truth is None else truth[6:9],
        }
        self._late = 0.0
        if self.test is not None:
            state |= {"trial": self.test.told(), "progress": min(self.test.time / self.test.duration, 1.0)}
        if vessel.helm.is_idle:
            state |= {"phase": "idle", "reason": "", "u": np.zeros_like(state["u"]), "progress": 0.0}
        self._note_changes(state)
        return state | {"alerts": alerts(state, vessel.composed.thruster_names)}

    def _note_changes(self, state: dict[str, Any]) -> None:
        """An event for each reason of the supervisor, and for the end of a mission."""
        phase, reason = now = (state["phase"], state["reason"])
        if reason and reason != self._before[1]:
            self.event("danger", f"{phase}: {reason}")
        elif phase != self._before[0] and phase in ("finished", "returned", "surfaced"):
            self.event("info", phase)
        self._before = now

    def _plan_told(self) -> dict[str, Any]:
        waypoints = [waypoint.model_dump(exclude_none=True) for waypoint in self.plan]
        return {"kind": "flown", "submitted": self.submitted, "waypoints": waypoints}

    def _setup_told(self) -> dict[str, Any]:
        return setup_of(self._wanted, self.vessel.composed, self.vessel.readiness, self.test and self.test.laid_out())


def _close(opening: Future[FlightLog | None], ending: str) -> None:
    """A log that was opened for nothing."""
    if opening.exception() is None and (flight := opening.result()) is not None:
        flight.close(ending)
