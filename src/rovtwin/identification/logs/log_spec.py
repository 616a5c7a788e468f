"""How the columns of a file become signals and commands: the part of an evidence file that describes one recording.

Every reader turns its file into tables (named blocks of columns over one clock). What is in which column, in which unit
and which frame, is said in this one language, by the user or, where a format says it itself, by the reader.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from rovtwin.core.plugins import READERS, installed
from rovtwin.core.user_files.config import Degrees3, NonNegative, Number, Strict, Vector3, near
from rovtwin.identification.logs.record import SIGNALS

Column = int | str
FORMATS = ("auto", "rovtwin", "csv", "npz", "qtm", "c3d", "rosbag", "blueye", "dataflash", "tlog", "ulog")
Format = Annotated[str, AfterValidator(lambda value: _known_format(value))]
"""One of FORMATS, or an entry point of rovtwin.readers."""
Estimate = Literal["estimate"]

# To SI, by which kind of quantity a unit belongs to.
UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "angle": {"rad": 1.0, "deg": 0.017453292519943295},
    "rate": {"rad/s": 1.0, "deg/s": 0.017453292519943295},
    "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "acceleration": {"m/s2": 1.0, "mm/s2": 1e-3, "g": 9.80665},
    "pressure": {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1e3, "bar": 1e5},
}
KINDS: dict[str, tuple[str, ...]] = {
    "position": ("length",),
    "horizontal": ("length",),
    "depth": ("length", "pressure"),
    "attitude": ("angle",),
    "gyro": ("rate",),
    "velocity": ("speed",),
    "accelerometer": ("acceleration",),
}


class SignalSpec(Strict):
    """One signal: where its columns are, their unit, their frame, their noise."""

    table: str | None = Field(None, alias="from", description="array, topic or body in the file; not for plain CSV")
    columns: list[Column] | None = Field(None, description="by name, or by number from 0; else those of a known format")
    time: Column | None = Field(
        None, description="column, or array, of the time; else the table's own, or its first column"
    )
    unit: str | None = Field(None, description="mm, deg, deg/s, g, mbar ..; else SI")
    frame: Literal["frd", "flu", "ned", "enu", "nwu", "down", "up"] | None = Field(
        None, description="body: frd or flu; world: ned, enu or nwu (z up); attitude: ned (FRD), enu or nwu (FLU)"
    )
    euler: Literal["zyx", "xyz"] = Field("zyx", description="zyx: Rz(yaw) Ry(pitch) Rx(roll); xyz: Rx Ry Rz, as QTM")
    quaternion: Literal["wxyz", "xyzw"] = Field("wxyz", description="order of four columns of an attitude")
    matrix: Literal["rows", "columns"] = Field("rows", description="order of nine columns of an attitude")
    sigma: NonNegative | list[NonNegative] | None = Field(
        None, description="standard deviation of the noise, SI, one number or one per column"
    )
    lever: Vector3 = Field([0.0, 0.0, 0.0], description="place of the sensor from CO, b [m]")
    mounting_deg: Degrees3 = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw of the sensor's axes in b")
    zero: Number = Field(0.0, description="what the sensor reads at zero, in its unit: the air pressure for a depth")
    repeats: Literal["keep", "drop"] = Field("keep", description="drop: a row equal to the last one is no new reading")
    time_offset: Number = Field(0.0, description="added to its times [s]: negative where they are logged too late")


class CommandSpec(Strict):
    """The thruster commands: where their columns are, their unit, which column drives which thruster."""

    table: str | None = Field(None, alias="from", description="array, topic or channel in the file; not for plain CSV")
    columns: list[Column] | None = Field(None, description="by name, or by number from 0")
    time: Column | None = Field(
        None, description="column, or array, of the time; else the table's own, or its first column"
    )
    unit: Literal["normalised", "percent", "pwm"] = Field("normalised", description="pwm: (value - 1500) / 400")
    thrusters: list[str] | None = Field(None, description="thruster of each column; else the order of the vehicle")
    mix: dict[str, list[Number]] | None = Field(
        None, description="where columns are the pilot's axes: of each thruster, the gain from every column"
    )
    time_offset: Number = Field(0.0, description="added to its times [s]: negative where they are logged too late")

    @model_validator(mode="after")
    def _one_way(self) -> "CommandSpec":
        if self.mix is not None and self.thrusters is not None:
            raise ValueError("found thrusters and mix, expected one of them")
        return self


class Clock(Strict):
    """What the clock of a file shows against that of the log's first file: t = t_file (1 + drift) + offset."""

    offset: Number = Field(0.0, description="[s]")
    drift: Number = Field(0.0, description="relative, 1e-5 is 10 ppm")


class SourceSpec(Strict):
    """One file of a test."""

    file: str = Field(description="recording, relative to the evidence file")
    format: Format = Field("auto", description="else recognised by the file's ending and first bytes")
    clock: Clock | Estimate | None = Field(None, description="offset and drift against the first file, or estimate")
    commands: CommandSpec | None = None
    signals: dict[str, SignalSpec] = {}
    body: str | None = Field(None, description="rigid body of a motion capture file; else its only one")
    markers: dict[str, Vector3] | None = Field(
        None, description="C3D: places of the markers in b [m]; attitude and position follow by least squares"
    )

    @field_validator("signals", mode="before")
    @classmethod
    def _known_signals(cls, value: Any) -> Any:
        for name, spec in value.items() if isinstance(value, dict) else ():
            if name not in SIGNALS:
                raise ValueError(f"{name}: no such signal.{near(name, SIGNALS)}")
            unit = spec.get("unit") if isinstance(spec, dict) else None
            known = [u for kind in KINDS[name] for u in UNITS[kind]]
            if unit is not None and unit not in known:
                raise ValueError(f"{name}.unit: found {unit!r}, expected one of {', '.join(known)}")
        return value


def _known_format(value: str) -> str:
    if value not in FORMATS and value not in (others := installed(READERS)):
        raise ValueError(f"found {value!r}, expected one of {', '.join([*FORMATS, *others])}")
    return value


def factor(name: str, unit: str | None) -> tuple[float, str]:
    """What to multiply readings of a signal with to get SI, and the kind of quantity they are."""
    for kind in KINDS[name]:
        if unit is None or unit in UNITS[kind]:
            return (1.0 if unit is None else UNITS[kind][unit]), kind
    raise ValueError(f"{name}: unit {unit!r}")
