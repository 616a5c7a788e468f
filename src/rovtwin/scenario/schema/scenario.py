"""A run, complete."""

import math
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, field_validator, model_validator

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import Number, Strict, parse
from rovtwin.core.user_files.yamlfile import read_yaml
from rovtwin.scenario.schema.autopilot import PRESETS, AutopilotSection, ModelBasedSection
from rovtwin.scenario.schema.battery import BatterySection
from rovtwin.scenario.schema.datum import DatumSection, require_near
from rovtwin.scenario.schema.experiment import ExperimentSection
from rovtwin.scenario.schema.face import ScenarioFace
from rovtwin.scenario.schema.faults import FaultSection
from rovtwin.scenario.schema.mission import MissionSection, StartSection, Waypoint
from rovtwin.scenario.schema.operator import RequestSection
from rovtwin.scenario.schema.sensors import SensorsSection
from rovtwin.scenario.schema.world import WorldSection
from rovtwin.simulation.camera.sensor import CameraSection


class RatesSection(Strict):
    """Steps per second; control must divide physics."""

    physics: Annotated[int, Field(strict=True, gt=0, le=10_000)] = 500
    control: Annotated[int, Field(strict=True, gt=0, le=1_000)] = 50

    @model_validator(mode="after")
    def _divides(self) -> "RatesSection":
        if self.physics % self.control:
            raise ValueError(f"control rate {self.control} Hz does not divide the physics rate {self.physics} Hz")
        return self


class LogSection(Strict):
    """How often the channels are written; sensors are logged as they come."""

    rate: Annotated[int, Field(strict=True, gt=0, le=1_000)] = Field(
        default=10, description="of truth and autopilot channels [1/s]"
    )
    sensors: bool = Field(default=True, description="log every sensor reading")


class Scenario(ScenarioFace, Strict):
    """A run, complete: the same scenario and seed give the same data, bit for bit on the same machine.

    Example:
        >>> rovtwin.load_scenario("square", seed=3)
        <Scenario square, seed 3: double_blueye, 4 way-points>
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="default that of the file")] = (
        "scenario"
    )
    description: str = ""
    vehicle: str | dict[str, Any] = Field(
        default="double_blueye", description="library name, file, or the description itself"
    )
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**31)] = 1
    duration: Annotated[Number, Field(gt=0, le=86_400)] = Field(default=1500.0, description="longest run [s]")
    datum: DatumSection = DatumSection()
    start: StartSection = StartSection()
    rates: RatesSection = RatesSection()
    world: WorldSection = WorldSection()
    sensors: SensorsSection = SensorsSection()
    autopilot: AutopilotSection = ModelBasedSection()
    mission: MissionSection | None = Field(default=None, description="way-points, or")
    test: ExperimentSection | None = Field(default=None, description="an identification test: manoeuvres")
    battery: BatterySection | None = None
    cameras: list[CameraSection] = Field(default_factory=list, description="recorded by fly --camera")
    operator: list[RequestSection] = Field(default_factory=list, description="what the operator asks for, and when")
    faults: list[FaultSection] = Field(default_factory=list, description="what breaks, and when")
    log: LogSection = LogSection()

    @field_validator("sensors", mode="before")
    @classmethod
    def _sensors_by_name(cls, value: Any) -> Any:
        return {"preset": value} if isinstance(value, str) else value

    @field_validator("autopilot", mode="before")
    @classmethod
    def _autopilot_by_name(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value not in PRESETS:
                raise ValueError(f"no autopilot {value!r}; there are {', '.join(PRESETS)}, or files of `rovtwin tune`")
            return PRESETS[value]
        return value

    @model_validator(mode="before")
    @classmethod
    def _tests_log_every_command(cls, data: Any) -> Any:
        # Identification needs each command; a mission's log of 10 Hz would leave out four of five.
        if isinstance(data, dict) and data.get("test") is not None:
            rates = data.get("rates")
            rate = rates.get("control", 50) if isinstance(rates, dict) else 50
            log = data.get("log") or {}
            if isinstance(log, dict):
                data = data | {"log": {"rate": rate} | log}
        return data

    @field_validator("battery", mode="before")
    @classmethod
    def _battery_by_default(cls, value: Any) -> Any:
        return {} if value is True else None if value is False else value

    @model_validator(mode="after")
    def _fits_together(self) -> "Scenario":
        if self.rates.control % self.log.rate:
            raise ValueError(f"log.rate {self.log.rate} Hz does not divide the control rate {self.rates.control} Hz")
        limit = self.autopilot.supervisor.deepest
        if (self.mission is None) == (self.test is None):
            found = "neither a mission nor a test" if self.mission is None else "both a mission and a test"
            raise ValueError(f"found {found}, expected one: where to go, or which manoeuvres to fly")
        for i, waypoint in enumerate(self.waypoints):
            if waypoint.geodetic:
                require_near(self.origin, waypoint.geodetic, f"mission.waypoints[{i}].geodetic")
            if waypoint.depth >= limit:
                raise ValueError(
                    f"mission.waypoints[{i}] is {waypoint.depth:g} m deep, where the supervisor aborts; stay "
                    f"above {limit:g} m or raise autopilot.supervisor.depth_limit"
                )
        return self

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        vehicle = self.vehicle if isinstance(self.vehicle, str) else self.vehicle.get("name", "a vehicle")
        todo = f"{len(self.waypoints)} way-points" if self.test is None else f"{len(self.test.manoeuvres)} manoeuvres"
        return f"<Scenario {self.name}, seed {self.seed}: {vehicle}, {todo}>"

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """The scenario of a file that stands for itself, as `save` writes it; `load_scenario` reads any.

        Raises:
            ConfigError: With a line per mistake: file, place, what was found, what was expected, the fix.

        Example:
            >>> square = rovtwin.load_scenario("square")
            >>> rovtwin.Scenario.load(square.save("mine.yaml", overwrite=True)) == square
            True
        """
        data = read_yaml(path)
        if isinstance(mission := data.get("mission"), str):
            raise ConfigError(
                f"{path}: mission: found the name {mission!r}, expected way-points as Scenario.save writes them; "
                "rovtwin.load_scenario reads files that name others"
            )
        return parse(cls, data, Path(path).name)

    @property
    def control_dt(self) -> float:
        return 1.0 / self.rates.control

    @property
    def substeps(self) -> int:
        return self.rates.physics // self.rates.control

    @property
    def origin(self) -> Datum:
        """The datum, which converts between the world frame and the map."""
        return self.datum.origin

    @property
    def waypoints(self) -> list[Waypoint]:
        """Of the mission; a test has none."""
        return self.mission.waypoints if self.mission else []

    @property
    def heading(self) -> float:
        """Start heading [rad]."""
        return math.radians(self.start.heading_deg)
