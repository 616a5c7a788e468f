"""Lines over what a survey has left unseen."""

from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.survey.area import read_area, read_json
from rovtwin.survey.library import shapely_library
from rovtwin.survey.lines import LEAST, Lines, lines_of
from rovtwin.survey.pace import Pace
from rovtwin.survey.plan import SurveyPlan, seen_from
from rovtwin.survey.room import Swath, room_of
from rovtwin.survey.route import Network, cell_forms, route

FILE = "gaps.geojson"  # in the folder of a map
ROUNDING = 0.05  # by which a gap's outline may lie outside the area, as cells of a map do [m]


def read_gaps(path: str | FilePath, datum: Datum, area: Any) -> Any:
    """Gaps of a map within the area that it is of, a shapely MultiPolygon in the plane of n.

    Args:
        path: GeoJSON with polygons in longitude and latitude, or a map's folder with `gaps.geojson`.
        datum: Origin of n.
        area: A shapely MultiPolygon.

    Raises:
        ConfigError: No such file, no gaps in it, none that is large enough, or some outside the area.
    """
    shapely, path = shapely_library(), FilePath(path)
    if path.is_dir():
        if not (path / FILE).is_file():
            raise ConfigError(f"{path}: has no {FILE}; expected the folder of a map that rovtwin map has made")
        path = path / FILE
    if path.suffix.lower() not in (".geojson", ".json"):
        raise ConfigError(f"{path}: expected GeoJSON with the gaps' polygons, or the folder of a map")
    if read_json(path).get("features") == []:
        raise ConfigError(f"{path.name}: has no gaps: all of the area was seen, and there is nothing to fill")
    gaps = read_area(path, datum, slivers=True).shape
    _require_within(gaps, area, path.name)
    inside = gaps.intersection(area)
    parts = [part for part in shapely.get_parts(inside) if part.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts)


def _require_within(gaps: Any, area: Any, name: str) -> None:
    shapely = shapely_library()
    beyond = gaps.difference(area.buffer(ROUNDING))
    if beyond.area < 1e-9:
        return
    places = shapely.points(shapely.get_coordinates(beyond))
    far = float(shapely.distance(area, places).max())
    if not gaps.intersects(area):
        raise ConfigError(
            f"{name}: no gap lies in the area, the farthest is {far:,.1f} m outside it. Is --area the one that was "
            "surveyed, and its datum the same? (--datum latitude,longitude)"
        )
    raise ConfigError(
        f"{name}: {beyond.area:.3g} of {gaps.area:.3g} m2 of gaps lie outside the area, up to {far:,.1f} m; expected "
        "gaps within --area: nobody has said what stands beyond it"
    )


def plan_fill(
    area: Any, gaps: Any, swath: Swath, pace: Pace, clearance: float, inside: bool = False, acceptance: float = 0.0
) -> SurveyPlan:
    """Lines over gaps, each group of gaps with lines along its longer side; obstacles are the area's.

    Args:
        area: That was surveyed, with its holes, a shapely MultiPolygon in the plane of n.
        gaps: What is not seen of it, likewise.
        swath: What is seen at once.
        pace: How the vehicle moves.
        clearance: Least distance of the vehicle's origin from obstacles [m].
        inside: Whether the vehicle stays inside the outline.
        acceptance: Radius within which a way-point counts as reached [m].

    Raises:
        ConfigError: No gap is worth a line or can be reached.
    """
    shapely = shapely_library()
    lead_in, lead_out = pace.lead_in, pace.lead_out + acceptance
    whole = room_of(area, swath, clearance, max(lead_in, lead_out), inside)
    reachable = gaps.intersection(whole.free.buffer(0.5 * swath.width))
    room = replace(whole, area=gaps, laps=[], target=gaps, reachable=reachable)
    cells, heading = [], 0.0
    groups = shapely.get_parts(gaps.buffer(0.5 * swath.spacing))
    for group in sorted(groups, key=lambda part: -part.area):
        held = gaps.intersection(group)
        angle = _along(held)
        found = lines_of(replace(room, target=held), angle, max(lead_in, lead_out))
        heading = heading if cells else angle
        cells += found.cells
    if not cells:
        raise ConfigError(
            f"gaps: none of {gaps.area:.3g} m2 can be seen by a line: pieces are smaller than "
            f"{LEAST * swath.width**2:.2g} m2, or the vehicle cannot come near enough"
        )
    lines, ways = Lines(heading, np.nan, cells), Network(room)
    path = route([cell_forms(cell, lead_in, lead_out, ways) for cell in cells], pace, ways)
    assert path is not None  # without a limit on its time there is one
    return SurveyPlan(room, pace, lines, path, seen_from(room, lines))


def _along(region: Any) -> float:
    """Direction of the longer side of the narrowest rectangle about a region [rad]."""
    box = shapely_library().oriented_envelope(region)
    if box.geom_type != "Polygon":
        return 0.0
    sides = np.diff(np.asarray(box.exterior.coords)[:3], axis=0)
    north, east = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    return float(np.arctan2(east, north) % np.pi)
