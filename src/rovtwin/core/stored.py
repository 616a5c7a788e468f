"""Results as one netCDF file, and back, to the last bit: arrays are variables, all else is JSON beside them.

What is kept is a tree of dataclasses, named tuples, pydantic models, containers, arrays and plain values. A class is
named by the module that defines it, and read back only from rooms of this package in which results are at home; its
fields are set as they were. Nothing else is imported or called.
"""

from __future__ import annotations

import dataclasses
import importlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import BaseModel

from rovtwin._version import __version__
from rovtwin.core.errors import LogError, RovtwinError
from rovtwin.core.log.files import atomic, write_error
from rovtwin.core.notebook import Result
from rovtwin.core.numerics import as_array, jax
from rovtwin.core.user_files.config import near

if TYPE_CHECKING:
    from netCDF4 import Dataset

FORMAT = 1  # of the file
PACKAGE = __name__.partition(".")[0]
# Of this package: those whose classes a result may hold.
_ROOMS = ("campaign", "core", "gnc", "identification", "planning", "runs", "scenario", "simulation", "vehicle")
_HDF = b"\x89HDF\r\n\x1a\n"  # what a netCDF4 file begins with
_SMALL = 64  # elements up to which nothing is gained by compressing them


class Stored(Result):
    """A result that is kept as one netCDF file; a dataclass."""

    __slots__ = ()

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Written as one netCDF file, to the last bit; returns the path.

        Args:
            path: By custom with the ending `.nc`.
            overwrite: Whether a file that exists may be replaced.

        Raises:
            LogError: The file cannot be written, or it exists.

        Example:
            >>> path = rovtwin.simulate("double_blueye", {"port.surge": [0.5] * 10})
            >>> path.save("path.nc", overwrite=True).name
            'path.nc'
        """
        import netCDF4

        path, arrays = Path(path), {}
        words = json.dumps(_packed(self, "", arrays))
        try:
            with atomic(path, overwrite) as temporary, netCDF4.Dataset(temporary, "w", format="NETCDF4") as file:
                about = {"format": f"rovtwin {type(self).__name__}", "format_version": np.int32(FORMAT)}
                file.setncatts(about | {"title": str(repr(self)).strip("<>"), "source": f"rovtwin {__version__}"})
                for name, values in arrays.items():
                    _add(file, name, values)
                file.createVariable("words", str, ())[...] = np.array(words, dtype=object)
        except RuntimeError as error:  # of the netCDF library, such as a full disk
            raise write_error(path, error) from error
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """What `save` wrote; nothing is computed again.

        Raises:
            LogError: The file is missing, damaged, of another kind of result or of another version.

        Example:
            >>> path = rovtwin.simulate("double_blueye", {"port.surge": [0.5] * 10})
            >>> rovtwin.Trajectory.load(path.save("path.nc", overwrite=True)).dt
            0.01
        """
        import netCDF4

        path = Path(path)
        require_netcdf(path, cls.__name__, LogError, ": give the file that `save` wrote, or save the result again")
        try:
            with netCDF4.Dataset(path, "r") as file:
                file.set_auto_maskandscale(False)
                _require_kind(path, file, cls.__name__)
                arrays = {name: np.asarray(variable[...]) for name, variable in file.variables.items()}
            result = _unpacked(json.loads(str(arrays.pop("words")[()])), arrays)
            if type(result) is not cls:
                raise ValueError(f"it holds {type(result).__name__}")
            return result
        except RovtwinError:
            raise
        except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, ImportError) as error:
            raise LogError(
                f"{path}: found a damaged file, one that was cut short, or one of another version "
                f"({type(error).__name__}: {error}), expected all that {cls.__name__}.save writes; copy it once more, "
                "or read it with the rovtwin that wrote it"
            ) from error


def require_netcdf(path: Path, kind: str, error: type[RovtwinError], fix: str) -> None:
    """Raises `error` where a path certainly leads to no saved result of a kind; `fix` is for a file of another one."""
    if not path.is_file():
        around = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        what = "a folder" if path.is_dir() else "no such file"
        raise error(f"{path}: found {what}, expected a saved {kind}.{near(path.name, around)}")
    with open(path, "rb") as stream:
        if stream.read(len(_HDF)) != _HDF:
            raise error(f"{path}: found no netCDF file, expected a saved {kind}{fix}")


def _require_kind(path: Path, file: Dataset, kind: str) -> None:
    about = {name: file.getncattr(name) for name in file.ncattrs()}
    found = str(about.get("format", ""))
    if found != f"rovtwin {kind}":
        what = found.removeprefix("rovtwin ") if found.startswith("rovtwin ") else ""
        fix = f"rovtwin.{what[:1].upper()}{what[1:]}.load reads it" if what else "save the result again"
        raise LogError(
            f"{path}: found {f'a saved {what}' if what else 'another netCDF file'}, expected a {kind}; {fix}"
        )
    if about.get("format_version") != FORMAT:
        raise LogError(
            f"{path}: found version {about.get('format_version')} of the format, written by {about.get('source')}, "
            f"expected version {FORMAT}; read it with that rovtwin"
        )


def _add(file: Dataset, name: str, values: np.ndarray) -> None:
    """A variable with dimensions of its own; truths are bytes, which `_unpacked` knows from the JSON."""
    dimensions = tuple(f"{name}_{k}" for k in range(values.ndim))
    for dimension, size in zip(dimensions, values.shape, strict=True):
        file.createDimension(dimension, size)
    more: dict[str, Any] = {"compression": "zlib", "complevel": 1} if values.size > _SMALL else {}
    values = values.astype("i1") if values.dtype.kind == "b" else values
    variable = file.createVariable(name, values.dtype, dimensions, **more)
    if values.size:
        variable[...] = values


def _packed(value: Any, place: str, arrays: dict[str, np.ndarray]) -> Any:
    """A value as JSON; its arrays go to `arrays`, named by their place in the tree."""
    if value is None or isinstance(value, bool | int | float | str) and type(value).__module__ == "builtins":
        return value
    if isinstance(value, BaseModel):
        return {"model": _address(value), "data": value.model_dump(mode="json", exclude_unset=True)}
    if isinstance(value, Path):
        return {"path": str(value)}
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        return _array(value, place, arrays)
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value)]
        held = {name: _packed(getattr(value, name), _inside(place, name), arrays) for name in names}
        return {"class": _address(value), "fields": held}
    if isinstance(value, list | tuple):
        held = [_packed(one, _inside(place, k), arrays) for k, one in enumerate(value)]
        if hasattr(value, "_fields"):
            return {"named": _address(value), "items": held}
        return held if isinstance(value, list) else {"tuple": held}
    if isinstance(value, dict):
        pairs = [(k, str(k).replace("/", "_"), one) for k, one in value.items()]
        return {"dict": [[_packed(k, "", {}), _packed(one, _inside(place, name), arrays)] for k, name, one in pairs]}
    raise TypeError(f"{place}: {type(value).__name__} cannot be kept in a file")


def _array(value: Any, place: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    kind = "jax" if isinstance(value, jax.Array) else "scalar" if isinstance(value, np.generic) else "numpy"
    found = np.asarray(value)
    if found.dtype.kind not in "bif":
        raise TypeError(f"{place}: an array of {found.dtype} cannot be kept in a file")
    name = place if place and place not in arrays else f"array_{len(arrays)}"
    arrays[name] = found
    return {"array": name, "kind": kind, "type": found.dtype.str}


def _inside(place: str, name: str | int) -> str:
    return f"{place}.{name}" if place else str(name)


def _address(value: Any) -> str:
    return f"{type(value).__module__}:{type(value).__qualname__}"


def _unpacked(held: Any, arrays: dict[str, np.ndarray]) -> Any:
    """The value that `_packed` wrote."""
    if isinstance(held, list):
        return [_unpacked(one, arrays) for one in held]
    if not isinstance(held, dict):
        return held
    if "array" in held:
        values = arrays[held["array"]].astype(held["type"])
        return {"jax": lambda: as_array(values, values.dtype), "scalar": lambda: values[()]}.get(
            held["kind"], lambda: values
        )()
    if "path" in held:
        return Path(held["path"])
    if "tuple" in held:
        return tuple(_unpacked(one, arrays) for one in held["tuple"])
    if "dict" in held:
        return {_unpacked(key, arrays): _unpacked(one, arrays) for key, one in held["dict"]}
    return _made(held, arrays)


def _made(held: dict[str, Any], arrays: dict[str, np.ndarray]) -> Any:
    """An object of one of our classes."""
    if "model" in held:
        return _class(held["model"], BaseModel).model_validate(held["data"])
    if "named" in held:
        return _class(held["named"], tuple)._make(_unpacked(held["items"], arrays))
    kind: Any = _class(held["class"], object)
    if not hasattr(kind, "__dataclass_fields__"):
        raise ValueError(f"{held['class']} is no dataclass")
    if (names := [f.name for f in dataclasses.fields(kind)]) != list(held["fields"]):
        raise ValueError(f"{held['class']} has the fields {names} here, {list(held['fields'])} there")
    made = object.__new__(kind)
    for name, value in held["fields"].items():
        object.__setattr__(made, name, _unpacked(value, arrays))
    return made


def _class(address: str, base: type) -> Any:
    """A class of this package that results hold, by the module that defines it; a file names no other."""
    module, _, name = address.partition(":")
    parts = module.split(".")
    if parts[0] != PACKAGE or len(parts) < 2 or parts[1] not in _ROOMS or "__main__" in parts:
        raise ValueError(f"{address} is no class of {PACKAGE} that a result holds")
    found: Any = importlib.import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    is_class = isinstance(found, type) and issubclass(found, base)
    if not is_class or (found.__module__, found.__qualname__) != (module, name):
        raise ValueError(f"{address} is no {base.__name__}")
    return found
