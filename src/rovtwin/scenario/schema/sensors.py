"""Sensors on board and what is different about them."""

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from rovtwin.core.config import Degrees3, NonNegative, Number, Positive, Share, Strict, Vector3

Window = Annotated[list[Number], Field(min_length=2, max_length=2)]


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


class ExtraSection(SensorSection):
    """A sensor that is not on board unless asked for."""

    on_board: bool = False


class DvlSection(ExtraSection):
    """A Doppler log, 5 mm/s per axis at 10 Hz."""


class AltimeterSection(ExtraSection):
    """A single-beam echo sounder, 1 cm at 10 Hz; it looks along its x axis, which is down by default."""

    max_range: Positive | None = Field(default=None, description="no reading beyond it [m]; default 50")


SENSOR_NAMES = ("position", "pressure", "accelerometer", "gyro", "attitude", "dvl", "altimeter", "battery", "leak")


class SensorsSection(Strict):
    """Sensors of thesis table 5.7 with their biases put right (`table_5_7`) or as printed (`as_printed`)."""

    preset: Literal["table_5_7", "as_printed"] = "table_5_7"
    position: SensorSection = SensorSection()
    pressure: SensorSection = SensorSection()
    accelerometer: SensorSection = SensorSection()
    gyro: SensorSection = SensorSection()
    attitude: SensorSection = SensorSection()
    dvl: DvlSection = DvlSection()
    altimeter: AltimeterSection = AltimeterSection()
    battery: ExtraSection = ExtraSection()
    leak: ExtraSection = ExtraSection()

    @field_validator("dvl", "altimeter", "battery", "leak", mode="before")
    @classmethod
    def _by_default(cls, value: Any) -> Any:
        return {"on_board": value} if isinstance(value, bool) else value
