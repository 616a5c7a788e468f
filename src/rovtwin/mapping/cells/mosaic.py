"""From lines to cells: blocks of lines located, corrected and gridded, then joined to a cube and its layers."""

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.cells.gridding import LAYERS, Part, gridded
from rovtwin.mapping.cells.masking import AROUND, masked, without_signal
from rovtwin.mapping.cells.parts import Parts, masked_layers
from rovtwin.mapping.cells.radiometry import Calibrated
from rovtwin.mapping.formats.colours import colour_bands
from rovtwin.mapping.formats.envi import NO_DATA, EnviCube, opened
from rovtwin.mapping.georeference import Georeference, Located
from rovtwin.mapping.projection import Projection

BLOCK = 64  # lines that make one part
UNITS = {
    "range": "m", "incidence": "deg", "time": "s", "depth": "m", "slant_x": "1", "slant_y": "1", "coverage": "1",
    "noise": "1",
}  # fmt: skip
_FULL = 1e-3  # weight of a pixel with a band that is full: its cell has a hole there, unless others fill it
_SHOWN = 550.0  # whose noise is a layer [nm]
# More layers of pixels: from times (line,) and where pixels lie to name -> (line, pixel); with the unit of each.
More = Callable[[Float[np.ndarray, " line"], Located], Mapping[str, Float[np.ndarray, "line pixel"]]]


@dataclass(frozen=True)
class Job:
    """A mosaic to be made.

    Attributes:
        calibrated: Lines and what becomes of them.
        georeference: Where they lie.
        projection: To the map.
        grid: Cells.
        t: Of each line on the run's clock, the imager's clock put right [s].
        use: Which lines count.
        best: Whether a cell is taken from the lines that saw it best; else the mean of all.
        more: Layers besides, such as standard deviations of the place.
        more_units: Their names and units, in order.
    """

    calibrated: Calibrated
    georeference: Georeference
    projection: Projection
    grid: Grid
    t: Float[np.ndarray, " line"]
    use: Bool[np.ndarray, " line"]
    best: bool = True
    more: More | None = None
    more_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def numbers(self) -> range:
        """Of the parts."""
        return range(-(-len(self.t) // BLOCK))

    @property
    def layer_names(self) -> list[str]:
        """In the order in which parts keep them."""
        return [*LAYERS, *self.more_units]

    def units(self) -> dict[str, str]:
        """Of all layers."""
        return UNITS | dict(self.more_units)

    def part(self, number: int, cube: Float[np.ndarray, "line pixel band"]) -> tuple[Part, dict[str, int]]:
        """Of one block of lines, as the file has them; and how many pixels were left out."""
        first = number * BLOCK
        t, use = self.t[first : first + BLOCK], self.use[first : first + BLOCK]
        located = self.georeference.locate(t)
        xy = self.projection.to_map(located.point[..., :2])
        cell = self.grid.number(xy)
        cell[~located.valid | ~use[:, None]] = -1
        weight = np.where(located.valid, np.maximum(located.cosine, 0.0) / np.square(located.way), 0.0)
        weight[(cube >= self.calibrated.lines.saturation).any(axis=-1)] *= _FULL  # other lines may have seen it
        numbers = cube.size if self.calibrated.lines.counts else int(np.isfinite(cube).sum())
        value, variance, full = self.calibrated.values(cube, first, located)
        layers = [
            located.way,
            np.degrees(np.arccos(np.clip(located.cosine, -1.0, 1.0))),
            np.broadcast_to((t - self.t[0])[:, None], located.way.shape),
            located.point[..., 2],
            *self._slants(located),
        ]
        if self.more is not None:
            found = self.more(t, located)
            layers += [found[name] for name in self.more_units]
        flat = np.stack(layers, axis=-1).reshape(cell.size, -1)
        bands = value.shape[-1]
        made = gridded(cell.ravel(), weight.ravel(), flat, value.reshape(-1, bands), variance.reshape(-1, bands))
        missed = int((~located.valid & use[:, None]).sum())
        return made, {"saturated": full, "missed": missed, "no_number": value.size - numbers, "samples": value.size}

    def _slants(self, located: Located) -> tuple[Float[np.ndarray, "line pixel"], Float[np.ndarray, "line pixel"]]:
        """Way along the map's x and y from the imager to each pixel, for each metre down.

        By so much a thing that stands higher than the floor lies farther out, for each metre of height.
        No number where a ray is level or rises, as it may with a mesh.
        """
        way = located.point - located.position[:, None]
        to_map = self.projection.slope(0.5 * (self.projection.low + self.projection.high))
        down = np.where(way[..., 2:] > 0, way[..., 2:], np.nan)
        slant = (way[..., :2] / down) @ to_map.T
        return slant[..., 0], slant[..., 1]


def make_parts(job: Job, parts: Parts, progress: Callable[[int, int], None] | None = None) -> int:
    """Make the parts that are missing; how many were there already.

    Raises:
        LogError: Lines cannot be read, or parts not written.
    """
    job.calibrated.prepare()
    _ = job.georeference.locate(job.t[:1])
    missing = [number for number in job.numbers if not parts.has(number)]
    there = len(job.numbers) - len(missing)
    with ThreadPoolExecutor(_threads()) as pool:
        for done, (number, future) in enumerate(_ahead(job, missing, pool), there + 1):
            parts.add(number, *future.result())
            if progress:
                progress(done, len(job.numbers))
    return there


def _threads() -> int:
    return min(4, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def _ahead(job: Job, numbers: list[int], pool: ThreadPoolExecutor) -> Iterator[tuple[int, Future]]:
    """Parts in order, one more being made than there are threads; the file is read here, by one thread."""
    waiting: list[tuple[int, Future]] = []
    lines = job.calibrated.lines
    for number in numbers:
        cube = lines.read(number * BLOCK, min((number + 1) * BLOCK, len(job.t)))
        waiting.append((number, pool.submit(job.part, number, cube)))
        if len(waiting) > _threads():
            yield waiting.pop(0)
    yield from waiting


@dataclass(frozen=True)
class Joined:
    """What the parts of a mosaic make together.

    Attributes:
        layers: By name with unit, (row, column); no number where nothing was seen.
        rgb: Means of the bands of red, green and blue.
        seen: Cells with a value.
        direct: Those into which a pixel fell; the others lie between two lines and were filled.
        masked: Share of the seen cells in which a band is masked by its noise, by band; 1 where it is masked whole.
    """

    layers: dict[str, tuple[Float[np.ndarray, "row column"], str]]
    rgb: Float[np.ndarray, "row column 3"]
    seen: Bool[np.ndarray, "row column"]
    direct: Bool[np.ndarray, "row column"]
    masked: Float[np.ndarray, " band"]


def join(job: Job, parts: Parts, cube_path: Path, what: str, smallest_snr: float) -> Joined:
    """Join parts to an ENVI cube, rows at a time, and to layers, which are held.

    Raises:
        LogError: It cannot be written.
    """
    lines, grid = job.calibrated.lines, job.grid
    bands, names = len(lines.wavelengths), job.layer_names
    colours = colour_bands(lines.wavelengths)
    shown = int(np.argmin(np.abs(lines.wavelengths - _SHOWN)))
    layers = np.full((grid.rows, grid.columns, len(names) + 2), np.nan, np.float32)
    rgb, dropped = np.full((grid.rows, grid.columns, 3), np.nan, np.float32), np.zeros(bands)
    masking = job.calibrated.has_noise and job.calibrated.correction.reflects
    cube = EnviCube(cube_path, grid, lines.wavelengths, lines.fwhm, what)
    try:
        blocks = parts.joined(job.numbers, grid, bands, len(names), job.best, AROUND // 2 if masking else 0)
        for rows, own, wide in blocks:
            hidden = _hidden(wide, grid.columns, smallest_snr)[own] if masking else None
            part = wide.some(own)
            seen, value = part.weight > 0, part.value
            value[~seen] = np.nan
            if hidden is not None:
                dropped += hidden[seen].sum(axis=0)
                value[hidden] = np.nan
            cube.append(value.reshape(-1, grid.columns, bands))
            at = slice(rows.start, rows.stop)
            rgb[at] = _colours(value.reshape(-1, grid.columns, bands), colours)
            layers[at] = masked_layers(part, np.sqrt(part.variance[:, shown]), grid.columns)
    finally:
        cube.close()
    seen, direct = np.isfinite(layers[..., 0]), np.nan_to_num(layers[..., -2]) > 0
    units, share = job.units(), dropped / max(int(seen.sum()), 1)
    if (factor := job.calibrated.correction.factor) is not None:
        share[~np.isfinite(factor)] = 1.0  # bands in which a panel could not be seen
    _mask_whole(cube_path, (grid.rows, grid.columns, bands), without_signal(share), rgb, colours)
    share[without_signal(share)] = 1.0
    named = {name: (layers[..., k], units[name]) for k, name in enumerate([*names, "coverage", "noise"])}
    return Joined(named, rgb, seen, direct, share)


def _hidden(part: Part, columns: int, smallest_snr: float) -> Bool[np.ndarray, "cell band"]:
    """Where noise hides the bands of a dense part."""
    wide = (-1, columns, part.value.shape[1])
    seen = (part.weight > 0).reshape(wide[:2])
    return masked(part.value.reshape(wide), np.sqrt(part.variance).reshape(wide), seen, smallest_snr).reshape(
        part.value.shape
    )


def _mask_whole(
    cube_path: Path, shape: tuple[int, int, int], bands: Bool[np.ndarray, " band"], rgb: np.ndarray, colours: Any
) -> None:
    """Take bands out of the cube that is written, and out of the picture."""
    if not bands.any():
        return
    cube = opened(cube_path, shape, "r+")
    cube[:, bands] = NO_DATA
    cube.flush()
    if bands[np.concatenate(colours)].any():
        for row in range(shape[0]):
            values = np.moveaxis(np.array(cube[row : row + 1]), 1, -1)
            rgb[row] = _colours(np.where(values == np.float32(NO_DATA), np.float32(np.nan), values), colours)[0]


def _colours(value: Float[np.ndarray, "row column band"], colours: Any) -> Float[np.ndarray, "row column 3"]:
    """Means of the bands of red, green and blue."""
    flat = value.reshape(-1, value.shape[-1])
    return np.stack([_known_mean(flat[:, c]) for c in colours], axis=-1).reshape(*value.shape[:2], 3)


def _known_mean(values: Float[np.ndarray, "n band"]) -> Float[np.ndarray, " n"]:
    """Over the bands that are known; no number where none is."""
    known = np.isfinite(values)
    total = np.where(known, values, 0.0).sum(axis=1)
    return np.where(known.any(axis=1), total / np.maximum(known.sum(axis=1), 1), np.nan)
