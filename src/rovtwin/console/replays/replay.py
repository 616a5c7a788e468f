"""A finished run, ready to be looked at: the state at any of its times, as `reporting.state` tells it of a flight.

What a log does not have is None in the state: the truth of a real flight, the filter of an identification test.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.console.engine.reporting.alerts import alerts
from rovtwin.console.engine.reporting.setup import SIZE, described, values_of
from rovtwin.console.engine.reporting.state import SensorStatus, flown
from rovtwin.console.planning import for_browser, row_from
from rovtwin.console.replays.tape import Consistency, readings_of, tape_of
from rovtwin.core.errors import LogError, RovtwinError
from rovtwin.core.flow import AutopilotOutput, Command, Estimate, Measurement, Reference, Setpoint, Wrench
from rovtwin.core.log import Log
from rovtwin.core.log.missions import FlownMission, mission_at, missions_of
from rovtwin.core.log.pictures import Album
from rovtwin.core.user_files.yamlfile import parse_yaml
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.scenario.files import scenario_of
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.camera.sensor import camera_named
from rovtwin.vehicle import Vehicle

LOG = "log.mcap"
POSES = ("eta", "setpoint", "reference", "reference_rate")  # shown as they are logged, with Euler angles
SOURCES_OF = {  # what of a state rests on what of the log
    "eta": ("eta", "to_go"),
    "nu": ("nu",),
    "bias": ("bias",),
    "std": ("sd", "ellipse"),
    "setpoint": ("setpoint",),
    "reference": ("reference", "reference_rate"),
    "leg": ("leg", "on_leg", "to_go", "progress"),
    "mode": ("phase", "reason", "waypoint", "on_leg", "progress"),
    "tau": ("tau",),
    "u": ("u",),
    "health": ("health",),
}


class Recording:
    """A run that is over.

    Attributes:
        path: Of its log.
        name: Of its scenario.
        log: All of it.
        tape: What it has of `tape.SOURCES`.
        readings: Those of each sensor.
        consistency: Of its filter.
        thrusters: Their names.
        missions: Way-points that were flown, from when [s], as rows of a plan; in order of time.
        scenario, vehicle: What was flown; None where the log does not say.
        album: Pictures that were recorded beside it, or None.
        notes: What cannot be shown, and why.
    """

    def __init__(self, log: Log, path: Path):
        """Raises LogError where nothing in the log can be shown."""
        self.log, self.path = log, path
        self.tape, self.readings, self.consistency = tape_of(log), readings_of(log), Consistency(log)
        if not self.tape and not self.readings:
            found = ", ".join(name for name in log if len(log[name])) or "no samples"
            raise LogError(f"{path}: found {found}, expected what a run leaves: autopilot/.., truth/.., sensor/..")
        self.notes: list[str] = list(log.notes)
        self.scenario, self.vehicle = self._flown()
        self.name = log.metadata.get("name") or path.stem
        self.thrusters = list(log["autopilot/command"].channel.fields) if "u" in self.tape else []
        self.missions = self._missions()
        self.album = self._album()

    @classmethod
    def open(cls, path: str | Path) -> "Recording":
        """Of a log, or of a run's folder.

        Raises:
            LogError: It is none, unfinished, empty or damaged; the text says what to do.
        """
        path = Path(path)
        if path.is_dir():
            if not (path / LOG).is_file():
                raise LogError(f"{path}: found no {LOG} in it, expected the folder of a run, such as runs/<run>")
            path = path / LOG
        return cls(Log.read(path), path)

    @property
    def start(self) -> float:
        """Of its time [s]."""
        return self.log.start

    @property
    def end(self) -> float:
        """Of its time [s]."""
        return self.log.end

    def mission_at(self, t: float) -> int:
        """Number of the mission under way at a time [s], from 0; -1 before the first was started."""
        return mission_at(self.missions, t)

    def waypoints(self, mission: int) -> list[dict[str, Any]]:
        """Of a mission by its number; none of -1."""
        return self.missions[mission].waypoints if mission >= 0 else []

    def count(self, t: float) -> int:
        """Way-points of the mission under way at a time [s]; 0 where no autopilot flew."""
        return len(self.waypoints(self.mission_at(t))) if "mode" in self.tape else 0

    def at(self, name: str, t: float) -> Float[np.ndarray, "..."] | None:
        """What the tape has of a name at a time [s]."""
        return self.tape[name].at(t) if name in self.tape else None

    def state(self, t: float) -> dict[str, Any]:
        """All that was the case at a time [s]; the pace at which somebody looks at it is not in it."""
        report = flown(self._output(t), self.count(t)) | {name: self.at(name, t) for name in POSES}
        report |= {key: None for name, keys in SOURCES_OF.items() if name not in self.tape for key in keys}
        timing = self.at("timing", t)
        late, age, thrust = (None, 0.0, 1.0) if timing is None else timing
        state = report | {
            "kind": "state",
            "replay": True,
            "stage": "replay",
            "note": "",
            "scenario": self.name,
            "link": self.name,
            "t": t,
            "armed": thrust > 0.5,
            "arming": False,
            "stopped": False,
            "hung": False,
            "submitted": True,
            "wave": None,  # is not logged
            "sensors": self.sensors(t),
            "nis": self.consistency.report(t),
            "late_ms": late,
            "link_age": age,
            "operator_age": None,
            "truth": self.at("truth", t),
            "current": self.at("current", t),
            "folder": str(self.path.parent),
            "shot": None if self.album is None else self.album.number_at(t),
        }
        health = [] if state["health"] is None else state["health"]
        return state | {"alerts": alerts(state | {"health": health}, self.thrusters)}

    def sensors(self, t: float) -> dict[str, Any]:
        """Age and newest value of every sensor at a time [s]."""
        status = SensorStatus(sorted(self.readings))
        for name, held in self.readings.items():
            if (last := held.last(t)) >= 0:
                at = float(held.t[last])
                status.receive([Measurement(name, held.values[last], at)])
                status.news(at)
        return status.report(t)["sensors"]

    def setup(self) -> dict[str, Any]:
        """What does not change; where looks and pictures are served is for the server to say."""
        fixed: dict[str, Any] = {"vehicle": "", "room": {"kind": "open", "floor": None}, "fence": None, "waves": None}
        if self.scenario is not None and self.vehicle is not None:
            fixed = described(self.scenario, self.vehicle)
        home = self.tape["eta"].values[0, :3] if "eta" in self.tape else None
        sensors = sorted(self.readings)
        readings = values_of({name: (held.fields, held.units) for name, held in self.readings.items()})
        names = {"thrusters": self.thrusters, "sensors": sensors, "readings": readings}
        return (
            {"kind": "setup", "size": SIZE, "home": home, "twin": "truth" in self.tape, "missing": []} | names | fixed
        )

    def plan(self, mission: int) -> dict[str, Any]:
        """The way-points of a mission by its number; none of -1."""
        state = {"submitted": True, "changed": False, "checks": [], "undo": False, "redo": False}
        return {"kind": "plan", "draft": self.waypoints(mission), "flown": self.waypoints(mission)} | state

    def _output(self, t: float) -> AutopilotOutput:
        """What the autopilot gave at a time, as far as it was logged, else zeros; but for POSES, attitudes level."""

        def row(name: str, width: int = 6) -> Any:
            found = self.at(name, t)
            return np.zeros(width) if found is None else found

        leg, (phase, reason, waypoint, on_leg) = row("leg"), row("mode", 4)
        covariance = np.diag(row("std", 12) ** 2)  # all that is logged of it
        few: Any = np.zeros(0)
        three: Any = np.zeros(3)
        level: Any = np.array([1.0, 0.0, 0.0, 0.0])
        return AutopilotOutput(
            Command(row("u", 0)),
            Estimate(row("eta")[:3], level, row("nu"), row("bias"), covariance, few, few, row("wave")),  # type: ignore[arg-type]  (NumPy: to be shown)
            Setpoint(three, level, row("nothing"), leg[:3], leg[3:], on_leg > 0.5, waypoint, phase, reason),
            Reference(three, level, three, three, three, three),
            Wrench(row("tau"), row("nothing")),
            row("health", 0),
        )

    def _flown(self) -> tuple[Scenario | None, Vehicle | None]:
        text = self.log.metadata.get("scenario")
        if not text:
            self.notes.append("the log does not say what was flown: no plan, room and looks of the vehicle")
            return None, None
        try:
            scenario = scenario_of(parse_yaml(text, self.path.name), self.path.name, self.path.parent)
            return scenario, vehicle_of(scenario)
        except RovtwinError as error:
            self.notes.append(f"no plan, room and looks of the vehicle: {error}")
            return None, None

    def _missions(self) -> list[FlownMission]:
        found = missions_of(self.log.metadata)
        if "mission" not in self.log.metadata and self.scenario is not None and self.scenario.waypoints:
            found = [FlownMission(-np.inf, [w.model_dump() for w in self.scenario.waypoints])]
        return [FlownMission(one.t, [for_browser(row_from(point)) for point in one.waypoints]) for one in found]

    def _album(self) -> Album | None:
        """Pictures of the first camera that `runs.recording.filming` recorded."""
        if self.scenario is None or self.vehicle is None or not self.scenario.cameras:
            return None
        try:
            camera = camera_named(self.vehicle, self.scenario.cameras[0].camera).name
            file = self.path.parent / f"{camera.replace('.', '_')}.mcap"
            return Album(file) if file.is_file() else None
        except RovtwinError as error:
            self.notes.append(f"no pictures: {error}")
            return None
