"""Meshes from files, STL, OBJ and what else trimesh reads, checked before anything is computed of them.

A mesh must be closed, in metres and of a vehicle's size. Normals that point inward are turned, cavities left out.
Triangles larger than a panel are cut; a finer mesh than panels want is made coarser by merging the vertices of a cell.
"""

from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.priors.panel import PANELS, Mesher
from rovtwin.identification.priors.shells import outer_shells, wet_share
from rovtwin.identification.priors.surface import LEAST, Panels

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", ".3mf")
_LARGEST, _SMALLEST = 20.0, 0.02  # of a small ROV [m]
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
    vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)
    vertices = scale * (vertices - np.asarray(origin, dtype=float)) @ R.T
    _require_metres(vertices, path.name, scale)
    _require_closed(mesh, path.name)
    faces, notes = outer_shells(vertices, faces)
    whole = Panels(vertices, _four(faces), tuple(notes))

    # Midpoints of edges quarter triangles: the other mesh is half as fine, so that it is another.
    return Mesher(
        lambda size, least: _at(whole, faces, size, path.name, least < LEAST),
        whole.area,
        _order(whole, faces),
        path.name,
        2.0,
    )


def _order(whole: Panels, faces: np.ndarray) -> float:
    """Of a mesh that is only cut; merging two ways gives two bodies, which are no sequence."""
    return _ORDER if len(faces) < 0.1 * PANELS else 0.0


def _read(path: Path) -> Any:
    try:
        import trimesh
    except ImportError as missing:
        raise IdentificationError("meshes need trimesh: pip install 'rovtwin[panel]'") from missing
    if not path.is_file():
        raise IdentificationError(f"{path}: no such file")
    try:
        mesh = trimesh.load(path, force="mesh", process=True)
    except Exception as broken:  # readers of many formats, each with errors of its own
        raise IdentificationError(f"{path.name}: not readable as a mesh: {broken}") from broken
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) < 4:
        raise IdentificationError(f"{path.name}: found no triangles, expected a closed surface of at least 4")
    if not np.isfinite(mesh.vertices).all():
        raise IdentificationError(f"{path.name}: found vertices that are no numbers")
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return mesh


def _rotation(frame: tuple[str, str, str]) -> np.ndarray:
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


def _require_metres(vertices: np.ndarray, name: str, scale: float) -> None:
    longest = float(np.ptp(vertices, axis=0).max())
    if _SMALLEST <= longest <= _LARGEST:
        return
    for unit, factor in (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254)):
        if 0.1 <= longest * factor <= 5.0:
            hint = f"looks like {unit}; give --scale {scale * factor:g}"
            break
    else:
        hint = "give --scale, metres per unit of the file"
    raise IdentificationError(
        f"{name}: found a body {longest:.3g} m long, expected {_SMALLEST} to {_LARGEST} m; {hint}"
    )


def _require_closed(mesh: Any, name: str) -> None:
    if mesh.is_watertight:
        if not mesh.is_winding_consistent:
            mesh.fix_normals()
        return
    edges, count = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
    where = mesh.vertices[edges[count == 1].ravel()]
    about = f", the first near {np.round(where[0], 3).tolist()}" if len(where) else ""
    raise IdentificationError(
        f"{name}: the surface is not closed: {int((count == 1).sum())} open edges and {int((count > 2).sum())} shared "
        f"by more than two triangles{about}; expected a watertight body. Close it in the CAD or mesh program"
    )


def _four(faces: np.ndarray) -> np.ndarray:
    return np.column_stack([faces, faces[:, 2]])


def _at(whole: Panels, faces: np.ndarray, size: float, name: str, only_for_error: bool) -> Panels:
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


def _panels(vertices: np.ndarray, triangles: np.ndarray, notes: tuple[str, ...]) -> Panels:
    wet = wet_share(vertices, triangles)
    if wet is not None:
        notes = (*notes, f"shells run into each other: {100 * (1 - wet.mean()):.0f} % of the panels lie inside others")
    return Panels(vertices, _four(triangles), notes, wet)


def _merged(vertices: np.ndarray, faces: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
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
