"""An identification as one netCDF file, and back, to the last bit.

Arrays are variables, in groups: those of the parameters in the root, where xarray finds them unasked, the starting
model in `model`, the solver's in `solution`, then `fitted`, `held_out` and `residuals`, mesh files of the vehicle in
`meshes`. Everything else is JSON in the variable `words`. Written with netCDF4 alone: xarray is an extra.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rovtwin.core.errors import IdentificationError, RovtwinError
from rovtwin.core.log.files import atomic, write_error
from rovtwin.core.stored import require_netcdf
from rovtwin.core.user_files.files import write_bytes
from rovtwin.identification.result.packing import Packed, packed, unpacked

if TYPE_CHECKING:
    from netCDF4 import Dataset

    from rovtwin.identification.result.identification import Identification

FORMAT, VERSION = "rovtwin identification", 2
_AGAIN = "run rovtwin identify again, which writes one beside its vehicle file"
_ROOM = 1 << 20  # bytes that are tried
_SMALL = 64  # elements up to which nothing is gained by compressing them
_SQUARE = ("parameter", "parameter_2")


def save(result: Identification, path: Path, overwrite: bool) -> Path:
    """See `Identification.save`."""
    import netCDF4

    held = packed(result)
    try:
        with atomic(path, overwrite) as temporary, netCDF4.Dataset(temporary, "w", format="NETCDF4") as file:
            file.setncatts(
                {
                    "title": f"Identification of {result.vehicle.name}",
                    "format": FORMAT,
                    "format_version": np.int32(VERSION),
                    "source": f"rovtwin {result.version}",
                }
            )
            file.createDimension("parameter", len(result.theta))
            file.createDimension("parameter_2", len(result.theta))
            for place, values in held.arrays.items():
                _add(file, place, values)
            _add_text(file, "words", (), np.array(json.dumps(held.words, default=_plain), dtype=object))
    except RuntimeError as error:
        _require_room(path)
        raise write_error(path, error) from error
    return path


def _require_room(path: Path) -> None:
    """Raises OSError where the disk is full: the netCDF library says "HDF error" only."""
    probe = path.with_name(f".{path.name}.room")
    try:
        write_bytes(probe, bytes(_ROOM))
    finally:
        probe.unlink(missing_ok=True)


def load(path: Path) -> dict[str, Any]:
    """Fields of an Identification; see `Identification.load`."""
    import netCDF4

    _require_file(path)
    try:
        with netCDF4.Dataset(path, "r") as file:
            file.set_auto_maskandscale(False)
            _require_ours(path, file)
            arrays: dict[str, np.ndarray] = {}
            _read(file, "", arrays)
        words = json.loads(str(arrays.pop("words")[()]))
        return unpacked(Packed(arrays, words), path.name)
    except RovtwinError:
        raise
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError) as error:
        raise IdentificationError(
            f"{path}: found a damaged file, or one that was cut short ({type(error).__name__}: {error}), expected all "
            f"that Identification.save writes; copy it once more, or {_AGAIN}"
        ) from error


def require_replaceable(path: Path) -> None:
    """Before minutes are spent: what a result is about to replace is an identification, or nothing.

    Raises:
        IdentificationError: Another file has that name.
    """
    import netCDF4

    if not path.exists():
        return
    try:
        _require_file(path)
        with netCDF4.Dataset(path, "r") as file:
            ours = "format" in file.ncattrs() and file.getncattr("format") == FORMAT
    except (IdentificationError, OSError):
        ours = False
    if not ours:
        raise IdentificationError(
            f"{path}: found a file that is no saved identification, expected nothing or one: the result is written "
            "there. Move it, or choose another name with -o"
        )


def _require_file(path: Path) -> None:
    other = "; a vehicle file is read by rovtwin.load_vehicle" if path.suffix in (".yaml", ".yml") else ""
    fix = f" such as identified.nc{other}. Without one, {_AGAIN}"
    require_netcdf(path, "identification", IdentificationError, fix)


def _require_ours(path: Path, file: Dataset) -> None:
    attributes = {name: file.getncattr(name) for name in file.ncattrs()}
    if attributes.get("format") != FORMAT:
        title = f" titled '{attributes['title']}'" if "title" in attributes else ""
        raise IdentificationError(
            f"{path}: found a netCDF file{title} that is no identification, expected one that Identification.save or "
            "rovtwin identify wrote, such as identified.nc"
        )
    if attributes.get("format_version") != VERSION:
        raise IdentificationError(
            f"{path}: found version {attributes.get('format_version')} of the format, "
            f"written by {attributes.get('source')}, expected version {VERSION}; read it with that rovtwin, or {_AGAIN}"
        )


def _add(file: Dataset, place: str, values: Any) -> None:
    """A variable at `group/name`; truths are bytes of the type `bool`."""
    group, _, name = place.rpartition("/")
    parent: Any = file.createGroup(group) if group else file
    values = np.asarray(values)
    if group or values.ndim == 0:
        dimensions = tuple(f"{name}_{k}" for k in range(values.ndim))
        for dimension, size in zip(dimensions, values.shape, strict=True):
            parent.createDimension(dimension, size)
    else:
        dimensions = _SQUARE[: values.ndim]
    if values.dtype == object:
        return _add_text(parent, name, dimensions, values)
    truths = values.dtype.kind == "b"
    more: dict[str, Any] = {"compression": "zlib", "complevel": 1} if values.size > _SMALL else {}
    variable = parent.createVariable(name, "i1" if truths else values.dtype, dimensions, **more)
    if truths:
        variable.setncattr("type", "bool")
    if values.size:
        variable[...] = values.astype("i1") if truths else values


def _add_text(parent: Any, name: str, dimensions: tuple[str, ...], values: np.ndarray) -> None:
    variable = parent.createVariable(name, str, dimensions)
    if values.size:
        variable[...] = values


def _read(group: Any, place: str, arrays: dict[str, np.ndarray]) -> None:
    """Every variable of a group and of those in it, by `group/name`."""
    for name, variable in group.variables.items():
        values = np.asarray(variable[...])
        arrays[place + name] = values.astype(bool) if "type" in variable.ncattrs() else values
    for name, inner in group.groups.items():
        _read(inner, f"{place}{name}/", arrays)


def _plain(value: Any) -> Any:
    """What JSON does not know: NumPy's numbers and arrays."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} cannot be kept in a file")
