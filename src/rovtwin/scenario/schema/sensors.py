"""What a scenario says about the sensors on board."""

import re
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag, create_model, field_validator, model_validator

from rovtwin.core.sensors import ESSENTIAL, SENSORS, kind_of
from rovtwin.core.user_files.config import Degrees3, NonNegative, Number, Positive, Share, Strict, Vector3
from rovtwin.core.user_files.yamlfile import near
from rovtwin.scenario.schema.own_block import require_name

_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)  # of a log's channel
_OF_VEHICLES = ("estimate", "force", "mocap", "thrusters", "truth")  # what a link or the twin tells besides readings
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


class OwnSensorSection(SensorSection):
    """A sensor of one's own, by a name of one's own."""

    kind: str = Field(min_length=1, description="package.module:Name, or an entry point of rovtwin.sensors")
    settings: dict[str, Any] = Field(default_factory=dict, description="arguments to make it with")

    @field_validator("kind")
    @classmethod
    def _is_name(cls, value: str) -> str:
        return require_name(value)


def _branch(value: Any) -> str:
    return "own" if isinstance(value, OwnSensorSection) or (isinstance(value, dict) and "kind" in value) else "ours"


_Named = Annotated[
    Annotated[SensorSection, Tag("ours")] | Annotated[OwnSensorSection, Tag("own")], Discriminator(_branch)
]
_Preset = Literal["vehicle", "table_5_7", "as_printed"]
_KEYS: dict[str, Any] = {"preset": (_Preset, "vehicle")} | {kind: (SensorSection, SensorSection()) for kind in SENSORS}
_OfTheTable = create_model("_OfTheTable", __base__=Strict, **_KEYS)


class SensorsSection(_OfTheTable):
    """Sensors on board: those of the vehicle's parts (`vehicle`), or in their place those of thesis table 5.7 at CO.

    `table_5_7` has the biases of that table put right, `as_printed` as printed. Beside the sensors by kind, the second
    of a kind is `dvl_2`, and so on. `true` has a sensor in any case, `false` silences it. One of your own has a name of
    your own and a `kind`, the address of its class or an entry point of the group rovtwin.sensors.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, _Named] = Field(init=False)  # type: ignore[assignment]  (typed extras)

    preset: _Preset = "vehicle"

    @property
    def by_name(self) -> dict[str, SensorSection]:
        """What is said of each sensor, by its name."""
        return {name: getattr(self, name) for name in SENSORS} | dict(self.__pydantic_extra__ or {})

    @property
    def own(self) -> dict[str, OwnSensorSection]:
        """Sensors of one's own that fly, by name."""
        found = {name: one for name, one in self.by_name.items() if isinstance(one, OwnSensorSection)}
        return {name: one for name, one in found.items() if one.on_board is not False}

    @model_validator(mode="before")
    @classmethod
    def _by_default(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        found = {name: _opened(str(name), value) for name, value in data.items()}
        for name, value in found.items():
            _require_known(str(name), value)
        return found

    @model_validator(mode="after")
    def _what_flies_anyway(self) -> "SensorsSection":
        for name in ESSENTIAL:
            if getattr(self, name).on_board is False:
                raise ValueError(
                    f"found {name}: false, but autopilots and tests need one; to see what they do without it: "
                    f"faults: [{{fault: silent, sensor: {name}, at: 0}}]"
                )
        return self


def _opened(name: str, value: Any) -> Any:
    """A section's short forms: whether it is on board; of one's own its kind."""
    if isinstance(value, bool):
        return {"on_board": value}
    is_own = isinstance(value, str) and name != "preset" and kind_of(name) not in SENSORS
    return {"kind": value} if is_own else value


def _require_known(name: str, value: Any) -> None:
    """Raise ValueError for a name that is neither in the table nor that of a sensor of one's own."""
    is_own, in_table = _branch(value) == "own", name == "preset" or kind_of(name) in SENSORS
    if in_table and is_own:
        raise ValueError(f"{name}: found kind, but its name says its kind; give a sensor of your own another name")
    if not in_table and not is_own:
        known = near(name, [*SENSORS, "preset"])
        raise ValueError(f"{name}: no such key.{known} One of your own needs its kind: package.module:Name")
    if is_own and (name in _OF_VEHICLES or not _NAME.fullmatch(name)):
        raise ValueError(
            f"{name}: found a name that a log's channel cannot have, or that is taken; expected letters, digits and _, "
            f"beginning with a letter, and none of {', '.join(_OF_VEHICLES)}"
        )
