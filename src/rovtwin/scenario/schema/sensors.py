"""What a scenario says about the sensors on board."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, create_model, field_validator, model_validator

from rovtwin.core.sensors import ESSENTIAL, SENSORS, kind_of
from rovtwin.core.user_files.config import Degrees3, NonNegative, Number, Positive, Share, Strict, Vector3
from rovtwin.core.user_files.yamlfile import near

Window = Annotated[list[Number], Field(min_length=2, max_length=2)]


class SensorSection(Strict):
    """What is different about one sensor; all that is not given is the part's, or the preset's."""

    on_board: bool | None = Field(
        default=None, description="true: there in any case; false: silent; else as the vehicle carries it"
    )
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
    errors: Literal["acoustic", "none"] | None = Field(
        default=None,
        description="of a position: those of an Underwater GPS besides, as fitted on a real one; none: not the part's",
    )
    min_range: NonNegative | None = Field(default=None, description="nearer to the floor it does not read [m]")
    max_range: Positive | None = Field(default=None, description="farther from the floor it does not read [m]")
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


_Preset = Literal["vehicle", "table_5_7", "as_printed"]
_KEYS: dict[str, Any] = {"preset": (_Preset, "vehicle")} | {kind: (SensorSection, SensorSection()) for kind in SENSORS}
_OfTheTable = create_model("_OfTheTable", __base__=Strict, **_KEYS)


class SensorsSection(_OfTheTable):
    """Sensors on board: those of the vehicle's parts (`vehicle`), or in their place those of thesis table 5.7 at CO.

    `table_5_7` has the biases of that table put right, `as_printed` as printed. Beside the sensors by kind, the second
    of a kind is `dvl_2`, and so on. `true` has a sensor in any case, `false` silences it.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, SensorSection] = Field(init=False)  # type: ignore[assignment]  (typed extras)

    preset: _Preset = "vehicle"

    @property
    def by_name(self) -> dict[str, SensorSection]:
        """What is said of each sensor, by its name."""
        return {name: getattr(self, name) for name in SENSORS} | dict(self.__pydantic_extra__ or {})

    @model_validator(mode="before")
    @classmethod
    def _by_default(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        for name in data:
            if name != "preset" and kind_of(str(name)) not in SENSORS:
                raise ValueError(f"{name}: no such key.{near(str(name), [*SENSORS, 'preset'])}")
        return {name: {"on_board": value} if isinstance(value, bool) else value for name, value in data.items()}

    @model_validator(mode="after")
    def _what_flies_anyway(self) -> "SensorsSection":
        for name in ESSENTIAL:
            if getattr(self, name).on_board is False:
                raise ValueError(
                    f"found {name}: false, but autopilots and tests need one; to see what they do without it: "
                    f"faults: [{{fault: silent, sensor: {name}, at: 0}}]"
                )
        return self
