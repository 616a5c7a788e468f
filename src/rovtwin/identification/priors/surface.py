"""Panels: the wetted surface of a vehicle's shapes, cut into quadrilaterals for the panel method.

Panels shrink towards edges, where the flow is singular: with a cosine rule the error falls as their area, so that two
meshes give the limit (`panel`). Round bodies are blown up until their volume is right. Parallel boxes that overlap or
touch are cut at each other's faces, and what lies inside is left out; other parts keep their hidden panels.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.errors import IdentificationError
from rovtwin.vehicle.description.schema import Body
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.solids.placement import SIGNS, Placement

LEAST = 6  # panels along any side
_DRAWN_BACK = 0.985


@dataclass(frozen=True, eq=False)
class Panels:
    """A closed surface, normals outward.

    Attributes:
        vertices: In b at CO [m].
        faces: Rows of vertices; a triangle repeats its last one.
        notes: What was left out or mended, one line each.
        wet: Share of each panel that water touches; None: all of all. Where parts run into each other at an angle the
            surface keeps their hidden panels, so that each part stays closed.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 4"]
    notes: tuple[str, ...] = ()
    wet: Float[np.ndarray, " m"] | None = None

    @property
    def corners(self) -> Float[np.ndarray, "m 4 3"]:
        """Shape (m, 4, 3)."""
        return self.vertices[self.faces]

    @property
    def centers(self) -> Float[np.ndarray, "m 3"]:
        """Mean of the corners [m]."""
        return self.corners.mean(axis=1)

    @property
    def area_vectors(self) -> Float[np.ndarray, "m 3"]:
        """Outward normal times area [m2]."""
        a, b, c, d = np.moveaxis(self.corners, 1, 0)
        return 0.5 * np.cross(c - a, d - b)

    @property
    def area(self) -> float:
        """[m2]"""
        return float(np.linalg.norm(self.area_vectors, axis=1).sum())

    @property
    def volume(self) -> float:
        """Inside [m3], by the divergence theorem."""
        return float((self.centers * self.area_vectors).sum() / 3)

    @property
    def size(self) -> Float[np.ndarray, "3"]:
        """Of the box around it [m]."""
        return np.ptp(self.vertices, axis=0)


def solids(vehicle: Vehicle) -> list[Solid]:
    """All shapes of a vehicle's parts, each with its place in b.

    Raises:
        IdentificationError: No part has a shape.
    """
    found = _solids(vehicle.file, Placement.of([0, 0, 0]))
    if not found:
        raise IdentificationError(
            f"{vehicle.where}: no part has a 'shape', expected at least one box, cylinder, sphere, ellipsoid or mesh; "
            "add one (docs/vehicles.md), or give a size or a mesh instead"
        )
    return found


def _solids(body: Body, placement: Placement) -> list[Solid]:
    own = []
    if body.shape is not None:
        solid = Solid.of(body.shape)
        own = [replace(solid, placement=solid.placement.after(placement))]
    for part in body.parts:
        own += _solids(part, Placement.of(part.pose.position, part.pose.attitude_deg).after(placement))
    return own


def corner_points(solid: Solid) -> Float[np.ndarray, "n 3"]:
    """Points on a solid whose convex hull is nearly the solid, in b."""
    if solid.kind == "box":
        local = 0.5 * SIGNS * solid.size
    elif solid.mesh is not None:
        local = solid.mesh.outline
    else:
        local = _local_panels(solid, float(solid.size.max()) / 16)[0]
    return solid.placement.position + local @ solid.placement.rotation.T


def surface_of(bodies: list[Solid], panel_size: float, least: int = LEAST) -> Panels:
    """Panels of all solids moving as one body.

    Args:
        bodies: Placed in b.
        panel_size: Mean side of a panel [m].
        least: Panels along any side.
    """
    every, owner = _joined(bodies, panel_size, least)
    hidden, double = _hidden(every, owner, bodies, 1e-3 * min(float(solid.size.min()) for solid in bodies))
    if not (hidden | double).any():
        return every
    if (hidden | double).all():
        raise IdentificationError("panel method: every panel lies inside another part; are two parts the same?")
    notes = [f"shapes overlap or touch: {100 * (hidden | double).mean():.0f} % of the panels lie inside others"]
    if all(solid.kind == "box" and _square(solid, bodies[0]) for solid in bodies):
        return Panels(every.vertices, every.faces[~(hidden | double)], tuple(notes))
    # Flush in the eyes of a panel, whose middle lies inside a round face.
    _, double = _hidden(every, owner, bodies, 0.1 * panel_size)
    if double.any():
        # Sources on two faces in one place cannot be distinguished: the later part draws back a little.
        flush = set(owner[double].tolist())
        bodies = [replace(s, size=_DRAWN_BACK * s.size) if i in flush else s for i, s in enumerate(bodies)]
        every, owner = _joined(bodies, panel_size, least)
        notes.append(f"{len(flush)} flush with others taken as {100 * (1 - _DRAWN_BACK):.1f} % smaller")
    return replace(every, wet=_wet_share(every, owner, bodies), notes=tuple(notes))


def _joined(bodies: list[Solid], panel_size: float, least: int) -> tuple[Panels, Int[np.ndarray, " m"]]:
    """All panels of all solids, and which solid each is of."""
    vertices, faces, owner, count = [], [], [], 0
    for i, solid in enumerate(bodies):
        local, quads = _local_panels(solid, panel_size, least, _cuts(solid, bodies))
        vertices.append(solid.placement.position + local @ solid.placement.rotation.T)
        faces.append(quads + count)
        owner.append(np.full(len(quads), i))
        count += len(local)
    return Panels(np.concatenate(vertices), np.concatenate(faces)), np.concatenate(owner)


def _wet_share(panels: Panels, owner: Int[np.ndarray, " m"], bodies: list[Solid]) -> Float[np.ndarray, " m"]:
    """Share of each panel outside all solids but its own, by 4 x 4 points on it."""
    at = (np.arange(4) + 0.5) / 4
    share = np.zeros(len(owner))
    for u in at:
        for v in at:
            weights = np.array([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
            points = np.tensordot(panels.corners, weights, axes=(1, 0))
            dry = np.zeros(len(owner), dtype=bool)
            for i, solid in enumerate(bodies):
                dry |= (owner != i) & _inside(solid, points)
            share += ~dry / 16
    return share


def _square(solid: Solid, other: Solid) -> bool:
    """Whether their axes are parallel."""
    turned = np.abs(solid.placement.rotation.T @ other.placement.rotation)
    return bool(np.all((turned < 1e-9) | (turned > 1 - 1e-9)))


def _cuts(solid: Solid, bodies: list[Solid]) -> list[np.ndarray]:
    """Where faces of boxes parallel to this one cut it, along its axes, in half sizes: panels are to end there."""
    cuts: list[list[float]] = [[], [], []]
    for other in bodies:
        if other is solid or not (solid.kind == other.kind == "box" and _square(solid, other)):
            continue
        corners = (corner_points(other) - solid.placement.position) @ solid.placement.rotation / (0.5 * solid.size)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if (low < 1 + 1e-9).all() and (high > -1 - 1e-9).all():
            for axis in range(3):
                cuts[axis] += [at for at in (low[axis], high[axis]) if abs(at) < 1 - 1e-6]
    return [np.unique(np.round(at, 9)) for at in cuts]


def _hidden(
    panels: Panels, owner: Int[np.ndarray, " m"], bodies: list[Solid], tolerance: float
) -> tuple[Bool[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """Panels that water does not touch: those inside another solid, and those on the face of an earlier one."""
    normal = panels.area_vectors / np.linalg.norm(panels.area_vectors, axis=1, keepdims=True)
    step = tolerance * normal
    hidden, double = np.zeros(len(owner), dtype=bool), np.zeros(len(owner), dtype=bool)
    for i, solid in enumerate(bodies):
        before, behind = _inside(solid, panels.centers + step), _inside(solid, panels.centers - step)
        hidden |= (owner != i) & before
        double |= (owner > i) & behind & ~before
    return hidden, double & ~hidden


def _inside(solid: Solid, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which points of b lie in a solid."""
    x, y, z = ((points - solid.placement.position) @ solid.placement.rotation / (0.5 * solid.size)).T
    if solid.kind == "box":
        return (np.abs(x) < 1) & (np.abs(y) < 1) & (np.abs(z) < 1)
    if solid.kind == "cylinder":
        return (np.abs(x) < 1) & (y**2 + z**2 < 1)
    return x**2 + y**2 + z**2 < 1


def _local_panels(
    solid: Solid, panel_size: float, least: int = LEAST, cuts: list[np.ndarray] | None = None
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 4"]]:
    if solid.kind == "cylinder":
        return _cylinder(solid.size[0], 0.5 * solid.size[1], panel_size, least)
    # The cube around a sphere has twice its surface: fewer panels for the same mean size.
    stretch = 1.0 if solid.kind == "box" else np.sqrt(np.pi / 6)
    counts = [max(least, int(np.ceil(stretch * side / panel_size))) for side in solid.size]
    if solid.kind == "box":
        vertices, faces = _grid_box([_graded_between(n, at) for n, at in zip(counts, cuts or [[]] * 3, strict=True)])
        return vertices * 0.5 * solid.size, faces
    # A cube blown up to a sphere: no poles. Equal angles, so that its panels are about equal.
    vertices, faces = _grid_box([np.tan(np.linspace(-np.pi / 4, np.pi / 4, n + 1)) for n in counts])
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True) * 0.5 * solid.size
    return vertices * np.cbrt(solid.volume() / Panels(vertices, faces).volume), faces


def _graded(count: int) -> Float[np.ndarray, " points"]:
    """Points from -1 to 1, dense at both ends."""
    return np.sin(0.5 * np.pi * np.linspace(-1, 1, count + 1))


def _graded_between(count: int, cuts: object) -> Float[np.ndarray, " points"]:
    """The same with points at given places, dense there too."""
    ends = np.concatenate([[-1.0], np.asarray(cuts, dtype=float), [1.0]])
    pieces = [
        low + 0.5 * (high - low) * (1 + _graded(max(2, int(np.ceil(0.5 * count * (high - low))))))
        for low, high in zip(ends[:-1], ends[1:], strict=True)
    ]
    return np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])


def _grid_box(lines: list[np.ndarray]) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 4"]]:
    """Surface of the cube from -1 to 1 along three sets of grid lines, normals outward."""
    vertices, faces, count = [], [], 0
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        u, v = np.meshgrid(lines[j], lines[k], indexing="ij")
        for side in (-1.0, 1.0):
            points = np.empty((u.size, 3))
            points[:, axis], points[:, j], points[:, k] = side, u.ravel(), v.ravel()
            quads = _quads(*u.shape)
            vertices.append(points)
            faces.append((quads if side > 0 else quads[:, ::-1]) + count)
            count += u.size
    return np.concatenate(vertices), np.concatenate(faces)


def _quads(rows: int, columns: int) -> Int[np.ndarray, "m 4"]:
    """Faces of a grid of points stored row by row, anticlockwise as seen with rows to the right, columns up."""
    index = np.arange(rows * columns).reshape(rows, columns)
    return np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)


def _cylinder(
    length: float, radius: float, panel_size: float, least: int
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 4"]]:
    """Along x; its polygon has the circle's area."""
    around = max(3 * least, int(np.ceil(2 * np.pi * radius / panel_size)))
    along = max(least, int(np.ceil(length / panel_size)))
    across = max(least // 2, int(np.ceil(radius / panel_size)))
    angle = np.linspace(0, 2 * np.pi, around + 1)
    radius *= np.sqrt(2 * np.pi / around / np.sin(2 * np.pi / around))
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = radius * np.sin(0.5 * np.pi * np.linspace(0, 1, across + 1))
    x = 0.5 * length * _graded(along)
    # One strip of rings: the bottom's centre to its rim, along the side, the top's rim to its centre.
    profile = [(-0.5 * length, r) for r in rings[:-1]] + [(at, radius) for at in x]
    profile += [(0.5 * length, r) for r in rings[-2::-1]]
    vertices = np.concatenate([np.column_stack([np.full(len(circle), at), r * circle]) for at, r in profile])
    return vertices, _quads(len(profile), around + 1)[:, ::-1]
