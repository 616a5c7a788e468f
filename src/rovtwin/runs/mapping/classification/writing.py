"""Files of a classification but its page; the note comes last."""

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin._version import __version__
from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.classes.accuracy import FEW, Confusion
from rovtwin.mapping.formats import envi, geotiff
from rovtwin.mapping.formats.class_colours import MIXED, OUTSIDE, ClassMap, Colour, class_colours
from rovtwin.runs.mapping.classification.judging import Checked, Truth
from rovtwin.runs.mapping.classification.result import NOTE, Classification
from rovtwin.runs.mapping.classification.work import NOT_SEEN, Classified

FILES = {
    "classes.tif": "class of each cell, with colours and names: cloud-optimised GeoTIFF (names in classes.tif.aux.xml)",
    "classes.img": "the same: ENVI classification, with header classes.hdr",
    "abundance.tif": "share of each class with its standard deviation by noise, brightness: cloud-optimised GeoTIFF",
    "angle.tif": "angle to the nearest class, margin to the second, limit, angle to the nearest mixture [deg]",
    "areas.csv": "area of each class with its interval",
    "classes.json": "areas, angles between classes, accuracy, remarks",
}


@dataclass(frozen=True)
class Judged:
    """A classification with what is known of its accuracy.

    Attributes:
        found: Classes.
        truth: Of a simulation; None without.
        checked: By check points; None without.
    """

    found: Classified
    truth: Truth | None
    checked: Checked | None

    @property
    def colours(self) -> list[Colour]:
        """Of the values 0 .. K + 1."""
        return [OUTSIDE, *class_colours(self.found.names), MIXED]


def alike(found: Classified) -> list[tuple[str, str, float]]:
    """Pairs of classes that lie closer than their errors, with the angle between them [rad]."""
    prepared, classes = found.prepared, found.prepared.classes
    off = np.sqrt(prepared.common**2 + classes.variability**2)  # noise averages out over a patch
    return [
        (classes.names[i], name, float(classes.between[i, k]))
        for k, name in enumerate(classes.names)
        for i in range(k)
        if classes.between[i, k] < off[i] + off[k]
    ]


def remarks_of(judged: Judged) -> list[str]:
    """For people."""
    found = judged.found
    words = list(found.prepared.remarks)
    for one, other, angle in alike(found):
        words.append(
            f"{one} and {other} are {np.degrees(angle):.1f} deg apart, less than what their spectra may be off by: "
            "what is mapped as one may be the other"
        )
    a, total = found.areas, found.total_m2
    if a.outside > 0.0:
        words.append(
            f"{total * a.outside:.2f} m2 ({a.outside:.1%}) are not of this library: neither a class nor a mixture "
            "explains them; areas of classes are without them, `most_m2` has those that are nearest to each"
        )
    if found.missed:
        words.append(f"{found.missed} cells know less than half of the bands and are not classified")
    if judged.checked is None:
        words.append("intervals hold only as far as the library does: give --check points for areas that do not ask it")
    else:
        words += _of_checks(judged.checked)
    return words


def _of_checks(checked: Checked) -> list[str]:
    words = [
        f"{checked.confusion.count.sum()} check points: their areas hold if they were drawn at random within each class"
    ]
    if checked.areas.few:
        words.append(
            f"fewer than 2 check points on {', '.join(checked.areas.few)} ({checked.areas.unknown:.1%} of the area): "
            "whatever lies there widens each interval by all of it"
        )
    if checked.areas.rough:
        words.append(
            f"fewer than {FEW} check points on {', '.join(checked.areas.rough)}: their intervals are rough there"
        )
    if checked.unseen:
        words.append(f"{checked.unseen} check points lie on cells without a class and are left out")
    return words


def areas_of(judged: Judged) -> list[dict[str, Any]]:
    """By class [m2]."""
    found, total = judged.found, judged.found.total_m2
    a, rows = found.areas, []
    for k, name in enumerate(found.names):
        row: dict[str, Any] = {
            "class": name,
            "area_m2": total * a.unmixed[k],
            "low_m2": total * a.low[k],
            "high_m2": total * a.high[k],
            "most_m2": total * (a.high[k] + a.nearest[k]),
            "counted_m2": total * a.counted[k],
        }
        if judged.checked is not None:
            areas, true = judged.checked.areas, judged.checked.confusion.true
            low, high = areas.interval()
            at = true.index(name) if name in true else None
            row["checked_m2"] = 0.0 if at is None else total * areas.share[at]
            row["checked_low_m2"] = 0.0 if at is None else total * low[at]
            row["checked_high_m2"] = total * (areas.most_absent() if at is None else high[at])
        if judged.truth is not None:
            row["true_m2"] = total * judged.truth.share[k]
        rows.append({key: one if isinstance(one, str) else float(f"{one:.6g}") for key, one in row.items()})
    return rows


def write_files(judged: Judged, folder: Path) -> Classification:
    """Rasters, areas and note.

    Raises:
        LogError: They cannot be written.
    """
    found = judged.found
    prepared, total = found.prepared, found.total_m2
    _rasters(judged, folder)
    areas = areas_of(judged)
    table = io.StringIO()
    rows = csv.DictWriter(table, list(areas[0]), lineterminator="\n")
    rows.writeheader()
    rows.writerows(areas)
    figures: dict[str, Any] = {
        "classified_m2": total,
        "mixed_m2": total * found.areas.mixed,
        "not_of_library_m2": total * found.areas.outside,
        "bands": len(prepared.bands),
        "angle_median_deg": float(np.degrees(np.nanmedian(found.layers.angle))),
    }
    note: dict[str, Any] = {
        "rovtwin": __version__,
        "mosaic": str(prepared.mosaic.folder),
        "library": prepared.classes.source,
        "figures": figures,
        "areas": areas,
        "angles_deg": np.degrees(prepared.classes.between).round(2).tolist(),
        "not_apart": [[one, other, round(float(np.degrees(angle)), 2)] for one, other, angle in alike(found)],
        "variability_deg": np.degrees(prepared.classes.variability).round(3).tolist(),
        "remarks": remarks_of(judged),
    }
    if judged.truth is not None:
        figures |= {"accuracy": judged.truth.confusion.overall, "kappa": judged.truth.confusion.kappa}
        note["confusion"] = _confusion(judged.truth.confusion)
    if judged.checked is not None:
        areas_by = judged.checked.areas
        figures |= {"checked_accuracy": areas_by.overall, "checked_accuracy_sd": areas_by.overall_sd}
        note["checks"] = _confusion(judged.checked.confusion)
    for name, text in (("areas.csv", table.getvalue()), (NOTE, json.dumps(note, indent=1) + "\n")):
        try:
            write_text(folder / name, text)
        except OSError as error:
            raise write_error(folder / name, error) from error
    return Classification(folder, note)


def _confusion(confusion: Confusion) -> dict[str, Any]:
    return {
        "mapped": list(confusion.mapped),
        "true": list(confusion.true),
        "count": confusion.count.tolist(),
        "users": {name: confusion.users(name) for name in confusion.mapped},
        "producers": {name: confusion.producers(name) for name in confusion.true},
        "overall": confusion.overall,
        "kappa": confusion.kappa,
    }


def _rasters(judged: Judged, folder: Path) -> None:
    found = judged.found
    layers, grid = found.layers, found.prepared.ground.grid
    classes = ClassMap(layers.value, found.mapped, judged.colours, NOT_SEEN)
    geotiff.write_classes(folder / "classes.tif", grid, classes)
    envi.write_classes(folder / "classes.img", grid, classes)
    shares = {name: (layers.share[..., k], "1") for k, name in enumerate(found.names)}
    shares |= {f"{name} sd": (layers.sd[..., k], "1") for k, name in enumerate(found.names)}
    shares["brightness"] = (layers.brightness, "1")
    about = {"library": found.prepared.classes.source}
    geotiff.write_layers(folder / "abundance.tif", grid, shares, about)
    degrees = {
        "angle": layers.angle,
        "margin": layers.margin,
        "limit": layers.limit,
        "angle to the nearest mixture": layers.residual,
    }
    shown = {name: (np.degrees(layer), "deg") for name, layer in degrees.items()}
    geotiff.write_layers(folder / "angle.tif", grid, shown, about)
