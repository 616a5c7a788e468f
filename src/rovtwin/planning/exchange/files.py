"""Files of missions converted: rovtwin's YAML, GPX, KML, GeoJSON, plans of QGroundControl, in any direction."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.core.user_files.files import is_file, read_text
from rovtwin.core.user_files.yamlfile import dump_yaml, read_yaml
from rovtwin.planning.exchange.missions import (
    FORMATS,
    MOST,
    NO_DATUM,
    depthless,
    fence_in_words,
    left_out,
    mission_data,
    read_route,
    route_of,
)
from rovtwin.planning.exchange.route import Route
from rovtwin.runs.compose.fitting import fitted
from rovtwin.runs.vehicle_defaults import vehicle_of
from rovtwin.scenario.files import load_mission, load_scenario
from rovtwin.scenario.schema import MissionSection, Scenario

YAML = (".yaml", ".yml")
ENDINGS = (*YAML, *(one.ending for one in FORMATS.values()))
KINDS = {one.ending: kind for kind, one in FORMATS.items()} | {".json": "geojson"}


@dataclass(frozen=True)
class Converted:
    """A mission as another file has it.

    Attributes:
        text: Of the file.
        count: Of its way-points.
        notes: What is left out, a sentence each.
    """

    text: str
    count: int
    notes: list[str]


def convert(
    source: str,
    target: Path,
    datum: Datum | None = None,
    scenario: Scenario | None = None,
    depth: float | None = None,
) -> Converted:
    """A mission as the file of another program, or of rovtwin, has it; nothing is written.

    Args:
        source: A file of any format, a mission or scenario of rovtwin too, or the name of a shipped one.
        target: Its ending says the format.
        datum: Origin of metres; None for that of the scenario. Without any, a mission stays on the map, and one in
            metres is refused.
        scenario: That the mission belongs to: its datum and its fence.
        depth: Of way-points whose depth the source does not give [m].

    Raises:
        ConfigError: It cannot be read, or not be written in that format.
    """
    ending = target.suffix.lower()
    if ending not in YAML and ending not in KINDS:
        raise ConfigError(f"{target}: found the ending {target.suffix!r}, expected one of {', '.join(ENDINGS)}")
    route, mission, own = _read(source)
    scenario = own if scenario is None else scenario
    if datum is None and scenario is not None and scenario.datum.is_given:
        datum = scenario.origin
    where = Path(source).name
    notes: list[str] = []
    if route is not None:
        if depth is None and (missing := depthless(route)):
            raise ConfigError(
                f"{where}: gives no depth of {missing} of {len(route.points)} way-points: add --depth 3 [m]"
            )
        notes = [*route.notes, *fence_in_words(route, datum)] if ending in YAML else list(route.notes)
        data = mission_data(route, datum if ending in YAML else None, where, depth)
        mission = parse(MissionSection, data, where)
    assert mission is not None  # of a file that is no route
    if ending in YAML:
        return Converted(dump_yaml(_in_yaml(mission, datum)), len(mission.waypoints), notes)
    if datum is None and any(waypoint.geodetic is None for waypoint in mission.waypoints):
        raise ConfigError(f"{where}: {NO_DATUM}; or add --datum latitude,longitude")
    on_map = route_of(mission if scenario is None else _as_flown(mission, scenario), datum, scenario)
    if route is not None and not on_map.fence:
        on_map = Route(on_map.name, on_map.points, route.fence, on_map.circle)
    kind = KINDS[ending]
    return Converted(FORMATS[kind].write(on_map), len(mission.waypoints), notes + left_out(on_map, kind))


def _read(source: str) -> tuple[Route | None, MissionSection | None, Scenario | None]:
    """A route of another program, or a mission, with its scenario if it is that of one."""
    path = Path(source)
    if not is_file(path):
        try:
            scenario = load_scenario(source)
        except ConfigError:
            return None, load_mission(source), None
        return None, _mission_of(scenario, source), scenario
    try:
        text = read_text(path, MOST)
    except UnicodeDecodeError:
        packed = " A KMZ is a packed KML: unpack it" if path.suffix.lower() == ".kmz" else ""
        raise ConfigError(f"{path}: is not text, expected one of {', '.join(ENDINGS)}.{packed}") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    if (route := read_route(text, path.name)) is not None:
        return route, None, None
    data = read_yaml(path)
    if "waypoints" in data:
        return None, parse(MissionSection, data, path.name), None
    scenario = load_scenario(path)
    return None, _mission_of(scenario, source), scenario


def _mission_of(scenario: Scenario, source: str) -> MissionSection:
    if scenario.mission is None:
        raise ConfigError(f"{source}: is an identification test, expected a mission")
    return scenario.mission


def _as_flown(mission: MissionSection, scenario: Scenario) -> MissionSection:
    """With the speeds and acceptances of the scenario's vehicle where the mission gives none."""
    made = fitted(scenario.model_copy(update={"mission": mission}), vehicle_of(scenario).model())
    return mission if made.mission is None else made.mission


def _in_yaml(mission: MissionSection, datum: Datum | None) -> dict[str, Any]:
    """A mission file, in metres where a datum says how."""
    data = mission.model_dump(exclude_unset=True)
    for point, waypoint in zip(data["waypoints"], mission.waypoints, strict=True):
        if datum is not None and waypoint.geodetic is not None:
            del point["geodetic"]
            point["position"] = [round(value, 3) for value in waypoint.placed(datum)]
    return data
