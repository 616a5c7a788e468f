"""A part bolted onto a vehicle or taken off it: the new file's text, and the vehicle before and after.

A vehicle of the library, and a file that gives totals of the whole (`rigid_body`, `restoring`, `hydrodynamics`), is
held as a part with the device beside it, so that what is published of it stays and the device's own is added. A file of
one's own without totals is written again with one line more, all its comments kept.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.yamlfile import parse_yaml, read_yaml
from rovtwin.vehicle.analysis.extent import bounding_box
from rovtwin.vehicle.analysis.hydrostatics import floating_of
from rovtwin.vehicle.analysis.overlap import overlaps
from rovtwin.vehicle.description import files
from rovtwin.vehicle.description.identified import fingerprint
from rovtwin.vehicle.description.instruments import instruments
from rovtwin.vehicle.description.schema import Body, Part
from rovtwin.vehicle.description.vehicle import Vehicle, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.outfitting.ballast import FOAM, LEAD, BallastTarget, Piece, Stock, pieces_for
from rovtwin.vehicle.outfitting.ballasted import SHARE, blocks, weighed
from rovtwin.vehicle.outfitting.editing import (
    is_made,
    with_head,
    with_parts,
    with_references,
    with_spares,
    without_part,
    written,
)
from rovtwin.vehicle.outfitting.places import around_hull, laid_out
from rovtwin.vehicle.physics.actuation import size

TOTALS = ("rigid_body", "restoring", "hydrodynamics")
FAR = 20.0  # sizes of the vehicle from it, beyond which nothing is bolted on
STEP = 0.001  # what pieces of ballast are rounded to [kg]


@dataclass(frozen=True)
class Refit:
    """What changing a vehicle comes to.

    Attributes:
        text: Of the new file.
        before: The vehicle by its parts, without what tests found of it.
        after: The same with the change.
        notes: What to know.
        folder: What references to files in the text are relative to.
        what: What was done to the vehicle, in words that follow its name.
        made: Whether a command wrote the head of the text (its first line, name and description), and not a person.
        predicted: Whether tests identified the vehicle, so that `before` and `after` are predictions beside it.
    """

    text: str
    before: Vehicle
    after: Vehicle
    notes: tuple[str, ...]
    folder: Path
    what: str
    made: bool
    predicted: bool = False


def add(
    vehicle: str | Path,
    device: str | Path,
    position: Sequence[float],
    attitude_deg: Sequence[float] = (0.0, 0.0, 0.0),
    name: str | None = None,
    out: Path | None = None,
) -> Refit:
    """A vehicle with one part more; nothing is written.

    Args:
        vehicle: Library name or file.
        device: Library name or file of what is added.
        position: Of the part's origin in b [m].
        attitude_deg: Roll, pitch, yaw of the part.
        name: Of the part; None: as its file is called.
        out: File that the text is for; references to files are relative to its folder.

    Raises:
        ConfigError: No such vehicle or device, a place in millimetres, a name that is taken, or parts that make no
            vehicle.
    """
    path, part_path, folder = files.find(vehicle), files.find(device), Path() if out is None else out.parent
    _require_near(position, load_vehicle(path, identified=False))
    before, identified = load_vehicle(path, identified=False), files.load(path).identified is not None
    beside = path.parent != files.LIBRARY and path.parent.resolve() == folder.resolve()
    extended = beside and not identified and not _totals(before)
    holder = {} if extended else _holder(path, before, folder, out)
    taken = [part.name for part in before.file.parts] if extended else [holder["parts"][0]["name"]]
    part = {
        "name": _free_name(name, _log_name(part_path.stem), taken),
        "part": files.reference(part_path, folder),
        "pose": {"position": [float(x) for x in position]},
    }
    if any(attitude_deg):
        part["pose"]["attitude_deg"] = [float(angle) for angle in attitude_deg]
    if extended:
        own = path.read_text(encoding="utf-8")
        text, made = _respelt(with_parts(own, [part], path.name), before, path), is_made(own)
    else:
        holder["description"] = f"{before.name} with {part['name']}"
        text, made = written(holder | {"parts": [*holder["parts"], part]}), True
    after = _read(text, out, folder)
    lie = [one.line() for one in overlaps(after.file, after.name) if one.moved == part["name"]]
    notes = (*lie, *_about_identification(path, out))
    return Refit(text, before, after, notes, folder, f"with {part['name']}", made, predicted=identified)


def _require_near(position: Sequence[float], vehicle: Vehicle) -> None:
    """Nothing is bolted on tens of vehicles away: that is a place in millimetres.

    Raises:
        ConfigError: It is.
    """
    box, length = bounding_box(vehicle.file), size(vehicle.model())
    centre = np.zeros(3) if box is None else np.clip(position, *box)
    away = float(np.linalg.norm(np.asarray(position) - centre))
    if away > FAR * length:
        raise ConfigError(
            f"the part would be {away:.3g} m away from {vehicle.name}, a vehicle of some {length:.2g} m: expected its "
            "place in metres, -0.2,0,0.16, or with the unit, -200mm,0,160mm"
        )


def remove(vehicle: str | Path, name: str, out: Path | None = None) -> Refit:
    """A vehicle with one part fewer; nothing is written.

    Args:
        vehicle: Library name or file.
        name: Of the part, in the list `parts` of that file.
        out: File that the text is for; references to files become relative to its folder. None: to the vehicle's.

    Raises:
        ConfigError: It has no such part, or is no vehicle without it.
    """
    path = files.find(vehicle)
    folder = path.parent if out is None else out.parent
    before = load_vehicle(path, identified=False)
    text = path.read_text(encoding="utf-8")
    made, identified = is_made(text), "identified" in parse_yaml(text, path.name)
    if identified:
        text = written({key: value for key, value in read_yaml(path).items() if key != "identified"})
    text = _moved(_respelt(without_part(text, name, path.name), before, path), path, folder)
    notes = [
        f"{path.name} gives {key} of the whole, which stays as it is without '{name}': take it out, or measure it again"
        for key in _totals(before)
    ]
    after = _read(text, out, folder)
    if (left := instruments(after)) and all(one.spare for one in left):
        notes.append("all instruments that are left are spare_sensors, so that none is read: take them out there")
    notes += _about_identification(path, out)
    return Refit(text, before, after, tuple(notes), folder, f"without {name}", made, predicted=identified)


def trimming(before: Vehicle, after: Vehicle, net_buoyancy: float | None = None) -> list[Piece]:
    """Least foam and lead that gives a changed vehicle its net buoyancy and hangs it level, to the gram.

    The pieces sit on the box around the hull of the vehicle as it was; of one without shapes, around its thrusters.
    Where one would lie in another part it is shifted (`places.laid_out`).

    Args:
        before: The vehicle as it was.
        after: The changed one.
        net_buoyancy: The requested one, positive floats [N]; None: that of before.

    Raises:
        ConfigError: No pieces do it.
    """
    target = BallastTarget(
        floating_of(before.assembly).net_buoyancy if net_buoyancy is None else net_buoyancy, level=True
    )
    stock = Stock(around_hull(before), SHARE * after.assembly.solid.mass, FOAM, LEAD)

    def solve(places: np.ndarray) -> list[Piece]:
        pieces = [piece.rounded(STEP) for piece in pieces_for(after.assembly, target, replace(stock, places=places))]
        return [piece for piece in pieces if piece.mass > 0]

    def assembled(pieces: Sequence[Piece]) -> Body:
        parts = after.file.parts
        laid_on = [Part.model_validate(block) for block in blocks(pieces, [part.name for part in parts])]
        return after.file.model_copy(update={"parts": [*parts, *laid_on]})

    return laid_out(solve, stock.places, assembled)[0]


def with_ballast(change: Refit, pieces: Sequence[Piece], out: Path | None = None) -> Refit:
    """The same with pieces on it, and a note on each that lies in another part."""
    where = "vehicle" if out is None else out.name
    parts = blocks(pieces, [part.name for part in change.after.file.parts])
    text = with_parts(change.text, parts, where) if parts else change.text
    after = _read(text, out, change.folder)
    lie = [one.line() for one in overlaps(after.file, after.name, [part["name"] for part in parts])]
    return replace(change, text=text, after=after, notes=(*change.notes, *lie))


def signed(change: Refit, command: str, out: Path, pieces: Sequence[Piece] = ()) -> Refit:
    """The same with first line, name and description of the command that writes it.

    A file that a person wrote keeps its own.
    """
    if not change.made:
        return change
    about = f"{change.before.name} {change.what}" + (f", {weighed(pieces)} added" if pieces else "")
    text = with_head(change.text, command, out.stem, about, out.name)
    return replace(change, text=text, after=_read(text, out, change.folder))


def _read(text: str, out: Path | None, folder: Path) -> Vehicle:
    where = "vehicle" if out is None else out.name
    return vehicle_from_dict(parse_yaml(text, where), where, folder)


def _respelt(text: str, before: Vehicle, path: Path) -> str:
    """The text with `spare_sensors` as its parts spell them, without those of a part that went.

    With one part fewer or more, names in the others may lose or gain their part's: `starboard.imu` is `imu` alone.
    """
    data = parse_yaml(text, path.name)
    if not data.pop("spare_sensors", None):
        return text
    now = {(*s.path, s.item.name): s.name for s in vehicle_from_dict(data, path.name, path.parent).sensors}
    was = {s.name: (*s.path, s.item.name) for s in before.sensors}
    return with_spares(text, [now.get(was[name]) for name in before.file.spare_sensors or []], path.name)


def _moved(text: str, path: Path, folder: Path) -> str:
    """The text of a file for another folder: what it names with a relative path is named from there."""
    if folder.resolve() == path.parent.resolve():
        return text

    def renamed(key: str, name: str) -> str:
        if key != "part":
            target = path.parent / Path(name).expanduser()
            return name if Path(name).expanduser().is_absolute() else files.reference(target, folder)
        target = files.find(name, path.parent)
        same = _found(name, folder) == target.resolve()
        return name if same else files.reference(target, folder)

    moved = with_references(text, renamed)
    was = vehicle_from_dict(parse_yaml(text, path.name), path.name, path.parent)
    if _read(moved, None, folder).to_dict() != was.to_dict():
        raise ConfigError(f"{path.name}: its references to files cannot be moved to {folder}: write it beside it (-o)")
    return moved


def _found(name: str, folder: Path) -> Path | None:
    try:
        return files.find(name, folder).resolve()
    except ConfigError:
        return None


def _totals(vehicle: Vehicle) -> list[str]:
    return [key for key in TOTALS if getattr(vehicle.file, key) is not None]


def _holder(path: Path, vehicle: Vehicle, folder: Path, out: Path | None) -> dict[str, Any]:
    """Data of a file that holds a vehicle as its only part."""
    if out is not None and out.resolve() == path.resolve():
        totals = " and ".join(_totals(vehicle)) or "parameters"
        raise ConfigError(
            f"{path}: gives {totals} of the whole, so that it must become a part of another file; choose one"
        )
    name, whole = _log_name(vehicle.name), {"name": f"{vehicle.name}_refitted" if out is None else out.stem}
    whole |= {"description": vehicle.description}
    if vehicle.file.water_density is not None:
        whole |= {"water_density": vehicle.file.water_density}
    identified = files.load(path).identified
    if identified is None:
        return whole | {"parts": [{"name": name, "part": files.reference(path, folder)}]}
    # What was identified as a whole does not carry over to a part: hold the vehicle that it was identified from.
    for shipped in files.list_library():
        if fingerprint(files.load(files.find(shipped))) == identified.made_with:
            return whole | {"parts": [{"name": name, "part": shipped}]}
    own = vehicle.without_identification().to_dict()
    return whole | {"parts": [own | {"name": name, "keeps_names": True}]}


def _log_name(text: str) -> str:
    """A name as parts may have it: a letter, then letters, digits and _."""
    plain = re.sub(r"\W", "_", text, flags=re.ASCII)
    return plain if plain[:1].isalpha() else f"v_{plain}"


def _free_name(given: str | None, usual: str, taken: Sequence[str]) -> str:
    if given in taken:
        raise ConfigError(f"--name {given}: there is a part of that name already; there are {', '.join(taken)}")
    names = [given or usual, *(f"{usual}_{i}" for i in range(2, len(taken) + 3))]
    return next(name for name in names if name not in taken)


def _about_identification(path: Path, out: Path | None) -> list[str]:
    if files.load(path).identified is None:
        return []
    new = "NEW.yaml" if out is None else str(out)
    return [
        f"{path.name} was identified with other parts: what tests found does not hold any more, and both columns are "
        f"what parts and published values give. Predict it: rovtwin identify {new} --prior {path} -o PREDICTED.yaml"
    ]
