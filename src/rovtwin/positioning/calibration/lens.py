"""Lens of a camera from pictures of a chessboard.

Reference: Zhang (2000), A flexible new technique for camera calibration, IEEE PAMI 22(11).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.vision import opencv
from rovtwin.vehicle.physics.camera import Lens, lens_from

FEWEST = 3  # pictures; with fewer the focal length cannot be distinguished from the board's tilt


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated lens.

    Attributes:
        lens: The lens.
        std: Of f_x, f_y, c_x, c_y, k_1, k_2, p_1, p_2, k_3, shape (9,).
        rms: Distance of the corners from where the lens puts them, root of the mean square [px].
        points: Corners as found [px], a (n, 2) array for each picture used.
        residuals: Found minus predicted [px], the same shapes.
        used: Pictures in which the board was found.
        notes: Pictures without it, and what should be known of the result.
    """

    lens: Lens
    std: np.ndarray
    rms: float
    points: list[np.ndarray]
    residuals: list[np.ndarray]
    used: list[Path]
    notes: tuple[str, ...]


def calibrate(images: Sequence[Path], board: tuple[int, int], square: float) -> Calibration:
    """Calibrates a camera.

    Args:
        images: Pictures of the board, all from the same camera in the same mode.
        board: Inner corners along its rows and columns.
        square: Side of a square [m].

    Raises:
        ConfigError: Too few pictures with a board, or of different sizes.
    """
    cv2 = opencv()
    size, found, notes = None, [], []
    for path in images:
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            notes.append(f"{path}: cannot be read as a picture, left out")
            continue
        here = (grey.shape[1], grey.shape[0])
        size = size or here
        if here != size:
            raise ConfigError(
                f"{path}: found {here[0]} x {here[1]} pixels, but the pictures before have {size[0]} x {size[1]}. Give "
                "pictures of one mode of one camera"
            )
        corners = _corners(grey, board)
        if corners is None:
            notes.append(f"{path}: no board of {board[0]} x {board[1]} inner corners found, left out")
        else:
            found.append((path, corners))
    if len(found) < FEWEST or size is None:
        raise ConfigError(
            f"found a board of {board[0]} x {board[1]} inner corners in {len(found)} of {len(images)} pictures, "
            f"expected it in at least {FEWEST}. --board counts inner corners, one less than squares along each side"
        )
    return _fitted(found, board, square, size, notes)


def _corners(grey: np.ndarray, board: tuple[int, int]) -> np.ndarray | None:
    """Inner corners, shape (n, 2), or None."""
    cv2 = opencv()
    found, corners = cv2.findChessboardCornersSB(grey, board, flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE)
    return corners.reshape(-1, 2).astype(float) if found else None


def _fitted(
    found: list[tuple[Path, np.ndarray]], board: tuple[int, int], square: float, size: tuple[int, int], notes: list[str]
) -> Calibration:
    cv2 = opencv()
    flat = np.zeros((board[0] * board[1], 3), np.float32)
    flat[:, :2] = square * np.mgrid[: board[0], : board[1]].T.reshape(-1, 2)
    pictures = [corners.astype(np.float32)[:, None] for _, corners in found]
    _, K, d, turns, shifts, std, *_ = cv2.calibrateCameraExtended(
        [flat] * len(found), pictures, size, None, None,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12),
    )  # fmt: skip
    lens = lens_from([K[0, 0], K[1, 1]], [K[0, 2], K[1, 2]], size, d)
    residuals = []
    for (_, corners), turn, shift in zip(found, turns, shifts, strict=True):
        predicted = cv2.projectPoints(flat.astype(float), turn, shift, K, d)[0][:, 0]
        residuals.append(corners - predicted)
    points = [corners for _, corners in found]
    rms = float(np.sqrt(np.mean(np.concatenate([(r**2).sum(axis=1) for r in residuals]))))
    notes += _advice(points, size, rms)
    return Calibration(
        lens, np.asarray(std).ravel()[:9], rms, points, residuals, [path for path, _ in found], tuple(notes)
    )


def _advice(points: list[np.ndarray], size: tuple[int, int], rms: float) -> list[str]:
    """What makes a calibration worth less than its residuals say."""
    every = np.concatenate(points)
    share = np.ptp(every, axis=0) / np.array(size)
    out = []
    if (share < 0.8).any():
        out.append(
            f"the boards cover {100 * share[0]:.0f} % of the width and {100 * share[1]:.0f} % of the height: outside "
            "of that the distortion is a guess. Take pictures with the board in every corner"
        )
    if rms > 1.0:
        out.append(f"residuals of {rms:.2f} px: blurred pictures, a bent board, or a wrong --board")
    return out
