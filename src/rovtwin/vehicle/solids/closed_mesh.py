"""Closed triangle meshes from files (STL, OBJ and what else trimesh reads), checked before anything is computed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.solids.shells import outer_shells

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", ".3mf")
LARGEST_FILE, MOST_TRIANGLES = 60e6, 300_000  # [bytes]; a hull needs 1e4 triangles at most
LARGEST, SMALLEST = 20.0, 0.005  # extent of a part of a small vehicle [m]


@dataclass(frozen=True, eq=False)
class ClosedMesh:
    """A closed surface without cavities, normals outward.

    Attributes:
        vertices: In the file's axes and units.
        faces: Rows of vertices.
        notes: What was mended, one line each.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    notes: tuple[str, ...]


def read_closed(path: Path) -> ClosedMesh:
    """The surface in a file, its normals turned outward and its cavities left out.

    Raises:
        ConfigError: Not there, not readable, too large, without triangles, or not closed.
    """
    mesh = _read(path)
    vertices = np.asarray(mesh.vertices, dtype=float)
    _require_closed(mesh, path.name)  # may turn faces, which are therefore read behind it
    faces, notes = outer_shells(vertices, np.asarray(mesh.faces))
    return ClosedMesh(vertices, faces, tuple(notes))


def unit_hint(longest: float) -> float | None:
    """Metres per unit in which a body of that length would be a small vehicle: mm, cm or inches; None: none of them."""
    return next((factor for factor in (1e-3, 1e-2, 0.0254) if 0.1 <= longest * factor <= 5.0), None)


def _read(path: Path) -> Any:
    import trimesh  # on use: most vehicles have no mesh

    if not path.is_file():
        raise ConfigError(f"{path}: no such file")
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"{path.name}: found the ending '{path.suffix}', expected one of {', '.join(SUFFIXES)}")
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise ConfigError(
            f"{path.name}: found a file of {size / 1e6:.0f} MB, expected at most {LARGEST_FILE / 1e6:.0f}; simplify "
            "the mesh to about 10,000 triangles in the CAD or mesh program"
        )
    try:
        mesh = trimesh.load(path, force="mesh", process=True)
    except Exception as broken:  # readers of many formats, each with errors of its own
        raise ConfigError(f"{path.name}: not readable as a mesh: {broken}") from broken
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) < 4:
        raise ConfigError(f"{path.name}: found no triangles, expected a closed surface of at least 4")
    if len(mesh.faces) > MOST_TRIANGLES:
        raise ConfigError(
            f"{path.name}: found {len(mesh.faces)} triangles, expected at most {MOST_TRIANGLES}; simplify the mesh to "
            "about 10,000 in the CAD or mesh program"
        )
    if not np.isfinite(mesh.vertices).all():
        raise ConfigError(f"{path.name}: found vertices that are no numbers")
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return mesh


def _require_closed(mesh: Any, name: str) -> None:
    if mesh.is_watertight:
        if not mesh.is_winding_consistent:
            mesh.fix_normals()
        return
    edges, count = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
    where = mesh.vertices[edges[count == 1].ravel()]
    about = f", the first near {np.round(where[0], 3).tolist()}" if len(where) else ""
    raise ConfigError(
        f"{name}: the surface is not closed: {int((count == 1).sum())} open edges and {int((count > 2).sum())} shared "
        f"by more than two triangles{about}; expected a watertight body. Close it in the CAD or mesh program"
    )
