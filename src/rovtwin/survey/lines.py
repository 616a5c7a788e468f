"""Parallel lines of one heading over a region, and the cells that they fall into.

The region is cut into bands across the heading, one for each line, evenly wide and at most the spacing. A line is as
long as what its band holds, so that slanting edges are seen as well. Lines that follow each other one to one make a
cell, which is mown back and forth; where lines part or meet, at an obstacle or a bay, cells end.

Reference: Choset (2000), Coverage of known spaces: the boustrophedon cellular decomposition, Autonomous Robots 9, here
on the lines themselves in place of the polygon's corners.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.survey.library import shapely_library
from rovtwin.survey.room import Room, Swath

BACK = 1e-3  # [m]
LEAST = 0.01  # of a squared swath: smaller pieces of a band are not worth a line


@dataclass(frozen=True, eq=False)
class Line:
    """A line without direction.

    Attributes:
        ends: Between them the swath is needed, in n [m].
        room: How far the vehicle can go beyond each end [m], at most the longest lead.
    """

    ends: Float[np.ndarray, "2 2"]
    room: Float[np.ndarray, "2"]

    @property
    def length(self) -> float:
        """Between the ends [m]."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    def flown(self, backwards: bool, lead_in: float, lead_out: float) -> Float[np.ndarray, "4 2"]:
        """Where lead-in, line and lead-out begin, and where the lead-out ends, in order of flight [m]."""
        ends, room = (self.ends[::-1], self.room[::-1]) if backwards else (self.ends, self.room)
        along = (ends[1] - ends[0]) / max(self.length, 1e-12)
        first, last = ends[0] - along * min(lead_in, room[0]), ends[1] + along * min(lead_out, room[1])
        return np.stack([first, ends[0], ends[1], last])


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of one heading.

    Attributes:
        heading: Of the lines [rad], 0 to pi.
        spacing: Between neighbours [m]; nan where there is one line.
        cells: Lines of each cell in order across.
    """

    heading: float
    spacing: float
    cells: list[list[Line]]

    @property
    def all(self) -> list[Line]:
        """Of every cell."""
        return [line for cell in self.cells for line in cell]


def lines_of(room: Room, heading: float, lead: float) -> Lines:
    """Lines of a heading [rad] that see `room.target`, with at most `lead` [m] beyond their ends."""
    shapely = shapely_library()
    turn = heading_rotation(heading)  # rows (north, east) times it: along, across
    target, free = (shapely.transform(region, lambda xy: xy @ turn) for region in (room.target, room.free))
    if target.area < LEAST * room.swath.width**2:
        return Lines(heading, np.nan, [])
    middles, edges = bands(target.bounds[1], target.bounds[3], room.swath)
    segments, band = _segments(target, free, middles, edges, lead, LEAST * room.swath.width**2)
    beyond = _beyond(free, segments, lead)
    lines = [Line(ends @ turn.T, reach) for ends, reach in zip(segments, beyond, strict=True)]
    spacing = float(middles[1] - middles[0]) if len(middles) > 1 else np.nan
    return Lines(heading, spacing, [[lines[i] for i in cell] for cell in _cells(segments[:, :, 0], band)])


def bands(low: float, high: float, swath: Swath) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " edges"]]:
    """Middles (n,) and edges (n + 1,) of as few bands as the spacing allows between two limits across [m]."""
    width = high - low - swath.width
    if width <= 1e-9:
        return np.array([0.5 * (low + high)]), np.array([low, high])
    count = int(np.ceil(width / swath.spacing - 1e-9)) + 1
    middles = np.linspace(low + 0.5 * swath.width, high - 0.5 * swath.width, count)
    return middles, np.concatenate([[low], 0.5 * (middles[1:] + middles[:-1]), [high]])


def _segments(
    target: Any,
    free: Any,
    middles: Float[np.ndarray, " n"],
    edges: Float[np.ndarray, " edges"],
    lead: float,
    least: float,
) -> tuple[Float[np.ndarray, "m 2 2"], Int[np.ndarray, " m"]]:
    """Ends (m, 2, 2) of the lines along and across [m], in order, and the band of each, shape (m,)."""
    shapely = shapely_library()
    west, _, east, _ = target.bounds
    held = shapely.intersection(target, shapely.box(west - 1.0, edges[:-1], east + 1.0, edges[1:]))
    parts, band = shapely.get_parts(held, return_index=True)
    worth = shapely.area(parts) > least
    bounds, band = shapely.bounds(parts[worth]), band[worth]
    rows = []
    for k in np.unique(band):
        spans = bounds[band == k][:, [0, 2]]
        rows += [(k, *span) for span in _joined(spans, free, float(middles[k]), 2.0 * lead)]
    table = np.array(rows).reshape(-1, 3)
    band = table[:, 0].astype(int)
    flat = np.stack([table[:, 1:], np.repeat(middles[band][:, None], 2, axis=1)], axis=-1)
    # Lines lie in `free` but for rounding, and where the clearance is wider than half the swath.
    pieces, which = shapely.get_parts(shapely.intersection(shapely.linestrings(flat), free), return_index=True)
    good = shapely.length(pieces) > 1e-6
    pieces, which = pieces[good], which[good]
    spans = shapely.bounds(pieces)[:, [0, 2]].reshape(-1, 2)
    ends = np.stack([spans, np.repeat(middles[band[which]][:, None], 2, axis=1)], axis=-1)
    return ends, band[which]


def _joined(spans: Float[np.ndarray, "m 2"], free: Any, across: float, gap: float) -> list[tuple[float, float]]:
    """Spans along (m, 2) with those joined that overlap, or that the vehicle may fly on between rather than stop."""
    shapely = shapely_library()
    out: list[tuple[float, float]] = []
    for low, high in spans[np.argsort(spans[:, 0])]:
        if out:
            start, end = out[-1]
            between = shapely.LineString([(end, across), (low, across)])
            if low <= end or (low - end < gap and free.covers(between)):
                out[-1] = (start, max(end, high))
                continue
        out.append((float(low), float(high)))
    return out


def _beyond(free: Any, segments: Float[np.ndarray, "m 2 2"], lead: float) -> Float[np.ndarray, "m 2"]:
    """How far a vehicle can go on beyond both ends of segments (m, 2, 2), at most `lead` [m], shape (m, 2)."""
    shapely = shapely_library()
    out = segments + np.array([[-lead, 0.0], [lead, 0.0]])
    # A line that was cut at the boundary ends on it but for rounding, and may lie beyond: rays begin a little before.
    back = np.minimum(BACK, 0.5 * np.ptp(segments[:, :, 0], axis=1))[:, None]
    begin = segments.copy()
    begin[:, :, 0] += np.concatenate([back, -back], axis=1)
    rays = shapely.linestrings(np.stack([begin, out], axis=2))
    met = shapely.intersection(rays, free.boundary)
    away = shapely.distance(shapely.points(begin), met) - back
    return np.where(np.isnan(away), lead, np.clip(away, 0.0, lead))


def _cells(spans: Float[np.ndarray, "m 2"], band: Int[np.ndarray, " m"]) -> list[list[int]]:
    """Numbers of the lines in each cell; spans along (m, 2), bands (m,) in order."""
    overlap = np.minimum(spans[:, None, 1], spans[None, :, 1]) > np.maximum(spans[:, None, 0], spans[None, :, 0])
    follows = overlap & (band[None, :] == band[:, None] + 1)
    cells: list[list[int]] = []
    cell_of: dict[int, int] = {}
    for j in range(len(band)):
        below = np.flatnonzero(follows[:, j])
        if len(below) == 1 and follows[below[0]].sum() == 1:
            cell_of[j] = cell_of[int(below[0])]
            cells[cell_of[j]].append(j)
        else:
            cell_of[j] = len(cells)
            cells.append([j])
    return cells
