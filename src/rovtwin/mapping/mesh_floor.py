"""A triangle mesh as floor, such as photogrammetry makes: overhangs, walls and what stands on the floor are in it."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import checked
from rovtwin.imaging.floor import FloorHits
from rovtwin.mapping.mesh_rays import Tree
from rovtwin.mapping.projection import crs_of, rasterio

MESHES = (".ply", ".obj", ".stl", ".off")
OTHER_MESHES = (".vtk", ".vtp", ".vtu", ".glb", ".gltf", ".dae", ".fbx", ".3mf", ".las", ".laz")
AXES = ("ned", "enu")
COARSEST = 2e-3  # by which 32-bit numbers may round a mesh's coordinates [m]
_DEGREES = 0.01  # a mesh that spans less, both ways, is one in degrees, or none [m]


@dataclass(frozen=True)
class MeshFrame:
    """How a mesh's coordinates are meant.

    Attributes:
        crs: `ned`: north, east, down of the datum [m]; `enu`: east, north, up; else a projected coordinate system in
            metres, whose third coordinate is a height over the ellipsoid, up.
        depths: Whether the third coordinate of a coordinate system is a depth below the water instead, down.
    """

    crs: str = "ned"
    depths: bool = False


@dataclass(frozen=True, eq=False)
class MeshFloor:
    """Triangles in n; rays end on the one that they meet first.

    Attributes:
        corners: Of the triangles, n [m].
        source: What it was made of, for people.
    """

    corners: Float[np.ndarray, "m 3 3"]
    source: str = ""

    @cached_property
    def _tree(self) -> Tree:
        return Tree.of(self.corners)

    @cached_property
    def _normals(self) -> Float[np.ndarray, "m 3"]:
        """In the tree's order; their sense is not used, as meshes have either."""
        corners = self._tree.corners
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return across / np.linalg.norm(across, axis=1, keepdims=True)

    def hits(
        self, origin: Float[np.ndarray, "*n 3"], direction: Float[np.ndarray, "*n 3"], longest: float
    ) -> FloorHits:
        """See `imaging.floor.RayCaster`; normals are those of the triangles, on the side that the ray comes from."""
        origin, direction = np.broadcast_arrays(origin, direction)
        shape, o, d = origin.shape[:-1], origin.reshape(-1, 3), direction.reshape(-1, 3)
        way, which = self._tree.first(o, d, longest)
        way = np.where(which < 0, np.nan, way)
        normal = self._normals[which]
        normal = normal * -np.where(np.sum(normal * d, axis=1) < 0, -1.0, 1.0)[:, None]
        normal[which < 0] = [0.0, 0.0, -1.0]
        point = o + way[:, None] * d
        return FloorHits(way.reshape(shape), point.reshape(*shape, 3), normal.reshape(*shape, 3))

    def depth_and_slope(
        self, place: Float[np.ndarray, "*n 2"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n 2"]]:
        """See `imaging.floor.Floor`: of the uppermost surface; no number where there is none."""
        top = float(self.corners[..., 2].min()) - 1.0
        above = np.concatenate([place, np.full((*place.shape[:-1], 1), top)], axis=-1)
        found = self.hits(above, np.array([0.0, 0.0, 1.0]), np.inf)
        return found.point[..., 2], -found.normal[..., :2] / found.normal[..., 2:]


def mesh_floor(
    path: Path, datum: Datum, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], frame: MeshFrame
) -> MeshFloor:
    """Of a mesh file, as far as the vehicle may have seen it.

    Args:
        path: Of the file.
        datum: Where n lies.
        low: Of the box, n [m], in which floor may be seen.
        high: Of the other corner.
        frame: What its numbers are.

    Raises:
        ConfigError: It cannot be read, has no triangles or vertices that are no numbers, is in degrees or too coarse
            numbers, or lies elsewhere.
    """
    vertices, faces = _read(path)
    _check_numbers(path, vertices)
    place = _placed(path, vertices, datum, frame)
    corners = place[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    near = (corners.max(axis=1) >= low).all(axis=1) & (corners.min(axis=1) <= high).all(axis=1) & (area > 0)
    if not near.any():
        raise ConfigError(
            f"{path}: {_box(corners.min(axis=(0, 1)), corners.max(axis=(0, 1)))}; the survey's floor must lie within "
            f"{_box(low, high)} [m] of the datum {datum.latitude:.5f}, {datum.longitude:.5f}. Is the mesh of another "
            "place, or are its axes or units others? --floor-crs ned (north, east, down), enu (east, north, up), or "
            "its coordinate system, with --dem-values"
        )
    return MeshFloor(corners[near], f"mesh {path.name}, {int(near.sum())} of {len(faces)} triangles")


def _box(low: np.ndarray, high: np.ndarray) -> str:
    names = ("north", "east", "depth")
    return ", ".join(f"{name} {a:.6g} to {b:.6g}" for name, a, b in zip(names, low, high, strict=True))


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    import trimesh  # on use: most maps have no mesh

    try:
        loaded: Any = trimesh.load(str(checked(path, np.inf)), force="mesh", process=False)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # readers of several formats fail each in its own way
        raise ConfigError(f"{path}: cannot be read as a mesh: {error}") from None
    faces = np.asarray(getattr(loaded, "faces", ()))
    if not len(faces):
        raise ConfigError(f"{path}: has no triangles, expected a surface. A cloud of points is to be meshed first")
    vertices = np.asarray(loaded.vertices, float)
    if not np.isfinite(vertices[np.unique(faces)]).all():
        raise ConfigError(
            f"{path}: has vertices that are no numbers, expected metres. Clean the mesh, such as in MeshLab"
        )
    used, faces = np.unique(faces, return_inverse=True)  # others may be no numbers, and are not looked at
    return vertices[used], faces.reshape(-1, 3)


def _check_numbers(path: Path, vertices: np.ndarray) -> None:
    span = np.ptp(vertices, axis=0)
    if (span[:2] < _DEGREES).all():
        raise ConfigError(
            f"{path}: spans {span[0]:.2g} x {span[1]:.2g}, expected metres. Are its coordinates degrees? Export it in "
            "a projected system such as UTM, and say --floor-crs EPSG:32632"
        )
    largest = np.abs(vertices).max()
    step = float(np.spacing(np.float32(largest)))
    if step > COARSEST and _in_32_bits(path) and (vertices == vertices.astype(np.float32)).all():
        raise ConfigError(
            f"{path}: has coordinates up to {largest:.7g} as 32-bit numbers, which are {step:.2g} m apart. Export it "
            "in double precision (PLY with double, OBJ), or north, east, down of the datum"
        )


def _in_32_bits(path: Path) -> bool:
    """Whether a file's format has coordinates as 32-bit numbers: STL, and PLY that does not say double."""
    with path.open("rb") as stream:
        doubles = b"property double x" in stream.read(4096)
    return path.suffix.lower() in (".stl", ".ply") and not doubles


def _placed(path: Path, vertices: np.ndarray, datum: Datum, frame: MeshFrame) -> Float[np.ndarray, "k 3"]:
    """Of a mesh's frame to n."""
    if frame.crs == "ned":
        return vertices
    if frame.crs == "enu":
        return vertices[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    crs = crs_of(frame.crs, "--floor-crs")
    if np.abs(vertices[:, 0]).max() <= 360.0 and np.abs(vertices[:, 1]).max() <= 90.0:
        raise ConfigError(
            f"{path}: its coordinates are {vertices[:, 0].min():.6g} to {vertices[:, 0].max():.6g} and "
            f"{vertices[:, 1].min():.6g} to {vertices[:, 1].max():.6g}, expected metres in {frame.crs}. Are they "
            "degrees, or counted from an origin of their own (then --floor-crs enu, if that is the datum)?"
        )
    rio = rasterio("--floor-crs")
    from rasterio.warp import transform

    try:
        longitude, latitude, *_ = transform(crs, "EPSG:4326", vertices[:, 0], vertices[:, 1])
        depth = vertices[:, 2] if frame.depths else datum.height - vertices[:, 2]
        return datum.position(np.array(latitude), np.array(longitude), depth)
    except (rio.errors.RasterioError, ValueError, ConfigError) as error:
        raise ConfigError(f"{path}: its coordinates cannot be those of {frame.crs}: {error}") from None
