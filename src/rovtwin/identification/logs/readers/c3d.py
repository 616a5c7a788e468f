"""C3D: rigid bodies as the file has them, or a body put through its markers by least squares.

Without rotations in the file the attitude follows from at least three markers whose places in b are given
(`markers: {label: [x, y, z]}`). The laboratory is taken as z up.

Reference: Kabsch (1976), A solution for the best rotation to relate two sets of vectors, Acta Cryst. A32:922; Arun,
Huang and Blostein (1987) for the translation.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import require
from rovtwin.core.user_files.config import near
from rovtwin.identification.logs.readers.qtm import MATRIX, PLACE, pose_signals
from rovtwin.identification.logs.readers.raw import Raw, Table

_FLU = np.array([1.0, -1.0, -1.0])
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


def read_c3d(path: Path, body: str | None, markers: dict[str, list[float]] | None) -> Raw:
    """Position and attitude of one rigid body of a C3D file.

    Args:
        path: The file.
        body: Label of the rotation, where the file has several.
        markers: Places of the markers in b [m]; None: the file's own rotations.
    """
    require("ezc3d", "c3d", f"{path}: C3D")
    import ezc3d

    try:
        file: Any = ezc3d.c3d(str(path))
        points, rate = np.asarray(file["data"]["points"]), float(file["header"]["points"]["frame_rate"])
        rotations = np.asarray(file["data"]["rotations"])
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        raise IdentificationError(f"{path}: cannot be read as C3D ({error})") from None
    scale = _millimetres(file, path)
    if markers is not None:
        labels = [str(label) for label in file["parameters"]["POINT"]["LABELS"]["value"]]
        block, note = _through_markers(points[:3] * scale, labels, markers, path)
        bodies = {body or "body": block}
    elif rotations.size:
        labels = [str(label) for label in file["parameters"]["ROTATION"]["LABELS"]["value"]]
        bodies, note = {label: _pose(rotations[:, :, i], scale) for i, label in enumerate(labels)}, ""
    else:
        raise IdentificationError(
            f"{path}: holds markers but no rotations; give 'markers: {{label: [x, y, z]}}', their places in b [m]"
        )
    columns, notes = (*PLACE, *MATRIX), [note] if note else []
    tables = {n: Table(v, columns, np.arange(len(v)) / _rate_of(rate, points, v)) for n, v in bodies.items()}
    return Raw(path, tables, pose_signals(path, list(tables), body), notes=tuple(notes))


def _rate_of(rate: float, points: Float[np.ndarray, "_ _ _"], values: Float[np.ndarray, "n k"]) -> float:
    """Rotations may have a rate of their own, a whole multiple of the points'."""
    return rate * max(1, round(len(values) / points.shape[2])) if points.shape[2] else rate


def _millimetres(file: Any, path: Path) -> float:
    units = file["parameters"]["POINT"].get("UNITS", {"value": ["mm"]})["value"]
    unit = str(units[0]).strip() if len(units) else "mm"
    if unit not in MILLIMETRES:
        raise IdentificationError(f"{path}: POINT:UNITS is {unit!r}, expected mm, cm or m")
    return MILLIMETRES[unit]


def _pose(matrices: Float[np.ndarray, "4 4 n"], scale: float) -> Float[np.ndarray, "n 12"]:
    """Columns of `qtm`: X, Y, Z [mm] and the matrix column by column, of 4x4 transforms."""
    turned = np.moveaxis(matrices, 2, 0)
    block = np.column_stack([turned[:, :3, 3] * scale, turned[:, :3, :3].transpose(0, 2, 1).reshape(-1, 9)])
    block[~(np.abs(block[:, -9:]).sum(axis=1) > 0.5)] = np.nan
    return block


def _through_markers(
    points: Float[np.ndarray, "3 points n"], labels: list[str], markers: dict[str, list[float]], path: Path
) -> tuple[Float[np.ndarray, "n 12"], str]:
    """The same columns from markers [mm], and a note on how well they fit."""
    unknown = [name for name in markers if name not in labels]
    if unknown:
        raise IdentificationError(f"{path}: no marker {unknown[0]!r}.{near(unknown[0], labels)}")
    seen = points[:, [labels.index(name) for name in markers]].transpose(2, 1, 0)
    model = np.array(list(markers.values())) * _FLU * 1000.0
    if np.linalg.matrix_rank(model - model.mean(axis=0), tol=1.0) < 2:
        raise IdentificationError(f"{path}: markers: found {len(model)} on a line, expected at least 3 that are not")
    block, residuals = np.full((len(seen), 12), np.nan), []
    for i, frame in enumerate(seen):
        visible = np.isfinite(frame).all(axis=1) & (np.abs(frame).sum(axis=1) > 0)
        if visible.sum() < 3 or np.linalg.matrix_rank(model[visible] - model[visible].mean(axis=0), tol=1.0) < 2:
            continue
        R, p = rigid_fit(model[visible], frame[visible])
        block[i] = np.concatenate([p, R.T.ravel()])
        residuals.append(np.sqrt(np.mean((model[visible] @ R.T + p - frame[visible]) ** 2)))
    if not residuals:
        raise IdentificationError(f"{path}: never are 3 of the markers {', '.join(markers)} seen together")
    return block, f"{path}: body through {len(model)} markers, residual rms {np.median(residuals):.2f} mm"


def rigid_fit(
    model: Float[np.ndarray, "n 3"], seen: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """R and p that minimise |R model_i + p - seen_i|^2, n >= 3.

    Kabsch (1976): from the singular vectors of the covariance, the smallest one turned so that det R = 1.
    """
    centre_model, centre_seen = model.mean(axis=0), seen.mean(axis=0)
    U, _, Vt = np.linalg.svd((model - centre_model).T @ (seen - centre_seen))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])
    R = Vt.T @ flip @ U.T
    return R, centre_seen - R @ centre_model
