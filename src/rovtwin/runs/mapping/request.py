"""What is asked of a map, and the file that says what water the lines were taken in."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import NonNegative, Strict
from rovtwin.imaging.spectra.water import Constituents

if TYPE_CHECKING:
    from rovtwin.imaging.imager import Imager

NAVIGATIONS = ("smoothed", "estimate", "truth", "lines")
TURN = float(np.radians(6.0))  # lines taken while the vehicle turns faster are left out by default [rad/s]
COURSE = 1.5  # over which a turn is measured [s]
FORMATS = ("envi", "cog", "cube", "netcdf")  # cog: picture and layers; cube: all bands as GeoTIFF


class WaterFile(Strict):
    """The water of a dive, for `--water`."""

    constituents: Constituents = Field(default_factory=lambda: Constituents.model_validate({}))
    daylight: NonNegative = Field(0.0, description="share of a clear noon's daylight that is there at the surface")
    water_sd: NonNegative = Field(0.10, description="standard deviation of absorption and scattering, relative")
    lamps_sd: NonNegative = Field(0.05, description="of the lamps' light with the calibration, relative")
    height_sd: NonNegative | None = Field(None, description="of the floor's height below the imager [m]")


@dataclass(frozen=True)
class MapRequest:
    """What is asked for.

    Attributes:
        lines: File of lines; or several of one dive, folders of `*.h5` among them.
        navigation: Whose poses, of `NAVIGATIONS`; None: smoothed where there is such a track, else the estimate, and
            without a run those in the file of lines. `truth` takes true times and the true mount, too.
        floor: `altimeter`, `plane`, `truth`, a raster file of heights, or a mesh.
        floor_crs: Frame of a mesh: see `mapping.mesh_floor.MeshFrame`.
        floor_std: Standard deviation of the height of a plane, a raster file or a mesh [m]; None: 0.1, 0.05, 0.05.
        depth: Of the plane [m]; None: as the altimeter has it.
        heights: Whether numbers of a raster file, or third coordinates of a mesh in a coordinate system, are heights
            over the ellipsoid; else depths.
        resolution: Side of a cell [m].
        crs: Coordinate system of the mosaic; `utm` for the zone that the datum lies in.
        radiance: Whether radiances are asked for, not reflectances.
        water: A file as `WaterFile`, `truth` (of the scene), or None: the truth where lines know it, else a coast's.
        panel: A file as `runs.mapping.panel.PanelFile`, of a reference panel in the scene; None: without.
        best: Whether cells are taken from the lines that saw them best, else means of all.
        turn: Lines taken while the vehicle turns faster are left out [rad/s].
        clock_offset: What the imager's clock is ahead of the run's [s].
        begin: First line at the earliest [s].
        end: Last line at the latest [s].
        area: A file of the area that was to be seen, for gaps; None: the hull of what was seen.
        points: A CSV file of places whose spectra are asked for: name,north,east or name,latitude,longitude.
        register: Whether overlaps put poses and calibration right; needs a smoothed track.
        control: A CSV file of known points: name,line,pixel,north,east,sd.
        calibrated: Whether mount and clock are exact; else they are unsure as usual (1 deg, 10 mm, 20 ms).
        formats: Of `FORMATS`; cube beside ENVI only where asked for or small.
        imager: Of lines whose file does not describe it, name or file.
        datum: Of lines that have none.
    """

    lines: Path | tuple[Path, ...]
    navigation: str | None = None
    floor: str = "altimeter"
    depth: float | None = None
    heights: bool = True
    resolution: float = 0.01
    crs: str = "utm"
    radiance: bool = False
    water: str | None = None
    best: bool = True
    turn: float = TURN
    clock_offset: float = 0.0
    begin: float = -np.inf
    end: float = np.inf
    area: Path | None = None
    points: Path | None = None
    register: bool = False
    control: Path | None = None
    calibrated: bool = False
    formats: tuple[str, ...] = ("envi", "cog")
    imager: "Imager | str | None" = None
    datum: Datum | None = None
    floor_crs: str = "ned"
    floor_std: float | None = None
    panel: Path | None = None

    @property
    def files(self) -> list[Path]:
        """The files of lines, those of folders by name.

        Raises:
            ConfigError: A folder has none.
        """
        found = []
        for path in (self.lines,) if isinstance(self.lines, Path) else self.lines:
            try:
                within = sorted(path.glob("*.h5")) if path.is_dir() else [path]
            except OSError as error:
                raise ConfigError(f"--lines {path}: cannot be read: {error.strerror or error}") from None
            if not within:
                raise ConfigError(f"--lines {path}: is a folder without files *.h5, expected some, or files of lines")
            found += within
        return found
