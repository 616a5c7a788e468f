"""Figures of a map of classes: the map with its legend, areas with intervals, spectra, and tables of angles."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from rovtwin.report.mapping.figures import Sheet, lay, sheet_height
from rovtwin.report.parts.style import BLACK, BLUE, GREY, ORANGE, SMALL, TINY, dress, new_figure, note

Colour = tuple[int, int, int]
_PANELS = 3  # spectra side by side


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def class_map(
    sheet: Sheet, value: Int[np.ndarray, "row column"], names: Sequence[str], colours: Sequence[Colour]
) -> Figure:
    """The map, with a legend of what there is on it.

    Args:
        sheet: The mosaic.
        value: Of each cell, an index of names; beyond them: not seen.
        names: Of the values.
        colours: Of the values.
    """
    figure = new_figure(height=sheet_height(sheet, 6.0))
    axes = figure.subplots()
    axes.set_facecolor("#eef1f3")
    table = np.zeros((256, 4), np.uint8)
    table[: len(colours)] = [(*colour, 255) for colour in colours]
    lay(axes, sheet, table[value])
    total = max(int(np.count_nonzero(value < len(names))), 1)
    number = np.bincount(value.reshape(-1), minlength=256)
    shown = [
        Patch(
            facecolor=_hex(colours[k]), edgecolor="#555555", linewidth=0.5, label=f"{names[k]}  {number[k] / total:.1%}"
        )
        for k in np.argsort(-number[: len(names)])
        if number[k]
    ]
    axes.legend(
        handles=shown, fontsize=SMALL, frameon=False, loc="center left", bbox_to_anchor=(1.01, 0.5),
        title="share of cells", title_fontsize=SMALL, alignment="left",
    )  # fmt: skip
    note(axes, f"from x {sheet.left:.2f}, y {sheet.bottom:.2f} of {sheet.crs}; cells of {100 * sheet.cell:g} cm")
    return figure


def areas(rows: Sequence[Mapping[str, Any]], colours: Sequence[Colour]) -> Figure:
    """Of each class with its interval, beside it what check points and the truth say."""
    figure = new_figure(height=0.9 + 0.36 * len(rows))
    axes = dress(figure.subplots(), "", "Area [m2]")
    for k, (row, colour) in enumerate(zip(rows, colours, strict=True)):
        area, first = row["area_m2"], k == 0
        axes.barh(k, area, height=0.6, color=_hex(colour), edgecolor="#555555", linewidth=0.5)
        off = [[max(area - row["low_m2"], 0.0)], [max(row["high_m2"] - area, 0.0)]]
        axes.errorbar(
            area, k, xerr=off, color=BLACK, linewidth=1.2, capsize=3.0, label="95 %, if the library holds" * first
        )
        if row["most_m2"] > row["high_m2"]:
            axes.plot([row["high_m2"], row["most_m2"]], [k, k], color=GREY, linewidth=1.0, linestyle=(0, (2, 2)))
        axes.plot(row["counted_m2"], k, "|", color=BLUE, markersize=11, label="cells counted" * first)
        if "checked_m2" in row:
            by = row["checked_m2"]
            spread = [[by - row["checked_low_m2"]], [row["checked_high_m2"] - by]]
            axes.errorbar(
                by, k + 0.22, xerr=spread, fmt="s", color=ORANGE, markersize=4, linewidth=1.2, capsize=2.5,
                label="check points, 95 %" * first,
            )  # fmt: skip
        if "true_m2" in row:
            axes.plot(
                row["true_m2"],
                k,
                "D",
                color="white",
                markeredgecolor=BLACK,
                markersize=5,
                zorder=5,
                label="truth" * first,
            )
    axes.set_yticks(range(len(rows)), [row["class"] for row in rows], fontsize=SMALL)
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.legend(fontsize=TINY, frameon=False, loc="lower right")
    return figure


def spectra(
    wavelengths: Float[np.ndarray, " band"],
    names: Sequence[str],
    colours: Sequence[Colour],
    means: Float[np.ndarray, "class band"],
    cells: Int[np.ndarray, " class"],
    library: Float[np.ndarray, "class band"],
) -> Figure:
    """Mean of the cells of each class, how many these are, and the library's spectrum."""
    rows = -(-len(names) // _PANELS)
    figure = new_figure(height=0.5 + 1.55 * rows)
    panels = figure.subplots(rows, _PANELS, squeeze=False, sharex=True).ravel()
    for axes, name, colour, mean, count, given in zip(panels, names, colours, means, cells, library, strict=False):
        dress(axes, "", "", ticks=3)
        axes.plot(wavelengths, mean, color="#555555", linewidth=2.6)
        axes.plot(wavelengths, mean, color=_hex(colour), linewidth=1.8)
        axes.plot(wavelengths, given, color=BLACK, linewidth=1.0, linestyle=(0, (4, 2)))
        axes.set_title(f"{name}: {count:,} cells", fontsize=TINY, loc="left", pad=2)
        axes.set_ylim(bottom=0.0)
        axes.tick_params(labelsize=TINY)
    for axes in panels[len(names) :]:
        axes.set_visible(False)
    figure.supxlabel("Wavelength [nm]", fontsize=SMALL)
    return figure


def table(
    rows: Sequence[str], columns: Sequence[str], values: np.ndarray, text: Sequence[Sequence[str]], marked: np.ndarray,
    labels: tuple[str, str] = ("", ""),
) -> Figure:  # fmt: skip
    """Numbers in a table whose cells are darker for larger ones.

    Args:
        rows: Names.
        columns: Names.
        values: 0 to 1, how dark a cell is.
        text: In each cell.
        marked: Cells with a frame.
        labels: Of rows and columns.
    """
    figure = new_figure(height=1.0 + 0.3 * len(rows))
    axes: Axes = figure.subplots()
    axes.imshow(values, cmap="Blues", vmin=0.0, vmax=1.4, aspect="auto")
    axes.set_xticks(range(len(columns)), columns, fontsize=TINY, rotation=30, ha="left", rotation_mode="anchor")
    axes.set_yticks(range(len(rows)), rows, fontsize=TINY)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    for i, line in enumerate(text):
        for k, word in enumerate(line):
            axes.annotate(word, (k, i), ha="center", va="center", fontsize=TINY, color=BLACK)
    for i, k in np.argwhere(marked):
        axes.add_patch(
            Rectangle((float(k) - 0.47, float(i) - 0.45), 0.94, 0.9, fill=False, edgecolor=ORANGE, linewidth=1.6)
        )
    axes.set_ylabel(labels[0], fontsize=SMALL)
    axes.set_xlabel(labels[1], fontsize=SMALL)
    axes.xaxis.set_label_position("top")
    return figure
