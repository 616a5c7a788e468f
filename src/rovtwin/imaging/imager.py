"""An imager as arrays: where its pixels look in the water, what its bands take in; and where it sits on a vehicle."""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import as_array
from rovtwin.core.user_files.config import near
from rovtwin.imaging.files import load_imager_file
from rovtwin.imaging.schema import ImagerFile
from rovtwin.vehicle.description.schema import Sensor
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.physics.camera import R_DEVICE_C, Lens, Port, lens_from, refracted, seen_ray

_SIGMA = 1.0 / (2.0 * np.sqrt(2.0 * np.log(2.0)))  # of a Gaussian over its full width at half height

# Before any overlap is looked at, each axis [rad, m] and of the clock [s]: a bracket by hand, a ruler, a computer's
# clock set by network. Estimates; what is predicted of a map, and what is stated of it, both read them.
BORESIGHT_STD, LEVER_STD, CLOCK_STD = math.radians(1.0), 0.01, 0.02


@dataclass(frozen=True)
class Mount:
    """Where an imager sits on a vehicle.

    Attributes:
        position: Of its centre of projection, b [m]: the lever arm.
        rotation: R_bs, maps the imager's frame s (x line of sight, y right, z down the image) to b.
        name: Of the vehicle's sensor.
        imager: Which one the vehicle file says it is, name or file; "" where it does not say.
    """

    position: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    name: str = ""
    imager: str = ""


@dataclass(frozen=True)
class Imager:
    """A line imager.

    Attributes:
        file: As its file describes it.
    """

    file: ImagerFile

    @property
    def pixels(self) -> int:
        return self.file.pixels

    @cached_property
    def wavelengths(self) -> Float[np.ndarray, " band"]:
        """Centres of the bands [nm]."""
        bands = self.file.bands
        if bands.centres is not None:
            return np.array(bands.centres)
        assert bands.first is not None and bands.last is not None and bands.count is not None
        return np.linspace(bands.first, bands.last, bands.count)

    @cached_property
    def fwhm(self) -> Float[np.ndarray, " band"]:
        """Full widths of the responses at half their height [nm]."""
        return np.full(len(self.wavelengths), self.file.bands.fwhm)

    @cached_property
    def widths(self) -> Float[np.ndarray, " band"]:
        """How much of the spectrum each band takes in [nm]: from band to band, or its response if that is less."""
        return np.minimum(np.gradient(self.wavelengths), np.sqrt(2.0 * np.pi) * _SIGMA * self.fwhm)

    @cached_property
    def lens(self) -> Lens | None:
        """As a camera of `pixels` x 1; None where each pixel has an angle of its own."""
        given, n = self.file.lens, self.file.pixels
        if given.view_angles_deg is not None:
            return None
        focal = given.focal_length
        if focal is None:
            assert given.field_of_view_deg is not None
            focal = 0.5 * n / np.tan(np.radians(0.5 * given.field_of_view_deg))
        middle = 0.5 * (n - 1) if given.principal_point is None else given.principal_point
        return lens_from([focal, focal], [middle, 0.0], (n, 1), given.distortion, self.port)

    @cached_property
    def port(self) -> Port | None:
        """The window before it."""
        port = self.file.port
        return None if port is None else Port.of(port.distance, port.thickness, port.glass, port.water)

    def rays(self, across: float = 0.0) -> tuple[Float[np.ndarray, "pixel 3"], Float[np.ndarray, "pixel 3"]]:
        """Where each pixel's ray enters the water [m], and its unit direction there, both in s.

        Args:
            across: Place in the slit as a share of its width, from -0.5 (what the imager will see next, when it moves
                along -z) to 0.5; 0 is its middle, for which maps are made.

        Raises:
            ConfigError: The distortion leads no ray to some pixels.
        """
        down = across * 1e-3 * self.file.optics.slit_um / self.file.optics.focal_length_mm
        if self.lens is None:
            right = np.tan(np.radians(np.array(self.file.lens.view_angles_deg)))
            point, direction = refracted(self.port, as_array(np.stack([right, np.full_like(right, down)], axis=-1)))
        else:
            row = down * float(self.lens.focal[1])
            pixels = np.stack([np.arange(self.pixels), np.full(self.pixels, row)], axis=-1)
            point, direction = seen_ray(self.lens, as_array(pixels))
        point, direction = (np.asarray(x) @ R_DEVICE_C.T for x in (point, direction))
        if not np.isfinite(direction).all():
            raise ConfigError(
                f"{self.file.name}: lens.distortion: {self.file.lens.distortion} leads no ray to some of "
                f"{self.pixels} pixels; calibrate again"
            )
        return point, direction

    @cached_property
    def view_angles(self) -> Float[np.ndarray, " pixel"]:
        """Of the pixels' rays in the water from the line of sight, to the right positive [rad]."""
        direction = self.rays()[1]
        return np.arctan2(direction[:, 1], direction[:, 0])

    def in_bands(self, spectrum: Float[np.ndarray, " fine"], at: Float[np.ndarray, " fine"]) -> np.ndarray:
        """Means of a spectrum, given at wavelengths [nm], over the responses of the bands, shape (band,)."""
        sigma = np.maximum(_SIGMA * self.fwhm, 1e-3)[:, None]
        response = np.exp(-0.5 * ((at - self.wavelengths[:, None]) / sigma) ** 2)
        return response @ spectrum / response.sum(axis=1)


def load_imager(name_or_path: str | Path) -> Imager:
    """An imager of the library by name, or of any imager file by path.

    Raises:
        ConfigError: With a line per mistake: file, place, what was found, what was expected, the fix.
    """
    return Imager(load_imager_file(name_or_path))


def mount_of(vehicle: Vehicle, name: str | None = None) -> Mount:
    """Where a vehicle carries its imager: its sensor of kind `imager` of a name, or the first.

    Raises:
        ConfigError: It has none, or none of that name.
    """
    found = [m for m in vehicle.sensors if isinstance(m.item, Sensor) and m.item.kind == "imager"]
    if name is None:
        found = [m for m in found if not m.spare] or found
    if not found:
        raise ConfigError(
            f"{vehicle.where}: carries no imager. Add a sensor of kind imager, such as "
            "'parts: [{name: uhi, part: uhi}]' has, whose x axis is the line of sight"
        )
    names = [m.name for m in found]
    if name is not None and name not in names:
        raise ConfigError(f"{vehicle.where}: found no imager '{name}', there is {', '.join(names)}.{near(name, names)}")
    chosen = found[0 if name is None else names.index(name)]
    assert isinstance(chosen.item, Sensor)
    place = (np.asarray(chosen.position, float), np.asarray(chosen.rotation, float))
    return Mount(*place, chosen.name, chosen.item.imager or "")
