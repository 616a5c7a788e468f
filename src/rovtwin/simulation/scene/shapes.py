"""Bodies that are not flat: cylinders, meshes from files, a bottom with relief, the wreck of a boat."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import ConfigError
from rovtwin.simulation.relief import Relief, grid_axis
from rovtwin.simulation.scene.schema import Wreck
from rovtwin.simulation.scene.surfaces import Material, Mesh
from rovtwin.vehicle.solids.placement import Placement

_AROUND = 48  # sides of a cylinder


def placed(
    vertices: Float[np.ndarray, "n 3"],
    triangles: Int[np.ndarray, "m 3"],
    place: Placement,
    material: Material,
    name: str,
    smooth: bool,
) -> Mesh:
    """A mesh of vertices given in a frame at `place`; normals are those of the faces, or smooth ones at vertices."""
    at = place.position + vertices @ place.rotation.T
    across = np.cross(at[triangles[:, 1]] - at[triangles[:, 0]], at[triangles[:, 2]] - at[triangles[:, 0]])
    if not smooth:
        flat = np.repeat(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300), 3, axis=0)
        return Mesh(at[triangles].reshape(-1, 3), flat, np.arange(3 * len(triangles)).reshape(-1, 3), material, name)
    normals = np.zeros_like(at)
    for i in range(3):
        np.add.at(normals, triangles[:, i], across)  # weighted by area
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return Mesh(at, normals, triangles, material, name)


def grid_triangles(rows: int, columns: int) -> Int[np.ndarray, "m 3"]:
    """Two triangles for each cell of a grid of vertices."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (x.ravel() for x in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def cylinder(radius: float, length: float, place: Placement, material: Material, name: str = "") -> Mesh:
    """A closed cylinder along its x."""
    angle = np.linspace(0.0, 2 * np.pi, _AROUND + 1)
    ring = np.column_stack([np.zeros_like(angle), radius * np.cos(angle), radius * np.sin(angle)])
    ends = np.array([-0.5 * length, 0.5 * length])
    side = np.concatenate([ring + [ends[0], 0, 0], ring + [ends[1], 0, 0]])
    mantle = placed(side, grid_triangles(2, _AROUND + 1), place, material, name, smooth=True)
    # The seam's two columns are one line: their normals must agree.
    normals = np.concatenate([ring, ring]) / radius @ place.rotation.T
    vertices, all_normals, triangles = [mantle.vertices], [normals], [mantle.triangles]
    for end, outward in ((ends[0], -1.0), (ends[1], 1.0)):
        start = sum(len(v) for v in vertices)
        lid = np.concatenate([[[end, 0.0, 0.0]], ring[:-1] + [end, 0, 0]])
        vertices.append(place.position + lid @ place.rotation.T)
        all_normals.append(np.tile(place.rotation @ [outward, 0.0, 0.0], (len(lid), 1)))
        around = 1 + np.arange(_AROUND)
        triangles.append(start + np.column_stack([np.zeros(_AROUND, int), around, np.roll(around, -1)]))
    return Mesh(np.concatenate(vertices), np.concatenate(all_normals), np.concatenate(triangles), material, name)


def mesh_from_file(path: Path, scale: float, place: Placement, material: Material, where: str) -> Mesh:
    """Of a file that trimesh reads.

    Raises:
        ConfigError: It is not there, or not a mesh.
    """
    if not path.is_file():
        raise ConfigError(f"{where}: found {path}, which is no file")
    import trimesh  # on use: most scenes have no mesh

    try:
        loaded: Any = trimesh.load(str(path), force="mesh")
    except Exception as error:  # readers of a dozen formats fail each in its own way
        raise ConfigError(f"{where}: {path.name} cannot be read as a mesh: {error}") from None
    triangles = np.asarray(getattr(loaded, "faces", ()))
    if not len(triangles):
        raise ConfigError(f"{where}: {path.name} has no triangles")
    return placed(scale * np.asarray(loaded.vertices), triangles, place, material, path.stem, smooth=False)


def seabed(relief: Relief, size: float, material: Material) -> Mesh:
    """The floor of a square about the origin, `size` a side [m]."""
    axis = grid_axis(size)
    place = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    vertices = np.concatenate([place, relief.depth_and_slope(place)[0][..., None]], axis=-1).reshape(-1, 3)
    triangles = grid_triangles(len(axis), len(axis))
    return placed(vertices, triangles, Placement(np.zeros(3), np.eye(3)), material, "bottom", True)


def wreck(given: Wreck, place: Placement, material: Material, name: str = "") -> Mesh:
    """The hull of a boat with frames, thwarts and holes, keel down; its x is the boat's."""
    rng = np.random.default_rng(given.seed)
    stations, around = 41, 25
    s = np.linspace(0.0, 1.0, stations)
    half = 0.17 * given.length * np.sin(np.pi * np.clip(0.92 * s + 0.08, 0, 1)) ** 0.6  # narrow bow, broad stern
    sheer = 0.14 * given.length * (0.8 + 0.6 * (s - 0.45) ** 2)
    girth = np.linspace(-1.0, 1.0, around)
    y = half[:, None] * np.sign(girth) * np.abs(girth) ** 0.75
    z = -sheer[:, None] * np.abs(girth) ** 2.2
    x = np.broadcast_to(given.length * (0.5 - s)[:, None], y.shape)
    shell = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    triangles = grid_triangles(stations, around)
    cell = np.arange(len(triangles)) % ((stations - 1) * (around - 1))
    station, strake = cell // (around - 1), cell % (around - 1)
    gone = np.zeros(len(triangles), bool)
    for _ in range(7):  # planks that are no more, on one side
        first, row = rng.integers(3, stations - 12), rng.integers(around // 2 + 2, around - 2)
        gone |= (station >= first) & (station < first + rng.integers(4, 11)) & (strake == row)
    parts = [(shell, triangles[~gone])]
    parts += [_rib(x[i, 0], half[i], sheer[i]) for i in range(4, stations - 3, 4)]
    parts += [_thwart(x[i, 0], 0.98 * half[i], 0.75 * sheer[i]) for i in (12, 20, 28)]
    vertices = np.concatenate([v for v, _ in parts])
    starts = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    joined = np.concatenate([t + start for (_, t), start in zip(parts, starts, strict=True)])
    return placed(vertices, joined, place, material, name, smooth=False)


def _rib(x: float, half: float, sheer: float) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """A frame inside the hull, 6 cm wide and 8 cm deep."""
    girth = np.linspace(-1.0, 1.0, 25)
    outer = np.column_stack([np.sign(girth) * np.abs(girth) ** 0.75 * half, -sheer * np.abs(girth) ** 2.2])
    inner = outer * (1 - 0.08 / half) - [0.0, 0.08]
    strips = [np.column_stack([np.full(25, at), ring]) for at, ring in ((x - 0.03, inner), (x + 0.03, inner))]
    strips = [np.column_stack([np.full(25, x - 0.03), outer]), *strips, np.column_stack([np.full(25, x + 0.03), outer])]
    return np.concatenate(strips), grid_triangles(4, 25)


def _thwart(x: float, half: float, height: float) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """A plank across."""
    corners = np.array([[sx, sy, sz] for sx in (-0.12, 0.12) for sy in (-1, 1) for sz in (-0.02, 0.02)])
    vertices = corners * [1.0, half, 1.0] + [x, 0.0, -height]
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
