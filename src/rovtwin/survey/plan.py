"""A survey laid out: the heading that takes least time, the way, and what it sees."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.survey.library import shapely_library
from rovtwin.survey.lines import Line, Lines, lines_of
from rovtwin.survey.pace import Pace
from rovtwin.survey.room import Room, Swath, room_of
from rovtwin.survey.route import Network, Path, cell_forms, lap_forms, route

STEP = 5.0  # between headings that are tried, besides those of the area's edges [deg]
MOST_LINES, MOST_CORNERS = 10_000, 2000
EDGES = 12  # of the area's longest edges, whose headings are tried
Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class SurveyPlan:
    """A way over an area.

    Attributes:
        room: Area, obstacles, where the vehicle may be.
        pace: How it moves.
        lines: Parallel lines and their cells.
        path: The way, line by line and lap by lap; its corners are the way-points.
        seen: The area within the swath of lines and laps, a shapely region; leads and ways between do not count.
        crossing: Lines across the others that are flown after them; None: there are none.
    """

    room: Room
    pace: Pace
    lines: Lines
    path: Path
    seen: Any
    crossing: Lines | None = None

    @property
    def all_lines(self) -> list[Line]:
        """Those along and those across."""
        return [*self.lines.all, *(self.crossing.all if self.crossing else [])]

    @property
    def seconds(self) -> float:
        """From the first point, at rest, to the last."""
        legs, turns = self.pace.times(self.path.corners)
        return float(legs.sum() + turns.sum())

    @property
    def length(self) -> float:
        """Of the whole way [m]."""
        return float(self._legs.sum())

    @property
    def seeing(self) -> float:
        """Length of lines and laps [m]."""
        return float(self._legs[self.path.sees].sum())

    @property
    def turns(self) -> int:
        """Corners at which the vehicle stops."""
        return len(self.path.corners) - 2

    @property
    def coverage(self) -> float:
        """Share of the area that is seen."""
        return float(self.seen.area / self.room.area.area)

    @property
    def coverage_of_reachable(self) -> float:
        """Share of what can be seen at all without coming too near to an obstacle."""
        return float(self.seen.intersection(self.room.reachable).area / max(self.room.reachable.area, 1e-12))

    @property
    def gaps(self) -> Any:
        """What is not seen."""
        return self.room.area.difference(self.seen)

    @property
    def outside(self) -> float:
        """Farthest that the way leads out of the area, obstacles not counted [m]."""
        shapely = shapely_library()
        filled = shapely.union_all([shapely.Polygon(part.exterior) for part in self.room.area.geoms])
        beyond = shapely.LineString(self.path.points).difference(filled)
        beyond = shapely.segmentize(beyond, 0.25 * self.room.swath.width)
        places = shapely.points(shapely.get_coordinates(beyond))
        return float(shapely.distance(filled, places).max(initial=0.0))

    @property
    def detours(self) -> float:
        """Length of ways through the surroundings, where parts of the area are apart [m]."""
        return float(shapely_library().LineString(self.path.points).difference(self.room.free.buffer(0.01)).length)

    @property
    def short_leads(self) -> int:
        """Ends of lines at which an obstacle leaves less room than a lead needs."""
        lead = max(self.pace.lead_in, self.pace.lead_out)
        return int(sum((line.room < lead - 1e-6).sum() for line in self.all_lines))

    @property
    def _legs(self) -> Float[np.ndarray, " legs"]:
        return np.linalg.norm(np.diff(self.path.points, axis=0), axis=1)


def _require_size(area: Any, swath: Swath) -> None:
    """Raises ConfigError where the way would take hours to find, or no memory has room for what sees what."""
    corners = len(shapely_library().get_coordinates(area))
    if corners > MOST_CORNERS:
        raise ConfigError(
            f"area: found outlines of {corners:,} corners, expected at most {MOST_CORNERS:,}: simplify them, as GIS "
            f"programs do; {0.1 * swath.width:.2g} m is little beside the swath"
        )
    lines = float(area.area) ** 0.5 / swath.spacing  # of a square as large: a corridor takes few, long ones
    if lines > MOST_LINES:
        raise ConfigError(
            f"swath: {swath.width:g} m takes some {lines:,.0f} lines over this area, expected at most {MOST_LINES:,}: "
            "is it in metres? Else divide the area"
        )


def plan_survey(
    area: Any,
    swath: Swath,
    pace: Pace,
    clearance: float,
    heading: float | None = None,
    inside: bool = False,
    acceptance: float = 0.0,
    progress: Progress = lambda share: None,
) -> SurveyPlan:
    """A way from which a swath sees an area.

    Args:
        area: A shapely MultiPolygon in the plane of n.
        swath: What is seen at once.
        pace: How the vehicle moves; it also sets how long the leads are.
        clearance: Least distance of the vehicle's origin from obstacles [m].
        heading: Of the lines [rad]; None: the one that takes least time.
        inside: Whether the vehicle stays inside the outline.
        acceptance: Radius within which a way-point counts as reached, made up for by a longer lead-out [m].
        progress: Told how far it is, 0 to 1.

    Raises:
        ConfigError: Nothing of the area can be seen, the swath is wider than all of it, or there would be too
            many lines or corners.
    """
    _require_size(area, swath)
    lead_in, lead_out = pace.lead_in, pace.lead_out + acceptance
    room = room_of(area, swath, clearance, max(lead_in, lead_out), inside)
    ways = Network(room)
    laps = [lap_forms(ring) for ring in room.laps]
    headings = headings_of(area) if heading is None else np.array([heading % np.pi])
    found = [lines_of(room, angle, max(lead_in, lead_out)) for angle in headings]
    if not found[0].all and not laps:
        raise ConfigError("area: nothing in it is left for a line, expected an area larger than 0.01 squared swaths")
    # What a heading takes at the least says which of them need not be looked at.
    least = np.array([_least_time(lines, pace, lead_in, lead_out) for lines in found])
    best: tuple[float, Lines, Path] | None = None
    for done, i in enumerate(np.argsort(least, kind="stable")):
        progress(done / len(found))
        if best is not None and least[i] >= best[0]:
            break
        cells = [cell_forms(cell, lead_in, lead_out, ways) for cell in found[i].cells]
        path = route([*cells, *laps], pace, ways, np.inf if best is None else best[0])
        if path is None:
            continue
        time = sum(float(part.sum()) for part in pace.times(path.corners))
        if best is None or time < best[0] - 1e-9:
            best = time, found[i], path
    assert best is not None
    return SurveyPlan(room, pace, best[1], best[2], seen_from(room, best[1]))


def headings_of(area: Any) -> Float[np.ndarray, " n"]:
    """Headings worth a try [rad], 0 to pi: all round in steps, and along the longest edges of outline and holes."""
    rings = [np.asarray(ring.coords) for part in area.geoms for ring in (part.exterior, *part.interiors)]
    legs = np.concatenate([np.diff(ring, axis=0) for ring in rings])
    longest = legs[np.argsort(-np.linalg.norm(legs, axis=1), kind="stable")][:EDGES]
    along = np.round(np.degrees(np.arctan2(longest[:, 1], longest[:, 0])) % 180.0, 6) % 180.0
    return np.radians(np.unique(np.concatenate([np.arange(0.0, 180.0, STEP), along])))


def _least_time(lines: Lines, pace: Pace, lead_in: float, lead_out: float) -> float:
    """No way over these lines takes less [s]: every line flown, and within each cell every turn to the next one."""
    time = 0.0
    for cell in lines.cells:
        for line in cell:
            flown = line.flown(False, lead_in, lead_out)
            back = line.flown(True, lead_in, lead_out)
            length = min(np.linalg.norm(flown[3] - flown[0]), np.linalg.norm(back[3] - back[0]))
            time += float(pace.leg(np.asarray(length)))
        if len(cell) > 1:
            link = float(pace.leg(np.asarray(lines.spacing)) + pace.turn(np.asarray(np.pi)))
            time += (len(cell) - 1) * link
    return time


def seen_from(room: Room, lines: Lines) -> Any:
    """What of the area the swath of lines and laps covers."""
    shapely = shapely_library()
    half = 0.5 * room.swath.width
    strips = [shapely.buffer(shapely.LineString(line.ends), half, cap_style="flat") for line in lines.all]
    rings = [shapely.buffer(shapely.LinearRing(ring), half) for ring in room.laps]
    return shapely.union_all([*strips, *rings]).intersection(room.area)
