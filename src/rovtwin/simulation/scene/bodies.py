"""A vehicle's looks as meshes in n, for pictures from outside."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.simulation.scene.shapes import cylinder, grid_triangles, mesh_from_file, placed
from rovtwin.simulation.scene.surfaces import Material, Mesh, linear
from rovtwin.vehicle.analysis.visuals import Piece, pieces_of
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.solids.placement import SIGNS, Placement

_BOX = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])  # of SIGNS


def vehicle_meshes(
    vehicle: Vehicle, position: Float[np.ndarray, "3"], R_nb: Float[np.ndarray, "3 3"]
) -> tuple[Mesh, ...]:
    """The vehicle with CO at a position in n [m], and attitude R_nb."""
    there = Placement(np.asarray(position, float), np.asarray(R_nb, float))
    return tuple(_mesh(piece, piece.placement.after(there), vehicle.where) for piece in pieces_of(vehicle))


def _mesh(piece: Piece, place: Placement, where: str) -> Mesh:
    colour = linear(np.array(piece.colour))
    material = Material(colour, colour, 0.05, 0.1)
    if piece.kind == "mesh":
        return mesh_from_file(Path(piece.mesh), float(piece.size[0]), place, material, f"{where}: {piece.name}")
    if piece.kind == "cylinder":
        return cylinder(0.5 * piece.size[1], piece.size[0], place, material, piece.name)
    if piece.kind == "box":
        triangles = np.concatenate([_BOX[:, [0, 1, 2]], _BOX[:, [0, 2, 3]]])
        return placed(0.5 * piece.size * SIGNS, triangles, place, material, piece.name, smooth=False)
    polar, around = np.meshgrid(np.linspace(0, np.pi, 17), np.linspace(0, 2 * np.pi, 33), indexing="ij")
    unit = np.stack([np.cos(polar), np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around)], axis=-1)
    unit = unit.reshape(-1, 3)
    normals = unit / piece.size
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) @ place.rotation.T
    vertices = place.position + (0.5 * piece.size * unit) @ place.rotation.T
    return Mesh(vertices, normals, grid_triangles(17, 33), material, piece.name)
