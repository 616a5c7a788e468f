"""Where the vehicle may be while it surveys, and the laps round obstacles.

Parallel lines end at an obstacle in steps and leave its edges unseen. As a farmer ploughs a headland, one lap is flown
round each obstacle, near enough to see its edge; parallel lines then have to see only what the laps leave. An area that
may not be left (`inside`: a tank, a quay) is one obstacle more, seen from within.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.survey.library import shapely_library

MITRE = {"join_style": "mitre", "mitre_limit": 2.0}  # few corners: at each the vehicle stops and turns
FINEST = 0.01  # of the swath: detail below it is smoothed out of laps


@dataclass(frozen=True)
class Swath:
    """What is seen at once: `width` across the course [m], `overlap` shared with the neighbouring line, 0 to 1."""

    width: float
    overlap: float = 0.2

    def __post_init__(self) -> None:
        if not (np.isfinite(self.width) and self.width > 0):
            raise ConfigError(f"swath: found {self.width:g} m, expected more than 0")
        if not 0.0 <= self.overlap < 1.0:
            raise ConfigError(
                f"overlap: found {self.overlap:g}, expected a share of the swath from 0 to less than 1, such as 0.2"
            )

    @property
    def spacing(self) -> float:
        """Largest distance between neighbouring lines [m]."""
        return self.width * (1.0 - self.overlap)


@dataclass(frozen=True, eq=False)
class Room:
    """Regions in the plane of n, as shapely has them.

    Attributes:
        area: To be surveyed, a MultiPolygon.
        swath: What is seen at once.
        free: Where the vehicle's origin may be.
        wider: The same with the surroundings, for ways that find none in `free`; equal to it where `inside`.
        laps: Closed rings round obstacles, each (n, 2) [m].
        target: What is left for parallel lines.
        reachable: What of the area can be seen from `free`.
        inside: Whether the area is never left.
    """

    area: Any
    swath: Swath
    free: Any
    wider: Any
    laps: list[np.ndarray]
    target: Any
    reachable: Any
    inside: bool


def room_of(area: Any, swath: Swath, clearance: float, lead: float, inside: bool = False) -> Room:
    """Regions for a survey.

    Args:
        area: A shapely MultiPolygon in the plane of n.
        swath: What is seen at once.
        clearance: Least distance of the vehicle's origin from obstacles [m].
        lead: Longest run before or behind a line [m].
        inside: Whether the outline is an obstacle too.

    Raises:
        ConfigError: The swath is wider than the whole area, or the vehicle finds no room in it.
    """
    shapely = shapely_library()
    _require_larger(area, swath)
    # Smoothed laps keep the clearance, and still see the edge where that is possible.
    spare = 0.5 * (0.5 * swath.width - clearance)
    tolerance = max(min(0.25 * swath.overlap * swath.width, spare), FINEST * swath.width)
    off = max(clearance + tolerance, 0.5 * swath.spacing)
    if inside:
        free = _largest(area.buffer(-off, **MITRE).simplify(tolerance))
        if free.is_empty:
            raise ConfigError(
                f"area: nowhere in it is {off:.2g} m from its edge, as the vehicle needs; give a smaller clearance, or "
                "let it leave the area"
            )
        wider, laps = free, [free.exterior, *free.interiors]
    else:
        filled = shapely.union_all([shapely.Polygon(part.exterior) for part in area.geoms])
        around = filled.difference(area).buffer(off, **MITRE).simplify(tolerance)
        # Pockets that an obstacle's surroundings enclose cannot be entered.
        blocked = [shapely.Polygon(part.exterior) for part in shapely.get_parts(around)]
        keep_out, margin = shapely.union_all(blocked), lead + swath.width
        free = filled.buffer(margin, **MITRE).difference(keep_out)
        wider = filled.convex_hull.buffer(2.0 * margin, **MITRE).difference(keep_out)
        laps = [part.exterior for part in shapely.get_parts(keep_out) if not part.is_empty]
    seen = shapely.union_all([shapely.buffer(lap, 0.5 * swath.spacing) for lap in laps])
    return Room(
        area=area,
        swath=swath,
        free=free,
        wider=wider,
        laps=[np.asarray(lap.coords) for lap in laps],
        target=area.intersection(free).difference(seen),
        reachable=area.intersection(free.buffer(0.5 * swath.width)),
        inside=inside,
    )


def _require_larger(area: Any, swath: Swath) -> None:
    corners = np.asarray(area.minimum_rotated_rectangle.exterior.coords)
    sides = np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)
    if sides.max() <= swath.width:
        raise ConfigError(
            f"swath: found {swath.width:g} m, wider than the whole area of {sides.max():.3g} x {sides.min():.3g} m; "
            "expected less: one look from its middle sees it all"
        )


def _largest(shape: Any) -> Any:
    """The largest of the polygons that a region falls into."""
    return max(shapely_library().get_parts(shape), key=lambda part: part.area, default=shape)
