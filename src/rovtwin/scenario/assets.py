"""Files that a vehicle or a scenario names - meshes, scenes: they travel with what is written out."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import is_file, write_bytes, write_text
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.simulation.camera.sensor import CameraSection
from rovtwin.simulation.scene import is_scene_file, load_scene
from rovtwin.vehicle.description.files import with_meshes

MESHES, SCENES = "meshes", "scenes"


def kept_beside(vehicle: dict[str, Any], folder: Path, within: str = MESHES) -> dict[str, Any]:
    """Copies a vehicle's mesh files to where its data is written.

    Args:
        vehicle: Its plain data, mesh files by whatever path leads there.
        folder: Of the file that the data will stand in, which is there.
        within: Folder in it that is made for the copies.

    Returns:
        The data with the copies' names, relative to the folder. Files of one name from two places get two names.
    """
    found: list[str] = []
    with_meshes(vehicle, lambda mesh: found.append(mesh) or mesh)
    names = _copied(found, folder / within)
    return with_meshes(vehicle, lambda mesh: f"{within}/{names[mesh]}")


def scenes_kept_beside(cameras: Sequence[CameraSection], folder: Path) -> list[CameraSection]:
    """Cameras whose scene files, with the meshes in them, are copied into `scenes` of a folder and named there.

    Raises:
        ConfigError: A scene file, or a mesh in it, is not there or cannot be used.
    """
    names: dict[str, str] = {}
    for scene in dict.fromkeys(one.scene for one in cameras if is_scene_file(one.scene)):
        name = _free(Path(scene), names.values())
        names[scene] = f"{SCENES}/{name}"
        _copy_scene(scene, folder / SCENES / name)
    return [one.model_copy(update={"scene": names.get(one.scene, one.scene)}) for one in cameras]


def _copy_scene(name: str, target: Path) -> None:
    scene = load_scene(name)
    data = scene.file.model_dump(mode="json", exclude_unset=True)
    meshes = [item["mesh"] for item in data.get("objects", []) if item.get("mesh") is not None]
    for mesh in meshes:
        source = scene.folder / Path(mesh["file"]).expanduser()
        if not is_file(source):
            raise ConfigError(f"{scene.where}: objects: mesh: found file {mesh['file']}, but there is no file {source}")
        mesh["file"] = str(source)
    target.parent.mkdir(exist_ok=True)
    within = f"{target.name}_{MESHES}"  # with its ending: two scenes may differ in nothing else
    copies = _copied([mesh["file"] for mesh in meshes], target.parent / within)
    for mesh in meshes:
        mesh["file"] = f"{within}/{copies[mesh['file']]}"
    write_text(target, dump_yaml(data))


def _copied(files: Sequence[str], folder: Path) -> dict[str, str]:
    """Copies files into a folder, which is made if there are any; the names that they have there, all different."""
    names: dict[str, str] = {}
    for file in dict.fromkeys(files):
        names[file] = _free(Path(file), names.values())
    contents = {name: Path(file).read_bytes() for file, name in names.items()}  # before any of them is written over
    for name, content in contents.items():
        folder.mkdir(parents=True, exist_ok=True)
        write_bytes(folder / name, content)
    return names


def _free(path: Path, taken: Any) -> str:
    """The name of a file, with a number where others have that name."""
    used = {Path(name).name for name in taken}
    candidates = (f"{path.stem}{f'_{k}' if k else ''}{path.suffix}" for k in range(len(used) + 1))
    return next(name for name in candidates if name not in used)


def found_beside(data: dict[str, Any], base: Path) -> dict[str, Any]:
    """A scenario's plain data in which meshes and scenes that lie beside its file are named by their whole path."""

    def found(file: str) -> str:
        here = base / Path(file).expanduser()
        return str(here.resolve()) if is_file(here) else file

    def camera(item: Any) -> Any:
        named = isinstance(item, dict) and isinstance(item.get("scene"), str) and is_scene_file(item["scene"])
        return item | {"scene": found(item["scene"])} if named else item

    changed: dict[str, Any] = {}
    if isinstance(vehicle := data.get("vehicle"), dict):
        changed["vehicle"] = with_meshes(vehicle, found)
    if isinstance(cameras := data.get("cameras"), list):
        changed["cameras"] = [camera(item) for item in cameras]
    return data | changed
