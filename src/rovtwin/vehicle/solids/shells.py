"""Shells: the separate closed surfaces of a mesh, which CAD programs export one for each solid.

Cavities (a pressure hull's inner wall) are no wetted surface; shells may run into each other.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

_CHUNK = 2_000_000  # pairs of points and triangles at a time


def shell_of(faces: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, " m"]:
    """Which shell each triangle is of, by shared vertices."""
    count = int(faces.max()) + 1
    links = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(count, count))
    return np.unique(connected_components(graph, directed=False)[1][faces[:, 0]], return_inverse=True)[1]


def outer_shells(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]
) -> tuple[Int[np.ndarray, "kept 3"], list[str]]:
    """Triangles without cavities, all normals outward, and what was done.

    Args:
        vertices: [m].
        faces: Closed.
    """
    shell = shell_of(faces)
    pieces = [faces[shell == i] for i in range(int(shell.max()) + 1)]
    volumes = np.array([_volume(vertices[piece]) for piece in pieces])
    kept, cavities, turned = [], 0, 0
    for i, piece in enumerate(pieces):
        if volumes[i] > 0:
            kept.append(piece)
        elif any(
            abs(volumes[j]) > abs(volumes[i]) and inside(vertices[piece[0]].mean(0)[None], vertices[other])[0]
            for j, other in enumerate(pieces)
        ):
            cavities += 1
        else:
            kept.append(piece[:, ::-1])
            turned += 1
    notes = [f"normals of {turned} of {len(pieces)} shells pointed inward: turned"] if turned else []
    notes += [f"{cavities} cavities left out: what is in them moves with the body"] if cavities else []
    return np.concatenate(kept), notes


def wet_share(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"] | None:
    """1 for triangles in the water, 0 for those inside another shell; None where all are in the water."""
    shell = shell_of(faces)
    centers = vertices[faces].mean(axis=1)
    dry = np.zeros(len(faces), dtype=bool)
    for i in range(int(shell.max()) + 1) if shell.max() > 0 else ():
        others = np.flatnonzero(shell != i)
        dry[others] |= inside(centers[others], vertices[faces[shell == i]])
    return (~dry).astype(float) if dry.any() else None


def inside(points: Float[np.ndarray, "n 3"], triangles: Float[np.ndarray, "m 3 3"]) -> Bool[np.ndarray, " n"]:
    """Which points a closed surface of triangles goes round.

    By the solid angle of every triangle: Van Oosterom and Strackee (1983), IEEE Trans. Biomed. Eng. 30(2):125.
    """
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    found = ((points > low) & (points < high)).all(axis=1)
    near = np.flatnonzero(found)
    for part in np.array_split(near, max(1, len(near) * len(triangles) // _CHUNK)):
        a, b, c = np.moveaxis(triangles[None] - points[part][:, None, None], 2, 0)
        A, B, C = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
        above = np.einsum("...i,...i", a, np.cross(b, c))
        below = A * B * C + np.sum(a * b, -1) * C + np.sum(b * c, -1) * A + np.sum(c * a, -1) * B
        found[part] = np.abs(np.arctan2(above, below).sum(axis=1)) > np.pi  # half of 2 pi
    return found


def _volume(triangles: Float[np.ndarray, "m 3 3"]) -> float:
    a, b, c = np.moveaxis(triangles, 1, 0)
    return float(np.sum(a * np.cross(b, c)) / 6)
