"""A mosaic from a run and its file of lines: pixels located and corrected, cells joined, files written.

What is broken off, by a kill or a full disk, goes on where it was when the same map is asked for again.
"""

import hashlib
import json
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin._version import __version__
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.user_files.files import is_file
from rovtwin.imaging.files import imager_as_data
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.cells.mosaic import Job, join, make_parts
from rovtwin.mapping.cells.parts import Parts
from rovtwin.mapping.cells.radiometry import Budget, Calibrated, Correction, Unsure, budget
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.projection import Projection, crs_of, utm_of
from rovtwin.runs.mapping.area import Rings, on_map, rings_of
from rovtwin.runs.mapping.checking import check
from rovtwin.runs.mapping.output.losses import losses
from rovtwin.runs.mapping.output.noting import remove_old
from rovtwin.runs.mapping.output.products import Products
from rovtwin.runs.mapping.output.writing import write_all
from rovtwin.runs.mapping.panel import Seen, about_range, seen_panel
from rovtwin.runs.mapping.points import read_points
from rovtwin.runs.mapping.registering import (
    UNITS,
    Registered,
    errors_before,
    registered,
    sigma_layers,
)
from rovtwin.runs.mapping.request import MapRequest, WaterFile
from rovtwin.runs.mapping.result import CUBE, Mosaic
from rovtwin.runs.mapping.selection import Lines, lines_to_use
from rovtwin.runs.mapping.sources import Inputs, open_inputs

_FORMAT = 3  # of what parts are made of: a change that changes them raises it
_SAMPLED = 24  # lines of which the budget of uncertainty is taken
_MARGIN = 0.05  # of the grid beyond the pixels that are located to lay it out [m]
_EVERY = 8  # lines from one whose ends are located, for the mosaic's box, to the next


def map_run(
    run: Path | None,
    request: MapRequest,
    out: Path,
    overwrite: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> Mosaic:
    """Make the mosaic.

    Args:
        run: Folder of the run, or its log; None: the file of lines has navigation, mount and datum.
        request: What is asked for.
        out: Folder to make.
        overwrite: Whether a mosaic that is there may be replaced.
        progress: Called with what is done, how much of it, and how much there is.

    Raises:
        ConfigError: Something that is asked for is not there or cannot be, or the disk has no room.
        LogError: A file cannot be read or written.
    """
    begun = time.monotonic()
    check(run, request, out, overwrite)
    with (inputs := open_inputs(run, request)).lines:
        ready = prepare(inputs)
        job, lines, unsure, remarks = ready.job, ready.lines, ready.unsure, ready.remarks
        _check_room(out, job, request)
        out.mkdir(parents=True, exist_ok=True)
        remove_old(out)  # a mosaic is whole when its note is there
        parts = Parts(out / ".parts", key_of(inputs, job))
        steps = progress or (lambda what, done, count: None)
        resumed = make_parts(job, parts, lambda done, count: steps("lines", done, count))
        counts = parts.notes(job.numbers)
        steps("joining", 0, 1)
        snr = inputs.lines.imager.file.smallest_snr
        joined = join(job, parts, out / CUBE, _what(inputs, job), snr)
        unknown = _budget(inputs, job, unsure, ready.panel)
        used, wavelengths = int(lines.use.sum()), inputs.lines.wavelengths
        remarks += lines.remarks + losses(counts, joined, used * inputs.lines.shape[1], wavelengths)
        if ready.panel is not None:
            given = request.water is not None or inputs.scene is not None
            modelled = job.calibrated.correction.model is not None
            remarks.append(about_range(ready.panel, joined.layers["range"][0], modelled, given))
        done = (remarks, counts, resumed, used, ready.registration, ready.area, ready.panel)
        products = Products(inputs, job, joined, unknown, *done)
        mosaic = write_all(products, out, begun, steps)
        parts.remove()
    return mosaic


@dataclass(frozen=True)
class Ready:
    """All that is known before the work.

    Attributes:
        job: What is to be made.
        lines: Which count.
        unsure: How unsure light and water are.
        remarks: For people.
        registration: What it did; None without.
        area: That was to be seen, as rings of x and y; None: nobody says.
        panel: What a reference panel did; None without.
    """

    job: Job
    lines: Lines
    unsure: WaterFile
    remarks: list[str]
    registration: Registered | None
    area: Rings | None
    panel: Seen | None = None


def prepare(inputs: Inputs) -> Ready:
    """What is to be made of what was found.

    Raises:
        ConfigError: Something is missing.
        LogError: Nothing can be mapped.
    """
    request, lines = inputs.request, inputs.lines
    if lines.counts:
        _ = lines.frames  # named here, before the work, where they are missing
    _crs(inputs)
    area = None if request.area is None else rings_of(request.area, inputs.datum)
    if request.points is not None:
        read_points(request.points, inputs.datum)  # as above: what is wrong with files and --crs, too
    t, navigation = inputs.times, inputs.navigation
    chosen = lines_to_use(inputs)
    first = Georeference(lines.imager, inputs.mount, navigation, inputs.first_floor())
    place = _places(first, t[chosen.use])
    floor, height, remarks = inputs.floor(place.min(0), place.max(0))
    georeference = replace(first, floor=floor)
    model, water, words = inputs.light()
    if water.height_sd is not None and inputs.request.floor_std is None:
        height = water.height_sd
    done, errors = _registered(inputs, georeference, t, chosen, height)
    if done is not None:
        georeference, t = done.georeference, t + done.delay
        remarks = remarks + done.remarks
    # Laid out only now: registration moves pixels, and those beyond the grid would be lost.
    depth = float(inputs.first_floor().depth)
    projection, grid = _laid_out(inputs, _places(georeference, t[chosen.use]), area, depth)
    more = None if errors is None else sigma_layers(errors, georeference, t, chosen.use, height)
    calibrated = Calibrated(lines, Correction(lines.imager, model))
    panel = seen_panel(inputs.request.panel, inputs.datum, calibrated, georeference, t, chosen.use)
    if panel is not None:
        calibrated = Calibrated(lines, replace(calibrated.correction, factor=panel.factor))
        words = words + panel.remarks
    units = {} if more is None else UNITS
    job = Job(calibrated, georeference, projection, grid, t, chosen.use, request.best, more, units)
    if navigation.dropped:
        remarks = [*remarks, f"navigation: {navigation.dropped} poses without a number or with a stamp twice left out"]
    unsure = water.model_copy(update={"height_sd": height})
    rings = None if area is None else on_map(area, projection)
    return Ready(job, chosen, unsure, remarks + words, done, rings, panel)


def _crs(inputs: Inputs) -> Any:
    return crs_of(utm_of(inputs.datum) if inputs.request.crs == "utm" else inputs.request.crs, "--crs")


def _laid_out(
    inputs: Inputs, place: Float[np.ndarray, "n 2"], area: Rings | None, depth: float
) -> tuple[Projection, Grid]:
    """Map and cells over where pixels lie, with a margin for those that were not looked at; the map over the area, too.

    Raises:
        ConfigError: The coordinate system cannot be used, or there would be too many cells.
    """
    request, crs = inputs.request, _crs(inputs)
    corners = [place.min(0), place.max(0), *(ring for part in area or [] for ring in part)]
    every = np.vstack(corners)
    projection = Projection.of(inputs.datum, crs, every.min(0) - 0.2, every.max(0) + 0.2, depth)
    xy, margin = projection.to_map(place), max(_MARGIN, 2.0 * request.resolution)
    grid = Grid.over(crs, np.stack([xy.min(0) - margin, xy.max(0) + margin]), request.resolution)
    if area is not None:  # named before the work, where its cells are too many
        Grid.over(crs, projection.to_map(every), request.resolution)
    return projection, grid


def _registered(
    inputs: Inputs, georeference: Georeference, t: Float[np.ndarray, " line"], chosen: Lines, height: float
) -> tuple[Registered | None, JointErrors | None]:
    """Poses put right where that is asked for, and what is known of errors; None where nothing is."""
    asked = inputs.request.register or inputs.request.control is not None
    joint = errors_before(inputs, t, chosen.use)
    if joint is None:
        if asked:
            raise ConfigError(
                "--register, --control: need a smoothed track with its key frames (smoothed.mcap, smoothed_keys.nc): "
                f"rovtwin smooth {inputs.run or 'RUN'}, and --navigation smoothed"
            )
        return None, None
    if not asked:
        return None, joint
    done = registered(inputs, georeference, t, chosen.use, joint, height)
    return done, done.joint


def _places(georeference: Georeference, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, "m 2"]:
    """Of the ends and the middle of some lines, the last one among them."""
    some = np.r_[t[:: max(1, min(_EVERY, len(t) // 50))], t[-1:]]
    ends = slice(0, None, max(georeference.imager.pixels - 1, 1) // 2 or 1)
    place = georeference.locate(some, ends).point[..., :2].reshape(-1, 2)
    place = place[np.isfinite(place).all(axis=1)]
    if not len(place):
        raise LogError("no pixel of any line meets the floor: does the imager look at it, and is its depth right?")
    return place


def _check_room(out: Path, job: Job, request: MapRequest) -> None:
    """Parts take each cell some three times, the cube once, and as much again for each cube in another format."""
    bands = len(job.calibrated.lines.wavelengths)
    cube = 4.0 * job.grid.rows * job.grid.columns * bands
    size = cube * (1.0 + 2.0 * 1.6 + 2.0 * ("cube" in request.formats) + ("netcdf" in request.formats))
    there = out.resolve()
    while not there.exists():
        there = there.parent
    free = shutil.disk_usage(there).free
    if free < size:
        raise ConfigError(
            f"{out}: a mosaic of {job.grid.rows} x {job.grid.columns} cells and {bands} bands takes up to "
            f"{size / 1e9:.1f} GB while it is made, and the disk has {free / 1e9:.1f} GB free. Free some, or say a "
            "larger --resolution"
        )


def _what(inputs: Inputs, job: Job) -> str:
    correction = job.calibrated.correction
    return f"rovtwin {__version__}: {correction.quantity} [{correction.unit}] of {inputs.lines.name}"


def _budget(inputs: Inputs, job: Job, water: WaterFile, panel: Seen | None) -> Budget | None:
    """Of some lines spread over the survey; None where no model of light is at hand."""
    if job.calibrated.correction.model is None:
        return None
    numbers = np.flatnonzero(job.use)
    numbers = numbers[np.linspace(0, len(numbers) - 1, min(_SAMPLED, len(numbers))).astype(int)]
    some = []
    for number in numbers:
        located = job.georeference.locate(job.t[number : number + 1])
        some.append((int(number), located, inputs.lines.read(number, number + 1)))
    assert water.height_sd is not None
    return budget(job.calibrated, some, Unsure(water.height_sd, water.water_sd, water.lamps_sd),
                  None if panel is None else panel.pixels)  # fmt: skip


def key_of(inputs: Inputs, job: Job) -> str:
    """Of all that the parts depend on."""
    lines, request = inputs.lines, inputs.request
    states = [(str(one.path.resolve()), (state := one.path.stat()).st_size, state.st_mtime_ns) for one in lines.files]
    digest = hashlib.sha256()
    settings = {
        name: str(value)
        for name, value in asdict(replace(request, imager=None, formats=(), points=None, area=None)).items()
    }
    floor_file = Path(request.floor)
    states += [(request.floor, floor_file.stat().st_size, floor_file.stat().st_mtime_ns)] if is_file(floor_file) else []
    about = [_FORMAT, states, imager_as_data(lines.imager.file)]
    digest.update(json.dumps([about, settings, job.layer_names], default=str).encode())
    navigation, mount, grid = job.georeference.navigation, job.georeference.mount, job.grid
    north = np.linspace(job.projection.low[0], job.projection.high[0], 12)
    east = np.linspace(job.projection.low[1], job.projection.high[1], 12)
    floor = job.georeference.floor.depth_and_slope(np.stack(np.meshgrid(north, east), axis=-1))[0]
    arrays = [job.t, job.use, navigation.t, navigation.position, navigation.quaternion, mount.position, mount.rotation]
    arrays += [floor, np.array([grid.left, grid.top, grid.cell, grid.rows, grid.columns])]
    if job.more is not None:
        some = slice(None, None, max(len(job.t) // 50, 1))
        arrays += list(job.more(job.t[some], job.georeference.locate(job.t[some])).values())
    if (model := job.calibrated.correction.model) is not None:
        arrays += [model.at_fine.absorption, model.at_fine.scattering, np.array([model.surface, model.below])]
    if (factor := job.calibrated.correction.factor) is not None:
        arrays.append(factor)
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
