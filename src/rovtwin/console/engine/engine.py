"""The loop: a tick of the autopilot each control period, twenty states a second, and orders as they come."""

import logging
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.console.engine.experiment_helm import ExperimentHelm
from rovtwin.console.engine.fence import Polygon, fault_of, with_fence
from rovtwin.console.engine.flights import Logbook
from rovtwin.console.engine.helm import Helm
from rovtwin.console.engine.lending import LENT, WHY, Lending
from rovtwin.console.engine.manoeuvres import Manoeuvres
from rovtwin.console.engine.reporting.alerts import alerts, alerts_of_link
from rovtwin.console.engine.reporting.publisher import Publisher
from rovtwin.console.engine.reporting.setup import setup_of
from rovtwin.console.engine.reporting.state import Changes, counted, flown, plan_message
from rovtwin.console.engine.switch import ArmSwitch
from rovtwin.console.engine.ticker import Ticker
from rovtwin.console.engine.vehicle_session import STEPS, EngineConfig, SessionBuilder, VehicleSession
from rovtwin.core.errors import ConfigError, LinkError, RovtwinError
from rovtwin.core.flow import Mission
from rovtwin.core.processes.urgent import urgent
from rovtwin.runs.realtime import NO_PILOT_COMMAND
from rovtwin.scenario.schema import MissionSection, Scenario, Waypoint

logger = logging.getLogger(__name__)

PILOT_COMMAND_LIFE = 0.3  # of a pilot's sticks [s]
SOON = 1e-3  # wait for a world that is computed [s]
CATCH_UP = 20  # ticks at most before orders are taken again
AGAIN = 0.05  # until the next turn of a loop that failed [s]


class Engine:
    """A vehicle, its autopilot and its log; `Bridge` gives it orders.

    Attributes:
        switch: Whether commands go to the vehicle.
        plan, submitted: Way-points that a start flies, and whether an operator gave them.
        count: Way-points of the mission that was started.
        over: Whether to end.
        test: That is flown in place of a mission, or None.
        added_current: Current that was put into the twin's water beside the world's own, north and east [m/s].
    """

    def __init__(self, config: EngineConfig, news: str, speed: float = 1.0, runs: str | Path = "runs"):
        """Publishes at the address `news`; logs of flights go into the folder `runs`."""
        self._config, self._scenario = config, config.scenario
        self._publisher = Publisher(news)
        self._stage, self._note = "connecting", ""
        self._builder = SessionBuilder(config, speed, self._say)
        self._running = True
        self._ticker: Ticker | None = None
        self._now = 0.0  # time of the tick that comes, or of the last vehicle's [s]
        self.over = False
        self._logbook = Logbook(Path(runs), self.event)
        self.switch = ArmSwitch(self._logbook, self.event)
        self.test = Manoeuvres(config.scenario) if config.scenario.test else None
        self.plan: list[Waypoint] = list(config.scenario.waypoints)
        self.submitted, self.count = False, 0
        self.added_current = 0.0, 0.0
        self._operator_at = time.monotonic()
        self._pilot_command, self._commanded_at = NO_PILOT_COMMAND, -np.inf
        self._changes = Changes()
        self._urgent = ExitStack()
        self._lending = Lending(config.held)

    def run(self, obey: Callable[[], None], wait: Callable[[float], None]) -> None:
        """Until `over`; `obey` gives orders that came, `wait` waits for more, so many seconds at most."""
        if self._lending.lent:
            self._say(LENT, WHY)
        else:
            self._builder.begin()
        self._keep_time()
        try:
            while not self.over:
                try:
                    self._turn(obey, wait)
                except Exception as error:  # a mistake of ours, too: no thrust then, and whoever looks is informed
                    self._fail(error)
                    time.sleep(AGAIN)
        finally:
            self._urgent.close()
            self._let_go("ended")
            self._publisher.close()

    def _turn(self, obey: Callable[[], None], wait: Callable[[float], None]) -> None:
        obey()
        self._take_over(self._builder.ready())
        if self._lending.came_back():
            self.event("info", "the vehicle is given back")
            self.reconnect()
        if not self._running:
            self._listen()
        for _ in range(CATCH_UP):
            if self._rests() > 0.0 or not self._tick():
                break
        self._tell()
        wait(min(self._publisher.state_rests(), max(self._rests(), SOON)))

    # The vehicle

    @property
    def session(self) -> VehicleSession:
        """Raises ConfigError while there is none."""
        if self._lending.lent:
            raise ConfigError(WHY)
        if self._ticker is None:
            raise ConfigError(f"no vehicle yet ({self._stage}): wait until its sensors deliver readings")
        return self._ticker.session

    @property
    def is_making_ready(self) -> bool:
        """Whether a vehicle is being made ready, in a thread that knows of no end."""
        return self._builder.is_making

    @property
    def is_twin(self) -> bool:
        return self._config.is_twin

    @property
    def may_arm(self) -> bool:
        """Whether the link takes commands again; that of a real vehicle does not once it was stopped."""
        return self.is_twin or not self.session.link.stopped

    def arm(self, asked_at: float) -> None:
        """Ask the vehicle to take commands, as the operator asked [s, monotonic]; what came of it is an event."""
        session = self.session
        self.note_operator()
        session.helm.idle()
        if self.test is None:  # a test has a log of its own each time
            self._logbook.open(self.scenario_with(self.plan), session.simulation, session.helm, session.watch)
        self.switch.ask(asked_at)

    def disarm(self) -> None:
        """Thrusters off, the log closed."""
        self.session.link.stop()
        was = self.switch.off()
        self.session.helm.idle()
        if was:
            self.event("info", "disarmed: thrusters off")
        self._end_flight("disarmed")

    def stop(self) -> None:
        """The operator's STOP, which the link's host may have obeyed before we hear of it."""
        if self._ticker is not None:
            self._ticker.session.link.stop()
        if self.switch.stop():
            self.event("danger", "STOP: thrusters off")
        if self._ticker is not None:
            self._ticker.session.helm.idle()
        self._end_flight("stopped by the operator")

    def lend(self) -> None:
        """Let go of the vehicle, for a commissioning, until that is over.

        Raises:
            ConfigError: It is armed, or being made ready.
        """
        if self.switch.armed or self.switch.arming:
            raise ConfigError("the console has armed the vehicle: disarm it first")
        if self.is_making_ready:
            step = self._builder.step
            doing = "" if step is None else f" ({STEPS[step.number - 1]}, {step.number} of {len(STEPS)})"
            raise ConfigError(f"the console is making the vehicle ready{doing}. Start when it is: a minute or two")
        if (made := self._builder.ready()) is not None:  # that nobody has taken over yet
            made.close()
        self._let_go("lent to a commissioning")
        self._lending.lend()
        self._say(LENT, WHY)
        self.event("info", "the vehicle is lent to a commissioning")

    def reconnect(self) -> None:
        """Let go of the vehicle and look for it anew.

        Raises:
            ConfigError: A commissioning holds it.
        """
        if self._lending.lent:
            raise ConfigError(WHY)
        self._let_go("reconnecting")
        self._builder.begin()

    def fly(self, helm: Helm, mission: Mission, waypoints: list[Waypoint]) -> None:
        """Start a mission through way-points."""
        helm.start(mission)
        self.count = len(waypoints)
        self._logbook.flown(self.scenario_with(waypoints), self._now)

    def fly_test(self, helm: ExperimentHelm, test: Manoeuvres) -> None:
        """Start the test; its log begins with it, so that their times are the same."""
        self._logbook.open(self.scenario_with(self.plan), self.session.simulation, helm, self.session.watch)
        self._logbook.begin(self._now)
        self.event("info", f"logged in {self._logbook.folder}")
        helm.start()
        test.begin()
        self.count = test.count
        assert self._ticker is not None
        self._tell_hand(self._ticker.began + self._now)

    def submit(self, waypoints: list[Waypoint]) -> None:
        """What the next start flies."""
        self.plan, self.submitted = list(waypoints), True
        self._publisher.publish(self._plan_message())
        self.event("info", f"plan submitted: {counted(len(self.plan))}")

    def scenario_with(self, waypoints: list[Waypoint]) -> Scenario:
        """The scenario, with these way-points for its mission; a test's as it is."""
        if self.test is not None:
            return self._scenario
        return self._scenario.model_copy(update={"mission": MissionSection(waypoints=waypoints)})

    def set_fence(self, helm: Helm, polygon: Polygon | None) -> None:
        """From the next flight on the vehicle stays within a polygon; None: within the scenario's own.

        Raises:
            ConfigError: It is armed, or the polygon is no fence for where the vehicle is.
        """
        if self.switch.armed or self.switch.arming:
            raise ConfigError("armed: disarm first; a fence is that of a whole flight, and its log has it")
        if polygon is not None and (fault := fault_of(polygon, np.asarray(helm.output.estimate.position)[:2])):
            raise ConfigError(f"fence: {fault}")
        self._scenario = self._config.scenario if polygon is None else with_fence(self._config.scenario, polygon)
        helm.fence(self._scenario.autopilot.supervisor.geofence.polygon)
        self._publisher.publish(self._setup_message())
        self.event("info", "the fence is the scenario's again" if polygon is None else "fence drawn")

    def steer(self, velocity: Float[np.ndarray, "4"]) -> None:
        """The pilot's command: surge, sway, heave [m/s], turn rate [rad/s]."""
        self.note_operator()
        self._pilot_command, self._commanded_at = tuple(velocity), time.monotonic()

    def note_operator(self) -> None:
        """A sign of life of who is in control."""
        self._operator_at = time.monotonic()

    def run_at(self, speed: float | None, running: bool | None) -> None:
        """Let simulated time run so fast, or stand; None leaves it as it is."""
        session = self.session
        self._builder.speed = speed or self._builder.speed
        self._running = self._running if running is None else running
        session.link.tell(("pace", *self._builder.clock.run(self._builder.speed if self._running else 0.0)))
        self._keep_time()

    def _keep_time(self) -> None:
        """Run before others where time is real; faster simulation takes what is left."""
        self._urgent.close()
        self._urgent.enter_context(urgent(self._builder.speed <= 1.0))

    def event(self, level: str, text: str) -> None:
        """Tell that something happened; `level` is info, warning or danger."""
        self._publisher.event(level, text, self._now)

    # The loop

    def _rests(self) -> float:
        """Until the next tick is due [s]."""
        return self._ticker.rests() if self._ticker is not None and self._running else np.inf

    def _listen(self) -> bool:
        """Hear the vehicle, also while its time stands still; False where there is none, or it is lost."""
        ticker = self._ticker
        if ticker is None:
            return False
        try:
            ticker.listen()
        except LinkError as error:
            self._fail(error)
            return False
        if self.switch.is_overtaken(ticker.session.link):
            self.stop()
        self.switch.go_on(ticker.session.link, self._now)
        return True

    def _tick(self) -> bool:
        """One tick; False where the world has not come so far, or the vehicle is lost."""
        ticker = self._ticker
        if ticker is None or not self._listen():
            return False
        now = time.monotonic()
        pilot_command = self._pilot_command if now - self._commanded_at < PILOT_COMMAND_LIFE else NO_PILOT_COMMAND
        if not ticker.tick(now - self._operator_at, pilot_command, self.switch.armed):
            return False
        if self.switch.armed:
            self._logbook.add(1e3 * ticker.late, ticker.session.link.age)
        if self.test is not None and self.test.running:
            self._go_on(self.test, ticker.session)
        self._now = ticker.t
        return True

    def _go_on(self, test: Manoeuvres, session: VehicleSession) -> None:
        """What the test's own time brings, and its end."""
        if session.helm.is_over:
            done = flown(session.helm.output, 0)
            self._end_flight(done["reason"] or done["phase"])
            return
        for cue in test.tick():
            if not cue.text.isdigit():
                self.event("warning" if cue.hand else "info", cue.text)

    def _take_over(self, session: VehicleSession | None) -> None:
        """Begin to tick with a vehicle that is connected."""
        if session is None:
            return
        try:
            self._ticker = Ticker(session, self._builder.clock, self._config.scenario.control_dt)
        except Exception:
            session.close()
            raise
        self._running, self._now = True, 0.0
        self._say("ready", "")
        missing = ", ".join(session.readiness.missing)
        self.event("info", f"connected to {self._config.link}{f'; flying without {missing}' if missing else ''}")
        self._publisher.publish(self._setup_message())

    def _fail(self, error: Exception) -> None:
        """Let go of a vehicle that is lost, or that we cannot fly, and say why."""
        known = isinstance(error, RovtwinError)
        text = str(error) if known else f"{type(error).__name__}: {error}"
        if not known:
            logger.error("the autopilot failed", exc_info=error)
        self.event("danger", f"link lost: {text}" if known else f"the autopilot failed, thrusters off: {text}")
        self._let_go(text)
        self._say("lost", text)

    def _let_go(self, ending: str) -> None:
        ticker, self._ticker = self._ticker, None
        self.added_current = 0.0, 0.0  # a twin that is opened anew has none
        self.switch.off()
        try:
            if ticker is not None:
                ticker.session.close()  # before the log, which takes its time: thrusters off
        except Exception:
            logger.exception("letting go of the vehicle")
        self._end_flight(ending)

    def _end_flight(self, ending: str) -> None:
        """Of a test and of the log."""
        if self.test is not None and self.test.running:
            self.test.end(ending)
            self._tell_hand(np.inf)
        self._logbook.close(ending)

    def _tell_hand(self, began: float) -> None:
        """Tell a simulated hand when the test began [s]; inf: it does not."""
        if self.is_twin and self._ticker is not None:
            self._ticker.session.link.tell(("test", began))

    # What is reported

    def _say(self, stage: str, note: str) -> None:
        self._stage, self._note = stage, note

    def _tell(self) -> None:
        if not self._publisher.state_due():
            return
        self._publisher.publish(self._state())
        if self._publisher.all_due():
            self._publisher.publish({"kind": "history", "events": self._publisher.events})
            self._publisher.publish(self._plan_message())
            if self._ticker is not None:
                self._publisher.publish(self._setup_message())
                self._publisher.publish(self.session.watch.message(self.switch.armed))

    def _state(self) -> dict[str, Any]:
        now = time.monotonic()
        state: dict[str, Any] = {
            "kind": "state",
            "sent": now,
            "pid": os.getpid(),
            "stage": self._stage,
            "note": self._note,
            "making": None if (step := self._builder.step) is None else step.message(),
            "scenario": self._config.scenario.name,
            "link": self._config.link,
            "speed": self._builder.speed,
            "running": self._running,
            "armed": self.switch.armed,
            "arming": self.switch.arming,
            "stopped": self.switch.stopped,
            "operator_age": now - self._operator_at,
            "submitted": self.submitted,
            "added_current": self.added_current,
            "folder": self._logbook.folder,
        }
        ticker = self._ticker
        if ticker is None or not ticker.ticks:
            return state | {"alerts": alerts_of_link(self._stage, self._note)}
        state |= ticker.report(self.count) | {"resumable": ticker.session.helm.can_resume}
        if self.test is not None:
            state |= {"experiment": self.test.report(), "progress": min(self.test.time / self.test.duration, 1.0)}
        if ticker.session.helm.is_idle:
            state |= {"phase": "idle", "reason": "", "u": np.zeros_like(state["u"]), "progress": 0.0}
        if (news := self._changes.of(state["phase"], state["reason"], state["gives_up_heading"])) is not None:
            self.event(*news)
        state["changed"] = ticker.session.watch.names
        return state | {"alerts": alerts(state, ticker.session.simulation.thruster_names)}

    def _plan_message(self) -> dict[str, Any]:
        return plan_message(self.plan, self.submitted, self._config.scenario.origin)

    def _setup_message(self) -> dict[str, Any]:
        drawn = self._scenario is not self._config.scenario
        config = replace(self._config, scenario=self._scenario) if drawn else self._config
        return {"fence_drawn": drawn} | setup_of(
            config, self.session.simulation, self.session.readiness, self.test and self.test.laid_out()
        )
