"""The log of a flight, from arming to disarming: the same files as `rovtwin fly --link` leaves."""

from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.console.engine.steering import Steering
from rovtwin.core.flow import Measurements, Slot
from rovtwin.core.jsontext import to_json
from rovtwin.core.log import LogWriter
from rovtwin.scenario.composition import Composed
from rovtwin.scenario.decisions import decisions
from rovtwin.scenario.flight import new_folder
from rovtwin.scenario.live.flight import metadata_of
from rovtwin.scenario.live.recorder import LiveRecorder, live_channels, live_figures
from rovtwin.scenario.schema import Scenario

CHUNK = 1.0  # written as often [s]


class FlightLog:
    """A run folder that fills while the vehicle is armed.

    Attributes:
        folder: Where it lies.
        began: Time at which it starts, by the clock of the helm's readings [s].
    """

    def __init__(self, scenario: Scenario, composed: Composed, helm: Steering, folder: Path):
        """Raises ConfigError or LogError where the folder cannot be written."""
        self.folder, self.began = new_folder(folder), 0.0
        self._composed, self._helm = composed, helm
        metadata = metadata_of(scenario, composed, self.folder)
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
        self._flush()
        summary = self._summary(ending)
        self._log.annotate({"summary": to_json(summary)})
        self._log.close()
        (self.folder / "summary.json").write_text(to_json(summary) + "\n", encoding="utf-8")
        return summary

    def _flush(self) -> None:
        if self._rows:
            taken, given, host = zip(*self._rows, strict=True)
            measurements, decided = self._helm.unpacked(taken, given)
            self._recorder.take(_on_own_clock(measurements, self.began), decided, np.array(host))
            self._rows = []

    def _summary(self, ending: str) -> dict[str, Any]:
        if not self._recorder.seconds:
            return {"completed": False, "phase": "idle", "reason": ending, "decisions": []}
        flown = self._recorder.flown()
        figures = live_figures(flown, test=self._composed.scenario.test is not None)
        return figures | {
            "reason": "" if figures["completed"] else figures["reason"] or ending,
            "decisions": decisions(flown, self._composed.thruster_names),
        }


def _on_own_clock(measurements: Measurements, began: float) -> Measurements:
    """The same readings, timed since a flight began, as its ticks are."""
    return {name: Slot(slot.value, slot.valid, slot.t_valid - began) for name, slot in measurements.items()}
