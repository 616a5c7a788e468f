"""A vehicle with foam and lead on it: a file that holds the vehicle as a part, and what the pieces change."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError, exists_already
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.vehicle.analysis.hydrostatics import floating_of
from rovtwin.vehicle.description import files
from rovtwin.vehicle.description.vehicle import Vehicle, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.water import check_density
from rovtwin.vehicle.outfitting.ballast import FOAM, LEAD, BallastTarget, Piece, Stock, pieces_for
from rovtwin.vehicle.outfitting.editing import made_by
from rovtwin.vehicle.outfitting.places import ROUNDS, around_hull, laid_out

STEP = 0.01  # what pieces are rounded to unless a step is given [kg]
SHARE = 0.25  # of the vehicle's mass: more foam and lead than that is another vehicle
LARGEST_BG = 1.0  # [m]; more is a slip of units


@dataclass(frozen=True)
class Materials:
    """What one has at hand, and where it may go; None: as the vehicle suggests.

    Attributes:
        foam_density: [kg/m3].
        weight_density: [kg/m3].
        places: Where the middle of a piece may be, in b [m], shape (k, 3); None: on the box around the hull.
        most: Of all pieces together [kg]; None: `SHARE` of what the vehicle weighs.
    """

    foam_density: float = FOAM
    weight_density: float = LEAD
    places: Sequence[Sequence[float]] | None = None
    most: float | None = None


def ballast(
    name_or_path: str | Path,
    target: BallastTarget,
    materials: Materials | None = None,
    water_density: float | None = None,
    step: float | None = None,
    out: Path | None = None,
    command: str = "",
) -> dict[str, Any]:
    """Pieces for a vehicle, what they change, and if asked the file of the vehicle with them.

    Args:
        name_or_path: A vehicle.
        target: What it should be like.
        materials: What there is.
        water_density: Of the water it should float in [kg/m3]; None: that of the file.
        step: Pieces are rounded to this [kg]; None: they are exact, and what rounding to `STEP` does is reported.
        out: File to write; must not exist.
        command: What the file's first line says it was made by.

    Returns:
        JSON-serialisable: target, pieces, before, after, rounded (None where they are), file.

    Raises:
        ConfigError: Nothing asked for, a target out of reach (with what is in reach), or a file that is in the way.
    """
    _require_sense(target)
    if out is not None:
        _require_new(out)
    path = files.find(name_or_path)
    vehicle = load_vehicle(path)
    density = vehicle.assembly.density if water_density is None else check_density(water_density)
    total = vehicle.in_water(density).assembly
    folder, stock = Path() if out is None else out.parent, _stock(vehicle, materials or Materials())
    reference = files.reference(path, folder)
    exact, remarks = laid_out(
        lambda places: pieces_for(total, target, replace(stock, places=places)),
        stock.places,
        lambda pieces: (
            vehicle_from_dict(wrapper(vehicle, reference, pieces, density), "ballasted vehicle", folder).file
        ),
        0 if materials is not None and materials.places is not None else ROUNDS,
    )
    rounded = [p for p in (piece.rounded(STEP if step is None else step) for piece in exact) if p.mass > 0]
    pieces = exact if step is None else rounded

    data = wrapper(vehicle, reference, pieces, density)
    if out is not None:
        _write(data, out, command)
    where = "ballasted vehicle" if out is None else out.name
    before, after = figures(vehicle, density), figures(vehicle_from_dict(data, where, folder), density)
    return {
        "vehicle": vehicle.name,
        "water_density_kgm3": density,
        "target": {
            "net_buoyancy_N": target.net_buoyancy,
            "level": target.level,
            "metacentric_height_m": target.metacentric_height,
        },
        "pieces": [_described(piece, name) for piece, name in zip(pieces, names(pieces), strict=True)],
        "before": before,
        "after": after,
        "rounding_kg": STEP if step is None else step,
        "rounded": None if step is not None else _rounded_figures(vehicle, path, rounded, density),
        "notes": [*_notes(target, before, after), *remarks],
        "file": None if out is None else str(out),
    }


def _rounded_figures(vehicle: Vehicle, path: Path, rounded: list[Piece], density: float) -> dict[str, Any]:
    data = wrapper(vehicle, files.reference(path, Path()), rounded, density)
    return figures(vehicle_from_dict(data, "ballasted vehicle", Path()), density)


def figures(vehicle: Vehicle, density: float) -> dict[str, Any]:
    """How a vehicle floats in water of a density, JSON-serialisable."""
    total = vehicle.in_water(density).assembly
    rest = floating_of(total)
    roll, pitch = (float(angle) if np.isfinite(angle) else None for angle in np.degrees(rest.trim))
    return {
        "mass_kg": float(total.solid.mass),
        "net_buoyancy_N": float(rest.net_buoyancy),
        "roll_deg": roll,
        "pitch_deg": pitch,
        "metacentric_height_m": float(rest.metacentric_height),
        "righting_stiffness_Nm_per_rad": float(rest.stiffness[0]),
    }


def _notes(target: BallastTarget, before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """What the target left open, or asked for and may not have meant."""
    found = []
    if after["righting_stiffness_Nm_per_rad"] <= 0:
        found.append("it capsizes: no righting moment is left; ask for a BG with --bg")
    elif not target.level and max(abs(after["roll_deg"] or 0.0), abs(after["pitch_deg"] or 0.0)) > 0.5:
        found.append("it does not hang level: ask for it with --level")
    was, required = before["metacentric_height_m"], target.metacentric_height
    if required is not None and was > required + 1e-6:
        found.append(f"BG is lowered from {1000 * was:.3g} mm, as asked; without --bg fewer pieces may do")
    return found


def names(pieces: Sequence[Piece], taken: Collection[str] = ()) -> list[str]:
    """foam_1, foam_2, lead_1, in order; a number that is taken is passed over."""
    found: list[str] = []
    for piece in pieces:
        numbered = (f"{piece.material}_{i}" for i in count(1))
        found.append(next(name for name in numbered if name not in taken and name not in found))
    return found


def weighed(pieces: Sequence[Piece]) -> str:
    """How much there is of each material, in words; empty without pieces."""
    weights = {m: sum(p.mass for p in pieces if p.material == m) for m in dict.fromkeys(p.material for p in pieces)}
    return " and ".join(f"{1000 * mass:.0f} g of {material}" for material, mass in weights.items())


def size(piece: Piece) -> tuple[float, float, float]:
    """Length, width, height [m] of the flat block, twice as long and wide as high, that stands for a piece."""
    height = (piece.volume / 4.0) ** (1.0 / 3.0)
    return 2.0 * height, 2.0 * height, height


def blocks(pieces: Sequence[Piece], taken: Collection[str] = ()) -> list[dict[str, Any]]:
    """The pieces as parts of a vehicle file, with names that are not taken."""
    return [
        {
            "name": name,
            "pose": {"position": list(piece.position)},
            "mass": _written(piece.mass),
            "volume": _written(piece.volume),
            "shape": {"box": [float(f"{edge:.4g}") for edge in size(piece)]},
        }
        for piece, name in zip(pieces, names(pieces, taken), strict=True)
    ]


def wrapper(vehicle: Vehicle, reference: str, pieces: Sequence[Piece], density: float) -> dict[str, Any]:
    """The vehicle as a part `rov`, with the pieces beside it: data of a vehicle file.

    Args:
        vehicle: As it is.
        reference: Library name or path of its file, as the new file should say.
        pieces: To add.
        density: Of the water [kg/m3].
    """
    return {
        "name": f"{vehicle.name}_ballasted",
        "description": f"{vehicle.name} with {weighed(pieces) or 'nothing'} added",
        "water_density": density,
        "parts": [_as_it_was(vehicle, reference, density), *blocks(pieces)],
    }


def _as_it_was(vehicle: Vehicle, reference: str, density: float) -> dict[str, Any]:
    """The vehicle as a part, its values still holding in the water of its own file."""
    own = vehicle.assembly.density
    if vehicle.file.water_density is not None or own == density:
        return {"name": "rov", "part": reference}
    # A file that names no water takes its parent's: `buoyancy: neutral` would become neutral in the new water.
    return {"name": "rov", "water_density": own, "parts": [{"name": "vehicle", "part": reference}]}


def _described(piece: Piece, name: str) -> dict[str, Any]:
    return {
        "name": name,
        "material": piece.material,
        "mass_kg": piece.mass,
        "volume_m3": piece.volume,
        "position_m": list(piece.position),
        "size_m": list(size(piece)),
    }


def _written(value: float) -> float:
    return float(f"{value:.12g}")  # as text that people can read; 1e-12 of a piece is no force


def _require_sense(target: BallastTarget) -> None:
    if target == BallastTarget():
        raise ConfigError("nothing is asked for: give --buoyancy, --level or --bg")
    bg = target.metacentric_height
    if bg is not None and bg <= 0:
        raise ConfigError(f"BG {1000 * bg:g} mm: CG would not be below CB, the vehicle capsizes; expected more than 0")
    if bg is not None and bg > LARGEST_BG:
        raise ConfigError(f"BG {bg:g} m is more than {LARGEST_BG:g} m; did you mean {bg:g}mm?")


def _stock(vehicle: Vehicle, materials: Materials) -> Stock:
    most = SHARE * vehicle.assembly.solid.mass if materials.most is None else materials.most
    if materials.places is not None:
        places = np.array(materials.places, dtype=float)
        far = np.abs(places).max()
        if far > 10.0:
            raise ConfigError(f"a place {far:g} m from CO, expected within 10 m; did you mean {far:g}mm?")
    else:
        places = around_hull(vehicle)
    return Stock(places, most, materials.foam_density, materials.weight_density)


def _require_new(out: Path) -> None:
    if out.suffix not in files.SUFFIXES:
        raise ConfigError(f"{out}: found the ending '{out.suffix}', expected .yaml")
    if out.exists():
        raise ConfigError(exists_already(out))
    if not out.parent.is_dir():
        raise ConfigError(f"{out}: there is no folder {out.parent}")


def _write(data: dict[str, Any], out: Path, command: str) -> None:
    text = dump_yaml(data, default_flow_style=None, allow_unicode=True)
    with out.open("x", encoding="utf-8") as file:  # "x": also where somebody else made it meanwhile
        file.write((made_by(command) if command else "") + text)
