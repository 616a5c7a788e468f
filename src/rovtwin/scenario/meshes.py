"""Mesh files of a vehicle that is written out in a scenario: they travel with the run's folder."""

import shutil
from pathlib import Path
from typing import Any

from rovtwin.vehicle.files import with_meshes

FOLDER = "meshes"


def kept_beside(vehicle: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Copies a vehicle's mesh files into a run's folder.

    Args:
        vehicle: Its plain data, mesh files by whatever path leads there.
        folder: Of the run, which is there.

    Returns:
        The data with the copies' names, relative to the folder. Files of one name from two places get two names.
    """
    names: dict[str, str] = {}

    def copied(mesh: str) -> str:
        if mesh not in names:
            source, taken = Path(mesh), set(names.values())
            (folder / FOLDER).mkdir(exist_ok=True)
            candidates = (f"{FOLDER}/{source.stem}{f'_{k}' if k else ''}{source.suffix}" for k in range(len(taken) + 1))
            names[mesh] = next(name for name in candidates if name not in taken)
            shutil.copyfile(source, folder / names[mesh])
        return names[mesh]

    return with_meshes(vehicle, copied)


def found_beside(vehicle: dict[str, Any], base: Path) -> dict[str, Any]:
    """A vehicle's plain data with mesh files that lie beside the scenario's file by their whole path."""

    def found(mesh: str) -> str:
        here = base / Path(mesh).expanduser()
        return str(here.resolve()) if here.is_file() else mesh

    return with_meshes(vehicle, found)
