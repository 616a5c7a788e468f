"""Figure of a registration: what ties and control points measured, as arrows over the mosaic."""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovtwin.report.mapping.figures import Sheet, lay, sheet_height
from rovtwin.report.parts.style import BLUE, ORANGE, PURPLE, SMALL, new_figure

_LONG = 0.10  # of the longer side of the sheet: an arrow of the key's length


def residuals(
    sheet: Sheet,
    at: Float[np.ndarray, "m 2"],
    before: Float[np.ndarray, "m 2"],
    after: Float[np.ndarray, "m 2"],
    used: Bool[np.ndarray, " m"],
    control: Bool[np.ndarray, " m"],
) -> Figure:
    """Before and after, on one scale.

    Args:
        sheet: The mosaic.
        at: Places, x and y of the sheet's axes [m].
        before: Residuals along x and y [m].
        after: Likewise.
        used: Which counted; the others were dropped.
        control: Which are control points; the others are ties.
    """
    wide, high = sheet.size
    beside = high > 0.6 * wide
    figure = new_figure(
        height=sheet_height(sheet, 3.6, 7.5) if beside else min(2.0 * sheet_height(sheet, 7.0, 4.5), 9.0)
    )
    panels = figure.subplots(1, 2) if beside else figure.subplots(2, 1)
    key = key_length(before[used])
    for axes, name, arrows, colour in zip(panels, ("before", "after"), (before, after), (ORANGE, BLUE), strict=True):
        _panel(axes, sheet, key, [(at[~used], arrows[~used], PURPLE), (at[used], arrows[used], colour)])
        axes.plot(*at[control].T, marker="^", markersize=5, color="black", linestyle="")
        rms = 1e3 * np.sqrt(np.mean(arrows[used] ** 2)) if used.any() else np.nan
        axes.set_title(f"{name}: {rms:.1f} mm rms a component", fontsize=SMALL, loc="left", pad=3)
    return figure


def _panel(axes: Axes, sheet: Sheet, key: float, groups: list[tuple[np.ndarray, np.ndarray, str]]) -> None:
    axes.set_facecolor("#eef1f3")
    lay(axes, sheet, sheet.rgb, alpha=0.35)
    scale = key / (_LONG * max(sheet.size))
    for places, arrows, colour in groups:
        if not len(places):
            continue
        axes.plot(*places.T, marker="o", markersize=2.0, color=colour, linestyle="")
        drawn = axes.quiver(
            *places.T, *arrows.T, angles="xy", scale_units="xy", scale=scale, color=colour, width=0.005, zorder=3
        )
    axes.set(xlim=sheet.extent[:2], ylim=sheet.extent[2:])
    if any(len(places) for places, _, _ in groups):
        axes.quiverkey(drawn, 0.82, 1.02, key, f"{1e3 * key:g} mm", labelpos="E", fontproperties={"size": SMALL})


def key_length(residuals: Float[np.ndarray, "m 2"]) -> float:
    """A round length [m] near that of most of the residuals."""
    usual = float(np.percentile(np.linalg.norm(residuals, axis=1), 75.0)) if len(residuals) else 0.0
    steps = np.array([1.0, 2.0, 5.0])
    lengths = (steps * 10.0 ** np.arange(-4, 2)[:, None]).ravel()
    return float(lengths[np.argmin(np.abs(np.log(lengths) - np.log(max(usual, 1e-4))))])
