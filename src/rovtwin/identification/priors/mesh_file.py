"""Meshes from files, STL, OBJ and what else trimesh reads, checked before anything is computed of them.

A mesh must be closed, in metres and of a vehicle's size. Normals that point inward are turned, cavities left out.
Triangles larger than a panel are cut; a finer mesh than panels want is made coarser by merging the vertices of a cell.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.identification.priors.panel import PANELS, Mesher
from rovtwin.identification.priors.surface import LEAST, Panels, solids, surface_of
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.solids.closed_mesh import LARGEST, SUFFIXES, ClosedMesh, read_closed, unit_hint
from rovtwin.vehicle.solids.shells import wet_share

__all__ = ["SUFFIXES", "mesher_of_file"]

_SMALLEST = 0.02  # of a small ROV [m]
_ORDER = 1.3  # of the error, with the size of triangles cut in even pieces: boxes of the tests
_LOST = 0.05  # share of the volume that merging may change


def mesher_of_file(
    path: Path, scale: float = 1.0, frame: tuple[str, str, str] = ("x", "y", "z"), origin: tuple[float, ...] = (0, 0, 0)
) -> Mesher:
    """The surface in a file.

    Args:
        path: Of the mesh.
        scale: Metres per unit of the file: 0.001 for millimetres.
        frame: Which axis of the file points forward, to starboard and down, as `("x", "-y", "-z")`.
        origin: Where CO is, in the file's axes and units.

    Raises:
        IdentificationError: Not there, not readable, open, in other units, or axes that are not a right-handed frame.
    """
    mesh = _read(path)
    R = _rotation(frame)
    vertices = scale * (mesh.vertices - np.asarray(origin, dtype=float)) @ R.T
    _require_metres(vertices, path.name, scale)
    whole = Panels(vertices, _four(mesh.faces), mesh.notes)

    # Midpoints of edges quarter triangles: the other mesh is half as fine, so that it is another.
    return Mesher(
        lambda size, least: _at(whole, mesh.faces, size, path.name, least < LEAST),
        whole.area,
        _order(whole, mesh.faces),
        path.name,
        2.0,
    )


def mesher_of_solids(bodies: list[Solid], name: str) -> Mesher:
    """The surface of solids of which some are meshes, all placed in b: triangles, less what lies inside of others."""

    def at(size: float, least: int) -> Panels:
        surfaces = [_of_solid(solid, size, least, name) for solid in bodies]
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in surfaces)])
        faces = [faces + start for (_, faces), start in zip(surfaces, starts[:-1], strict=True)]
        return _panels(np.concatenate([vertices for vertices, _ in surfaces]), np.concatenate(faces), ())

    largest = max(float(solid.size.max()) for solid in bodies)
    return Mesher(at, at(largest / 12, LEAST - 1).area, 0.0, name, 2.0)  # roughly: no merged mesh is refused


def _of_solid(
    solid: Solid, size: float, least: int, name: str
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Vertices in b, (n, 3), and triangles (m, 3) of about that side."""
    if solid.mesh is None:
        found = surface_of([solid], size, least)
        vertices, owner = np.unique(np.round(found.vertices, 9), axis=0, return_inverse=True)  # sides share their edges
        quads = owner.ravel()[found.faces]
        faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        distinct = (np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)
        return vertices, faces[distinct]
    place = solid.placement
    whole = Panels(place.position + solid.mesh.vertices @ place.rotation.T, _four(solid.mesh.faces))
    found = _at(whole, solid.mesh.faces, size, name, least < LEAST)
    return found.vertices, found.faces[:, :3]


def _order(whole: Panels, faces: Int[np.ndarray, "m _"]) -> float:
    """Of a mesh that is only cut; merging two ways gives two bodies, which are no sequence."""
    return _ORDER if len(faces) < 0.1 * PANELS else 0.0


def _read(path: Path) -> ClosedMesh:
    try:
        return read_closed(path)
    except ConfigError as error:
        raise IdentificationError(str(error)) from error


def _rotation(frame: tuple[str, str, str]) -> Float[np.ndarray, "3 3"]:
    """Rows: forward, starboard, down in the file's axes."""
    units = {"x": 0, "y": 1, "z": 2}
    R = np.zeros((3, 3))
    for row, name in enumerate(frame):
        axis = name.lstrip("+-")
        if axis not in units:
            raise IdentificationError(f"frame: found '{name}', expected x, y or z with or without a minus")
        R[row, units[axis]] = -1.0 if name.startswith("-") else 1.0
    if abs(np.linalg.det(R) - 1) > 1e-9:
        raise IdentificationError(
            f"frame: {', '.join(frame)} is no right-handed frame of forward, starboard, down; for a file with x "
            "forward, y to port and z up: x,-y,-z"
        )
    return R


def _require_metres(vertices: Float[np.ndarray, "n 3"], name: str, scale: float) -> None:
    longest = float(np.ptp(vertices, axis=0).max())
    if _SMALLEST <= longest <= LARGEST:
        return
    factor = unit_hint(longest)
    names = {1e-3: "millimetres", 1e-2: "centimetres", 0.0254: "inches"}
    hint = "give --scale, metres per unit of the file"
    if factor is not None:
        hint = f"looks like {names[factor]}; give --scale {scale * factor:g}"
    raise IdentificationError(f"{name}: found a body {longest:.3g} m long, expected {_SMALLEST} to {LARGEST} m; {hint}")


def _four(faces: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 4"]:
    return np.column_stack([faces, faces[:, 2]])


def _at(whole: Panels, faces: Int[np.ndarray, "m 3"], size: float, name: str, only_for_error: bool) -> Panels:
    import trimesh

    if whole.area / size**2 > 0.5 * len(faces):
        # Edges of twice the side: triangles of up to twice the area of a panel, most of them of half of it.
        cut = trimesh.remesh.subdivide_to_size(whole.vertices, faces, 2 * size, max_iter=20)
        return _panels(np.asarray(cut[0]), np.asarray(cut[1]), whole.notes)
    vertices, small = _merged(whole.vertices, faces, 1.1 * size)
    note = f"{len(faces)} triangles merged to {len(small)}"
    panels = _panels(vertices, small, (*whole.notes, note))
    if abs(lost := 1 - panels.volume / whole.volume) > _LOST and not only_for_error:
        raise IdentificationError(
            f"{name}: {len(faces)} triangles are more than panels of {size:.3g} m want, and merged the body loses "
            f"{100 * lost:.0f} % of its volume; give a smaller panel size, or simplify the mesh to about {PANELS}"
        )
    return panels


def _panels(vertices: Float[np.ndarray, "n 3"], triangles: Int[np.ndarray, "m 3"], notes: tuple[str, ...]) -> Panels:
    wet = wet_share(vertices, triangles)
    if wet is not None:
        notes = (*notes, f"shells run into each other: {100 * (1 - wet.mean()):.0f} % of the panels lie inside others")
    return Panels(vertices, _four(triangles), notes, wet)


def _merged(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], cell: float
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "f 3"]]:
    """Vertices of each cell of a grid made one, at their mean; triangles that vanish left out."""
    index = np.floor((vertices - vertices.min(axis=0)) / cell).astype(int)
    _, owner, count = np.unique(index, axis=0, return_inverse=True, return_counts=True)
    owner = owner.ravel()
    middle = np.zeros((len(count), 3))
    np.add.at(middle, owner, vertices)
    joined = owner[faces]
    kept = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    joined = joined[kept]
    # Flaps: two triangles on the same corners, back to back, enclose nothing.
    _, first, times = np.unique(np.sort(joined, axis=1), axis=0, return_index=True, return_counts=True)
    return middle / count[:, None], joined[np.sort(first[times == 1])]


def mesher_of(vehicle: Vehicle) -> Mesher:
    """Of all shapes of a vehicle's parts moving as one body."""
    bodies = solids(vehicle)
    if any(solid.mesh is not None for solid in bodies):
        return mesher_of_solids(bodies, vehicle.name)
    largest = max(float(solid.size.max()) for solid in bodies)
    area = surface_of(bodies, largest / 6).area
    return Mesher(lambda size, least: surface_of(bodies, size, least), area, 2.0, vehicle.name)
