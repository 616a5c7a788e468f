"""Whether pictures overlap enough for photogrammetry: their outlines on the floor, compared."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.extras import imported
from rovtwin.core.numerics import as_array
from rovtwin.imaging.floor import Floor, ways_to
from rovtwin.vehicle.description.cameras import Camera
from rovtwin.vehicle.physics.camera import seen_ray

FARTHEST = 12.0  # a ray that meets the floor only beyond that sees water [m]
ENOUGH, SIDE = 0.6, 0.3  # shares of a picture that the next one, and those of other lines, should see too
BENT = 0.9  # of a way: less between its ends is a turn
EDGE = 5  # points along each side of a picture's outline


@dataclass(frozen=True, eq=False)
class Overlap:
    """Of a series of pictures.

    Attributes:
        outlines: On the floor, shapely polygons in the plane of n; None where a picture sees past the floor.
        forward: Share of each picture that the next one sees too; NaN for the last and where an outline is missing.
        side: Share of each picture that pictures of other lines see; NaN also beside turns, where lines are one.
    """

    outlines: list[Any]
    forward: Float[np.ndarray, " n"]
    side: Float[np.ndarray, " n"]

    def words(self, t: Float[np.ndarray, " n"]) -> list[str]:
        """What is wrong with it, in words; nothing where all is well. `t`: of the pictures [s]."""
        out, blind = [], sum(outline is None for outline in self.outlines)
        if blind == len(self.outlines):
            return [
                "no picture sees the floor all over within 12 m: overlaps cannot be judged (a camera that looks ahead?)"
            ]
        if blind:
            out.append(f"{blind} of {len(t)} pictures see past the floor, and are left out of the overlaps")
        weak = np.flatnonzero(self.forward < ENOUGH)
        for run in np.split(weak, np.flatnonzero(np.diff(weak) > 1) + 1) if len(weak) else []:
            first, last = int(run[0]), int(run[-1]) + 1
            least = float(np.nanmin(self.forward[run]))
            share = "nothing" if least == 0 else f"as little as {least:.0%}"
            where = f"pictures {first + 1} to {last + 1}, {t[first]:.1f} to {t[last]:.1f} s"
            out.append(f"{where}: {share} of one is seen by the next, {ENOUGH:.0%} is enough")
        known = np.isfinite(self.side)
        lonely = int((self.side[known] < SIDE).sum())
        if lonely:
            out.append(
                f"{lonely} of {known.sum()} pictures share less than {SIDE:.0%} with those of other lines: a model may "
                "bend there, or fall apart between lines"
            )
        return out


def overlap_of(
    camera: Camera, position: Float[np.ndarray, "n 3"], R_nb: Float[np.ndarray, "n 3 3"], floor: Floor
) -> Overlap:
    """Of pictures in order of time.

    Args:
        camera: That took them.
        position: Of CO in n [m].
        R_nb: Attitudes.
        floor: That they look at.
    """
    shapely = imported("shapely", "survey", "outlines of pictures")
    rim, direction = _rim(camera)
    eye = position[:, None] + np.einsum("nij,pj->npi", R_nb, camera.position + rim @ camera.R_bc.T)
    ray = np.einsum("nij,pj->npi", R_nb, direction @ camera.R_bc.T)
    way = ways_to(floor, eye, ray, FARTHEST)
    ground = (eye + way[..., None] * ray)[..., :2]
    outlines = [shapely.Polygon(ring) if np.isfinite(ring).all() else None for ring in ground]
    outlines = [one if one is not None and one.is_valid and one.area > 0 else None for one in outlines]
    forward = np.full(len(outlines), np.nan)
    for i, (one, other) in enumerate(zip(outlines, outlines[1:], strict=False)):
        if one is not None and other is not None:
            forward[i] = one.intersection(other).area / one.area
    return Overlap(outlines, forward, _side(shapely, outlines, position[:, :2]))


def _side(shapely: Any, outlines: list[Any], place: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Share that pictures of other lines see: those that a way longer than the picture's diagonal leads to."""
    side, there = np.full(len(outlines), np.nan), [i for i, one in enumerate(outlines) if one is not None]
    if not there:
        return side
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
    tree = shapely.STRtree([outlines[i] for i in there])
    for i in there:
        corners = shapely.get_coordinates(outlines[i])
        diagonal = np.linalg.norm(corners[:, None] - corners, axis=-1).max()
        near = (there[k] for k in tree.query(outlines[i], predicate="intersects"))
        others = [outlines[k] for k in near if abs(way[k] - way[i]) > diagonal]
        side[i] = shapely.union_all(others).intersection(outlines[i]).area / outlines[i].area if others else 0.0
        if side[i] < SIDE and _turns(place, way, i, diagonal):
            side[i] = np.nan
    return side


def _turns(place: Float[np.ndarray, "n 2"], way: Float[np.ndarray, " n"], i: int, reach: float) -> bool:
    """Whether the way bends so near to picture i that those beyond the bend cannot be told from its own line's."""
    near = (np.abs(way - way[i]) <= reach) & (np.abs(way - way[i]) > 0.25 * reach)
    return bool((np.linalg.norm(place[near] - place[i], axis=1) < BENT * np.abs(way - way[i])[near]).any())


def _rim(camera: Camera) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
    """Rays round the edge of the picture, in c: points [m] and directions."""
    width, height = camera.lens.size
    share = np.linspace(0.0, 1.0, EDGE + 1)[:-1]
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1], [0, 0]], float)
    edge = np.concatenate([a + share[:, None] * (b - a) for a, b in zip(corners, corners[1:], strict=False)])
    point, direction = seen_ray(camera.lens, as_array(edge))
    return np.asarray(point), np.asarray(direction)


def length_on(camera: Camera, height: float) -> float:
    """Length of a picture along its own upward direction on a floor so far below a camera that looks straight down [m].

    For what an overlap makes of the way between pictures.
    """
    width, rows = camera.lens.size
    ends = np.array([[0.5 * (width - 1), 0.0], [0.5 * (width - 1), rows - 1.0]])
    point, direction = (np.asarray(x) for x in seen_ray(camera.lens, as_array(ends)))
    way = (height - point[:, 2]) / direction[:, 2]
    return float(np.abs(np.diff((point + way[:, None] * direction)[:, 1]))[0])
