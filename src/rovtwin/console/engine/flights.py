"""The log of a flight, from arming to disarming: the same files as `rovtwin fly --link` leaves."""

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.console.engine.reporting.watching import VehicleWatch
from rovtwin.console.engine.steering import Steering
from rovtwin.core.datum import utc_now
from rovtwin.core.flow import FINISHED, PHASES, Measurements, Slot
from rovtwin.core.log import LogWriter
from rovtwin.core.log.files import keeping
from rovtwin.core.log.missions import FlownMission, mission_metadata, no_mission_yet
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.live.beside import changed
from rovtwin.live.flight import metadata_of, write_scenario
from rovtwin.live.recorder import LiveRecorder, live_channels, live_figures
from rovtwin.runs.compose.composition import Simulation
from rovtwin.runs.fly import new_folder, run_folder
from rovtwin.runs.recording.provenance import beginning, flown_points
from rovtwin.runs.scoring.decisions import decisions
from rovtwin.runs.scoring.scores import finished
from rovtwin.scenario.schema import Scenario

logger = logging.getLogger(__name__)

CHUNK = 1.0  # written as often [s]

Event = Callable[[str, str], None]  # level, text


class FlightLog:
    """A run folder that fills while the vehicle is armed.

    Attributes:
        folder: Where it lies.
        began: Time at which it starts, by the clock of the helm's readings [s].
    """

    def __init__(
        self,
        scenario: Scenario,
        simulation: Simulation,
        helm: Steering,
        folder: Path,
        watch: VehicleWatch | None = None,
    ):
        """With what `watch` finds in it. Raises ConfigError or LogError where the folder cannot be written."""
        self.folder, self.began = new_folder(folder), 0.0
        self._simulation, self._helm, self._watch = simulation, helm, watch
        self._monitor = None if watch is None else watch.begin()
        metadata = metadata_of(scenario, simulation, self.folder) | no_mission_yet()
        channels = live_channels(scenario, simulation.thruster_names, simulation.sensor_kinds, self._monitor)
        self._log = LogWriter(self.folder / "log.mcap", channels, metadata)
        self._recorder = LiveRecorder(scenario, self._log.write_many, self.folder, self._monitor)
        self._rows: list[Any] = []
        self._scenario = scenario
        self._flown: list[tuple[float, Scenario]] = []  # missions, and when they were started on the log's clock [s]
        self._chunk = round(CHUNK / scenario.control_dt)

    def begin(self, now: float, utc: str) -> None:
        """Its time zero is now, by the clock of the helm's readings [s] and by the time of day."""
        self.began = now
        self._log.annotate(beginning(self._scenario, utc))

    def add(self, late_ms: float, link_age: float) -> None:
        """The helm's last tick."""
        self._rows.append((*self._helm.row, (late_ms, link_age, 1.0)))
        if len(self._rows) >= self._chunk:
            self._flush()

    def flown(self, scenario: Scenario, now: float) -> None:
        """What is flown from now on [s, by the clock of the helm's readings]."""
        mission = FlownMission(now - self.began, flown_points(scenario))
        self._log.annotate(mission_metadata(len(self._flown), mission))
        self._flown.append((mission.t, scenario))

    def close(self, ending: str) -> dict[str, Any]:
        """Write what is left, what was flown and how it ended; the summary."""
        try:
            self._flush()
            if self._flown:
                self._log.annotate({"scenario": write_scenario(self._flown[-1][1], self._simulation, self.folder)})
            summary = self._summary(ending) | changed(self._monitor, self._watch.unwatched if self._watch else "")
            self._log.annotate({"summary": to_json(summary)})
        finally:
            self._log.close()
            self._recorder.close()
        with keeping(self.folder, f"The log is whole: {self.folder / 'log.mcap'}"):
            write_text(self.folder / "summary.json", to_json(summary) + "\n")
        return summary

    def _flush(self) -> None:
        if self._rows:
            rows, self._rows = self._rows, []  # those that cannot be written are not written twice
            taken, given, host = zip(*rows, strict=True)
            measurements, decided = self._helm.unpacked(taken, given)
            self._recorder.take(_on_own_clock(measurements, self.began), decided, np.array(host))

    def _summary(self, ending: str) -> dict[str, Any]:
        if not self._recorder.seconds:
            return {"completed": False, "phase": "idle", "reason": ending, "decisions": []}
        flown = self._recorder.flown()
        figures = live_figures(flown, test=self._simulation.scenario.test is not None)
        simulation = self._simulation
        missions = self._flown if simulation.scenario.test is None else [(0.0, simulation.scenario)]
        if missions and finished(flown.during(missions[-1][0])):  # whatever came after it, as a hold
            figures |= {"completed": True, "phase": PHASES[FINISHED]}
        return figures | {
            "reason": "" if figures["completed"] else figures["reason"] or ending,
            "decisions": decisions(flown, simulation.thruster_names, missions, simulation.model),
        }


def _on_own_clock(measurements: Measurements, began: float) -> Measurements:
    """The same readings, timed since a flight began, as its ticks are."""
    return {name: Slot(slot.value, slot.valid, slot.t_valid - began) for name, slot in measurements.items()}


class Logbook:
    """The log of the flight under way, if there is one. A log that fails, as on a full disk, ends no flight."""

    def __init__(self, runs: Path, event: Event):
        """Flights become folders in `runs`; what happens to their logs is reported to `event`."""
        self._runs, self._event = runs, event
        self._flight: FlightLog | None = None
        self._opening: Future[FlightLog] | None = None
        self._watch: VehicleWatch | None = None
        self._beside = ThreadPoolExecutor(1)

    @property
    def folder(self) -> str:
        """Of the flight under way, "" if there is none."""
        return "" if self._flight is None else str(self._flight.folder)

    def open(self, scenario: Scenario, simulation: Simulation, helm: Steering, watch: VehicleWatch) -> None:
        """Open the log of a flight to come, beside the loop: it takes some tenths of a second."""
        folder = run_folder(scenario.name, self._runs)
        self._watch = watch
        self._opening = self._beside.submit(FlightLog, scenario, simulation, helm, folder, watch)

    @property
    def is_opening(self) -> bool:
        return self._opening is not None and not self._opening.done()

    def begin(self, now: float) -> None:
        """From now on [s] the log that was opened is written.

        Raises:
            RovtwinError, OSError: It could not be opened.
        """
        utc = utc_now()  # before waiting for it to be opened
        if self._opening is not None:
            opening, self._opening = self._opening, None
            self._flight = opening.result()
            self._flight.begin(now, utc)

    def flown(self, scenario: Scenario, now: float) -> None:
        """The mission that is flown from now on [s], for the log of the flight under way."""
        try:
            if self._flight is not None:
                self._flight.flown(scenario, now)
        except Exception as error:
            self._fail(error)

    def add(self, late_ms: float, link_age: float) -> None:
        """The last tick of the flight under way."""
        try:
            if self._flight is not None:
                self._flight.add(late_ms, link_age)
                if self._watch is not None and (news := self._watch.news()):
                    self._event("warning", news)
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Fly on without the log."""
        self._event("danger", f"flying on without a log: {error}")
        self.close("the log failed")

    def close(self, ending: str) -> None:
        """Close the log of a flight that is over, or does not come."""
        flight, self._flight = self._flight, None
        if self._opening is not None:
            opening, self._opening = self._opening, None
            opening.add_done_callback(lambda done: _close_unused(done, ending))
        if flight is None:
            return
        try:
            flight.close(ending)
        except Exception as error:
            logger.error("closing a log", exc_info=error)
            self._event("danger", f"{flight.folder}: the log is not complete: {error}")
        else:
            self._event("info", f"log closed: {flight.folder}")


def _close_unused(opening: Future[FlightLog], ending: str) -> None:
    """A log that was opened for a flight that did not come."""
    if opening.exception() is None:
        opening.result().close(ending)
