"""What is requested of a survey."""

import pathlib
from dataclasses import dataclass
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.planning.survey_assumptions import Assumptions
from rovtwin.survey.room import Swath


@dataclass(frozen=True)
class MapRequest:
    """What a survey is flown with that is to become a map.

    Attributes:
        imager: A library name or a file.
        overlap: Share of the swath that neighbouring lines both see.
        roll_deg: Roll of the vehicle that the swath allows for, either way [deg].
        square: Whether lines are flown as slowly as makes pixels square.
        crosshatch: Whether the area is flown a second time, across.
        error: Error within the mosaic that is asked for once it is registered, 2D rms [m]: overlap and crosshatch
            follow from it; None: nothing is asked for.
        assumed: What is not known of compass, mounting and clock.
    """

    imager: str
    overlap: float = 0.2
    roll_deg: float = 2.0
    square: bool = False
    crosshatch: bool = False
    error: float | None = None
    assumed: Assumptions = Assumptions()

    def __post_init__(self) -> None:
        if not 0 <= self.roll_deg < 30:
            raise ConfigError(f"--roll: found {self.roll_deg:g} deg, expected from 0 to less than 30")
        if self.error is not None and not self.error > 0:
            raise ConfigError(f"--error: found {self.error:g} m, expected more than 0")


@dataclass(frozen=True)
class SurveyRequest:
    """What is requested; None takes what follows from vehicle and scenario.

    Attributes:
        area: File, see `read_area`.
        swath: What is seen at once; None: what the imager of `mapping` sees.
        heading_deg: Of the lines; None: the one that takes least time.
        scenario: To start from: world, sensors, autopilot, datum.
        vehicle: Library name or file.
        depth: Of the lines [m]; None: 3 m, or what the altitude gives.
        altitude: Over the scenario's floor [m].
        floor: Depth of the sea floor [m], in place of the scenario's.
        speed: On the lines [m/s]; None: the vehicle's own.
        clearance: Least distance of the vehicle's origin from holes [m].
        inside: Whether the vehicle stays inside the outline.
        datum: Latitude and longitude of n [deg], "auto" for the area's middle, None for the scenario's.
        sees: Name of the imager or camera whose swath it is; None: the vehicle's first imager, else its origin.
        middle: Of the swath, ahead of the vehicle's origin and to the right of it [m]; None: below what sees it.
        overrides: `key.path=value` texts that change the scenario, see `load_scenario`.
        mapping: The imager and what the map is to be like; None: only a swath is known.
        gaps: File or folder with what a map of this area lacks, or that as a shapely MultiPolygon in the plane of n:
            only that is flown; None: all of the area.
    """

    area: str | pathlib.Path
    swath: Swath | None
    heading_deg: float | None = None
    scenario: str = "lawnmower_calm"
    vehicle: str | None = None
    depth: float | None = None
    altitude: float | None = None
    floor: float | None = None
    speed: float | None = None
    clearance: float | None = None
    inside: bool = False
    datum: str | None = None
    sees: str | None = None
    overrides: tuple[str, ...] = ()
    mapping: MapRequest | None = None
    gaps: Any = None
    middle: tuple[float, float] | None = None

    @property
    def settings(self) -> tuple[str, ...]:
        """All that changes the scenario, in order: a relief that is set needs the floor first."""
        return (*(() if self.floor is None else (f"world.floor={float(self.floor)!r}",)), *self.overrides)

    def sets(self, *keys: str) -> str | None:
        """The first key among the overrides that is one of these, lies in one of them or holds one; None: none."""
        given = (text.partition("=")[0].strip() for text in self.overrides)
        return next((key for key in given for k in keys if f"{key}.".startswith(f"{k}.") or k.startswith(f"{key}.")),
                    None)  # fmt: skip


def refuse_doubles(request: SurveyRequest) -> None:
    """Nothing that the survey lays out, or that an option of its own says, is also set; a swath is given once.

    Raises:
        ConfigError: It is.
    """
    laid = request.sets("mission", "start", "test")
    if laid:
        raise ConfigError(
            f"--set {laid}: a survey lays its way-points and its start itself, see --depth, --altitude, --speed and "
            f"--heading; change them afterwards: rovtwin fly survey.yaml --set {laid}=..."
        )
    twice = {"vehicle": request.vehicle, "floor": request.floor, "datum": request.datum}
    for option, key in (("vehicle", "vehicle"), ("floor", "world.floor"), ("datum", "datum")):
        if twice[option] is not None and (found := request.sets(key)):
            raise ConfigError(f"--{option} and --set {found}: found both, expected one")
    if (request.swath is None) == (request.mapping is None):
        found = "neither" if request.swath is None else "both"
        raise ConfigError(f"--swath and --imager: found {found}, expected one: an imager has a swath of its own")
    if request.mapping and request.mapping.square and request.speed is not None:
        raise ConfigError("--speed and --square: found both, expected one")
