"""Writing a file of lines: what is known before, then the cube, a few lines at a time."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin._version import __version__
from rovtwin.core.datum import Datum
from rovtwin.core.errors import LogError
from rovtwin.core.log.files import atomic, write_error
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.imaging import lines
from rovtwin.imaging.files import imager_as_data
from rovtwin.imaging.imager import Imager, Mount
from rovtwin.imaging.lines import Truth


@dataclass(frozen=True)
class Navigation:
    """Of the vehicle, beside its lines.

    Attributes:
        t: On the run's clock [s].
        position: Of CO in n [m].
        euler: Roll, pitch, yaw [rad].
        source: Whose it is.
    """

    t: Float[np.ndarray, " k"]
    position: Float[np.ndarray, "k 3"]
    euler: Float[np.ndarray, "k 3"]
    source: str


@dataclass(frozen=True)
class Head:
    """All of a file of lines but the lines.

    Attributes:
        imager: That took them.
        mount: Where it sits, as stated.
        datum: Of the run.
        t: Stamps, middle of each exposure, by the imager's clock, on the run's time [s].
        exposure: Of each [s].
        dark: Counts of the dark.
        response: Counts a second for a radiance of 1 W/(m2 sr nm).
        saturation: Count of a pixel that is full.
        navigation: Of the vehicle.
        truth: Of a simulation.
        remarks: More attributes of the file.
    """

    imager: Imager
    mount: Mount
    datum: Datum
    t: Float[np.ndarray, " line"]
    exposure: Float[np.ndarray, " line"]
    dark: Float[np.ndarray, "pixel band"]
    response: Float[np.ndarray, "pixel band"]
    saturation: float
    navigation: Navigation | None = None
    truth: Truth | None = None
    remarks: Mapping[str, str] = field(default_factory=dict)


def write_lines(
    path: str | Path, head: Head, cube: Iterable[np.ndarray], dtype: type = np.uint16, overwrite: bool = False
) -> Path:
    """Write a file of lines, whole or not at all.

    Args:
        path: By custom with the ending `.h5`.
        head: All but the cube.
        cube: Blocks (line, pixel, band) in order; together as many lines as there are stamps.
        dtype: uint16 for counts, float32 for radiances.
        overwrite: Whether a file that exists may be replaced.

    Raises:
        LogError: The file cannot be written, it exists, stamps do not grow, or blocks are not as many as stamps.
    """
    import netCDF4

    path = Path(path)
    lines.check_stamps(head.t, str(path))
    try:
        with atomic(path, overwrite) as temporary, netCDF4.Dataset(temporary, "w", format="NETCDF4") as file:
            _write_head(file, head, dtype)
            variable, count = file[lines.CUBE], 0
            for block in cube:
                variable[count : count + len(block)] = block
                count += len(block)
            if count != len(head.t):
                raise LogError(f"{path}: found {count} lines for {len(head.t)} stamps")
    except RuntimeError as error:  # of the HDF5 library, such as a full disk
        raise write_error(path, error) from error
    return path


def _write_head(file: Any, head: Head, dtype: type) -> None:
    imager = head.imager
    file.setncatts({"title": f"lines of {imager.file.name}", "source": f"rovtwin {__version__}", **head.remarks})
    for name, size in (("line", len(head.t)), ("pixel", imager.pixels), ("band", len(imager.wavelengths)), ("xyz", 3)):
        file.createDimension(name, size)
    shape = (1, imager.pixels, len(imager.wavelengths))
    cube = file.createVariable(lines.CUBE, dtype, ("line", "pixel", "band"), chunksizes=shape, fill_value=False)
    counts = np.issubdtype(dtype, np.integer)
    cube.setncatts({"units": "1" if counts else "W m-2 sr-1 nm-1", "saturation": float(head.saturation)})
    cube.long_name = "counts" if counts else "spectral radiance in the water before the port"
    start = float(head.datum.utc(0.0).astype("datetime64[ns]").astype(np.int64)) * 1e-9
    _add(file, lines.STAMP, start + head.t, ("line",), units="s", long_name="unix time, middle of the exposure")
    _add(file, lines.EXPOSURE, 1e3 * head.exposure, ("line",), units="ms")
    _add(file, lines.WAVELENGTHS, imager.wavelengths, ("band",), units="nm")
    _add(file, lines.FWHM, imager.fwhm, ("band",), units="nm")
    _add(file, lines.DARK, head.dark, ("pixel", "band"), units="1")
    _add(file, lines.RESPONSE, head.response, ("pixel", "band"), units="s-1 (W m-2 sr-1 nm-1)-1")
    _add(file, lines.FIELD, np.degrees(imager.view_angles), ("pixel",), units="degree", long_name="in the water")
    own = file.createGroup(lines.OWN)
    own.format_version = np.int32(lines.FORMAT)
    _say(file, "imager", dump_yaml(imager_as_data(imager.file)))
    _say(file, "datum", head.datum.metadata())
    _add_mount(file, "mount", head.mount)
    if head.navigation is not None:
        _add_navigation(file, head.navigation, head.datum, start)
    if head.truth is not None:
        _add_truth(file, head.truth)


def _add_navigation(file: Any, given: Navigation, datum: Datum, start: float) -> None:
    file.createDimension("epoch", len(given.t))
    _add(file, f"{lines.NAVIGATION}/timestamp", start + given.t, ("epoch",), units="s", long_name="unix time")
    place = datum.ecef(given.position)
    _add(file, f"{lines.NAVIGATION}/position_ecef", place, ("epoch", "xyz"), units="m", long_name="of CO, EPSG:4978")
    names = {"units": "degree", "long_name": "roll, pitch, yaw (zyx) of b against north, east, down"}
    _add(file, f"{lines.NAVIGATION}/euler_angles", np.degrees(given.euler), ("epoch", "xyz"), **names)
    file[lines.NAVIGATION].source = given.source


def _add_truth(file: Any, truth: Truth) -> None:
    file.createDimension("quaternion", 4)
    of = f"{lines.OWN}/truth"
    _add(file, f"{of}/t", truth.t, ("line",), units="s", long_name="middle of the exposure on the run's clock")
    _add(file, f"{of}/position", truth.position, ("line", "xyz"), units="m", long_name="of CO in n")
    _add(file, f"{of}/attitude", truth.attitude, ("line", "quaternion"), units="1", long_name="q_nb, scalar first")
    _add(file, f"{of}/floor", truth.floor, ("line",), units="m", long_name="depth of the floor, middle of the line")
    _add_mount(file, "truth/mount", truth.mount)
    _say(file, "truth/scene", truth.scene)


def _add_mount(file: Any, name: str, mount: Mount) -> None:
    _add(file, f"{lines.OWN}/{name}_position", mount.position, ("xyz",), units="m", long_name="in b")
    _add(file, f"{lines.OWN}/{name}_rotation", mount.rotation, ("xyz", "xyz"), units="1", long_name="R_bs")
    _say(file, f"{name}_name", mount.name)


def _add(file: Any, name: str, values: np.ndarray, dimensions: tuple[str, ...], **attributes: str) -> None:
    variable = file.createVariable(name, np.float64, dimensions, fill_value=False)
    variable.setncatts(attributes)
    variable[...] = values


def _say(file: Any, name: str, text: str) -> None:
    file.createVariable(f"{lines.OWN}/{name}", str, ())[...] = np.array(text, dtype=object)
