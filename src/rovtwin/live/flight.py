"""Flying over a link: listen, arm, a tick each control period, and thrusters off however it ends."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.datum import utc_now
from rovtwin.core.errors import LinkError
from rovtwin.core.flow import ENDS, PAUSED, PHASES, Command, Slot
from rovtwin.core.link import Link, Source
from rovtwin.core.log import Log, LogWriter
from rovtwin.core.log.files import keeping
from rovtwin.core.numerics import jax
from rovtwin.core.processes.urgent import settle, urgent
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.links.replay import ReplayLink
from rovtwin.links.twin import TwinLink
from rovtwin.live.beside import changed, monitor_of
from rovtwin.live.manoeuvres import Cue, Prompter, touched_spans
from rovtwin.live.readiness import NEEDED, NEEDED_IN_TESTS, TO_COME_HOME, Readiness, SensorMux, listen
from rovtwin.live.recorder import LiveRecorder, live_channels, live_figures
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.compose.experiment import needs_position
from rovtwin.runs.compose.fit_experiment import fitted_test
from rovtwin.runs.compose.fitting import assumptions, fitted
from rovtwin.runs.compose.sensors import rotated
from rovtwin.runs.feasibility.mission import foreseen
from rovtwin.runs.flight import Flight
from rovtwin.runs.fly import Progress, new_folder
from rovtwin.runs.interrupt import Interrupt
from rovtwin.runs.pace import Clock, Pace
from rovtwin.runs.realtime import HostAutopilot
from rovtwin.runs.recording.provenance import beginning, provenance, scenario_to_replay
from rovtwin.runs.run import CHUNK, above, ticks_in
from rovtwin.runs.scoring.decisions import decisions
from rovtwin.runs.scoring.failures import failed_block
from rovtwin.runs.scoring.summary import not_finished
from rovtwin.scenario.files import dump_scenario
from rovtwin.scenario.schema import Scenario

ROOM = 8  # readings of a sensor in one tick: a link delivers them in bursts

Arm = Callable[[Readiness], bool]


def fly_live(
    scenario: Scenario,
    link: Link,
    sources: Sequence[Source],
    clock: Clock,
    folder: str | Path,
    *,
    arm: Arm,
    thrust: bool = True,
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
    tell: Callable[[Cue], None] = lambda cue: None,
    warn: Callable[[str], None] = lambda line: None,
) -> Flight:
    """Fly a scenario's mission or test with the vehicle behind a link, which is closed when this returns or raises.

    Args:
        scenario: Vehicle, autopilot, mission or test; its world counts for nothing.
        link: To the vehicle, open.
        sources: Instruments beside it, open.
        clock: That link and sources stamp readings with.
        folder: New folder for log, scenario and summary.
        arm: Asked once everything is compiled and the sensors speak; False ends here, thrusters never having turned.
        thrust: False sends zeros, and does all else.
        progress: Called about once a second.
        say: Takes lines for the user, each in place of the last.
        tell: Takes what the operator of a test has to know and do, as its time comes; it must not keep the loop.
        warn: Told before arming what the vehicle cannot do of the mission, and what it does instead.

    Raises:
        ConfigError: The scenario cannot be composed, or the vehicle can do nothing useful of its mission.
        LinkError: The vehicle is not there, is silent, or refuses to arm. A link that is lost in flight ends it.
    """
    with link:
        simulation = compose(_without_world(scenario if thrust else _dry(scenario)))
        for line in foreseen(simulation.scenario, simulation.vehicle, simulation.model, known_world=False):
            warn(line)
        for line in assumptions(scenario, simulation.scenario):
            warn(line)
        scenario = fitted(fitted_test(scenario), simulation.model)
        mux = SensorMux(link, sources)
        rewound(link)
        needed = needed_by(scenario)
        known: dict[str, Any] = {
            "needed": needed,
            "rotation": rotated(simulation.loop.twin.sensors).get("attitude"),
            "position_noise": simulation.position_noise,
        }
        say("listening to its sensors")
        readiness = listen(mux, simulation.sensor_names, say, clock.speed, **known)
        say("compiling the autopilot")
        loop = _LiveLoop(simulation, scenario, readiness, link, mux, clock, thrust)
        folder = new_folder(folder)
        metadata = metadata_of(scenario, simulation, folder, thrust)
        monitor, unwatched = monitor_of(simulation, scenario) if thrust else (None, "")
        if unwatched:
            warn(f"what has changed of the vehicle is not watched: {unwatched}")
        channels = live_channels(scenario, simulation.thruster_names, simulation.sensor_kinds, monitor)
        with (
            LogWriter(folder / "log.mcap", channels, metadata) as log,
            closing(LiveRecorder(scenario, log.write_many, folder, monitor)) as recorder,
        ):
            ending = "not armed"
            if arm(readiness):
                # It may have drifted while everything was compiled and somebody thought.
                rewound(link)
                also = [name for name in ("position",) if name in readiness.rates]
                loop.start_from(listen(mux, also, say, clock.speed, **known))
                if thrust:
                    link.arm()
                ending = loop.fly(recorder, lambda utc: log.annotate(beginning(scenario, utc)), progress, tell)
            link.stop()
            summary = _summary(recorder, simulation, ending, loop.pace) | changed(monitor, unwatched)
            log.annotate({"summary": to_json(summary), "pace": to_json(loop.pace.counts.tolist())})
        with keeping(folder, f"The log is whole: {folder / 'log.mcap'}"):
            write_text(folder / "summary.json", to_json(summary) + "\n")
    return Flight(scenario, folder, Log.read(folder / "log.mcap"), summary)


def metadata_of(scenario: Scenario, simulation: Simulation, folder: Path, thrust: bool = True) -> dict[str, str]:
    """What the log of a flight over a link says of it; the scenario is written into its folder, too."""
    metadata = provenance(scenario, simulation) | {"live": "true", "thrust": str(thrust).lower()}
    if scenario.test:
        metadata["test"] = to_json(touched_spans(scenario))
    return metadata | {"scenario": write_scenario(scenario, simulation, folder)} | beginning(scenario, utc_now())


def write_scenario(scenario: Scenario, simulation: Simulation, folder: Path) -> str:
    """Write what was flown into its folder, so that it can be flown again; the text."""
    text = dump_scenario(scenario_to_replay(scenario, simulation, folder))
    write_text(folder / "scenario.yaml", text)
    return text


def _without_world(scenario: Scenario) -> Scenario:
    """The scenario for a vehicle that swims elsewhere: nothing breaks by a time-line."""
    return scenario.model_copy(update={"faults": []})


def needed_by(scenario: Scenario) -> dict[str, str]:
    """Sensors that the flight cannot do without, and where each can come from."""
    if not scenario.test:
        return NEEDED
    return NEEDED_IN_TESTS | (TO_COME_HOME if needs_position(scenario) else {})


def _dry(scenario: Scenario) -> Scenario:
    """The scenario for a run without thrust: forces that do not come are no failure then."""
    supervisor = scenario.autopilot.supervisor
    ignored = {
        name: getattr(supervisor, name).model_copy(update={"action": "ignore"})
        for name in ("thruster_failed", "saturated")
    }
    autopilot = scenario.autopilot.model_copy(update={"supervisor": supervisor.model_copy(update=ignored)})
    return scenario.model_copy(update={"autopilot": autopilot})


def rewound(link: Link) -> None:
    """A log begins when it is listened to, not when it was opened; a computed vehicle waits for its host."""
    if isinstance(link, ReplayLink):
        link.rewind()
    if isinstance(link, TwinLink):
        link.go_on_from_here()


class _LiveLoop:
    """The fixed-rate loop around an autopilot that is compiled and waits."""

    def __init__(
        self,
        simulation: Simulation,
        scenario: Scenario,
        readiness: Readiness,
        link: Link,
        mux: SensorMux,
        clock: Clock,
        thrust: bool,
    ):
        loop = simulation.loop
        slots = {n: Slot.empty(max(ROOM, s.valid.shape[0]), s.value.shape[1]) for n, s in loop.twin.empty().items()}
        key = jax.random.split(simulation.key)[0]
        self._begin = lambda start: loop.autopilot.init(key, start)
        self._autopilot = HostAutopilot(loop.autopilot, self._begin(readiness.start), slots, scenario.control_dt)
        self._above = above(loop.topside, scenario.control_dt)
        self._above(0)
        self._link, self._mux, self._clock = link, mux, clock
        self._dt, self._thrust = scenario.control_dt, thrust
        self._total, self._chunk = ticks_in(scenario.duration, self._dt) + 1, ticks_in(CHUNK, self._dt)
        self._off = Command(np.zeros(len(simulation.thruster_names)))  # type: ignore[arg-type]  (NumPy: for a link)
        self._prompter, self._tested = Prompter(scenario), 0
        self.pace = Pace()

    def start_from(self, readiness: Readiness) -> None:
        """Begin where the vehicle is now."""
        self._autopilot.restart(self._begin(readiness.start))

    def fly(
        self,
        recorder: LiveRecorder,
        began_at: Callable[[str], None],
        progress: Progress | None,
        tell: Callable[[Cue], None],
    ) -> str:
        """Fly to the end of mission or test, the duration, Ctrl-C or a lost link; why it ended, "" for its own end.

        `began_at` gets the UTC of time zero.
        """
        rows: list[tuple[np.ndarray, np.ndarray, tuple[float, float, float]]] = []
        ending = ""
        settle()
        rewound(self._link)  # a short log may have ended by now, and says so when read
        self._mux.drain()
        rewound(self._link)
        self._mux.zero = began = self._clock.next(self._dt)
        then = self._link.datum if isinstance(self._link, ReplayLink) else None
        began_at(then.utc_start if then else utc_now((began - self._clock()) / self._clock.speed))
        with Interrupt() as interrupt, urgent(self._clock.speed <= 1.0):
            for k in range(self._total):
                try:
                    rows.append(self._tick(k, began))
                    self._prompt(tell)
                except LinkError as error:
                    ending = f"link lost: {error}"
                over = bool(ending) or interrupt.asked or self._autopilot.phase in ENDS
                if rows and (over or len(rows) == self._chunk):
                    self._record(recorder, rows)
                    rows = []
                    if progress:
                        progress(recorder.seconds, self._prompter.now or PHASES[self._autopilot.phase])
                if over:
                    return ending or ("interrupted" if self._autopilot.phase not in ENDS else "")
        if rows:
            self._record(recorder, rows)
        return ending

    def _tick(self, k: int, began: float) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
        late = self.pace.wait(began + k * self._dt, self._clock, self._clock.speed)
        readings = self._mux.read()
        (_, operator_age, _), request, pilot = self._above(k)
        link_age = self._link.age * self._clock.speed
        periods = late * self._clock.speed / self._dt
        command = self._autopilot.step(readings, request, (link_age, operator_age, periods), pilot)
        self._link.send(command if self._thrust else self._off)
        return self._autopilot.taken, self._autopilot.given, (1e3 * late, link_age, float(self._thrust))

    def _prompt(self, tell: Callable[[Cue], None]) -> None:
        """Tell what comes now, the command being out; a test that pauses stands still."""
        for cue in self._prompter.at(self._tested * self._dt):
            tell(cue)
        self._tested += self._autopilot.phase != PAUSED

    def _record(self, recorder: LiveRecorder, rows: list[Any]) -> None:
        taken, given, host = zip(*rows, strict=True)
        recorder.take(*self._autopilot.unpacked(taken, given), np.array(host))


def _summary(recorder: LiveRecorder, simulation: Simulation, ending: str, pace: Pace) -> dict[str, Any]:
    if not recorder.seconds:
        return {"completed": False, "phase": "idle", "reason": ending, "interrupted": False, "decisions": []}
    flown = recorder.flown()
    figures = live_figures(flown, test=simulation.scenario.test is not None)
    reason = "" if figures["completed"] else ending or figures["reason"] or not_finished(flown, simulation)
    return figures | {
        "reason": reason,
        "why": failed_block(flown, simulation.scenario) or None,
        "interrupted": reason == "interrupted",
        "decisions": decisions(flown, simulation.thruster_names, [(0.0, simulation.scenario)], simulation.model),
        **pace.figures(),
    }
