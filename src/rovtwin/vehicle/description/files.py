"""Vehicle files: found, read, their parts put in place."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import near, parse, read_yaml
from rovtwin.core.user_files.files import is_file
from rovtwin.vehicle.description.schema import Body, Part, VehicleFile
from rovtwin.vehicle.description.thrust_curve import read_bollard_csv, read_points
from rovtwin.vehicle.solids.mesh_solid import mesh_solid

LIBRARY = Path(__file__).parents[1] / "library"
DEVICES = LIBRARY / "devices"
SUFFIXES = (".yaml", ".yml")
MOST_BODIES = 200  # in a vehicle, those of part files counted


def list_library() -> list[str]:
    """Names of the vehicles that ship with rovtwin."""
    return sorted(p.stem for p in LIBRARY.glob("*.yaml"))


def list_devices() -> list[str]:
    """Names of the devices that ship with rovtwin: parts to bolt on, one name-space with the vehicles."""
    return sorted(p.stem for p in DEVICES.glob("*.yaml"))


def _shipped(name: str) -> Path | None:
    """The library's file of a name, vehicle or device."""
    return next((path for folder in (LIBRARY, DEVICES) if is_file(path := folder / f"{name}.yaml")), None)


def find(name_or_path: str | Path, folder: Path | None = None) -> Path:
    """The file behind a library name or a path; paths are relative to `folder`, a library name may be shadowed there.

    Raises:
        ConfigError: Neither a file nor a name of the library.
    """
    text, folder = str(name_or_path), folder or Path()
    as_path = folder / Path(text).expanduser()
    looks_like_path = as_path.suffix in SUFFIXES or "/" in text or "\\" in text
    if looks_like_path:
        if is_file(as_path):
            return as_path
        shipped = _shipped(Path(text).stem)
        # A part may be written with its suffix and still be the library's.
        if Path(text).name == text and shipped is not None:
            return shipped
        read_yaml(as_path)  # says what is wrong with the path
        raise ConfigError(f"{as_path}: is not a file")
    beside = folder / f"{text}.yaml"
    if is_file(beside):
        return beside
    shipped = _shipped(text)
    if shipped is not None:
        return shipped
    names = list_library() + list_devices()
    raise ConfigError(f"{text}: no such vehicle or device in the library, and no file {beside}.{near(text, names)}")


def reference(path: Path, folder: Path) -> str:
    """How a file in a folder names a vehicle file: the library's name where it leads there, else the way to it."""
    if path.parent in (LIBRARY, DEVICES) and find(path.stem, folder) == path:
        return path.stem
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def load(path: Path) -> VehicleFile:
    """The vehicle in a file, with every `part:` replaced by what its file says."""
    description = parse(VehicleFile, read_yaml(path), path.name)
    return _filled(description, path, (path.resolve(),))


def from_data(data: dict[str, Any], where: str, folder: Path | None = None) -> VehicleFile:
    """The same from data already read; `folder` is what its part files are relative to."""
    description = parse(VehicleFile, data, where)
    return _filled(description, (folder or Path()) / where, ())


def _filled(body: Any, path: Path, chain: tuple[Path, ...], place: str = "") -> Any:
    """A body whose parts, at any depth, no longer refer to files: neither parts nor thrust tables."""
    parts = []
    for i, part in enumerate(body.parts):
        here = f"{place}parts[{i}]"
        if part.part is not None:
            part = _from_file(part, path, chain, here)
        else:
            part = _filled(part, path, chain, f"{here}.")
        parts.append(part)
    parts = _with_names_kept(body, parts)
    thrusters = [_with_table_read(t, path, f"{place}thrusters[{i}]") for i, t in enumerate(body.thrusters)]
    visuals = [_with_mesh_found(v, path, f"{place}visuals[{i}]") for i, v in enumerate(body.visuals)]
    shape = None if body.shape is None else _with_solid_read(body.shape, path, f"{place}shape")
    return body.model_copy(update={"parts": parts, "thrusters": thrusters, "visuals": visuals, "shape": shape})


def _from_file(part: Part, path: Path, chain: tuple[Path, ...], here: str) -> Part:
    try:
        target = find(str(part.part), path.parent)
    except ConfigError as error:
        raise ConfigError(f"{path.name}: {here}.part: {error}") from None
    if target.resolve() in chain:
        names = [p.name for p in chain[chain.index(target.resolve()) :]] + [target.name]
        raise ConfigError(f"{path.name}: {here}.part: a vehicle cannot be a part of itself: {' -> '.join(names)}")
    inner = _filled(parse(VehicleFile, read_yaml(target), target.name), target, (*chain, target.resolve()))
    if inner.identified is not None:
        raise ConfigError(
            f"{path.name}: {here}.part: {target.name} was identified as a whole, which does not carry over to a part. "
            f"Use the vehicle that it was made from, and run: rovtwin identify NEW --prior {target.name} -o NEW_FILE"
        )
    if (count := _bodies(inner)) > MOST_BODIES:
        raise ConfigError(
            f"{path.name}: {here}.part: {target.name} comes to {count} bodies with those of its part files, expected "
            f"{MOST_BODIES} at most: does each of them name the next one several times?"
        )
    own = {key: getattr(inner, key) for key in Body.model_fields}
    given = {key: getattr(part, key) for key in ("description", "source", "sources") if key in part.model_fields_set}
    return Part.model_construct(
        **(own | given), name=part.name, part=None, pose=part.pose, keeps_names=part.keeps_names
    )


def _bodies(body: Any) -> int:
    return 1 + sum(_bodies(part) for part in body.parts)


def _with_names_kept(body: Body, parts: list[Part]) -> list[Part]:
    """The parts, with the vehicle among them marked: the only one with thrusters, if it or a part in it is from a file.

    Names in it stay what they were without the others (`assembly`), so that logs, faults and identifications still fit.

    Args:
        body: Its parts still refer to files.
        parts: The same with what the files say.
    """
    driven = [i for i, part in enumerate(parts) if has_thrusters(part)]
    if body.thrusters or len(driven) != 1:
        return parts
    (i,) = driven
    vehicle = body.parts[i].part is not None or any(inner.keeps_names for inner in parts[i].parts)
    if not vehicle or parts[i].keeps_names is not None:
        return parts
    return [*parts[:i], parts[i].model_copy(update={"keeps_names": True}), *parts[i + 1 :]]


def has_thrusters(body: Body) -> bool:
    """Whether a body or any part in it has thrusters."""
    return bool(body.thrusters) or any(has_thrusters(part) for part in body.parts)


def _with_mesh_found(item: Any, path: Path, here: str) -> Any:
    """A visual or shape whose mesh file, if any, is a path that holds wherever it is read from."""
    if item.mesh is None:
        return item
    target = path.parent / Path(item.mesh).expanduser()
    if not is_file(target):
        raise ConfigError(f"{path.name}: {here}.mesh: found {item.mesh}, but there is no file {target}")
    return item.model_copy(update={"mesh": str(target.resolve())})


def _with_solid_read(shape: Any, path: Path, here: str) -> Any:
    """A shape whose mesh, if any, was found and is a solid."""
    shape = _with_mesh_found(shape, path, here)
    if shape.mesh is not None:
        try:
            mesh_solid(shape.mesh, shape.scale or 1.0)
        except ConfigError as error:
            raise ConfigError(f"{path.name}: {here}.mesh: {error}") from None
    return shape


def with_meshes(body: dict[str, Any], renamed: Callable[[str], str]) -> dict[str, Any]:
    """Plain data of a vehicle or part in which each mesh file, at any depth, has the name that `renamed` gives it.

    What is not as it should be is left as it is, for whoever checks it.
    """

    def one(item: Any) -> Any:
        named = isinstance(item, dict) and isinstance(item.get("mesh"), str)
        return item | {"mesh": renamed(item["mesh"])} if named else item

    def part(item: Any) -> Any:
        return with_meshes(item, renamed) if isinstance(item, dict) else item

    kinds = {"visuals": one, "parts": part}
    lists = {key: [of(i) for i in body[key]] for key, of in kinds.items() if isinstance(body.get(key), list)}
    return body | lists | ({"shape": one(body["shape"])} if "shape" in body else {})


def _with_table_read(thruster: Any, path: Path, here: str) -> Any:
    """A thruster whose CSV files, if any, are points by voltage, as a file could hold them."""
    table = getattr(thruster.curve, "table", None)
    names = [table] if isinstance(table, str) else table
    if not isinstance(names, list) or not isinstance(names[0], str):
        return thruster
    points: dict[str, list[list[float]]] = {}
    for name in names:
        try:
            target = path.parent / Path(name).expanduser()
            voltage, curve = read_points(target) if target.suffix == ".txt" else read_bollard_csv(target)
        except ConfigError as error:
            raise ConfigError(f"{path.name}: {here}.curve.table: {error}") from None
        if f"{voltage:.10g}" in points:
            raise ConfigError(f"{path.name}: {here}.curve.table: {name}: a second table at {voltage:g} V; keep one")
        if not math.isfinite(voltage):
            if len(names) > 1:
                raise ConfigError(f"{path.name}: {here}.curve.table: {name}: says no voltage; give it alone")
            return thruster.model_copy(update={"curve": thruster.curve.model_copy(update={"table": curve.tolist()})})
        points[f"{voltage:.10g}"] = curve.tolist()
    return thruster.model_copy(update={"curve": thruster.curve.model_copy(update={"table": points})})
