"""Evidence files: which logs were flown, what is in them, which are fitted and which only checked against.

`rovtwin identify VEHICLE --evidence evidence.yaml` reads one. Paths in it are relative to the file itself. What decides
about the estimate (`free`, `prior`, `anchors`, `options`) is carried as written; the estimate checks it.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from rovtwin.core.user_files.config import NonNegative, Number, Positive, Share, Strict, Vector3, parse, read_yaml
from rovtwin.identification.logs.log_spec import Clock, CommandSpec, Estimate, Format, SignalSpec, SourceSpec

Use = Literal["fit", "validate"]


class BallastSpec(Strict):
    """A known piece that was on the vehicle in this test only."""

    mass: Positive = Field(description="[kg]")
    volume: NonNegative = Field(0.0, description="[m3]")
    position: Vector3 = Field(description="from CO, b [m]")


class LogSpec(SourceSpec):
    """One test: one file, or several files of the same test."""

    file: str = Field("", description="recording, relative to the evidence file")
    files: list[SourceSpec] = Field([], description="instead of file: several recordings of the same test")
    name: str | None = Field(None, description="for people; else the file's name")
    use: Use = Field("fit", description="fit: parameters come from it; validate: never fitted")
    fit_share: Annotated[Share, Field(gt=0, lt=1)] | None = Field(
        None, description="the first part is fitted, the rest validates"
    )
    span: Literal["commands", "all"] | list[Number] = Field(
        "commands", description="commands: first to last command; [start, end] in s from the first sample"
    )
    water_density: Annotated[Number, Field(ge=900, le=1100)] | None = Field(None, description="[kg/m3]")
    tether_length: NonNegative | None = Field(None, description="paid out [m]")
    current: Vector3 = Field([0.0, 0.0, 0.0], description="velocity of the water over ground, n [m/s]")
    ballast: list[BallastSpec] = []

    @model_validator(mode="after")
    def _one_or_many(self) -> "LogSpec":
        if bool(self.file) == bool(self.files):
            raise ValueError("expected either 'file' or 'files'")
        if self.files and (self.signals or self.commands or self.clock):
            raise ValueError("with 'files', write signals, commands and clock under each of them")
        if isinstance(self.span, list) and not (len(self.span) == 2 and 0 <= self.span[0] < self.span[1]):
            raise ValueError(f"span: found {self.span}, expected commands, all, or [start, end] with 0 <= start < end")
        if self.fit_share is not None and self.use == "validate":
            raise ValueError("fit_share: this log is never fitted (use: validate); leave one of them out")
        return self

    @property
    def sources(self) -> list[SourceSpec]:
        """The files of the test, in the order in which they are written; the first one has the clock."""
        if self.files:
            return self.files
        return [SourceSpec.model_construct(**{name: getattr(self, name) for name in SourceSpec.model_fields})]


class EvidenceFile(Strict):
    """An evidence file."""

    vehicle: str | None = Field(None, description="name of the library, or a file relative to this one")
    logs: list[LogSpec] = Field(min_length=1)
    free: list[str] = Field([], description="patterns of the parameters to estimate: added_mass.*")
    prior: dict[str, Any] = Field({}, description="by pattern: {factor: 2}, {sd: 0.3}, {value: .., sd: ..}")
    anchors: list[dict[str, Any]] = Field([], description="what is known from elsewhere, such as a bollard pull")
    options: dict[str, Any] = {}


@dataclass(frozen=True)
class Evidence:
    """An evidence file and where it lies."""

    file: EvidenceFile
    path: Path

    @property
    def vehicle(self) -> str | Path | None:
        """What `load_vehicle` takes: a path where the named file lies beside the evidence, else a library name."""
        name = self.file.vehicle
        if name is None:
            return None
        beside = self.path.parent / Path(name).expanduser()
        return beside if beside.suffix else name

    def locate(self, name: str) -> Path:
        """The path of a recording named in the file."""
        return self.path.parent / Path(name).expanduser()


def read_evidence(path: str | Path) -> Evidence:
    """The evidence in a file.

    Raises:
        ConfigError: With a line per mistake: file, place, what was found, what was expected, the fix.
    """
    path = Path(path)
    return Evidence(parse(EvidenceFile, read_yaml(path), path.name), path)


__all__ = [
    "BallastSpec",
    "Clock",
    "CommandSpec",
    "Estimate",
    "Evidence",
    "EvidenceFile",
    "Format",
    "LogSpec",
    "SignalSpec",
    "SourceSpec",
    "Use",
    "read_evidence",
]
