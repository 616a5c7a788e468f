"""Parts that lie in each other: which two, by how much, what is counted twice there, and the nearest free place.

By points spread evenly in the smaller of two solids. Only parts that have a shape and displace water can be wrong:
electronics in a hull without a volume, and parts without a shape, are described so on purpose. Of a body with totals of
the whole (`restoring`, `hydrodynamics`) nothing is counted twice.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.vehicle.description.schema import Body, Part
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.solids.mesh_solid import MeshSolid
from rovtwin.vehicle.solids.placement import HERE, Placement

WORTH_SAYING = 0.1  # share of the smaller part's solid that lies in the other
# Along each axis of the box around a solid: middles of cells, which all count alike, and lines with both faces.
_CELLS, _FACES = (np.arange(15) + 0.5) / 15 - 0.5, np.linspace(-0.5, 0.5, 11)
_COLUMNS = 64  # of a mesh, along x and y of its box
_STEPS = 200  # of a way out, from where a part is to the far side of all others
_FACE = 0.0015  # [m]: places of ballast are rounded to the millimetre
_FULL = 1.02  # water that two parts displace over the room of both, beyond which some is counted twice
Vector = tuple[float, float, float]
_WAYS = (
    ("down", (0, 0, 1)),
    ("up", (0, 0, -1)),
    ("to starboard", (0, 1, 0)),
    ("to port", (0, -1, 0)),
    ("ahead", (1, 0, 0)),
    ("astern", (-1, 0, 0)),
)


@dataclass(frozen=True, eq=False)
class Piece:
    """A solid of a vehicle that displaces water.

    Attributes:
        name: Of its part, with those around it.
        within: The bodies around it, outermost first, itself last.
        solid: Its shape.
        placement: Of the solid's box in b.
        displaced: Water [m3].
    """

    name: str
    within: tuple[Body, ...]
    solid: Solid
    placement: Placement
    displaced: float

    @property
    def reach(self) -> float:
        """From the middle of its box to its corners [m]."""
        return 0.5 * float(np.linalg.norm(self.solid.size))

    @property
    def outer(self) -> Body:
        """What is moved when it is moved: the part of the vehicle that it belongs to, or the vehicle."""
        return self.within[min(1, len(self.within) - 1)]


@dataclass(frozen=True)
class Overlap:
    """Two parts of which one lies in the other.

    Attributes:
        smaller: Name of the smaller one.
        larger: Name of the other.
        share: Of the smaller one's solid that lies in the other.
        depth: Least way along an axis of b that takes them apart [m].
        twice: What is counted twice: buoyancy, added mass and drag.
        moved: Name of the part that `way` is for; None: both are in one part.
        way: Least way along an axis of b after which that part lies in no other, b [m].
        place: Its position then, as its file says it [m].
    """

    smaller: str
    larger: str
    share: float
    depth: float
    twice: str
    moved: str | None
    way: Vector
    place: Vector

    def line(self) -> str:
        """In words."""
        text = (
            f"'{self.smaller}' and '{self.larger}' overlap: {100 * self.share:.0f} % of '{self.smaller}', "
            f"{1000 * self.depth:.0f} mm deep; counted twice there: {self.twice}. "
        )
        if self.moved is None:
            return text + "Where one replaces a piece of the other, make that smaller"
        (x, y, z), length = self.place, float(np.abs(self.way).sum())
        word = next(name for name, way in _WAYS if np.dot(way, self.way) > 0.5 * length)
        return text + f"'{self.moved}' is free {1000 * length:.0f} mm further {word}, at {x:g},{y:g},{z:g}"


def pieces(body: Body, name: str, placement: Placement = HERE, within: tuple[Body, ...] = ()) -> Iterator[Piece]:
    """All solids of a body that displace water, seen from b."""
    chain = (*within, body)
    if body.shape is not None:
        solid = Solid.of(body.shape)
        displaced = solid.volume() if body.volume is None else body.volume
        if displaced > 0:
            yield Piece(name, chain, solid, solid.placement.after(placement), displaced)
    for part in body.parts:
        inner = Placement.of(part.pose.position, part.pose.attitude_deg).after(placement)
        yield from pieces(part, f"{name}.{part.name}" if within else part.name, inner, chain)


def overlaps(file: Body, name: str, among: Collection[str] | None = None) -> list[Overlap]:
    """The parts of a vehicle that overlap by more than a tenth of the smaller one, where that counts water twice.

    Args:
        file: Of the vehicle.
        name: Of the vehicle, for a shape of its own.
        among: Names of parts; only pairs with one of them are looked at. None: all.
    """
    every = list(pieces(file, name))
    found = []
    for first, later in combinations(every, 2):
        if among is not None and not {first.name, later.name} & set(among):
            continue
        small, large = sorted((first, later), key=lambda piece: piece.solid.volume())
        if np.linalg.norm(small.placement.position - large.placement.position) > small.reach + large.reach:
            continue
        share = float(np.mean(_inside(_points(small, _CELLS), [large])))
        reported = share > WORTH_SAYING and not (share <= 0.5 and _laid_on(small, large))
        twice = _twice(small, large, share) if reported else ""
        if twice:
            depth = float(np.abs(_way_out([small], [large])).sum())
            found.append(Overlap(small.name, large.name, share, depth, twice, *_free_place(first, later, every)))
    return found


def _laid_on(small: Piece, large: Piece) -> bool:
    """Whether the middle of a piece lies in the other's face: where `vehicle ballast` fastens foam and lead."""
    local = (small.placement.position - large.placement.position) @ large.placement.rotation
    box = replace(large.solid, kind="box", mesh=None) if large.solid.mesh is not None else large.solid
    return bool(_holds(box, local[None], _FACE)[0] and not _holds(box, local[None], -_FACE)[0])


def _free_place(first: Piece, later: Piece, every: Sequence[Piece]) -> tuple[str | None, Vector, Vector]:
    """Name of the part that has to go, the way, and where it is then; no name where both are in one part."""
    part = later.outer
    if part is first.outer or not isinstance(part, Part):
        return None, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    others = [piece for piece in every if piece.outer is not part]
    way = _way_out([piece for piece in every if piece.outer is part], others)
    x, y, z = np.round(np.array(part.pose.position) + way, 4) + 0.0
    return part.name, (float(way[0]), float(way[1]), float(way[2])), (float(x), float(y), float(z))


def _twice(small: Piece, large: Piece, share: float) -> str:
    """What two overlapping solids count twice, in words; empty where totals of the whole say otherwise."""
    around = [a for a, b in zip(small.within, large.within, strict=False) if a is b]
    room = small.solid.volume() * (1.0 - share) + large.solid.volume()
    full = small.displaced + large.displaced > _FULL * room
    for given in (body.restoring for body in around if body.restoring):
        full = full and given.buoyancy is None and given.net_buoyancy is None
    hydrodynamics = [body.hydrodynamics for body in around if body.hydrodynamics]
    words = ["buoyancy"] if full else []
    words += [] if any(one.added_mass is not None for one in hydrodynamics) else ["added mass"]
    words += [] if any(one.linear_damping is not None for one in hydrodynamics) else ["drag"]
    return ", ".join(words[:-1]) + (" and " if len(words) > 1 else "") + words[-1] if words else ""


def _points(piece: Piece, line: Float[np.ndarray, " _"]) -> Float[np.ndarray, "n 3"]:
    """Points of a solid, b [m], on a grid in the box around it with lines at shares of its size."""
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3) * piece.solid.size
    grid = grid[_holds(piece.solid, grid, 1e-9)]
    return piece.placement.position + grid @ piece.placement.rotation.T


def _inside(points: Float[np.ndarray, "n 3"], others: Sequence[Piece]) -> Bool[np.ndarray, " n"]:
    """Which points in b lie in one of some solids, by more than touching."""
    found = np.zeros(len(points), bool)
    for other in others:
        local = (points - other.placement.position) @ other.placement.rotation
        near = np.flatnonzero(np.all(np.abs(local) < 0.5 * other.solid.size, axis=1) & ~found)
        if near.size:
            found[near] = _holds(other.solid, local[near], -1e-6)
    return found


def _holds(solid: Solid, local: Float[np.ndarray, "n 3"], slack: float) -> Bool[np.ndarray, " n"]:
    """Which points, in the solid's own axes from the middle of its box, lie in it, widened by a slack [m]."""
    scaled = np.abs(local) / (0.5 * solid.size + slack)
    if solid.mesh is not None:
        return _wound(solid.mesh, local)
    if solid.kind == "box":
        return np.all(scaled <= 1.0, axis=1)
    if solid.kind == "ellipsoid":
        return np.sum(scaled**2, axis=1) <= 1.0
    return (scaled[:, 0] <= 1.0) & (np.sum(scaled[:, 1:] ** 2, axis=1) <= 1.0)


def _wound(mesh: MeshSolid, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which points a closed mesh goes around, to a 64th of its box across."""
    column = np.clip(((points[:, :2] / mesh.size[:2] + 0.5) * _COLUMNS).astype(int), 0, _COLUMNS - 1)
    heights, signs = _crossings(mesh)
    heights, signs = heights[column[:, 0], column[:, 1]], signs[column[:, 0], column[:, 1]]
    return np.abs(np.sum(signs * (heights > points[:, 2, None]), axis=1)) > 0.5


@lru_cache(maxsize=8)
def _crossings(mesh: MeshSolid) -> tuple[Float[np.ndarray, "64 64 k"], Float[np.ndarray, "64 64 k"]]:
    """Where upright lines through the middles of columns cross a mesh [m], and the sense."""
    corners = mesh.vertices[mesh.faces]  # (m, 3, 3)
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    middles = (np.arange(_COLUMNS) + 0.5) / _COLUMNS - 0.5
    found: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}
    for i, j in np.ndindex(_COLUMNS, _COLUMNS):
        point = np.array([middles[i], middles[j]]) * mesh.size[:2] + 1e-7 * np.array([1.0, np.sqrt(2.0)])  # off edges
        near = corners[np.all((low <= point) & (point <= high), axis=1)]
        a, b, c = near[:, 0], near[:, 1], near[:, 2]
        area = _cross(b - a, c - a)
        area = np.where(area == 0.0, np.inf, area)
        u, v = _cross(point - a[:, :2], c - a) / area, _cross(b - a, point - a[:, :2]) / area
        crossed = (u >= 0) & (v >= 0) & (u + v <= 1) & np.isfinite(area)
        found[i, j] = ((a + u[:, None] * (b - a) + v[:, None] * (c - a))[crossed, 2], np.sign(area[crossed]))
    most = max(len(sign) for _, sign in found.values())
    heights, signs = np.zeros((_COLUMNS, _COLUMNS, most)), np.zeros((_COLUMNS, _COLUMNS, most))
    for (i, j), (height, sign) in found.items():
        heights[i, j, : len(sign)], signs[i, j, : len(sign)] = height, sign
    return heights, signs


def _cross(a: Float[np.ndarray, "n _"], b: Float[np.ndarray, "n _"]) -> Float[np.ndarray, " n"]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _way_out(own: Sequence[Piece], others: Sequence[Piece]) -> Float[np.ndarray, "3"]:
    """Least way along an axis of b that takes some solids out of others, to the millimetre above, b [m]."""
    points = np.concatenate([_points(piece, _FACES) for piece in own])
    corners = np.concatenate([_points(piece, _FACES) for piece in others])
    best, least = np.zeros(3), np.inf
    for _, way in _WAYS:
        unit = np.array(way, dtype=float)
        far = float((corners @ unit).max() - (points @ unit).min())
        steps = np.linspace(0.0, far, _STEPS + 1)[1:]
        steps = steps[steps < least]
        free = next((s for s in steps if not _inside(points + s * unit, others).any()), None)
        if free is not None:
            touching, apart = free - far / _STEPS, free
            while apart - touching > 2e-4:
                middle = 0.5 * (touching + apart)
                inside = _inside(points + middle * unit, others).any()
                touching, apart = (middle, apart) if inside else (touching, middle)
            least = np.ceil(1000.0 * apart - 0.1) / 1000.0
            best = least * unit
    return best
