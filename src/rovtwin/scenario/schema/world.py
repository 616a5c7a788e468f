"""The water, and how the true vehicle differs from the model."""

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from rovtwin.core.sensors import EARTH_FIELD
from rovtwin.core.user_files.config import Degrees, NonNegative, Number, Positive, Share, Strict, Vector3
from rovtwin.scenario.schema.own_block import OwnBlock, by_short_form
from rovtwin.scenario.schema.tether import TethersSection
from rovtwin.scenario.schema.water import WaterSection


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


class AirySection(Strict):
    """A real sea: linear waves of a spectrum, whose orbital motion the vehicle feels at its depth."""

    model: Literal["airy"]
    spectrum: Literal["jonswap", "pierson_moskowitz"] = "jonswap"
    significant_height: Positive = Field(description="Hs [m]")
    zero_crossing_period: Positive | None = Field(default=None, description="Tz [s]; this or peak_period")
    peak_period: Positive | None = Field(default=None, description="Tp [s]; this or zero_crossing_period")
    gamma: Annotated[Number, Field(ge=1, le=10)] | None = Field(
        default=None, description="peak enhancement of jonswap; default 3.3"
    )
    direction_deg: Degrees = Field(default=0.0, description="where the waves run to, from north over east")
    spreading: Annotated[Number, Field(gt=0, le=100)] | None = Field(
        default=None, description="s of cos^2s about the direction; default all run the same way"
    )
    depth: Positive | None = Field(default=None, description="of the water [m]; default world.floor, or deep")
    components: Annotated[int, Field(strict=True, ge=2, le=1024)] = Field(default=64, description="number of waves")

    @model_validator(mode="after")
    def _one_sea(self) -> "AirySection":
        if (self.zero_crossing_period is None) == (self.peak_period is None):
            given = "neither" if self.peak_period is None else "both"
            raise ValueError(f"found {given} of zero_crossing_period and peak_period, expected one of them")
        if self.spectrum == "pierson_moskowitz" and self.gamma not in (None, 1.0):
            raise ValueError("gamma belongs to jonswap; take it out or write spectrum: jonswap")
        return self

    @property
    def peak_enhancement(self) -> float:
        """gamma; Pierson-Moskowitz is the JONSWAP spectrum of gamma = 1."""
        if self.spectrum == "pierson_moskowitz":
            return 1.0
        return 3.3 if self.gamma is None else self.gamma


WavesSection = Annotated[ThesisWavesSection | AirySection, Field(discriminator="model")]


class MismatchSection(Strict):
    """How the plant differs from the autopilot's model; the damping factors are drawn from the seed."""

    damping: Annotated[Number, Field(ge=0, lt=1)] = Field(
        default=0.25, description="each coefficient times U[1 - d, 1 + d]"
    )
    mass: Positive = Field(default=1.10, description="factor on rigid-body and added mass, weight and buoyancy")
    thrust: Positive = Field(default=0.90, description="factor on every thruster's force")


def _rising(span: list[float]) -> list[float]:
    if span[0] >= span[1]:
        raise ValueError(f"found {span}, expected the lower number first")
    return span


Span = Annotated[list[Number], Field(min_length=2, max_length=2), AfterValidator(_rising)]


class TankSection(Strict):
    """Walls that run north and east; the hull cannot pass them."""

    north: Span = Field(description="southern and northern wall [m]")
    east: Span = Field(description="western and eastern wall [m]")


class SandWaveSection(Strict):
    """A wave of the floor."""

    amplitude: Positive = Field(description="half of its height [m]")
    length: Positive = Field(description="from crest to crest [m]")
    direction_deg: Degrees = Field(default=0.0, description="across the crests, from north")


class HillsSection(Strict):
    """Ripples on hills, made from a seed, as the bottom of a scene has them."""

    height: Positive = Field(default=0.6, description="trough to crest [m]")
    length: Positive = Field(default=12.0, description="from hill to hill [m]")
    seed: Annotated[int, Field(ge=0, strict=True)] = 1
    size: Positive = Field(default=80.0, description="side of the square about the origin in which that holds [m]")


class ReliefSection(Strict):
    """What makes a floor uneven; `floor` is its depth at the origin. Cameras and imagers see it so, tethers level."""

    slope: Annotated[list[Number], Field(min_length=2, max_length=2)] = Field(
        default=[0.0, 0.0], description="metres deeper per metre north and east"
    )
    waves: list[SandWaveSection] = []
    hills: HillsSection | None = None


class MagneticFieldSection(Strict):
    """The Earth's magnetic field where the run is, which magnetometers read; by default near Trondheim in 2025."""

    strength_ut: Annotated[Positive, Field(le=1000)] = Field(
        default=EARTH_FIELD[0], description="[uT]; 22 to 67 on Earth"
    )
    inclination_deg: Annotated[Number, Field(ge=-90, le=90)] = Field(
        default=EARTH_FIELD[1], description="below the horizontal; negative in the south"
    )
    declination_deg: Annotated[Number, Field(ge=-180, le=180)] = Field(
        default=EARTH_FIELD[2], description="from true north over east"
    )

    @property
    def vector(self) -> list[float]:
        """What a magnetometer reads of it, as `core.sensors.EARTH_FIELD`."""
        return [self.strength_ut, self.inclination_deg, self.declination_deg]


class WorldSection(Strict):
    """The water, and how the true vehicle differs from the model."""

    water: WaterSection | None = Field(
        default=None, description="density, for the plant, not for the model; default: what the vehicle is written for"
    )
    current: CurrentSection = ConstantCurrentSection()
    waves: WavesSection | None = None
    surface: bool = Field(default=True, description="whether buoyancy ends at depth 0, as in nature")
    floor: Positive | None = Field(default=None, description="depth of the floor, which holds the hull [m]")
    relief: ReliefSection | None = None
    tank: TankSection | None = None
    tethers: TethersSection | None = Field(
        default=None, description="true: all that the vehicle has, tended from above the start"
    )
    forces: list[OwnBlock] = Field(
        default_factory=list, description="forces of your own on the hull: package.module:Name, or entry points"
    )
    magnetic_field: MagneticFieldSection = MagneticFieldSection()
    mismatch: MismatchSection | None = None
    net_buoyancy: Number = Field(default=0.0, description="added to the plant, not to the autopilot's model [N]")
    thruster_health: dict[str, Share] = Field(
        default_factory=dict, description="faults: share of the force left, by thruster name; 0 is dead"
    )

    @property
    def moving_surface(self) -> bool:
        """Whether there is a surface that goes up and down."""
        return self.surface and isinstance(self.waves, AirySection)

    @field_validator("current", mode="before")
    @classmethod
    def _current_as_vector(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return {"type": "constant", "velocity": value}
        if isinstance(value, dict) and "type" not in value:
            return {"type": "constant"} | value
        if not isinstance(value, Strict | dict):
            raise ValueError(
                f"found {value!r}, expected three numbers [north, east, down] in m/s, such as [0.2, 0, 0], or a mapping"
            )
        return value

    @field_validator("forces", mode="before")
    @classmethod
    def _force_by_address(cls, value: Any) -> Any:
        return [by_short_form(one) for one in value] if isinstance(value, list) else value

    @field_validator("waves", mode="before")
    @classmethod
    def _thesis_waves_by_default(cls, value: Any) -> Any:
        return {"model": "thesis"} | value if isinstance(value, dict) else value

    @model_validator(mode="after")
    def _relief_of_a_floor(self) -> "WorldSection":
        if self.relief is not None and self.floor is None:
            raise ValueError("relief: there is no floor to be uneven; add floor, its depth at the origin [m]")
        return self

    @model_validator(mode="after")
    def _one_depth(self) -> "WorldSection":
        waves = self.waves
        if isinstance(waves, AirySection) and waves.depth and self.floor and waves.depth != self.floor:
            raise ValueError(
                f"waves.depth is {waves.depth:g} m and floor {self.floor:g} m, but the waves feel the floor; give one"
            )
        return self

    @field_validator("mismatch", "tethers", mode="before")
    @classmethod
    def _by_default(cls, value: Any) -> Any:
        return {} if value is True else None if value is False else value
