"""Corners of a small marker from its whole print: what a camera would show of it is laid over the image.

A search for single corners needs some pixels around each that no other corner comes into. A marker of 20 pixels has no
such: its cells are 3 pixels wide, and its corners come out up to 0.4 px inwards, 5 % of its distance. But what is
printed on it is known once its id is read. The print, blurred by the size of a pixel, is laid over the image by the
homography of its corners; corners, and how ink and paper are lit, follow by Gauss-Newton steps.

Reference: Lucas and Kanade (1981), An iterative image registration technique, IJCAI; Baker and Matthews (2004),
Lucas-Kanade 20 years on, IJCV 56(3).
"""

from functools import lru_cache
from typing import Any

import numpy as np

from rovtwin.core.markers import pattern

_FINE = 8  # pixels of the drawn print along a cell
_RIM = 2  # cells of paper drawn around the marker
_SEEN = 0.5  # of which so many count: whoever cuts prints out leaves that much
_SOFT = 0.42  # standard deviation of an image's softness: a pixel's own width and a little of a lens's [px]
_ROUNDS, _STILL = 6, 0.01  # steps at most; a step that moves no corner further than this is the last [px]
_STEP, _FARTHEST = 1.0, 2.5  # longest step; from where it started, beyond which the fit went astray [px]
_UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  # corners on the print, of its side, y down


def fitted(cv2: Any, linear: np.ndarray, dictionary: str, number: int, corners: np.ndarray) -> np.ndarray | None:
    """Corners of a marker, from nearly where they are.

    Args:
        cv2: OpenCV.
        linear: The image, linear in brightness, uint8 or float32, shape (H, W).
        dictionary: Of the marker.
        number: Its id.
        corners: Nearly [px], shape (4, 2).

    Returns:
        Corners [px], shape (4, 2); None where the print does not fit to the image.
    """
    found, print_ = np.asarray(corners, float), _drawn(dictionary, number)
    cells = len(print_) // _FINE - 2 * _RIM
    cell = np.linalg.norm(found - np.roll(found, 1, axis=0), axis=1).mean() / cells
    print_ = cv2.GaussianBlur(print_, (0, 0), _SOFT * _FINE / cell)
    low = np.maximum(np.floor(found.min(axis=0) - cell), 0).astype(int)
    high = np.ceil(found.max(axis=0) + cell).astype(int) + 1
    image = linear[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    if min(image.shape) < 2 * cells:
        return None
    for _ in range(_ROUNDS):
        step = _step(cv2, image, print_, found - low, cells)
        if step is None:
            return None
        found = found + np.clip(step, -_STEP, _STEP)
        if np.abs(step).max() < _STILL:
            break
    return found if np.abs(found - corners).max() < _FARTHEST else None


@lru_cache(maxsize=256)
def _drawn(dictionary: str, number: int) -> np.ndarray:
    """The print with some paper around, 0 is ink and 1 paper, float32."""
    paper = np.pad(~pattern(dictionary, number), _RIM, constant_values=True)
    return np.kron(paper, np.ones((_FINE, _FINE))).astype(np.float32)


def _step(cv2: Any, image: np.ndarray, print_: np.ndarray, corners: np.ndarray, cells: int) -> np.ndarray | None:
    """One Gauss-Newton step of the corners, shape (4, 2) [px]."""
    side, edge = cells * _FINE, _RIM * _FINE - 0.5  # pixel centres are whole
    H = cv2.getPerspectiveTransform((side * _UNIT + edge).astype(np.float32), corners.astype(np.float32))
    height, width = image.shape
    shown = cv2.warpPerspective(print_, H, (width, height), flags=cv2.INTER_LINEAR, borderValue=1.0)
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    back = np.linalg.inv(H) @ np.stack([column.ravel(), row.ravel(), np.ones(image.size)])
    u, v = (back[:2] / back[2] - edge) / side
    rim = _SEEN / cells
    on = (u > -rim) & (u < 1 + rim) & (v > -rim) & (v < 1 + rim)
    down, right = np.gradient(shown)
    u, v, shown, down, right, seen = (x.ravel()[on] for x in (u, v, shown, down, right, image))
    plane = np.stack([np.ones_like(u), u - 0.5, v - 0.5], axis=1)  # light is uneven
    lit = np.concatenate([plane, plane * shown[:, None]], axis=1)
    light = _solved(lit, seen)
    if light is None:
        return None
    contrast = plane @ light[3:]
    share = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)  # of a corner's shift, at a pixel
    J = np.concatenate([-(contrast * right)[:, None] * share, -(contrast * down)[:, None] * share, lit], axis=1)
    change = _solved(J, seen - lit @ light)
    return None if change is None else change[:8].reshape(2, 4).T


def _solved(A: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """Least squares, or None where nothing tells."""
    try:
        x = np.linalg.solve(A.T @ A, A.T @ b)
    except np.linalg.LinAlgError:
        return None
    return x if np.isfinite(x).all() else None
