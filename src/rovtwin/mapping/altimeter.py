"""The floor as the vehicle's own altimeter sounded it: hits along its track, and the likeliest smooth surface between.

Heights are a plane and a Gaussian process of Matern's covariance, 5/2 times differentiable, with noise; its three
numbers are those of greatest likelihood. It says how unsure it is: little under the track, more between two lines.

Reference: Rasmussen and Williams (2006), Gaussian Processes for Machine Learning, eq. 2.25, 2.26, 2.30, 4.17.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RegularGridInterpolator
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from rovtwin.core.errors import LogError
from rovtwin.mapping.floors import GridFloor
from rovtwin.mapping.navigation import Navigation

_FEWEST, _MOST = 12, 600  # hits: that make a surface, that it goes through
_TOGETHER, _GROUPS = 48, 12  # hits whose joint likelihood is counted, and how many such groups
_FIRST = 0.10  # side of the cells in which hits are averaged [m]; coarser where there are too many
_BEYOND = 6.0  # robust standard deviations from the median of its neighbours: no echo of the floor


@dataclass(frozen=True)
class Altimeter:
    """Where a vehicle's altimeter sits.

    Attributes:
        position: b [m].
        direction: Of its beam, unit vector, b.
        noise: Standard deviation of a range [m].
    """

    position: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    noise: float = 0.01


@dataclass(frozen=True)
class Surface:
    """A surface of greatest likelihood through hits.

    Attributes:
        floor: As a grid, with standard deviations.
        hits: That it goes through, averaged in cells, n [m].
        scale: Standard deviation of the floor about its plane [m].
        length: Over which it varies [m].
        noise: Of a cell's hit [m].
        dropped: Echoes left out, far from all about them, or without a pose.
    """

    floor: GridFloor
    hits: Float[np.ndarray, "k 3"]
    scale: float
    length: float
    noise: float
    dropped: int


def altimeter_hits(
    navigation: Navigation, altimeter: Altimeter, t: Float[np.ndarray, " n"], ranges: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "m 3"], int]:
    """Where echoes at times [s] came from, n [m], and how many were left out.

    Left out is what has no pose, no range, and what lies far from the median of the ten echoes about it.
    """
    good = np.isfinite(ranges) & (ranges > 0) & np.isfinite(t)
    poses = navigation.at(t[good])
    lever = altimeter.position + ranges[good][:, None] * altimeter.direction
    points = (poses.position + np.einsum("nij,nj->ni", poses.rotation, lever))[poses.valid]
    if len(points) > 20:
        away = points[:, 2] - _running_median(points[:, 2], 5)
        spread = 1.4826 * np.median(np.abs(away - np.median(away)))
        points = points[np.abs(away) <= _BEYOND * max(spread, altimeter.noise)]
    return points, len(t) - len(points)


def _running_median(x: Float[np.ndarray, " n"], half: int) -> Float[np.ndarray, " n"]:
    padded = np.pad(x, half, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)


def surface_through(
    hits: Float[np.ndarray, "n 3"],
    low: Float[np.ndarray, "2"],
    high: Float[np.ndarray, "2"],
    noise: float,
    dropped: int = 0,
) -> Surface:
    """The likeliest smooth floor through hits, over a box of north and east [m].

    Args:
        hits: n [m].
        low: Of the box.
        high: Of the box.
        noise: Standard deviation of one hit's depth [m], where to begin.
        dropped: For the report.

    Raises:
        LogError: There are too few.
    """
    if len(hits) < _FEWEST:
        raise LogError(f"altimeter: found {len(hits)} echoes, expected {_FEWEST} or more. Say --floor plane or a file")
    cells = _averaged(hits)
    plane = _plane(cells)
    left = cells[:, 2] - _on_plane(plane, cells[:, :2])
    scale, length, sigma = _likeliest(cells[:, :2], left, noise)
    K = _matern(cdist(cells[:, :2], cells[:, :2]), scale, length) + sigma**2 * np.eye(len(cells))
    factor = cho_factor(K, lower=True)
    weights = cho_solve(factor, left)
    step = float(np.clip(0.1 * length, 0.05, 0.25))
    axes, coarse = (
        [np.linspace(a, b, max(int(np.ceil((b - a) / h)) + 1, 8)) for a, b in zip(low, high, strict=True)]
        for h in (step, max(step, 0.15))
    )
    depth, spread = np.empty([len(x) for x in axes]), np.empty([len(x) for x in coarse])
    for i, north in enumerate(axes[0]):
        part = np.column_stack([np.full(len(axes[1]), north), axes[1]])
        depth[i] = _on_plane(plane, part) + _matern(cdist(part, cells[:, :2]), scale, length) @ weights
    for i, north in enumerate(coarse[0]):
        part = np.column_stack([np.full(len(coarse[1]), north), coarse[1]])
        known = solve_triangular(factor[0], _matern(cdist(cells[:, :2], part), scale, length), lower=True)
        spread[i] = np.sqrt(np.maximum(scale**2 - np.sum(known * known, axis=0), 0.0))
    between = RegularGridInterpolator(coarse, spread)(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    floor = GridFloor(axes[0], axes[1], depth, between, None, "altimeter's track")
    return Surface(floor, cells, scale, length, sigma, dropped)


def _averaged(hits: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k 3"]:
    """Means of the hits in square cells, as many as a surface goes through at most."""
    side = _FIRST
    while True:
        _, which = np.unique(np.floor(hits[:, :2] / side).astype(int), axis=0, return_inverse=True)
        count = np.bincount(which.ravel())
        if len(count) <= _MOST:
            return np.column_stack([np.bincount(which.ravel(), hits[:, i]) / count for i in range(3)])
        side *= 1.3


def _plane(hits: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "3"]:
    """Of least squares; level where the hits lie on one line."""
    A = np.column_stack([np.ones(len(hits)), hits[:, :2] - hits[:, :2].mean(0)])
    found = np.linalg.lstsq(A, hits[:, 2], rcond=0.05)[0]  # a slope across a single line is none that is known
    return np.array([found[0] - found[1:] @ hits[:, :2].mean(0), *found[1:]])


def _on_plane(plane: Float[np.ndarray, "3"], place: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    return plane[0] + place @ plane[1:]


def _matern(distance: np.ndarray, scale: float, length: float) -> np.ndarray:
    """Eq. 4.17: Matern, nu = 5/2."""
    x = np.sqrt(5.0) * distance / length
    return scale**2 * (1.0 + x + x * x / 3.0) * np.exp(-x)


def _likeliest(
    place: Float[np.ndarray, "m 2"], left: Float[np.ndarray, " m"], noise: float
) -> tuple[float, float, float]:
    """Scale, length and noise of the greatest likelihood, eq. 2.30, each within what floors have.

    Counted is that of groups of neighbours, each by itself: many small matrices are quicker than one large.
    """
    size = min(_TOGETHER, len(left))
    begins = np.unique(np.linspace(0, len(left) - size, _GROUPS).astype(int))
    group = begins[:, None] + np.arange(size)
    distance = np.linalg.norm(place[group][:, :, None] - place[group][:, None], axis=-1)
    low, high = np.log([1e-3, 0.3, 0.1 * noise]), np.log([5.0, 30.0, max(10.0 * noise, 0.1)])

    def cost(theta: np.ndarray) -> float:
        scale, length, sigma = np.exp(np.clip(theta, low, high))
        K = _matern(distance, scale, length) + (sigma**2 + 1e-10) * np.eye(size)
        try:
            factor = np.linalg.cholesky(K)
        except np.linalg.LinAlgError:
            return 1e10
        white = np.linalg.solve(factor, left[group][..., None])
        return float(0.5 * np.sum(white**2) + np.log(np.diagonal(factor, axis1=1, axis2=2)).sum())

    begin = np.log([max(float(np.std(left)), 0.005), 2.0, noise])
    found = minimize(cost, begin, method="Nelder-Mead", options={"maxiter": 120, "xatol": 0.02, "fatol": 0.05})
    scale, length, sigma = np.exp(np.clip(found.x, low, high))
    return float(scale), float(length), float(sigma)
