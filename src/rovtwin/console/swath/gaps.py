"""What of a survey's area an eye has not seen: the share, outlines of the gaps, and lines over them. For a worker."""

import zlib
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.console.surveys import SurveyArea, rows_over
from rovtwin.core.errors import ConfigError
from rovtwin.survey.library import shapely_library

LEAST = 4  # cells of a gap that is worth a word, as in a map's gaps
LISTED = 40  # gaps with outlines, the largest
FINEST = 200  # cells along the longer side of the area, in which gaps are outlined

Corners = tuple[tuple[float, float], ...]  # of an area: north, east [m]


@dataclass(frozen=True, eq=False)
class Seen:
    """How much was seen of each cell over the box of an area.

    Attributes:
        shares: Packed, row by row from the south, each from the west; 0 to 1.
        shape: Rows and columns.
        low: Row and column of the first cell, counted from the origin of n.
        cell: Side of a cell [m].
    """

    shares: bytes
    shape: tuple[int, int]
    low: tuple[int, int]
    cell: float

    @classmethod
    def of(cls, shares: Float[np.ndarray, "n m"], low: Any, cell: float) -> "Seen":
        """Of what `Cells.window` gives; half floats hold its shares exactly up to 32 x 32 cells together."""
        packed = zlib.compress(shares.astype(np.float16).tobytes(), 1)
        return cls(packed, (shares.shape[0], shares.shape[1]), (int(low[0]), int(low[1])), cell)

    def unpacked(self) -> Float[np.ndarray, "n m"]:
        return np.frombuffer(zlib.decompress(self.shares), np.float16).astype(float).reshape(self.shape)

    def missing(self, corners: Corners) -> Bool[np.ndarray, "n m"]:
        """Cells in an area of which half or more was not seen."""
        return _inside(corners, self.shape, self.low, self.cell) & (self.unpacked() <= 0.5)


def share_seen(corners: Corners, seen: Seen) -> dict[str, Any]:
    """What pages are given of an area.

    `share` seen of `area_m2`; `count` gaps of `gaps_m2` together; of the largest `gaps`, each with its `area_m2` and
    its `rings`, outline first, holes behind it, corners [north, east] [m].

    Raises:
        ConfigError: No shapely.
    """
    inside = _inside(corners, seen.shape, seen.low, seen.cell)
    total, area = int(inside.sum()), seen.cell**2
    regions = _regions(seen.missing(corners), seen)
    return {
        "share": float(seen.unpacked()[inside].mean()) if total else 0.0,
        "area_m2": total * area,
        "gaps_m2": sum(region.area for region in regions),
        "count": len(regions),
        "gaps": [{"area_m2": region.area, "rings": _rings(region, seen.cell)} for region in regions[:LISTED]],
    }


def lines_over(
    survey: SurveyArea, seen: Seen, vehicle: str | dict[str, Any], eye: dict[str, Any], floor: float | None
) -> list[dict[str, Any]]:
    """Way-points over what is not seen, laid out as `plan-survey --fill-gaps` does.

    Args:
        survey: Whose area it is.
        seen: What was seen of it.
        vehicle: Name, file or description.
        eye: `name`, `imager` ("" of what is none), `width` of its swath, and its `middle` ahead of the vehicle's origin
            and to the right of it [m].
        floor: Depth of the floor [m].

    Raises:
        ConfigError: Nothing is missing, or no line can be laid.
    """
    from rovtwin.planning.survey_request import MapRequest
    from rovtwin.survey.room import Swath

    shapely = shapely_library()
    regions = _regions(seen.missing(survey.corners), seen)
    if not regions:
        raise ConfigError("nothing is missing: all of the area was seen")
    parts = shapely.get_parts(shapely.union_all(regions).intersection(shapely.Polygon(survey.corners)))
    asked = {"floor": floor, "gaps": shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])}
    if eye["imager"]:
        return rows_over(survey, vehicle, mapping=MapRequest(eye["imager"]), sees=eye["name"], **asked)
    ahead, right = (float(x) for x in eye["middle"])
    return rows_over(survey, vehicle, Swath(eye["width"]), middle=(ahead, right), **asked)


@lru_cache(maxsize=8)
def _inside(corners: Corners, shape: tuple[int, int], low: tuple[int, int], cell: float) -> Bool[np.ndarray, "n m"]:
    """Cells whose middles lie in an area."""
    north, east = ((low[i] + np.arange(shape[i]) + 0.5) * cell for i in (0, 1))
    polygon = shapely_library().Polygon(corners)
    shapely_library().prepare(polygon)
    x, y = np.meshgrid(north, east, indexing="ij")
    return np.asarray(shapely_library().contains_xy(polygon, x, y))


def _regions(unseen: Bool[np.ndarray, "n m"], seen: Seen) -> list[Any]:
    """Connected areas of cells as polygons [m], the largest first; those of fewer than LEAST cells are left out."""
    shapely = shapely_library()
    cell, low = seen.cell, np.array(seen.low)
    while max(unseen.shape) > FINEST:  # outlines as fine as a screen shows; a cell is unseen where half of it is
        rows, columns = (size + size % 2 for size in unseen.shape)
        whole = np.zeros((rows, columns), bool)
        whole[: unseen.shape[0], : unseen.shape[1]] = unseen
        unseen = whole.reshape(rows // 2, 2, columns // 2, 2).sum(axis=(1, 3)) >= 2
        cell, low = 2.0 * cell, low / 2.0
    edges = np.diff(np.pad(unseen, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, begin = np.nonzero(edges == 1)
    end = np.nonzero(edges == -1)[1]
    if not len(row):
        return []
    boxes = shapely.box(
        (low[0] + row) * cell, (low[1] + begin) * cell, (low[0] + row + 1) * cell, (low[1] + end) * cell
    )
    parts = shapely.get_parts(shapely.union_all(boxes, grid_size=0.01 * cell))
    return sorted((part for part in parts if part.area > (LEAST - 0.5) * cell**2), key=lambda part: -part.area)


def _rings(region: Any, cell: float) -> list[list[list[float]]]:
    smooth = region.simplify(0.8 * cell)
    rings = [smooth.exterior, *smooth.interiors] if smooth.geom_type == "Polygon" else [region.exterior]
    return [np.round(np.asarray(ring.coords)[:-1], 3).tolist() for ring in rings]
