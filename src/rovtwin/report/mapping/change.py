"""Figures of what changed between two mosaics."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from rovtwin.report.mapping.figures import Sheet, lay, sheet_height
from rovtwin.report.parts.style import SMALL, TINY, new_figure, note

_STEP = 0.5  # between arrows [m]


Rings = Sequence[tuple[tuple[float, float], float]]  # middle, x and y of the sheet's axes, and radius [m]


def changes(sheet: Sheet, rings: Rings, elsewhere: Rings) -> Figure:
    """The first mosaic with a numbered ring about each change, a dashed one about each thing standing or moved.

    Args:
        sheet: The first mosaic.
        rings: Of the changes.
        elsewhere: Of what both mosaics show, only in another place.
    """
    figure = new_figure(height=sheet_height(sheet, 7.0))
    axes = figure.subplots()
    axes.set_facecolor("#dfe5ea")
    lay(axes, sheet, sheet.rgb)
    for number, (place, radius) in enumerate(rings, start=1):
        _ring(axes, place, radius, "#d7301f", "-", str(number))
    for number, (place, radius) in enumerate(elsewhere, start=1):
        _ring(axes, place, radius, "#2166ac", (0, (3, 2)), f"s{number}")
    axes.set(xlim=sheet.extent[:2], ylim=sheet.extent[2:])
    note(axes, sheet.about())
    return figure


def _ring(axes: Any, place: tuple[float, float], radius: float, colour: str, line: Any, label: str) -> None:
    axes.add_patch(Circle(place, radius, fill=False, edgecolor="#ffffff", linewidth=2.2))
    axes.add_patch(Circle(place, radius, fill=False, edgecolor=colour, linewidth=1.2, linestyle=line))
    axes.annotate(
        label, (place[0] + 0.7 * radius, place[1] + 0.7 * radius), (2, 2), textcoords="offset points",
        fontsize=SMALL, color="white",
        bbox={"boxstyle": "round,pad=0.15", "facecolor": "#00000099", "edgecolor": "none"},
    )  # fmt: skip


def difference(
    sheet: Sheet,
    change: Float[np.ndarray, "row column"],
    shift: Float[np.ndarray, "row column 2"],
    seen: Bool[np.ndarray, "row column"],
) -> Figure:
    """Change of brightness, and how far the second mosaic lies from the first.

    Args:
        sheet: The first mosaic.
        change: As a share of reflectance.
        shift: East and north [m].
        seen: Cells that both have seen.
    """
    wide, high = sheet.size
    beside = high > wide
    figure = new_figure(
        height=sheet_height(sheet, 3.6, 6.5) if beside else min(2.0 * sheet_height(sheet, 6.0, 4.5), 9.0)
    )
    left, right = figure.subplots(1, 2) if beside else figure.subplots(2, 1)
    most = max(float(np.nanpercentile(np.abs(change), 99.8)), 0.05)
    for axes in (left, right):
        axes.set_facecolor("#eef1f3")
    shown: Any = lay(left, sheet, 100.0 * change, cmap="RdBu_r", vmin=-100 * most, vmax=100 * most)
    figure.colorbar(shown, ax=left, shrink=0.85, pad=0.02).ax.tick_params(labelsize=TINY)
    left.set_title("change of reflectance [%]", fontsize=SMALL, loc="left", pad=3)
    middle = shift[seen].mean(axis=0)
    shown = lay(right, sheet, np.where(seen, 1e3 * np.linalg.norm(shift - middle, axis=2), np.nan), cmap="viridis")
    figure.colorbar(shown, ax=right, shrink=0.85, pad=0.02).ax.tick_params(labelsize=TINY)
    step = max(round(_STEP / sheet.cell), 1)
    rows, columns = np.nonzero(seen[step // 2 :: step, step // 2 :: step])
    rows, columns = step // 2 + step * rows, step // 2 + step * columns
    there = shift[rows, columns] - middle
    right.quiver(
        sheet.extent[0] + (columns + 0.5) * sheet.cell, sheet.extent[3] - (rows + 0.5) * sheet.cell, *there.T,
        color="white", width=0.004,
        pivot="middle",
    )  # fmt: skip
    right.set_title("shift less its mean [mm]", fontsize=SMALL, loc="left", pad=3)
    return figure
