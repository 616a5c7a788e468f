"""Finding printed markers in an image: OpenCV's ArUco detector, set to be quick and exact at 1080p.

One adaptive threshold instead of three takes a third of the time and finds the same markers. Two things put corners
off, and a marker nearer or further than it is. A camera's tone curve brightens what lies halfway between ink and paper,
so that black seems smaller: corners are sought in an image in which it is undone. And blur rounds a corner off: what is
next to it is left out, and the sides beyond it say where they meet. The half width of the window follows the marker's
cells, so that no other corner comes into it. Of a small marker nothing is left then: its whole print is laid over the
image (`print_fit`).

Reference: Garrido-Jurado et al. (2014), Automatic generation and detection of highly reliable fiducial markers under
occlusion, Pattern Recognition 47(6); Collins and Bartoli (2014), Infinitesimal plane-based pose estimation, IJCV 109.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from rovtwin.core.frames import rotation_from_vector, skew
from rovtwin.core.markers import CORNERS
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Index, Matrix3, Scalar, Vector3, Vector6
from rovtwin.core.vision import opencv
from rovtwin.positioning.images.print_fit import fitted
from rovtwin.vehicle.physics.camera import Lens, project, ray

THRESHOLD_WINDOW = 13  # [px]; of the settings tried, the one that keeps markers of 20 px
APART = 0.05  # of the perimeter; at OpenCV 5's 0.125 the edge of the paper hides the marker on it now and then
CORNER_WINDOW, CORNER_SHARE = 12, 0.7  # half width of the corner search: at most [px], and in cells of the marker
ROUNDED = 1  # [px] on either side of a corner that its sides say nothing about; kept in windows too small to lose it
TONE = 2.2  # exponent of the tone curve that cameras put on their images
SMALL = 40.0  # sides below this are found by the whole print [px]; beyond it single corners are as good, and quicker
LARGE = 60.0  # sides from which a marker's cells may be wider than the threshold's window [px]
SMALLEST = 0.02  # perimeter over the longer side of the image; 0.03 loses a marker of 0.15 m beyond 8 m
_FLAT = 5.0  # standard deviation of grey levels below which there is no print; OpenCV's own limit
_BATCH = 8  # poses are computed so many at a time, so that they are compiled once
_REFINE = 6  # Gauss-Newton steps; a pose from straight rays is off by little
_SAME = 0.05  # poses that differ by less are one solution [rad]


@dataclass(frozen=True, eq=False)
class Detections:
    """Markers found in one image.

    Attributes:
        ids: What is printed on each.
        corners: As the lens shows them, distorted [px]; top left, top right, bottom right, bottom
            left of the upright print.
    """

    ids: Int[np.ndarray, " n"]
    corners: Float[np.ndarray, "n 4 2"]

    @classmethod
    def none(cls) -> "Detections":
        return cls(np.zeros(0, int), np.zeros((0, 4, 2)))

    @property
    def duplicated(self) -> Bool[np.ndarray, " n"]:
        """Which of them share their id with another in the same image: a copy or a reflection."""
        return (self.ids[:, None] == self.ids).sum(axis=1) > 1


class Detector:
    """Finds the markers of one dictionary.

    Args:
        dictionary: Name, such as DICT_4X4_50.
        tone: Exponent of the camera's tone curve; 1 for images that are linear in brightness.
        settings: Of `cv2.aruco.DetectorParameters`, by name, over those chosen here.
    """

    def __init__(self, dictionary: str = "DICT_4X4_50", tone: float = TONE, **settings: Any):
        aruco = opencv().aruco
        parameters = aruco.DetectorParameters()
        chosen = {
            "adaptiveThreshWinSizeMin": THRESHOLD_WINDOW,
            "adaptiveThreshWinSizeMax": THRESHOLD_WINDOW,
            "minMarkerPerimeterRate": SMALLEST,
            "minMarkerDistanceRate": APART,
            "cornerRefinementMethod": aruco.CORNER_REFINE_NONE,
        }
        for name, value in (chosen | settings).items():
            setattr(parameters, name, value)
        cells = aruco.getPredefinedDictionary(getattr(aruco, dictionary))
        self._detector, self._cells = aruco.ArucoDetector(cells, parameters), cells.markerSize + 2
        self._dictionary_cells = cells
        self._dictionary = dictionary
        self._linear = np.round(255.0 * (np.arange(256) / 255.0) ** tone).astype(np.uint8)

    def __call__(self, image: UInt8[np.ndarray, "..."]) -> Detections:
        """Markers in an image, grey or RGB, uint8."""
        cv2 = opencv()
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        grey = np.ascontiguousarray(grey)
        corners, ids, others = self._detector.detectMarkers(grey)
        numbers = [] if ids is None else np.asarray(ids).ravel().astype(int).tolist()
        found = [(n, np.asarray(one).reshape(4, 2)) for n, one in zip(numbers, corners, strict=True)]
        found += self._overlooked(grey, [np.asarray(quad).reshape(4, 2) for quad in others], found)
        if not found:
            return Detections.none()
        linear = cv2.LUT(grey, self._linear)
        exact = [self._refined(linear, number, one) for number, one in found]
        return Detections(np.array([number for number, _ in found]), np.array(exact, dtype=float))

    def _overlooked(
        self, grey: UInt8[np.ndarray, "h w"], quads: list[np.ndarray], found: list[Any]
    ) -> list[tuple[int, np.ndarray]]:
        """Markers among the large squares that OpenCV has not read.

        A black cell that stands alone in white is a square with a square in it once it is wider than the threshold's
        window; OpenCV then reads the inner squares and not the marker around them. Every bit must be right.
        """
        more: list[tuple[int, np.ndarray]] = []
        for quad in quads:
            side = np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).min()
            if side < LARGE or any(np.linalg.norm(quad.mean(axis=0) - c.mean(axis=0)) < side / 2 for _, c in found):
                continue
            if (read := self._read(grey, quad)) is not None:
                more.append(read)
        return more

    def _read(self, grey: UInt8[np.ndarray, "h w"], quad: np.ndarray) -> tuple[int, np.ndarray] | None:
        """Id of the print in a square and its corners from the top left one of the print; None where it is no print."""
        cv2, wide, n = opencv(), 8, self._cells
        end = wide * n - 0.5
        flat = np.array([[-0.5, -0.5], [end, -0.5], [end, end], [-0.5, end]], np.float32)
        H = cv2.getPerspectiveTransform(quad.astype(np.float32), flat)
        seen = cv2.warpPerspective(grey, H, (wide * n, wide * n))
        if seen.std() < _FLAT:
            return None
        level, _ = cv2.threshold(seen, 0, 255, cv2.THRESH_OTSU)
        middle = slice(wide // 4, wide - wide // 4)
        bits = seen.reshape(n, wide, n, wide)[:, middle, :, middle].mean(axis=(1, 3)) > level
        if bits.sum() > bits[1:-1, 1:-1].sum():  # the border is black
            return None
        known, number, turns = self._dictionary_cells.identify(bits[1:-1, 1:-1].astype(np.uint8), 0.0)
        return (int(number), np.roll(quad, turns, axis=0)) if known else None

    def _refined(self, linear: UInt8[np.ndarray, "h w"], number: int, corners: np.ndarray) -> np.ndarray:
        """Corners of one marker to a fraction of a pixel."""
        cv2 = opencv()
        side = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).min()
        half = int(np.clip(CORNER_SHARE * side / self._cells, 1, CORNER_WINDOW))
        rounded = ROUNDED if half > 2 * ROUNDED else -1
        points = corners.astype(np.float32)[:, None].copy()
        # First coarsely: the threshold's corner of a small marker may lie outside of the window that ends the search.
        for reach, left_out, rounds, exact in ((half + 1, -1, 5, 0.1), (half, rounded, 30, 0.01)):
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, rounds, exact)
            points = cv2.cornerSubPix(linear, points, (reach, reach), (left_out, left_out), stop)
        by_print = fitted(cv2, linear, self._dictionary, number, points[:, 0]) if side < SMALL else None
        return points[:, 0] if by_print is None else by_print


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of markers before a camera, each with its two solutions, the better first.

    A small flat square looks nearly the same tilted one way or the other; how much worse the second solution fits is
    how sure the first is.

    Attributes:
        t_cm: Middle of the marker in c [m].
        R_cm: Map m to c.
        error: rms distance of the four corners [px].
    """

    t_cm: Float[np.ndarray, "n 2 3"]
    R_cm: Float[np.ndarray, "n 2 3 3"]
    error: Float[np.ndarray, "n 2"]

    @property
    def ambiguity(self) -> Float[np.ndarray, " n"]:
        """Error of the better solution over that of the other: near 1, it may be either."""
        return self.error[:, 0] / np.maximum(self.error[:, 1], 1e-12)


def poses(lens: Lens, corners: Float[np.ndarray, "n 4 2"], sizes: Float[np.ndarray, " n"]) -> Poses:
    """Poses of markers from their corners.

    IPPE on undistorted corners gives two solutions; both are then fitted to the corners through lens and port.

    Args:
        lens: The camera's.
        corners: [px].
        sizes: Sides of the markers [m].
    """
    n = len(corners)
    t, R, error = np.zeros((n, 2, 3)), np.zeros((n, 2, 3, 3)), np.zeros((n, 2))
    for begin in range(0, n, _BATCH):
        part = slice(begin, min(begin + _BATCH, n))
        rows = part.stop - begin
        pixels, side = np.tile(corners[part][:1], (_BATCH, 1, 1)), np.full(_BATCH, float(sizes[begin]))
        pixels[:rows], side[:rows] = corners[part], sizes[part]
        guess = _ippe(np.asarray(_straight(lens, jnp.asarray(pixels)))[:rows], side[:rows])
        start = [np.concatenate([g, np.repeat(g[:1], _BATCH - rows, axis=0)]) for g in guess]
        fitted = _fit(lens, jnp.asarray(pixels), jnp.asarray(side), *map(jnp.asarray, start))
        t[part], R[part], error[part] = _best_two(*(np.asarray(x)[:rows] for x in fitted))
    return Poses(t, R, error)


def _best_two(
    t: Float[np.ndarray, "n s 3"], R: Float[np.ndarray, "n s 3 3"], error: Float[np.ndarray, "n s"]
) -> tuple[Float[np.ndarray, "n 2 3"], Float[np.ndarray, "n 2 3 3"], Float[np.ndarray, "n 2"]]:
    """The best of several fits, and the best that is another pose; none such has the error infinity."""
    rows, best = np.arange(len(t)), error.argmin(axis=1)
    same = np.einsum("nsij,nij->ns", R, R[rows, best]) > 1.0 + 2.0 * np.cos(_SAME)
    others = np.where(same, np.inf, error)
    pick = rows[:, None], np.stack([best, others.argmin(axis=1)], axis=1)
    return t[pick], R[pick], np.stack([error[rows, best], others.min(axis=1)], axis=1)


@jax.jit
def _straight(lens: Lens, pixels: Float[Array, "*axes 2"]) -> Float[Array, "*axes 2"]:
    """Corners in units of the focal length without lens and, nearly, without port."""
    _, direction = ray(lens, pixels)
    return direction[..., :2] / direction[..., 2:]


def _ippe(
    corners: Float[np.ndarray, "n 4 2"], sizes: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3 3 3"]]:
    """Three guesses for each marker: both solutions, and facing the camera; t_cm and R_cm.

    OpenCV's solutions are no numbers, or none at all, for a marker that faces the camera exactly.
    """
    cv2 = opencv()
    R = np.tile(np.diag([1.0, -1.0, -1.0]), (len(corners), 3, 1, 1))
    across = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1)
    away = sizes * np.sqrt(2.0) / np.maximum(across, 1e-6)
    middle = np.concatenate([corners.mean(axis=1), np.ones((len(corners), 1))], axis=1)
    t = np.repeat((away[:, None] * middle)[:, None], 3, axis=1)
    for k, (xy, size) in enumerate(zip(corners, sizes, strict=True)):
        try:
            _, turns, shifts, _ = cv2.solvePnPGeneric(
                size * CORNERS, xy[:, None], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE
            )
        except cv2.error:
            continue
        for solution, (turn, shift) in enumerate(zip(turns, shifts, strict=True)):
            if np.isfinite(turn).all() and np.isfinite(shift).all() and shift[2] > 0:
                R[k, solution], t[k, solution] = cv2.Rodrigues(turn)[0], shift.ravel()
    return t, R


@jax.jit
def _fit(
    lens: Lens,
    pixels: Float[Array, "n 4 2"],
    sizes: Float[Array, " n"],
    t: Float[Array, "n 3 3"],
    R: Float[Array, "n 3 3 3"],
) -> tuple[Float[Array, "n 3 3"], Float[Array, "n 3 3 3"], Float[Array, "n 3"]]:
    """Poses that fit the corners best, from three guesses for each: t, R, rms error [px]."""

    def one(corners: Float[Array, "4 2"], size: Scalar, t: Vector3, R: Matrix3) -> tuple[Vector3, Matrix3, Scalar]:
        flat = size * jnp.asarray(CORNERS)

        def residual(step: Vector6, t: Vector3, R: Matrix3) -> Float[Array, "8"]:
            return (project(lens, flat @ (R @ rotation_from_vector(step[3:])).T + t + step[:3]) - corners).reshape(8)

        def newton(_: Index, pose: tuple[Vector3, Matrix3]) -> tuple[Vector3, Matrix3]:
            t, R = pose
            e, J = residual(jnp.zeros(6), t, R), pose_slope(lens, flat, t, R)
            step = -jnp.linalg.solve(J.T @ J + 1e-6 * jnp.diag(jnp.diagonal(J.T @ J)), J.T @ e)
            return t + step[:3], R @ rotation_from_vector(step[3:])

        t, R = jax.lax.fori_loop(0, _REFINE, newton, (t, R))
        e = residual(jnp.zeros(6), t, R)
        return t, R, jnp.where(jnp.isfinite(e).all(), jnp.sqrt(jnp.sum(e**2) / 4.0), jnp.inf)

    both = jax.vmap(one, in_axes=(None, None, 0, 0))
    return jax.vmap(both)(pixels, sizes, t, R)


def pose_slope(lens: Lens, flat: Float[Array, "4 3"], t: Vector3, R: Matrix3) -> Float[Array, "8 6"]:
    """Derivative of the corners' pixels by shift (c) and turn (m) of a marker [px/m, px/rad]."""
    slope = jax.vmap(jax.jacfwd(lambda p: project(lens, p)))(flat @ R.T + t)
    return jnp.concatenate([slope, -slope @ R @ jax.vmap(skew)(flat)], axis=-1).reshape(8, 6)
