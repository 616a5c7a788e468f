"""Shortest ways round obstacles: a visibility graph of a region's corners.

Reference: Lozano-Perez and Wesley (1979), An algorithm for planning collision-free paths among polyhedral obstacles,
Comm. ACM 22(10).
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.survey.library import shapely_library

TOLERANCE = 1e-3  # ways may touch the region's edge, and rounding goes beyond it [m]


class Ways:
    """Ways within a region."""

    def __init__(self, region: Any) -> None:
        """Lay the graph of a shapely region's corners."""
        from scipy.sparse.csgraph import shortest_path

        shapely = shapely_library()
        self._region = region.buffer(TOLERANCE, join_style="mitre")
        shapely.prepare(self._region)
        self.corners = np.unique(shapely.get_coordinates(region), axis=0)
        seen = self._seen(self.corners, self.corners)
        self._between, self._before = shortest_path(np.where(seen, _far(self.corners, self.corners), np.inf),
                                                    return_predecessors=True)  # fmt: skip

    def lengths(self, a: Float[np.ndarray, "m 2"], b: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m n"]:
        """Lengths of the shortest ways from points (m, 2) to points (n, 2) [m], inf where there is none, (m, n)."""
        straight = np.where(self._clear(a[:, None], b[None]), _far(a, b), np.inf)
        if np.isfinite(straight).all() or not len(self.corners):
            return straight
        out, back = self._to_corners(a), self._to_corners(b)
        reach = _min_plus(out, self._between)
        return np.minimum(straight, _min_plus(reach, back.T))

    def way(self, a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 2"] | None:
        """Corners of the shortest way from a to b, both included; None where there is none."""
        if self._clear(a, b):
            return np.stack([a, b])
        if not len(self.corners):
            return None
        total = self._to_corners(a[None])[0][:, None] + self._between + self._to_corners(b[None])[0][None, :]
        first, last = np.unravel_index(int(np.argmin(total)), total.shape)
        if not np.isfinite(total[first, last]):
            return None
        chain = [int(last)]
        while chain[-1] != first:
            chain.append(int(self._before[first, chain[-1]]))
        return np.concatenate([[a], self.corners[chain[::-1]], [b]])

    def _to_corners(self, points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m corners"]:
        return np.where(self._seen(points, self.corners), _far(points, self.corners), np.inf)

    def _seen(self, a: Float[np.ndarray, "m 2"], b: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "m n"]:
        return np.asarray(self._clear(a[:, None], b[None]))

    def _clear(self, a: Float[np.ndarray, "*m 2"], b: Float[np.ndarray, "*n 2"]) -> Bool[np.ndarray, "..."] | np.bool_:
        """Whether straight lines between points (..., 2) stay in the region, shape (...)."""
        shapely = shapely_library()
        return shapely.covers(self._region, shapely.linestrings(np.stack(np.broadcast_arrays(a, b), axis=-2)))


def _far(a: Float[np.ndarray, "m 2"], b: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m n"]:
    return np.linalg.norm(a[:, None] - b[None], axis=-1)


def _min_plus(a: Float[np.ndarray, "m k"], b: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "m n"]:
    """Shortest sums over the common index."""
    return np.stack([(row[:, None] + b).min(axis=0) for row in a]) if len(a) else np.zeros((0, b.shape[1]))
