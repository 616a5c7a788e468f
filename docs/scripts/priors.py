"""The figures of docs/identification/priors.md, and the comparisons behind rovtwin.identification.priors.widths.

python docs/scripts/priors.py
"""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from rovtwin.identification.priors.empirical import DOUBLE_BLUEYE, estimate
from rovtwin.identification.priors.mesh_file import mesher_of
from rovtwin.identification.priors.outline import Outline, full_box
from rovtwin.identification.priors.panel import panel_added_mass
from rovtwin.identification.priors.surface import solids
from rovtwin.identification.priors.widths import UNITS, prior_widths
from rovtwin.report.evidence.surface import surface_figure
from rovtwin.report.parts.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SMALL, dress, legend_above, new_figure
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.description.totals.added_mass import added_mass

FIGURES = Path(__file__).parents[1] / "figures"
NAN = np.nan
BOXES = ((1, 1, 1), (1, 1, 0.5), (1, 0.5, 0.5), (1, 0.5, 0.25), (1, 0.53, 0.73), (1, 1, 0.2), (2, 1, 0.4))
# Of the thesis: towing (4.3) to (4.5), free running table 3.7, decay fitted again with BG 0.025 m, yaw table 3.6 again.
TOWING = {
    "linear_damping": [6.48, 3.12, 22.75, NAN, NAN, NAN],
    "quadratic_damping": [158.86, 146.38, 1009.85] + [NAN] * 3,
}
FREE = {
    "added_mass": [NAN, NAN, 291.8, NAN, NAN, 0.855],
    "linear_damping": [55.76, 44.8, 20.848, NAN, NAN, 0.178],
    "quadratic_damping": [23.67, NAN, 1197.91, NAN, NAN, 8.5],
}
DECAY = {"added_mass": [NAN] * 3 + [2.48, 0.83, NAN], "linear_damping": [NAN] * 3 + [3.04, 1.34, NAN]}
YAW = {"linear_damping": [NAN] * 5 + [0.40], "quadratic_damping": [NAN] * 5 + [7.7]}


def parts_only(vehicle):
    """Of the parts' shapes, without the totals of the file."""
    data = vehicle.to_dict()
    data.pop("hydrodynamics", None)
    total = vehicle_from_dict(data).assembly
    damping = total.damping()
    matrices = (total.added_mass, damping.linear_ahead, damping.quadratic_ahead)
    return {name: np.diag(m) for name, m in zip(UNITS, matrices, strict=True)}


def comparison(vehicle, panels):
    """Every source of every coefficient of the Double Blueye, with the 95 % of the parts' prior."""
    empirical = estimate(DOUBLE_BLUEYE, 1000.0, np.array([2.69, 0.85]), np.array([7.36, 7.36]))
    parts, widths = parts_only(vehicle), prior_widths(vehicle)
    figure = new_figure(3.7)
    FigureCanvasAgg(figure)
    handles = {}
    for k, quantity in enumerate(UNITS):
        axes = figure.add_subplot(1, 3, k + 1)
        dress(axes)
        axes.set_yscale("log")
        axes.set_title(quantity.replace("_", " "), fontsize=SMALL, loc="left")
        axes.set_xticks(range(6), [axis[:5] for axis in AXES], rotation=40)
        factor = np.exp(1.96 * np.array([widths[f"{quantity}.{axis}"] for axis in AXES]))
        band = axes.bar(
            range(6), parts[quantity] * (factor - 1 / factor), 0.7, parts[quantity] / factor, color=GREY, alpha=0.25
        )
        handles.setdefault("parts, 95 %", band)
        shown = {
            "parts": (parts[quantity], GREY, "_", 13),
            "Eidsvik": (getattr(empirical, quantity), ORANGE, "v", 6),
            "panels": (np.diag(panels.matrix) if k == 0 else np.full(6, NAN), BLUE, "s", 5),
            "towing": (TOWING.get(quantity), BLACK, "o", 5),
            "free running as printed": (FREE.get(quantity), PURPLE, "x", 6),
            "decay, yaw again": (
                np.fmax(DECAY.get(quantity, [NAN] * 6), YAW.get(quantity, [NAN] * 6)),
                GREEN,
                "D",
                4.5,
            ),
        }
        for name, (values, colour, marker, size) in shown.items():
            if values is not None:
                (drawn,) = axes.plot(range(6), values, marker, color=colour, markersize=size, label=name)
                handles.setdefault(name, drawn)
    for axes, quantity in zip(figure.axes, UNITS, strict=True):
        widest = np.exp(1.96 * np.array([widths[f"{quantity}.{axis}"] for axis in AXES]))
        axes.set_ylim(bottom=0.8 * float((parts[quantity] / widest).min()))
    for name, handle in handles.items():
        handle.set_label(name)
    legend_above(figure, list(handles.values()), 4)
    figure.supylabel("kg, N s/m, N s²/m²; kg m², N m s/rad, ..", fontsize=SMALL)
    figure.savefig(FIGURES / "priors_comparison.png", dpi=150)


def spread():
    """ln(published / estimate) of vehicles of the library, for the widths."""
    np.set_printoptions(precision=2, suppress=True)
    cases = (
        ("double_blueye", DOUBLE_BLUEYE),
        (
            "bluerov2_heavy",
            Outline(np.array([0.457, 0.575, 0.254]), 0.7 * full_box(np.array([0.457, 0.575, 0.254])).areas),
        ),
        ("bluerov2", Outline(np.array([0.457, 0.338, 0.254]), 0.7 * full_box(np.array([0.457, 0.338, 0.254])).areas)),
    )
    for name, outline in cases:
        total = load_vehicle(name).assembly
        damping = total.damping()
        found = estimate(outline, 1000.0, np.diag(total.solid.inertia)[:2], np.full(2, total.solid.mass * 9.81 * 0.025))
        for quantity, matrix in zip(
            UNITS, (total.added_mass, damping.linear_ahead, damping.quadratic_ahead), strict=True
        ):
            with np.errstate(divide="ignore"):
                print(name, quantity, "ln(file / Eidsvik)", np.log(np.diag(matrix) / getattr(found, quantity)))
    for size in BOXES:
        box = vehicle_from_dict({"name": "b", "description": "", "mass": 1.0, "shape": {"box": list(map(float, size))}})
        panels = np.diag(panel_added_mass(mesher_of(box), 1.0).matrix)
        print(
            size, "panels", np.round(panels, 4), "formula / panels", np.diag(added_mass(solids(box)[0], 1.0)) / panels
        )


if __name__ == "__main__":
    blueye = load_vehicle("double_blueye")
    found = panel_added_mass(mesher_of(blueye))
    surface_figure(found.panels.corners, found.pressure, "double_blueye").savefig(
        FIGURES / "priors_panels.png", dpi=130
    )
    comparison(blueye, found)
    spread()
