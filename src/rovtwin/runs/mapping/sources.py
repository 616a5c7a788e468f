"""What a map is made of besides its lines: poses, a floor, light and water; from a run's folder or from files."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Float

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.core.user_files.config import parse, read_yaml
from rovtwin.imaging.floor import Floor, Plane
from rovtwin.imaging.imager import Mount, load_imager, mount_of
from rovtwin.imaging.lines import LinesFile
from rovtwin.imaging.lines_of_files import open_lines
from rovtwin.imaging.radiance import Radiometry, fine_wavelengths
from rovtwin.imaging.spectra.water import SpectralWater
from rovtwin.mapping.altimeter import Altimeter, Surface, altimeter_hits, surface_through
from rovtwin.mapping.floors import Elevation, GridFloor, elevation_model
from rovtwin.mapping.georeference import LONGEST
from rovtwin.mapping.mesh_floor import MeshFloor, MeshFrame, mesh_floor
from rovtwin.mapping.navigation import Navigation
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.sensors import sensors_of, without_own
from rovtwin.runs.compose.world import on_world_floor
from rovtwin.runs.mapping.checking import NO_FILE, is_mesh
from rovtwin.runs.mapping.dating import date
from rovtwin.runs.mapping.request import NAVIGATIONS, MapRequest, WaterFile
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.imager.radiance import radiometry_of
from rovtwin.simulation.scene import Scene, scene_from_dict

_PLANE, _FILE = 0.1, 0.05  # standard deviations of floors of which nobody says any [m]
_REACH = 1.5  # of the floor beyond the pixels' first estimate [m]


@dataclass(frozen=True)
class Inputs:
    """A run, its lines, and what is asked of them.

    Attributes:
        run: Folder of the run, or None where there is only a file of lines.
        log: Of the run, or None.
        scenario: Of the run, or None.
        lines: Open file.
        request: What is asked for.
    """

    run: Path | None
    log: Log | None
    scenario: Scenario | None
    lines: LinesFile
    request: MapRequest

    @cached_property
    def datum(self) -> Datum:
        """Where n lies.

        Raises:
            ConfigError: Nobody says.
        """
        datum = self.lines.datum
        if datum is None:
            raise ConfigError(
                f"{self.lines.path}: says nothing of a datum, the origin of north, east, down. Say --datum "
                "LATITUDE,LONGITUDE[,HEIGHT]"
            )
        return datum

    @cached_property
    def mount(self) -> Mount:
        """Where the imager sits: as stated, or truly where the map is made by truth.

        Raises:
            ConfigError: Nobody says.
        """
        if self.by_truth:
            assert self.lines.truth is not None
            return self.lines.truth.mount
        if self.lines.mount is not None:
            return self.lines.mount
        if self.scenario is None:
            raise ConfigError(
                f"{self.lines.path}: does not say where the imager sits on the vehicle, and there is no run beside it "
                "whose vehicle file would"
            )
        return mount_of(vehicle_of(self.scenario))

    @property
    def by_truth(self) -> bool:
        """Whether true poses, times and mount are asked for."""
        return self.request.navigation == "truth"

    @cached_property
    def navigation(self) -> Navigation:
        """Of the vehicle.

        Raises:
            ConfigError: What is asked for is not there.
            LogError: It cannot be used.
        """
        source = self.request.navigation or self._usual()
        if source == "lines":
            return Navigation.of_lines(self.lines)
        if source == "truth" and self.log is None:
            truth = self.lines.truth
            if truth is None:
                raise ConfigError(f"--navigation truth: {self.lines.path} knows none: an instrument took its lines")
            return Navigation(truth.t, truth.position, truth.attitude, source="truth")
        if self.log is None or self.run is None:
            raise ConfigError(f"--navigation {source}: needs a run; without one there are lines and truth")
        if source == "smoothed":
            path = self.run / "smoothed.mcap"
            if not path.is_file():
                raise ConfigError(f"{path}: not there; make it first: rovtwin smooth {self.run}")
            return Navigation.of_log(Log.read(path), "smoothed", str(path))
        if source not in NAVIGATIONS:
            raise ConfigError(f"--navigation: found '{source}', expected {', '.join(NAVIGATIONS)}")
        return Navigation.of_log(self.log, source, str(self.run))

    def _usual(self) -> str:
        if self.run is None:
            return "lines"
        return "smoothed" if (self.run / "smoothed.mcap").is_file() else "estimate"

    @cached_property
    def times(self) -> Float[np.ndarray, " line"]:
        """Of the lines on the run's clock [s]."""
        if self.by_truth:
            if self.lines.truth is None:
                raise ConfigError(f"--navigation truth: {self.lines.path} knows none: an instrument took its lines")
            return self.lines.truth.t
        return self.lines.t - self.request.clock_offset

    @cached_property
    def scene(self) -> Scene | None:
        """What a simulation showed the imager, on the run's floor; None for lines of an instrument."""
        truth = self.lines.truth
        if truth is None:
            return None
        scene = scene_from_dict(yaml.safe_load(truth.scene), f"{self.lines.path.name}: its scene")
        return scene if self.scenario is None else on_world_floor(scene, self.scenario.world)

    @cached_property
    def hits(self) -> tuple[Float[np.ndarray, "n 3"], int, float] | None:
        """Echoes of the altimeter on the floor, n [m], how many were left out, and their noise [m]; None without."""
        if self.log is None or self.scenario is None:
            return None
        fitted = sensors_of(without_own(self.scenario), vehicle_of(self.scenario))
        for name, sensor in fitted.items():
            if sensor.kind == "altimeter" and (channel := f"sensor/{name}") in self.log:
                series = self.log[channel]
                noise = float(np.max(np.asarray(sensor.noise)))
                beam = np.asarray(sensor.rotation)[:, 0]
                at = Altimeter(np.asarray(sensor.lever, float), np.asarray(beam, float), noise)
                t = series.values[:, -1]  # when the reading was valid
                return (*altimeter_hits(self.navigation, at, t, series.values[:, 0]), noise)
        return None

    def first_floor(self) -> Plane:
        """A level floor, good enough to see how far pixels reach.

        Raises:
            ConfigError: Nobody knows how deep it is, or the file of heights cannot be used.
        """
        return self._first

    @cached_property
    def _first(self) -> Plane:
        if self.request.depth is not None:
            return Plane(self.request.depth)
        if self.hits is not None and len(self.hits[0]):
            return Plane(float(np.median(self.hits[0][:, 2])))
        if self.lines.truth is not None and np.isfinite(self.lines.truth.floor).any():
            return Plane(float(np.nanmedian(self.lines.truth.floor)))
        if self.request.floor not in NO_FILE:
            where = self.navigation.at(self.times)
            below = where.position[where.valid, :2]
            if len(below):
                known = self._of_file(below.min(0) - _REACH, below.max(0) + _REACH).depth_and_slope(below)[0]
                if np.isfinite(known).any():
                    return Plane(float(np.nanmedian(known)))
        raise ConfigError("nobody knows how deep the floor is: no altimeter in the run's log. Say --depth METRES")

    def _of_file(self, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> GridFloor | MeshFloor:
        if is_mesh(self.request.floor):
            return self._mesh
        given = Elevation(depths=not self.request.heights)
        return elevation_model(Path(self.request.floor), self.datum, low, high, given)

    @cached_property
    def _mesh(self) -> MeshFloor:
        """As far as any ray may reach."""
        where = self.navigation.at(self.times)
        place = where.position[where.valid]
        if not len(place):
            raise ConfigError(
                f"--floor {self.request.floor}: no line has a pose, so nobody knows what is to be covered"
            )
        frame = MeshFrame(self.request.floor_crs, not self.request.heights)
        reach = LONGEST + float(np.linalg.norm(self.mount.position))  # upwards, too: an imager may face a wall
        low, high = place.min(0) - reach, place.max(0) + reach
        return mesh_floor(Path(self.request.floor), self.datum, low, high, frame)

    def floor(self, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> tuple[Floor, float, list[str]]:
        """The floor as asked for over a box of north and east [m], the standard deviation of its height, and remarks.

        Raises:
            ConfigError: It is not there, or does not reach.
            LogError: There are too few echoes.
        """
        asked, stated, low, high = self.request.floor, self.request.floor_std, low - _REACH, high + _REACH
        if asked == "plane":
            plane = self.first_floor()
            return plane, _PLANE if stated is None else stated, [f"floor: a level plane at {plane.depth:.2f} m"]
        if asked == "truth":
            if self.scene is None or self.scene.floor is None:
                raise ConfigError("--floor truth: the lines are no simulation's")
            return self.scene.floor, 0.0, []
        if asked == "altimeter":
            surface = self.surface(low, high)
            sigma = _within(surface.floor, low + _REACH, high - _REACH)
            word = (
                f"floor: {len(surface.hits)} cells of altimeter echoes ({surface.dropped} echoes left out), height "
                f"varies by {surface.scale:.2f} m over {surface.length:.1f} m, unsure by {sigma:.3f} m in the median"
            )
            return surface.floor, sigma, [word]
        found = self._of_file(low, high)
        return found, _FILE if stated is None else stated, [f"floor: {found.source}"]

    def surface(self, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> Surface:
        """The likeliest floor through the altimeter's echoes.

        Raises:
            ConfigError: There is no altimeter.
            LogError: There are too few echoes.
        """
        if self.hits is None:
            raise ConfigError(
                "--floor altimeter: the run's log has no altimeter. Say --floor plane with --depth, or a file"
            )
        hits, dropped, noise = self.hits
        near = ((hits[:, :2] > low - 2.0) & (hits[:, :2] < high + 2.0)).all(axis=1)
        return surface_through(hits[near], low, high, noise, dropped)

    def light(self) -> tuple[Radiometry | None, WaterFile, list[str]]:
        """Lamps and water, how unsure they are, and remarks; None for radiances.

        Raises:
            ConfigError: The file is wrong, or there is no light at all.
        """
        if self.request.radiance:
            return None, WaterFile.model_validate({}), []
        imager, asked = self.lines.imager, self.request.water
        usual = WaterFile.model_validate({})
        if asked == "truth" or (asked is None and self.scene is not None):
            if self.scene is None:
                raise ConfigError("--water truth: the lines are no simulation's; give a file with its constituents")
            known = usual.model_copy(update={"water_sd": 0.0, "lamps_sd": 0.0})
            return self._lit(radiometry_of(imager, self.scene.file, LONGEST)), known, ["water and light: the truth"]
        given = usual if asked is None else parse(WaterFile, read_yaml(asked), Path(asked).name)
        remarks = ["water: taken for a usual coastal one; say --water for that of the dive"] if asked is None else []
        water = SpectralWater.of(given.constituents, fine_wavelengths(imager))
        model = Radiometry(imager, water, LONGEST, given.daylight)
        if self.request.panel is not None and not _has_light(model):
            return None, given, ["light: as it is at the panel, as no lamps are described and there is no daylight"]
        return self._lit(model), given, remarks

    def _lit(self, model: Radiometry) -> Radiometry:
        if not _has_light(model):
            raise ConfigError(
                f"{model.imager.file.name}: has no lamps, and there is no daylight: nobody knows what light the floor "
                "was in. Add lamps to the imager's file, daylight to --water, lay a reference panel (--panel), or say "
                "--radiance"
            )
        return model


def _has_light(model: Radiometry) -> bool:
    return bool(model.imager.file.lamps) or model.surface > 0


def open_inputs(run: Path | None, request: MapRequest) -> Inputs:
    """Open what is there.

    Raises:
        ConfigError: The scenario beside the log is missing or wrong, or lines and log have two origins.
        LogError: A file is missing, damaged, or none of lines, or nobody knows when the run's clock began.
    """
    imager = request.imager
    lines = open_lines(request.files, load_imager(imager) if isinstance(imager, str) else imager)
    try:
        if run is None:
            date(lines, request.datum, None)
            return Inputs(None, None, None, lines, request)
        path = run / "log.mcap" if run.is_dir() else run
        beside = path.with_name("scenario.yaml")
        if not beside.exists():
            raise ConfigError(f"{beside}: not there; the scenario beside a log says which vehicle and floor it is of")
        log = Log.read(path)
        date(lines, request.datum, log)
        return Inputs(path.parent, log, load_scenario(beside), lines, request)
    except BaseException:
        lines.close()
        raise


def _within(floor: GridFloor, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> float:
    """Median of the floor's standard deviation over a box [m]: beyond it nobody has sounded, and nothing is mapped."""
    place = np.stack(np.meshgrid(*np.linspace(low, high, 30).T, indexing="ij"), axis=-1)
    return float(np.median(floor.depth_sigma(place)))
