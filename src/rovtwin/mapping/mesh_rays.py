"""Where rays first meet a triangle mesh: a tree of boxes over triangles sorted along a curve, in double precision.

Trimesh's own rays need rtree or embree, which nothing else here needs. An edge belongs to both of its triangles, so
that no ray slips through between two.

References: Möller and Trumbore (1997), Fast, minimum storage ray/triangle intersection, J. Graphics Tools 2(1).
Lauterbach et al. (2009), Fast BVH construction on GPUs, Computer Graphics Forum 28(2), for the order by Morton code.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

_LEAF = 4  # triangles
_BITS = 16  # of each axis of the curve
_EDGE = 1e-9  # share of a triangle by which its edges are widened
_WIDER = 1e-9  # by which boxes are [m]
_AT_ONCE = 16384  # rays: memory goes with them
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Tree:
    """Of boxes over triangles.

    Attributes:
        corners: Of the triangles, in the order of the leaves.
        levels: Low and high corners of the boxes, the whole first, the leaves last; below a box i lie 2 i
            and 2 i + 1.
    """

    corners: Float[np.ndarray, "m 3 3"]
    levels: list[tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]]

    @classmethod
    def of(cls, corners: Float[np.ndarray, "m 3 3"]) -> "Tree":
        """Over at least one triangle."""
        corners = corners[np.argsort(_along_curve(corners.mean(axis=1)), kind="stable")]
        levels = [_boxes(corners.min(axis=1) - _WIDER, corners.max(axis=1) + _WIDER, _LEAF)]
        while len(levels[-1][0]) > 1:
            levels.append(_boxes(*levels[-1], 2))
        return cls(corners, levels[::-1])

    def first(
        self, origin: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"], longest: float
    ) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Ways of rays to what they meet first, no longer than `longest`, and which triangle; inf and -1 for misses."""
        way, which = np.full(len(origin), np.inf), np.full(len(origin), -1)
        known = np.flatnonzero(np.isfinite(origin).all(axis=1) & np.isfinite(direction).all(axis=1))
        for begin in range(0, len(known), _AT_ONCE):
            some = known[begin : begin + _AT_ONCE]
            way[some], which[some] = self._first(origin[some], direction[some], longest)
        return way, which

    def _first(self, origin: np.ndarray, direction: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
        ray, leaf = self._leaves(origin, direction, longest)
        ray = np.repeat(ray, _LEAF)
        triangle = (leaf[:, None] * _LEAF + np.arange(_LEAF)).ravel()
        there = triangle < len(self.corners)
        ray, triangle = ray[there], triangle[there]
        t = _ways(origin[ray], direction[ray], self.corners[triangle])
        met = np.flatnonzero((t > 0.0) & (t <= longest))
        met = met[np.argsort(t[met], kind="stable")]
        met = met[np.argsort(ray[met], kind="stable")]  # of each ray the nearest comes first
        met = met[np.flatnonzero(np.diff(ray[met], prepend=-1))]
        way, which = np.full(len(origin), np.inf), np.full(len(origin), -1)
        way[ray[met]], which[ray[met]] = t[met], triangle[met]
        return way, which

    def _leaves(self, origin: np.ndarray, direction: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of a ray and a leaf whose box it goes through."""
        over = 1.0 / np.where(np.abs(direction) < _TINY, _TINY, direction)
        ray: Any = np.arange(len(origin))
        box: Any = np.zeros(len(origin), int)
        for depth, (low, high) in enumerate(self.levels):
            if depth:
                ray, box = np.repeat(ray, 2), (2 * box[:, None] + [0, 1]).ravel()
                there = box < len(low)
                ray, box = ray[there], box[there]
            with np.errstate(over="ignore", invalid="ignore"):
                a, b = (low[box] - origin[ray]) * over[ray], (high[box] - origin[ray]) * over[ray]
            enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            through = (enter <= leave) & (leave >= 0.0) & (enter <= longest)
            ray, box = ray[through], box[through]
        return ray, box


def _boxes(low: np.ndarray, high: np.ndarray, together: int) -> tuple[np.ndarray, np.ndarray]:
    """About so many boxes each, in order."""
    begins = np.arange(0, len(low), together)
    return np.minimum.reduceat(low, begins, axis=0), np.maximum.reduceat(high, begins, axis=0)


def _ways(
    origin: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"], corners: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, " n"]:
    """Of each ray to its triangle; no number where it passes by or along it."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p, to = np.cross(direction, b), origin - corners[:, 0]
    size = np.sum(a * p, axis=1)
    q = np.cross(to, a)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = np.sum(to * p, axis=1) / size, np.sum(direction * q, axis=1) / size
        t = np.sum(b * q, axis=1) / size
        return np.where((u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1.0 + _EDGE), t, np.nan)


def _along_curve(place: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, " m"]:
    """Numbers of places along a Morton curve: near ones are near in space."""
    low, size = place.min(axis=0), max(float(np.ptp(place, axis=0).max()), _TINY)
    cell = ((place - low) / size * (2**_BITS - 1)).astype(np.int64)
    code = np.zeros(len(place), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code
