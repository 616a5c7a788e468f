"""What an imager file may say: a line imager behind a flat port, its bands, its detector, its clock, its lamps.

Frames: the imager's own frame s has its origin at the centre of projection, x along the line of sight, y to the right
along the line of pixels (pixel 0 is leftmost), z down the image, against the way that the image moves in. Where it sits
on a vehicle is the vehicle file's: the pose of its sensor of kind `imager`. SI units but where a name says otherwise.
"""

from typing import Annotated

from pydantic import Field, field_validator, model_validator

from rovtwin.core.user_files.config import NonNegative, Number, Positive, Strict, Vector3
from rovtwin.vehicle.description.schema import Port, Source

SMALLEST_FIELD = 3.0  # of view that is taken for degrees; a line of two radians would be 2 [deg]
SHORTEST, LONGEST = 300.0, 900.0  # wavelengths for which there are tables of water [nm]

Wavelength = Annotated[Number, Field(ge=SHORTEST, le=LONGEST)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Lens(Strict):
    """Where the pixels look in air: one of a field of view, a calibration in pixels, or an angle for each pixel."""

    field_of_view_deg: Annotated[Number, Field(gt=0, lt=150)] | None = Field(
        None, description="between the outer edges of the line, in air [deg]"
    )
    focal_length: Positive | None = Field(None, description="[px]")
    principal_point: Number | None = Field(None, description="c_x, of pixels counted from 0 [px]; else the middle")
    distortion: list[Number] = Field([], max_length=8, description="k_1, k_2, p_1, p_2, k_3 as in OpenCV")
    view_angles_deg: list[Number] | None = Field(
        None, description="of each pixel from the line of sight, in air, to the right positive [deg]"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> "Lens":
        kinds = [k for k in ("field_of_view_deg", "focal_length", "view_angles_deg") if getattr(self, k) is not None]
        if len(kinds) != 1:
            given = " and ".join(kinds) or "none"
            raise ValueError(f"found {given}, expected one of field_of_view_deg, focal_length, view_angles_deg")
        if self.view_angles_deg is not None and (self.distortion or self.principal_point is not None):
            raise ValueError("found view_angles_deg with distortion or principal_point: the angles hold these already")
        if self.field_of_view_deg is not None:
            _in_degrees(self.field_of_view_deg, f"found field_of_view_deg {self.field_of_view_deg:g}")
        return self

    @field_validator("view_angles_deg")
    @classmethod
    def _in_order(cls, value: list[float] | None) -> list[float] | None:
        if value is None:
            return value
        if len(value) < 2 or any(b <= a for a, b in zip(value, value[1:], strict=False)):
            raise ValueError("expected angles that grow from the left pixel to the right one")
        if max(abs(value[0]), abs(value[-1])) >= 75.0:
            raise ValueError(f"found angles from {value[0]:g} to {value[-1]:g} deg, expected less than 75 either way")
        _in_degrees(value[-1] - value[0], f"found angles from {value[0]:g} to {value[-1]:g}")
        return value


def _in_degrees(field: float, found: str) -> None:
    if field < SMALLEST_FIELD:
        raise ValueError(f"{found}, which looks like radians: expected degrees, at least {SMALLEST_FIELD:g} in all")


class Bands(Strict):
    """Of the spectrum; each has a Gaussian response about its centre."""

    first: Wavelength | None = Field(None, description="centre of the first [nm]")
    last: Wavelength | None = Field(None, description="centre of the last [nm]")
    count: Annotated[int, Field(ge=2, le=2000, strict=True)] | None = Field(None, description="from first to last")
    centres: list[Wavelength] | None = Field(None, description="in place of first, last and count [nm]")
    fwhm: Positive = Field(description="full width of a response at half its height [nm]")

    @model_validator(mode="after")
    def _one_way(self) -> "Bands":
        row = (self.first, self.last, self.count)
        if self.centres is None:
            if any(x is None for x in row):
                raise ValueError("no wavelengths: expected first, last and count, or centres")
            assert self.first is not None and self.last is not None
            if self.first >= self.last:
                raise ValueError(f"found first {self.first:g} and last {self.last:g} nm, expected the shorter first")
        elif any(x is not None for x in row):
            raise ValueError("found centres beside first, last or count, expected either")
        elif len(self.centres) < 2 or any(b <= a for a, b in zip(self.centres, self.centres[1:], strict=False)):
            raise ValueError("centres: expected two or more wavelengths that grow")
        return self


class Optics(Strict):
    """Between port and detector."""

    f_number: Annotated[Number, Field(ge=0.7, le=32)] = Field(description="of the lens before the slit")
    focal_length_mm: Positive = Field(description="of that lens [mm]")
    slit_um: Positive = Field(description="width of the slit, along the way that the imager moves [um]")
    transmission: Annotated[Number, Field(gt=0, le=1)] = Field(description="of port, lenses and grating together")


class Detector(Strict):
    """Makes counts of light; a pixel is what is read out as one, after binning."""

    pixel_um: Positive = Field(description="side of a pixel along the line [um]")
    quantum_efficiency: Annotated[list[Pair], Field(min_length=1)] = Field(
        description="rows of [nm, electrons a photon]"
    )
    full_well: Positive = Field(description="electrons at which a pixel saturates")
    bits: Annotated[int, Field(ge=8, le=16, strict=True)] = Field(description="of a count; the highest is a full well")
    offset: NonNegative = Field(0.0, description="counts of a pixel without light or dark current")
    read_noise: NonNegative = Field(description="standard deviation [electrons]")
    dark_current: NonNegative = Field(description="[electrons/s]")
    uniformity: Annotated[Number, Field(ge=0, le=0.2)] = Field(
        0.0, description="relative standard deviation of pixels' response and dark current"
    )

    @field_validator("quantum_efficiency")
    @classmethod
    def _rows(cls, value: list[list[float]]) -> list[list[float]]:
        if any(b[0] <= a[0] for a, b in zip(value, value[1:], strict=False)):
            raise ValueError("expected rows of growing wavelengths")
        if any(not 0 <= row[1] <= 1 for row in value):
            raise ValueError("expected efficiencies from 0 to 1")
        return value

    @model_validator(mode="after")
    def _room_above_the_offset(self) -> "Detector":
        if self.offset >= 0.5 * 2**self.bits:
            raise ValueError(f"offset: found {self.offset:g}, expected less than half of the {2**self.bits} counts")
        return self


class Clock(Strict):
    """The imager's own: what it stamps at the run's time t is t (1 + drift) + offset + noise."""

    offset: Number = Field(0.0, description="[s]")
    drift: Annotated[Number, Field(ge=-0.1, le=0.1)] = Field(0.0, description="relative")
    jitter: Annotated[Number, Field(ge=0, le=0.1)] = Field(0.0, description="standard deviation of a stamp [s]")


class Lamp(Strict):
    """A lamp that moves with the imager; its intensity falls off from its axis as cos^m."""

    name: str
    position: Vector3 = Field(description="in the imager's frame [m]")
    direction: Vector3 = Field([1.0, 0.0, 0.0], description="of its axis, in the imager's frame")
    beam_deg: Annotated[Number, Field(gt=0, lt=180)] = Field(description="between directions of half intensity [deg]")
    radiant_flux: NonNegative = Field(description="between 380 and 800 nm [W]")
    temperature: Annotated[Number, Field(ge=1000, le=20000)] | None = Field(
        None, description="of a black body of its spectrum [K]: 3000 for halogen"
    )
    spectrum: Annotated[list[Pair], Field(min_length=2)] | None = Field(
        None, description="in place of a temperature: rows of [nm, relative spectral flux]"
    )

    @model_validator(mode="after")
    def _one_spectrum(self) -> "Lamp":
        if (self.temperature is None) == (self.spectrum is None):
            raise ValueError("expected either temperature or spectrum")
        if self.spectrum is not None:
            if any(b[0] <= a[0] for a, b in zip(self.spectrum, self.spectrum[1:], strict=False)):
                raise ValueError("spectrum: expected rows of growing wavelengths")
            if min(row[1] for row in self.spectrum) < 0:
                raise ValueError("spectrum: expected no negative flux")
        if sum(x * x for x in self.direction) < 1e-12:
            raise ValueError("direction: a direction of length zero points nowhere")
        return self


class ImagerFile(Strict):
    """An imager file."""

    name: str
    description: str = ""
    source: Source = None
    sources: dict[str, str] = Field({}, description="where values come from, by key; 'estimate' where from nowhere")
    pixels: Annotated[int, Field(ge=2, le=20000, strict=True)] = Field(description="along the line")
    lens: Lens
    port: Port | None = Field(None, description="flat port; leave it out where the lens was calibrated in water")
    bands: Bands
    optics: Optics
    detector: Detector
    exposure: Positive = Field(description="time that a line collects light [s]")
    line_rate_hz: Positive = Field(description="lines a second")
    clock: Clock = Field(default_factory=lambda: Clock.model_validate({}))
    lamps: list[Lamp] = Field([], max_length=8)
    smallest_snr: Positive = Field(5.0, description="bands below it tell nothing and are masked in maps")

    @model_validator(mode="after")
    def _fits(self) -> "ImagerFile":
        angles = self.lens.view_angles_deg
        if angles is not None and len(angles) != self.pixels:
            raise ValueError(f"lens.view_angles_deg: found {len(angles)} angles for {self.pixels} pixels")
        if self.exposure * self.line_rate_hz > 1.0 + 1e-9:
            raise ValueError(
                f"exposure: found {self.exposure:g} s, but at {self.line_rate_hz:g} lines a second there are "
                f"{1.0 / self.line_rate_hz:g} s for each"
            )
        names = [lamp.name for lamp in self.lamps]
        if twice := sorted({n for n in names if names.count(n) > 1}):
            raise ValueError(f"lamps: the name '{twice[0]}' is given twice; names must differ")
        return self
