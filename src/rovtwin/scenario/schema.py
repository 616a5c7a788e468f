"""What a run is, as people write it: vehicle, world, sensors, autopilot, mission, seed.

SI units; a name whose unit is not SI says so (`heading_deg`). `rovtwin scenario show NAME` prints any scenario in full.
"""

import math
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from rovtwin.core.config import Degrees, Degrees3, NonNegative, Number, Positive, Share, Strict, Vector3


def _under_water(place: list[float]) -> list[float]:
    if place[2] < 0:
        raise ValueError(f"found {place[2]:g} m as the third number, expected a depth of at least 0 (down is positive)")
    return place


Place = Annotated[Vector3, AfterValidator(_under_water)]
Window = Annotated[list[Number], Field(min_length=2, max_length=2)]


class StartSection(Strict):
    """Where the vehicle begins, at rest and level."""

    position: Place = Field(default=[0.0, 0.0, 0.5], description="CO, north, east, down [m]")
    heading_deg: Degrees = 0.0


class ConstantCurrentSection(Strict):
    """The same water velocity everywhere."""

    type: Literal["constant"] = "constant"
    velocity: Vector3 = Field(default=[0.0, 0.0, 0.0], description="NED [m/s]")


class ShearedCurrentSection(Strict):
    """Water velocity that varies with depth, linear between the given depths and constant beyond them."""

    type: Literal["sheared"]
    depths: list[Number] = Field(min_length=2, description="increasing [m]")
    velocities: list[Vector3] = Field(min_length=2, description="NED at those depths [m/s]")

    @model_validator(mode="after")
    def _matching(self) -> "ShearedCurrentSection":
        if len(self.depths) != len(self.velocities):
            raise ValueError(
                f"{len(self.depths)} depths but {len(self.velocities)} velocities; give one for each depth"
            )
        if any(b <= a for a, b in pairwise(self.depths)):
            raise ValueError(f"depths {self.depths} do not increase; sort them from the surface down")
        return self


class GaussMarkovCurrentSection(Strict):
    """Water velocity that wanders about a mean: first-order Gauss-Markov."""

    type: Literal["gauss_markov"]
    mean: Vector3 = [0.0, 0.0, 0.0]
    sigma: Vector3 = Field(description="standard deviation of each component [m/s]")
    time_constant: Positive = Field(description="[s]")

    @field_validator("sigma")
    @classmethod
    def _not_negative(cls, sigma: Vector3) -> Vector3:
        if min(sigma) < 0:
            raise ValueError(f"a standard deviation cannot be negative, found {sigma}")
        return sigma


CurrentSection = Annotated[
    ConstantCurrentSection | ShearedCurrentSection | GaussMarkovCurrentSection, Field(discriminator="type")
]


class ThesisWavesSection(Strict):
    """Wave forces of the thesis: a shaping filter driven by white noise, and a drift force that walks at random."""

    model: Literal["thesis"] = "thesis"
    significant_height: Positive = Field(default=4.1, description="Hs [m]")
    zero_crossing_period: Positive = Field(default=8.7, description="Tz [s]")
    direction_deg: Degrees = Field(default=0.0, description="where the waves run to, from north over east")
    drift: NonNegative = Field(default=0.03, description="random walk of the drift force on north and east [N/sqrt(s)]")
    as_printed: bool = Field(default=False, description="modal frequency and sigma as (5.5) and (5.6) print them")


class MismatchSection(Strict):
    """How the plant differs from the autopilot's model; the damping factors are drawn from the seed."""

    damping: Annotated[Number, Field(ge=0, lt=1)] = Field(
        default=0.25, description="each coefficient times U[1 - d, 1 + d]"
    )
    mass: Positive = Field(default=1.10, description="factor on rigid-body and added mass, weight and buoyancy")
    thrust: Positive = Field(default=0.90, description="factor on every thruster's force")


class WorldSection(Strict):
    """The water, and how the true vehicle differs from the model."""

    current: CurrentSection = ConstantCurrentSection()
    waves: ThesisWavesSection | None = None
    mismatch: MismatchSection | None = None
    net_buoyancy: Number = Field(default=0.0, description="added to the plant, not to the autopilot's model [N]")
    thruster_health: dict[str, Share] = Field(
        default_factory=dict, description="faults: share of the force left, by thruster name; 0 is dead"
    )

    @field_validator("current", mode="before")
    @classmethod
    def _current_as_vector(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return {"type": "constant", "velocity": value}
        if isinstance(value, dict) and "type" not in value:
            return {"type": "constant"} | value
        return value

    @field_validator("mismatch", mode="before")
    @classmethod
    def _mismatch_by_default(cls, value: Any) -> Any:
        return {} if value is True else None if value is False else value


class SensorSection(Strict):
    """What is different about one sensor; all that is not given is the preset's."""

    rate_hz: Positive | None = Field(default=None, description="readings a second")
    noise: NonNegative | None = Field(default=None, description="standard deviation per axis, in the sensor's unit")
    bias: Number | None = Field(default=None, description="constant, on every axis")
    bias_walk: NonNegative | None = Field(default=None, description="random walk of the bias, per sqrt(s)")
    latency: Annotated[Number, Field(ge=0, le=1)] | None = Field(default=None, description="delay of delivery [s]")
    clock_drift: Annotated[Number, Field(ge=-0.1, le=0.1)] | None = Field(default=None, description="relative")
    clock_offset: Number | None = Field(default=None, description="of its time stamps [s]")
    dropout: Share | None = Field(default=None, description="share of the readings that are lost")
    outlier: Share | None = Field(default=None, description="share of the others that are outliers")
    outlier_size: NonNegative | None = Field(default=None, description="length of an outlier, any direction")
    blackouts: list[Window] | None = Field(default=None, description="from, to [s]: no readings")
    position: Vector3 | None = Field(default=None, description="mounting place seen from CO, body frame [m]")
    attitude_deg: Degrees3 | None = Field(default=None, description="mounting roll, pitch, yaw")

    @field_validator("blackouts")
    @classmethod
    def _ordered(cls, windows: list[Window] | None) -> list[Window] | None:
        for begin, end in windows or []:
            if not 0 <= begin < end:
                raise ValueError(f"a blackout begins before it ends, found [{begin:g}, {end:g}]")
        return windows


class DvlSection(SensorSection):
    """A Doppler log, 5 mm/s per axis at 10 Hz."""

    on_board: bool = False


SENSOR_NAMES = ("position", "pressure", "accelerometer", "gyro", "attitude", "dvl")


class SensorsSection(Strict):
    """Sensors of thesis table 5.7 with their biases put right (`table_5_7`) or as printed (`as_printed`)."""

    preset: Literal["table_5_7", "as_printed"] = "table_5_7"
    position: SensorSection = SensorSection()
    pressure: SensorSection = SensorSection()
    accelerometer: SensorSection = SensorSection()
    gyro: SensorSection = SensorSection()
    attitude: SensorSection = SensorSection()
    dvl: DvlSection = DvlSection()

    @field_validator("dvl", mode="before")
    @classmethod
    def _dvl_by_default(cls, value: Any) -> Any:
        return {"on_board": value} if isinstance(value, bool) else value


class ObserverSection(Strict):
    """The extended Kalman filter of thesis 2.13."""

    tuning: Literal["consistent", "as_printed"] = Field(default="consistent", description="as_printed: table 7.2")
    force_walk: NonNegative | None = Field(
        default=None, description="declared random walk of the disturbance force [N/sqrt(s)]; default of the tuning"
    )


class ControllerSection(Strict):
    """Five decoupled PIDs."""

    gains: Literal["table_7_1", "table_3_2", "pole_placement"] = Field(
        default="table_7_1", description="tables of the thesis, or placed from the model"
    )


class ReferenceSection(Strict):
    """Second-order reference model, thesis (7.8)."""

    damping: Positive = 1.0
    frequency: Positive = Field(default=1.5, description="[rad/s]")
    obey_speed: bool = Field(
        default=False, description="keep to the way-points' speeds; the thesis's reference does not"
    )


class GuidanceSection(Strict):
    """2-D line of sight with the phases dive, turn, go, switch."""

    lookahead: Positive = Field(default=2.0, description="Delta of (2.45) [m]")


class SupervisorSection(Strict):
    """When to give up: thrusters off, reason in the log."""

    depth_limit: Positive = Field(default=100.0, description="[m]")
    attitude_limit_deg: Annotated[Number, Field(gt=0, le=85)] = Field(
        default=60.0, description="roll or pitch; Euler angles fail at 90"
    )
    position_std_limit: Positive = Field(default=10.0, description="estimate counts as lost beyond it [m]")


class AutopilotSection(Strict):
    """The thesis's guidance, navigation and control, put right (`thesis`) or as printed (`thesis_as_printed`)."""

    type: Literal["thesis"] = "thesis"
    observer: ObserverSection = ObserverSection()
    controller: ControllerSection = ControllerSection()
    reference: ReferenceSection = ReferenceSection()
    guidance: GuidanceSection = GuidanceSection()
    supervisor: SupervisorSection = SupervisorSection()


class Waypoint(Strict):
    """One way-point."""

    position: Place = Field(description="north, east, down [m]")
    acceptance: Positive = Field(default=0.2, description="radius [m]")
    speed: Positive = Field(default=0.2, description="wanted speed on the leg [m/s], where the reference obeys it")
    hold_time: NonNegative = Field(default=0.0, description="time to stay [s]")
    heading_deg: Degrees | None = Field(default=None, description="heading to keep; default along the leg")


class MissionSection(Strict):
    """A list of way-points."""

    name: str = "mission"
    description: str = ""
    waypoints: list[Waypoint] = Field(min_length=1, max_length=64)


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


PRESETS: dict[str, dict[str, Any]] = {
    "thesis": {},
    "thesis_as_printed": {"observer": {"tuning": "as_printed"}},
    # The same blocks with gains from the vehicle's own model and a reference that it can follow.
    "thesis_placed": {"controller": {"gains": "pole_placement"}, "reference": {"obey_speed": True}},
}


class Scenario(Strict):
    """A run, complete: the same scenario and seed give the same data, bit for bit on the same machine."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")] = "scenario"
    description: str = ""
    vehicle: str | dict[str, Any] = Field(
        default="double_blueye", description="library name, file, or the description itself"
    )
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**31)] = 1
    duration: Annotated[Number, Field(gt=0, le=86_400)] = Field(default=1500.0, description="longest run [s]")
    start: StartSection = StartSection()
    rates: RatesSection = RatesSection()
    world: WorldSection = WorldSection()
    sensors: SensorsSection = SensorsSection()
    autopilot: AutopilotSection = AutopilotSection()
    mission: MissionSection
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
                raise ValueError(f"no autopilot {value!r}; there are {', '.join(PRESETS)}")
            return PRESETS[value]
        return value

    @model_validator(mode="after")
    def _fits_together(self) -> "Scenario":
        if self.rates.control % self.log.rate:
            raise ValueError(f"log.rate {self.log.rate} Hz does not divide the control rate {self.rates.control} Hz")
        limit = self.autopilot.supervisor.depth_limit
        for i, waypoint in enumerate(self.mission.waypoints):
            if waypoint.position[2] >= limit:
                raise ValueError(
                    f"mission.waypoints[{i}] is {waypoint.position[2]:g} m deep, where the supervisor aborts; stay "
                    f"above {limit:g} m or raise autopilot.supervisor.depth_limit"
                )
        return self

    @property
    def control_dt(self) -> float:
        return 1.0 / self.rates.control

    @property
    def substeps(self) -> int:
        return self.rates.physics // self.rates.control

    @property
    def heading(self) -> float:
        """Start heading [rad]."""
        return math.radians(self.start.heading_deg)
