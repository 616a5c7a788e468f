"""Figures of a mosaic: what it looks like, what was seen from how far, spectra of places, and how sure they are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovtwin.report.parts.style import BLACK, ORANGE, SMALL, TINY, YELLOW, dress, new_figure, note, series_colours

_MOST = 1400  # cells a side that a figure shows


@dataclass(frozen=True)
class Sheet:
    """A mosaic on its map.

    Attributes:
        rgb: Picture with opacity.
        left: x of its western edge [m].
        bottom: y of its southern edge [m].
        cell: Side of a cell [m].
        crs: Name of the map's system.
        origin: x and y of the run's datum, from which axes count [m].
        without: Cells that were seen and have no colour; None: none.
    """

    rgb: UInt8[np.ndarray, "row column 4"]
    left: float
    bottom: float
    cell: float
    crs: str
    origin: tuple[float, float]
    without: Bool[np.ndarray, "row column"] | None = None

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        return self.rgb.shape[1] * self.cell, self.rgb.shape[0] * self.cell

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top from the datum [m]."""
        left, bottom = self.left - self.origin[0], self.bottom - self.origin[1]
        return left, left + self.size[0], bottom, bottom + self.size[1]

    def about(self) -> str:
        """What axes count from."""
        x, y = self.origin
        return f"from x {x:.2f}, y {y:.2f} (datum) along the axes of {self.crs}; cells of {100 * self.cell:g} cm"


@dataclass(frozen=True)
class Spectrum:
    """Of a place.

    Attributes:
        name: For people.
        at: x and y of the sheet's axes, from the datum [m].
        value: By band.
        spread: Standard deviation over its cells.
        truth: None where nobody knows it.
    """

    name: str
    at: tuple[float, float]
    value: Float[np.ndarray, " band"]
    spread: Float[np.ndarray, " band"]
    truth: Float[np.ndarray, " band"] | None


def _thin(image: np.ndarray) -> np.ndarray:
    step = max(1, -(-max(image.shape[:2]) // _MOST))
    return image[::step, ::step]


def lay(axes: Axes, sheet: Sheet, image: np.ndarray, **given: Any) -> Any:
    """An image over the sheet, in metres from the datum along the map's axes."""
    shown = axes.imshow(_thin(image), extent=sheet.extent, interpolation="nearest", **given)
    dress(axes, "Map north [m]", "Map east [m]")
    axes.grid(False)
    axes.set_aspect("equal")
    return shown


def _hatch(axes: Axes, sheet: Sheet) -> None:
    """Cells without a colour."""
    if sheet.without is None or not sheet.without.any() or min(sheet.without.shape) < 2:
        return
    there = _thin(sheet.without).astype(float)
    axes.contourf(there, [0.5, 1.5], colors="none", hatches=["//////"], extent=sheet.extent, origin="upper")


def sheet_height(sheet: Sheet, width: float, most: float = 8.0) -> float:
    """Of a figure of a width that shows the sheet [inches]."""
    wide, high = sheet.size
    return float(np.clip(width * high / wide + 0.7, 2.2, most))


@dataclass(frozen=True)
class Plan:
    """What was to be seen, and what was not; x and y of the map [m].

    Attributes:
        outlines: Rings of the area that was asked for; none where the hull of what was seen counts.
        gaps: Cells that were not seen, from the north-western corner.
        extent: Left, right, bottom, top of these.
    """

    outlines: Sequence[Float[np.ndarray, "k 2"]]
    gaps: Bool[np.ndarray, "row column"]
    extent: tuple[float, float, float, float]


def picture(
    sheet: Sheet,
    spectra: Sequence[Spectrum],
    ways: Sequence[Float[np.ndarray, "k 2"]] = (),
    plan: Plan | None = None,
) -> Figure:
    """In colours, with the places whose spectra are shown, the vehicle's way, the area and its gaps."""
    figure = new_figure(height=sheet_height(sheet, 7.0))
    axes = figure.subplots()
    axes.set_facecolor("#dfe5ea")
    lay(axes, sheet, sheet.rgb)
    _hatch(axes, sheet)
    for way in ways:
        axes.plot(*(np.asarray(way) - sheet.origin).T, color="white", linewidth=0.7, alpha=0.55)
    for colour, one in zip(series_colours(len(spectra)), spectra, strict=True):
        axes.plot(*one.at, marker="o", markersize=5.5, markerfacecolor=colour, markeredgecolor="white", linestyle="")
        axes.annotate(
            one.name, one.at, (5, 4), textcoords="offset points", fontsize=SMALL, color="white",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "#00000099", "edgecolor": "none"},
        )  # fmt: skip
    low, high = np.array(sheet.extent[::2]), np.array(sheet.extent[1::2])
    if plan is not None:
        _draw_plan(axes, sheet, plan)
        corners = [ring - sheet.origin for ring in plan.outlines]
        low, high = np.min([low, *(c.min(0) for c in corners)], 0), np.max([high, *(c.max(0) for c in corners)], 0)
        low, high = low - 0.01 * (high - low), high + 0.01 * (high - low)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    note(axes, sheet.about())
    return figure


def _draw_plan(axes: Axes, sheet: Sheet, plan: Plan) -> None:
    x, y = sheet.origin
    extent = (plan.extent[0] - x, plan.extent[1] - x, plan.extent[2] - y, plan.extent[3] - y)
    colour = np.zeros((*_thin(plan.gaps).shape, 4))
    colour[_thin(plan.gaps)] = [0.835, 0.369, 0.0, 0.75]  # ORANGE
    axes.imshow(colour, extent=extent, interpolation="nearest", zorder=1.5)
    for ring in plan.outlines:
        axes.plot(*(ring - sheet.origin).T, color=YELLOW, linewidth=1.4, linestyle=(0, (5, 2)))


def layers(
    sheet: Sheet,
    shown: Mapping[str, tuple[Float[np.ndarray, "row column"], str]],
    span: tuple[float, float] | None = None,
) -> Figure:
    """Coverage, range, standard deviations: a panel each, its colours over what it has but for outliers, or a span."""
    wide, high = sheet.size
    columns = 3 if high > 1.3 * wide else 2
    rows = -(-len(shown) // columns)
    figure = new_figure(height=min(rows * sheet_height(sheet, 5.6 / columns, 5.0), 10.0))
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axes, (name, (layer, unit)) in zip(panels, shown.items(), strict=False):
        known = layer[np.isfinite(layer)]
        low, high = span or (np.percentile(known, [1.0, 99.0]) if len(known) else (0.0, 1.0))
        colours = "magma" if name.startswith(("sigma", "noise")) else "viridis"
        axes.set_facecolor("#eef1f3")
        image = lay(axes, sheet, layer, cmap=colours, vmin=low, vmax=max(high, low + 1e-9))
        bar = figure.colorbar(image, ax=axes, shrink=0.85, pad=0.02)
        bar.ax.tick_params(labelsize=TINY)
        axes.set_title(f"{name} [{unit}]" if unit not in ("", "1") else name, fontsize=SMALL, loc="left", pad=3)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    return figure


def spectra(wavelengths: Float[np.ndarray, " band"], shown: Sequence[Spectrum], quantity: str, unit: str) -> Figure:
    """Of each place, with its spread; the truth beside it, dashed."""
    figure = new_figure(height=3.6)
    axes = dress(figure.subplots(), f"{quantity.capitalize()}{'' if unit == '1' else f' [{unit}]'}", "Wavelength [nm]")
    known = False
    for colour, one in zip(series_colours(len(shown)), shown, strict=True):
        axes.fill_between(
            wavelengths, one.value - one.spread, one.value + one.spread, color=colour, alpha=0.15, linewidth=0
        )
        axes.plot(wavelengths, one.value, color=colour, linewidth=1.3, label=one.name)
        if one.truth is not None:
            axes.plot(wavelengths, one.truth, color=colour, linewidth=1.0, linestyle=(0, (4, 2)))
            known = True
    axes.set_xlim(float(wavelengths[0]), float(wavelengths[-1]))
    visible = (wavelengths >= 400.0) & (wavelengths <= 700.0)
    top = [np.nanmax(one.value[visible]) for one in shown if np.isfinite(one.value[visible]).any()]
    if top:
        axes.set_ylim(min(0.0, -0.02 * max(top)), 1.25 * max(top))
    if shown:
        axes.legend(fontsize=SMALL, frameon=False, ncols=min(len(shown), 5))
    if known:
        note(axes, "dashed: the truth; band: standard deviation of the cells")
    return figure


def budget(
    wavelengths: Float[np.ndarray, " band"],
    parts: Mapping[str, Float[np.ndarray, " band"]],
    error: Float[np.ndarray, " band"] | None,
    masked: Float[np.ndarray, " band"],
) -> Figure:
    """How unsure reflectance is by band and by what, the error that was made where the truth is known, bands masked."""
    figure = new_figure(height=3.4)
    top, below = figure.subplots(2, 1, sharex=True, height_ratios=[3.0, 1.0])
    dress(top, "Relative sd [%]")
    for colour, (name, values) in zip(series_colours(len(parts)), parts.items(), strict=True):
        top.plot(wavelengths, 100.0 * values, color=colour, linewidth=1.2, label=name)
    if error is not None:
        top.plot(wavelengths, 100.0 * error, color=BLACK, linewidth=1.4, linestyle=(0, (4, 2)), label="error made")
    top.set_ylim(0.0, 40.0)
    top.legend(fontsize=TINY, frameon=False, ncols=3, loc="upper left")
    dress(below, "Masked [%]", "Wavelength [nm]", ticks=2)
    below.fill_between(wavelengths, 100.0 * masked, color=ORANGE, alpha=0.5, linewidth=0, step="mid")
    below.set(ylim=(0.0, 105.0), xlim=(float(wavelengths[0]), float(wavelengths[-1])))
    return figure
