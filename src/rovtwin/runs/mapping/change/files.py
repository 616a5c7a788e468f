"""Files of what changed between two mosaics: layers, outlines and figures."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.change.things import Thing
from rovtwin.mapping.formats.geotiff import write_layers
from rovtwin.mapping.formats.vectors import polygons, write_geojson
from rovtwin.runs.mapping.change.difference import Difference
from rovtwin.runs.mapping.result import Mosaic

LAYERS = {
    "change": "change of reflectance, mean over the least thing, as a share of it",
    "sd": "its standard deviation",
    "chance": "probability that a place differs so much where nothing changed; 0.5: half of them or more do",
    "shift_east": "how far the second mosaic lies east of the first [m]",
    "shift_north": "the same to the north [m]",
    "shift_sd": "standard deviation of each [m]",
}


def written(found: Difference, first: Mosaic, second: Mosaic, folder: Path) -> Path:
    """Layers, changes as GeoJSON, and `change.json`.

    Raises:
        LogError: They cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    east, north = found.moved.shift[:, :, 1] * found.grid.cell, -found.moved.shift[:, :, 0] * found.grid.cell
    layers = {
        "change": (np.expm1(found.test.difference.mean(axis=2)), "1"),
        "sd": (found.test.sd, "1"),
        "chance": (found.test.chance, "1"),
        "shift_east": (np.where(found.seen, east, np.nan), "m"),
        "shift_north": (np.where(found.seen, north, np.nan), "m"),
        "shift_sd": (np.where(found.seen, found.moved.sd * found.grid.cell, np.nan), "m"),
    }
    write_layers(folder / "change.tif", found.grid, layers, LAYERS)
    kinds = {"changes": ("change", found.things), "standing_or_moved": ("standing or moved", found.elsewhere)}
    features = [
        {**polygon, "properties": {"kind": kind, **_properties(number, thing, found)}}
        for kind, some in kinds.values()
        for number, thing in enumerate(some, start=1)
        for polygon in polygons(thing.cells, found.grid)[:1]
    ]
    write_geojson(folder / "changes.geojson", features)
    note = {
        "first": str(first.folder), "second": str(second.folder), "figures": found.figures, "remarks": found.remarks,
        "wavelengths_nm": found.wavelengths.tolist(),
    } | {
        name: [_properties(number, thing, found) for number, thing in enumerate(some, start=1)]
        for name, (_, some) in kinds.items()
    }  # fmt: skip
    write_text(folder / "change.json", json.dumps(note, indent=1) + "\n")
    return folder


def _properties(number: int, thing: Thing, found: Difference) -> dict[str, Any]:
    x = found.grid.left + (thing.place[1] + 0.5) * found.grid.cell
    y = found.grid.top - (thing.place[0] + 0.5) * found.grid.cell
    return {
        "number": number,
        "x_m": round(x, 3),
        "y_m": round(y, 3),
        "area_m2": round(thing.area, 5),
        "size_m": [round(side, 3) for side in thing.size],
        "contrast": round(float(thing.contrast.mean()), 4),
        "sd": round(thing.sd, 4),
        "contrast_by_channel": [round(float(value), 4) for value in thing.contrast],
        "chance": float(f"{thing.chance:.2g}"),
    }
