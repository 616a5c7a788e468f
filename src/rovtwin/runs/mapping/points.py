"""Places whose spectra are asked for, or that show what there is; beside them the truth where a scene knows it."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_erosion

from rovtwin.core.datum import Datum
from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.projection import Projection
from rovtwin.runs.mapping.columns import POINTS, columns_of
from rovtwin.runs.mapping.result import Mosaic
from rovtwin.simulation.imager.ground import Ground
from rovtwin.simulation.scene import Scene

RADIUS = 0.04  # of the circle whose cells make a spectrum [m]
_INSIDE, _ALIKE = 4, 0.35  # cells from an edge; by how much of its largest value neighbours may differ
_SHOWN, _APART = 5, 0.4  # places that are shown where none are asked for, and how far apart at least [m]


@dataclass(frozen=True)
class Point:
    """A place with its spectrum.

    Attributes:
        name: For people.
        place: North and east [m].
        value: Of the mosaic by band; no number where masked or not seen.
        spread: Standard deviation over its cells.
        truth: Of the scene, the mean over the same circle; None where nobody knows.
    """

    name: str
    place: Float[np.ndarray, "2"]
    value: Float[np.ndarray, " band"]
    spread: Float[np.ndarray, " band"]
    truth: Float[np.ndarray, " band"] | None


def read_points(path: Path, datum: Datum) -> list[tuple[str, Float[np.ndarray, "2"]]]:
    """Names and places of a CSV file: name,north,east [m] or name,latitude,longitude [deg].

    Raises:
        ConfigError: It cannot be read, or has other columns or no numbers.
    """
    names, table, kind = columns_of("--points", path, *POINTS)
    places = table if kind == POINTS[0] else [datum.position(a, b, 0.0)[:2] for a, b in table]
    return list(zip(names, places, strict=True))


def without_value(points: list[Point]) -> list[str]:
    """A remark that names the places that the mosaic has no cell of; none where it has all."""
    names = [point.name for point in points if not np.isfinite(point.value).any()]
    return [f"places outside the mosaic, or where nothing was seen: {', '.join(names)}"] if names else []


def usual_points(
    mosaic: Mosaic, grid: Grid, projection: Projection, seen: Bool[np.ndarray, "row column"]
) -> list[tuple[str, Float[np.ndarray, "2"]]]:
    """Places whose spectra differ most: each next one is farthest, as an angle, from all chosen before."""
    rng = np.random.default_rng(1)
    rows, columns = np.nonzero(binary_erosion(seen, iterations=_INSIDE))
    if not len(rows):
        return []
    some = rng.choice(len(rows), min(1500, len(rows)), replace=False)
    rows, columns = rows[some], columns[some]
    xy = np.column_stack([grid.x[columns], grid.y[rows]])
    spectra = np.array([np.array(mosaic.cube[r, :, c]) for r, c in zip(rows, columns, strict=True)])
    alike = _alike(mosaic, rows, columns, spectra)
    spectra, xy = spectra[alike], xy[alike]
    if not len(spectra):
        return []
    usable = (spectra > -1.0).mean(axis=0) > 0.99
    spectra = np.maximum(spectra[:, usable], 1e-6)
    if not usable.any():
        return []
    unit = spectra / np.linalg.norm(spectra, axis=1, keepdims=True)
    chosen = [int(np.argmin(np.abs(np.linalg.norm(spectra, axis=1) - np.median(np.linalg.norm(spectra, axis=1)))))]
    while len(chosen) < min(_SHOWN, len(unit)):
        nearest = np.max(unit @ unit[chosen].T, axis=1)
        close = np.min(np.linalg.norm(xy[:, None] - xy[chosen][None], axis=-1), axis=1) < _APART
        chosen.append(int(np.argmin(np.where(close, np.inf, nearest))))
    return [(f"{'ABCDEFGH'[k]}", projection.to_place(xy[i])) for k, i in enumerate(chosen)]


def _alike(
    mosaic: Mosaic, rows: np.ndarray, columns: np.ndarray, spectra: Float[np.ndarray, "n band"]
) -> Bool[np.ndarray, " n"]:
    """Cells whose neighbours at a circle's edge look as they do: no border of two materials runs through it."""
    bands = np.flatnonzero((mosaic.wavelengths >= 450.0) & (mosaic.wavelengths <= 650.0))
    bands = bands if len(bands) else np.arange(spectra.shape[1])
    away = max(int(RADIUS / mosaic.about["grid"]["cell_m"]), 1)
    near = np.zeros((4, *spectra.shape))
    for k, (dr, dc) in enumerate(((away, 0), (-away, 0), (0, away), (0, -away))):
        r, c = np.clip(rows + dr, 0, mosaic.shape[0] - 1), np.clip(columns + dc, 0, mosaic.shape[1] - 1)
        near[k] = [mosaic.cube[i, :, j] for i, j in zip(r, c, strict=True)]
    off = np.abs(near[..., bands] - spectra[:, bands]).max(axis=(0, 2))
    good = off < _ALIKE * np.maximum(spectra[:, bands].max(axis=1), 0.02)
    return good if good.sum() >= 2 * _SHOWN else np.ones(len(rows), bool)


def with_spectra(
    places: Iterable[tuple[str, Float[np.ndarray, "2"]]], mosaic: Mosaic, projection: Projection, scene: Scene | None
) -> list[Point]:
    """Of each place the mosaic's spectrum and the truth."""
    ground = None if scene is None or scene.floor is None else Ground(scene, mosaic.wavelengths)
    points = []
    for name, place in places:
        x, y = projection.to_map(place)
        cells = mosaic.cells_about(float(x), float(y), RADIUS)
        none = np.full(mosaic.shape[2], np.nan)
        value, spread = (none, none) if not len(cells) else _mean_and_spread(cells)
        truth = None
        if ground is not None:
            angle, far = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), RADIUS * np.sqrt(np.linspace(0.1, 1.0, 4))
            ring = np.stack([np.outer(far, np.cos(angle)), np.outer(far, np.sin(angle))], -1).reshape(-1, 2)
            truth = ground.from_above(place + ring).mean(axis=0)
        points.append(Point(name, place, value, spread, truth))
    return points


def _mean_and_spread(cells: Float[np.ndarray, "n band"]) -> tuple[np.ndarray, np.ndarray]:
    """Of the cells that know a band, where half of them do."""
    known = np.isfinite(cells)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, cells, 0.0).sum(axis=0) / count
    spread = np.sqrt(np.where(known, np.square(cells - mean), 0.0).sum(axis=0) / count)
    enough = known.mean(axis=0) > 0.5
    return np.where(enough, mean, np.nan), np.where(enough, spread, np.nan)


@dataclass(frozen=True)
class Agreement:
    """Of a mosaic with the scene that it shows.

    Attributes:
        error: Median over cells and bands from 400 to 700 nm of the relative error of reflectance.
        by_band: Median of it over cells.
        bias: Median of the signed relative error by band.
        angle: Median spectral angle [rad].
    """

    error: float
    by_band: Float[np.ndarray, " band"]
    bias: Float[np.ndarray, " band"]
    angle: float


def agreement(
    mosaic: Mosaic, grid: Grid, projection: Projection, scene: Scene, direct: Bool[np.ndarray, "row column"]
) -> Agreement | None:
    """At two thousand cells, the truth a mean over each."""
    rows, columns = np.nonzero(direct)
    if scene.floor is None or len(rows) < 20:
        return None
    some = np.random.default_rng(2).choice(len(rows), min(2000, len(rows)), replace=False)
    rows, columns = rows[some], columns[some]
    value = np.array([np.array(mosaic.cube[r, :, c]) for r, c in zip(rows, columns, strict=True)], float)
    value[value < -1.0] = np.nan
    offsets = grid.cell * (np.arange(3) - 1.0) / 3.0
    ground, truth = Ground(scene, mosaic.wavelengths), np.zeros(value.shape)
    for dx in offsets:
        for dy in offsets:
            xy = np.column_stack([grid.x[columns] + dx, grid.y[rows] + dy])
            truth += ground.from_above(projection.to_place(xy)) / 9.0
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = (value - truth) / truth
    visible = (mosaic.wavelengths >= 400.0) & (mosaic.wavelengths <= 700.0)
    known = np.isfinite(value) & visible
    a, b = np.where(known, value, 0.0), np.where(known, truth, 0.0)
    cosine = np.sum(a * b, 1) / np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-12)
    if not known.any():
        return None
    return Agreement(
        float(np.median(np.abs(relative[known]))),
        _middle(np.abs(relative)),
        _middle(relative),
        float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0)))),
    )


def _middle(x: Float[np.ndarray, "n band"]) -> Float[np.ndarray, " band"]:
    """Medians by band; no number for bands that are masked everywhere."""
    some = np.isfinite(x).any(axis=0)
    found = np.full(x.shape[1], np.nan)
    found[some] = np.nanmedian(x[:, some], axis=0)
    return found


def write_spectra(path: Path, points: list[Point], wavelengths: Float[np.ndarray, " band"]) -> Path:
    """A column for each place, its spread and its truth; a row for each band.

    Raises:
        LogError: It cannot be written.
    """
    head, columns = ["wavelength_nm"], [wavelengths]
    for point in points:
        head += [point.name, f"{point.name} sd"] + ([f"{point.name} truth"] if point.truth is not None else [])
        columns += [point.value, point.spread] + ([point.truth] if point.truth is not None else [])
    rows = [",".join(f'"{name}"' if "," in name else name for name in head)]
    rows += [",".join(f"{x:.6g}" if np.isfinite(x) else "" for x in row) for row in np.column_stack(columns)]
    try:
        write_text(path, "\n".join(rows) + "\n")
    except OSError as error:
        raise write_error(path, error) from error
    return path
