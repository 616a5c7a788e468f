"""The log of a flight, from arming to disarming: the same files as `rovtwin fly --link` leaves."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.console.engine.helm import Helm
from rovtwin.core.jsontext import to_json
from rovtwin.core.log import LogWriter
from rovtwin.scenario.composition import Composed
from rovtwin.scenario.decisions import decisions
from rovtwin.scenario.files import dump_scenario
from rovtwin.scenario.flight import new_folder, run_folder
from rovtwin.scenario.live.recorder import LiveRecorder, live_channels, live_figures
from rovtwin.scenario.provenance import provenance, scenario_to_replay
from rovtwin.scenario.schema import Scenario

logger = logging.getLogger(__name__)

CHUNK = 1.0  # written as often [s]

Event = Callable[[str, str], None]  # level, text


class FlightLog:
    """A run folder that fills while the vehicle is armed.

    Attributes:
        folder: Where it lies.
    """

    def __init__(self, scenario: Scenario, composed: Composed, helm: Helm, folder: Path):
        """Raises ConfigError or LogError where the folder cannot be written."""
        self.folder = new_folder(folder)
        self._composed, self._helm = composed, helm
        text = dump_scenario(scenario_to_replay(scenario, composed, self.folder))
        metadata = provenance(scenario, composed) | {"live": "true", "thrust": "true", "scenario": text}
        (self.folder / "scenario.yaml").write_text(text, encoding="utf-8")
        channels = live_channels(scenario, composed.thruster_names, composed.sensor_names)
        self._log = LogWriter(self.folder / "log.mcap", channels, metadata)
        self._recorder = LiveRecorder(scenario, self._log.write_many)
        self._rows: list[Any] = []
        self._chunk = round(CHUNK / scenario.control_dt)

    def add(self, late_ms: float, link_age: float) -> None:
        """The helm's last tick."""
        self._rows.append((*self._helm.row, (late_ms, link_age, 1.0)))
        if len(self._rows) >= self._chunk:
            self._flush()

    def close(self, ending: str) -> dict[str, Any]:
        """Write what is left and how it ended; the summary."""
        try:
            self._flush()
            summary = self._summary(ending)
            self._log.annotate({"summary": to_json(summary)})
        finally:
            self._log.close()
        (self.folder / "summary.json").write_text(to_json(summary) + "\n", encoding="utf-8")
        return summary

    def _flush(self) -> None:
        if self._rows:
            taken, given, host = zip(*self._rows, strict=True)
            measurements, decided = self._helm.unpacked(taken, given)
            self._recorder.take(measurements, decided, np.array(host))
            self._rows = []

    def _summary(self, ending: str) -> dict[str, Any]:
        if not self._recorder.seconds:
            return {"completed": False, "phase": "idle", "reason": ending, "decisions": []}
        flown = self._recorder.flown()
        figures = live_figures(flown)
        return figures | {
            "reason": "" if figures["completed"] else figures["reason"] or ending,
            "decisions": decisions(flown, self._composed.thruster_names),
        }


class Logbook:
    """The log of the flight under way, if there is one. A log that fails, as on a full disk, ends no flight."""

    def __init__(self, runs: Path, event: Event):
        """Flights become folders in `runs`; what happens to their logs is told to `event`."""
        self._runs, self._event = runs, event
        self._flight: FlightLog | None = None

    @property
    def folder(self) -> str:
        """Of the flight under way, "" if there is none."""
        return "" if self._flight is None else str(self._flight.folder)

    def begin(self, scenario: Scenario, composed: Composed, helm: Helm) -> None:
        """Open the log of a flight that begins.

        Raises:
            RovtwinError, OSError: It cannot be written.
        """
        self._flight = FlightLog(scenario, composed, helm, run_folder(scenario.name, self._runs))

    def add(self, late_ms: float, link_age: float) -> None:
        """The last tick of the flight under way."""
        try:
            if self._flight is not None:
                self._flight.add(late_ms, link_age)
        except Exception as error:
            self._event("danger", f"flying on without a log: {error}")
            self.close("the log failed")

    def close(self, ending: str) -> None:
        """Close the log of a flight that is over."""
        flight, self._flight = self._flight, None
        if flight is None:
            return
        try:
            flight.close(ending)
        except Exception as error:
            logger.error("closing a log", exc_info=error)
            self._event("danger", f"{flight.folder}: the log is not complete: {error}")
        else:
            self._event("info", f"log closed: {flight.folder}")
