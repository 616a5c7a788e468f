"""A closed mesh as a solid: its volume and moments, its silhouettes, and the simple solids that it is like.

Added mass has no formula for a mesh. The box around it is taken as a box, as an elliptic cylinder along each of its
axes and as an ellipsoid, and these are weighed so that they fill the box and its three faces as the mesh's convex hull
does: a box, cylinder or ellipsoid given as a mesh is that solid again. Water between two walls of the mesh goes along;
gaps in what the hull covers let it through, as in a perforated plate (DNV-RP-N103, 2017, sec. 4.6.4). How far that is
from the panel method: docs/vehicles.md.
"""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.solids.closed_mesh import LARGEST, SMALLEST, read_closed, unit_hint
from rovtwin.vehicle.solids.shells import shell_of

_PIXELS, _CELLS = 576, 16  # of a silhouette along each side; what drag is spread over
_RAYS = 64  # along each side, for the water between walls
_SLACK = 1.08  # what rays make of a body without hollows, of its volume
_OTHER_AXES = 0.9  # the box around the mesh in its principal axes must be smaller by this to be taken

# How the simple solids fill the box around them and its faces across x, y, z. Columns: box, cylinder along x, y, z,
# ellipsoid.
_FILL = np.full((4, 5), np.pi / 4)
_FILL[:, 0], _FILL[0, 4] = 1.0, np.pi / 6
for _axis in range(3):
    _FILL[1:, 1 + _axis] = 1.0
    _FILL[1 + _axis, 1 + _axis] = np.pi / 4


@dataclass(frozen=True, eq=False)
class MeshSolid:
    """A mesh in numbers, seen from the middle of the box around it, in that box's axes.

    Attributes:
        middle: Of the box, in the file's frame [m].
        rotation: Of the box's axes to the file's: the file's own, or the principal axes.
        size: Of the box [m].
        volume: [m3].
        centroid: Centre of volume [m].
        second_moment: Of the volume about its centre, per volume [m2].
        silhouettes: Seen along x, y, z: places [m] and areas [m2].
        solidity: Area of each silhouette over that of the convex hull.
        fullness: Area of the convex hull seen along x, y, z over that of an ellipse in the box's face, at most 1.
        trapped: Water between the first and the last wall along x, y, z [m3].
        weights: Shares of box, cylinder along x, y, z and ellipsoid.
        outline: Corners of the convex hull [m].
        vertices: Of the surface [m].
        faces: Rows of vertices, normals outward.
        notes: What was mended, or is to be known of it, one line each.
    """

    middle: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    size: Float[np.ndarray, "3"]
    volume: float
    centroid: Float[np.ndarray, "3"]
    second_moment: Float[np.ndarray, "3 3"]
    silhouettes: tuple[tuple[Float[np.ndarray, "_ 3"], Float[np.ndarray, " _"]], ...]
    solidity: Float[np.ndarray, "3"]
    fullness: Float[np.ndarray, "3"]
    trapped: Float[np.ndarray, "3"]
    weights: Float[np.ndarray, "5"]
    outline: Float[np.ndarray, "n 3"]
    vertices: Float[np.ndarray, "k 3"]
    faces: Int[np.ndarray, "m 3"]
    notes: tuple[str, ...]

    @property
    def areas(self) -> Float[np.ndarray, "3"]:
        """Projected, along x, y, z [m2]."""
        return np.array([area.sum() for _, area in self.silhouettes])


def mesh_solid(path: str, scale: float = 1.0) -> MeshSolid:
    """The solid in a mesh file.

    Args:
        path: Of the file; what it names is read once for each change of the file.
        scale: Metres per unit of the file.

    Raises:
        ConfigError: Not there, not readable, too large, empty, not closed, or of no vehicle's size.
    """
    file = Path(path)
    stamp = file.stat() if file.is_file() else None
    return _read(path, scale, None if stamp is None else (stamp.st_mtime_ns, stamp.st_size))


def digest(path: str) -> str:
    """Of a mesh file's content: what a vehicle's fingerprint holds in place of a path."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]


@lru_cache(maxsize=64)
def _read(path: str, scale: float, stamp: object) -> MeshSolid:
    mesh = read_closed(Path(path))
    vertices, name = scale * mesh.vertices, Path(path).name
    _require_metres(vertices[mesh.faces], name, scale)
    shells = int(shell_of(mesh.faces).max()) + 1
    notes = tuple(f"{name}: {note}" for note in mesh.notes)
    if shells > 1:
        notes += (f"{name}: {shells} shells, whose volumes are added: where they run into each other it counts twice",)
    return solid_of(vertices, mesh.faces, notes)


def solid_of(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], notes: tuple[str, ...] = ()
) -> MeshSolid:
    """The solid that a closed surface encloses: vertices [m], faces with outward normals."""
    from scipy.spatial import ConvexHull

    volume, centroid, second = _moments(vertices[faces])
    hull = ConvexHull(vertices)
    rotation = _axes(vertices[hull.vertices], second)
    local = vertices @ rotation
    low, high = local.min(axis=0), local.max(axis=0)
    middle, size = 0.5 * (low + high), high - low
    local = local - middle
    shadows = [_shadow(local[faces], size, axis) for axis in range(3)]
    silhouettes = tuple(_silhouette(shadow, size, axis) for axis, shadow in enumerate(shadows))
    boxes = np.prod(size) / size
    hull_areas = np.array([ConvexHull(np.delete(local, axis, axis=1)).volume for axis in range(3)])
    solidity = np.minimum([area.sum() for _, area in silhouettes] / hull_areas, 1.0)
    return MeshSolid(
        rotation @ middle,
        rotation,
        size,
        volume,
        rotation.T @ centroid - middle,
        rotation.T @ second @ rotation,
        silhouettes,
        solidity,
        np.minimum(hull_areas / (np.pi / 4 * boxes), 1.0),
        np.array([_trapped(local[faces], shadow, size, axis, volume) for axis, shadow in enumerate(shadows)]),
        _weights(hull.volume / np.prod(size), hull_areas / boxes),
        local[hull.vertices],
        local,
        faces,
        notes,
    )


def open_share(solidity: Float[np.ndarray, " *axes"]) -> Float[np.ndarray, "*axes"]:
    """What gaps leave of added mass along each axis: DNV-RP-N103, sec. 4.6.4, on the silhouette's gaps."""
    gaps = 100.0 * (1.0 - solidity)
    mild = 0.7 + 0.3 * np.cos(np.pi * (gaps - 5.0) / 34.0)
    return np.where(gaps <= 5, 1.0, np.where(gaps < 34, mild, np.exp((10.0 - gaps) / 28.0)))


def _require_metres(corners: Float[np.ndarray, "m 3 3"], name: str, scale: float) -> None:
    longest = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if SMALLEST <= longest <= LARGEST:
        return
    factor = unit_hint(longest)
    hint = "give scale, metres per unit of the file"
    if factor is not None:
        hint = f"give scale: {scale * factor:g}, metres per unit of the file"
    raise ConfigError(f"{name}: found a body {longest:.3g} m long, expected {SMALLEST:g} to {LARGEST:g} m; {hint}")


def _moments(triangles: Float[np.ndarray, "m 3 3"]) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Volume, centre, and second moments about it per volume, from the tetrahedra that triangles make with a point."""
    about = triangles.mean(axis=(0, 1))  # near the body: no digits are lost to a far origin
    corners = triangles - about
    a, b, c = np.moveaxis(corners, 1, 0)
    six = np.einsum("ni,ni->n", a, np.cross(b, c))
    volume = six.sum() / 6
    total = corners.sum(axis=1)
    centroid = (six @ total) / 24 / volume
    squares = np.einsum("n,nki,nkj->ij", six, corners, corners) + np.einsum("n,ni,nj->ij", six, total, total)
    return float(volume), centroid + about, squares / 120 / volume - np.outer(centroid, centroid)


def _axes(points: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The file's axes, or the principal ones where the box around the points is smaller in these."""
    vectors = np.linalg.eigh(second)[1]
    order = np.abs(vectors).argmax(axis=0)
    if len(set(order.tolist())) < 3:
        return np.eye(3)
    R = vectors[:, np.argsort(order)]
    R = R * np.sign(np.diag(R))
    smaller = np.prod(np.ptp(points @ R, axis=0)) < _OTHER_AXES * np.prod(np.ptp(points, axis=0))
    return R if smaller and np.linalg.det(R) > 0 else np.eye(3)


def _shadow(triangles: Float[np.ndarray, "m 3 3"], size: Float[np.ndarray, "3"], axis: int) -> np.ndarray:
    """Pixels that are covered, seen along an axis: rows along the axis after the next, columns along the next."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    from PIL import Image, ImageDraw

    image = Image.new("L", (_PIXELS, _PIXELS))
    draw = ImageDraw.Draw(image)
    pixels = (triangles[:, :, [j, k]] / size[[j, k]] + 0.5) * (_PIXELS - 1)
    for corners in pixels.reshape(len(pixels), 6).tolist():
        draw.polygon(corners, fill=1)
    return np.asarray(image)


def _shares(shadow: np.ndarray, count: int) -> Float[np.ndarray, "{count} {count}"]:
    """Covered share of each of count x count cells."""
    block = _PIXELS // count
    return shadow.reshape(count, block, count, block).mean(axis=(1, 3))


def _silhouette(
    shadow: np.ndarray, size: Float[np.ndarray, "3"], axis: int
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, " k"]]:
    """What is seen along an axis: middles of covered cells, in the plane through the middle, and areas."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    span = size[[j, k]]
    share = _shares(shadow, _CELLS)
    rows, columns = np.nonzero(share)
    points = np.zeros((len(rows), 3))
    points[:, j] = ((columns + 0.5) / _CELLS - 0.5) * span[0]
    points[:, k] = ((rows + 0.5) / _CELLS - 0.5) * span[1]
    return points, share[rows, columns] * span.prod() / _CELLS**2


def _trapped(
    triangles: Float[np.ndarray, "m 3 3"], shadow: np.ndarray, size: Float[np.ndarray, "3"], axis: int, volume: float
) -> float:
    """Volume between the first and the last surface on lines along an axis, less what the solid fills of it [m3]."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    flat = (triangles[:, :, [j, k]] / size[[j, k]] + 0.5) * _RAYS
    first, last = np.full((_RAYS, _RAYS), np.inf), np.full((_RAYS, _RAYS), -np.inf)
    edges = np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2).max(axis=1)
    parts = np.ceil(np.minimum(2.0 * edges, 2.0 * _RAYS)).astype(int) + 1
    for count in np.unique(parts):
        u, v = (g.ravel() for g in np.meshgrid(*2 * [(np.arange(count) + 0.5) / count], indexing="ij"))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        share = np.column_stack([1 - u - v, u, v])
        chosen = parts == count
        cells = np.clip((share @ flat[chosen]).reshape(-1, 2).astype(int), 0, _RAYS - 1)
        depth = (share @ triangles[chosen][:, :, axis, None]).ravel()
        np.minimum.at(first, (cells[:, 0], cells[:, 1]), depth)
        np.maximum.at(last, (cells[:, 0], cells[:, 1]), depth)
    depth = np.where(np.isfinite(first), last - first, 0.0).T
    between = (depth * _shares(shadow, _RAYS)).sum() * size[j] * size[k] / _RAYS**2
    return max(between - _SLACK * volume, 0.0)


def _weights(fill: float, faces: Float[np.ndarray, "3"]) -> Float[np.ndarray, "5"]:
    """Shares of the simple solids that fill the box and its faces alike; they sum to 1."""
    target = np.array([max(fill, np.pi / 6), *np.clip(faces, np.pi / 4, 1.0)])
    from scipy.optimize import nnls

    weights = nnls(np.vstack([_FILL, np.full(5, 10.0)]), np.append(target, 10.0))[0]
    return weights / weights.sum()
