"""What is requested of a survey."""

import pathlib
from dataclasses import dataclass

from rovtwin.core.errors import ConfigError
from rovtwin.survey.room import Swath


@dataclass(frozen=True)
class SurveyRequest:
    """What is requested; None takes what follows from vehicle and scenario.

    Attributes:
        area: File, see `read_area`.
        swath: What is seen at once.
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
        overrides: `key.path=value` texts that change the scenario, see `load_scenario`.
    """

    area: str | pathlib.Path
    swath: Swath
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

    def sets(self, *keys: str) -> str | None:
        """The first key among the overrides that is one of these, lies in one of them or holds one; None: none."""
        given = (text.partition("=")[0].strip() for text in self.overrides)
        return next((key for key in given for k in keys if f"{key}.".startswith(f"{k}.") or k.startswith(f"{key}.")),
                    None)  # fmt: skip


def refuse_doubles(request: SurveyRequest) -> None:
    """Nothing that the survey lays out, or that an option of its own says, is also set.

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
