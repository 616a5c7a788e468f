"""Figures of vehicle files side by side, after figure 4.10 of the 2021 Double Blueye thesis."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from rovtwin.report.parts.curves import DIRECTIONS, FORCE_UNITS, SPEED_UNITS, Curve, Curves
from rovtwin.report.parts.style import FONT, SERIES, dress, legend_above, name_panel, new_figure

_DASHES = ("-", (0, (5, 2)), (0, (2, 1.5)), (0, (6, 2, 1, 2)))


def look(k: int) -> dict[str, Any]:
    """Colour and dashes of the k-th file: distinguished in black and white too."""
    return {"color": SERIES[k % len(SERIES)], "linestyle": _DASHES[k % len(_DASHES)], "linewidth": 1.4}


def damping_figure(labels: Sequence[str], curves: Sequence[Curves]) -> Figure:
    """Damping against speed by direction."""
    figure = new_figure(5.0)
    for i, (axes, name) in enumerate(zip(figure.subplots(2, 3).ravel(), DIRECTIONS, strict=True)):
        for k, one in enumerate(curves):
            _draw(axes, one.damping[name], k)
        dress(axes, f"Damping [{FORCE_UNITS[i]}]" if i % 3 == 0 else "")
        axes.set_xlabel(f"Speed [{SPEED_UNITS[i]}]" if i >= 3 else f"[{SPEED_UNITS[i]}]", fontsize=FONT)
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        name_panel(axes, name)
    legend_above(figure, _handles(labels), 3)
    return figure


def thrust_figure(labels: Sequence[str], curves: Sequence[Curves]) -> Figure:
    """Thrust against command by group; a file that lacks a group isn't in its panel."""
    groups = list(dict.fromkeys(g for one in curves for g in one.thrust))
    columns = min(3, len(groups))
    rows = -(-len(groups) // columns)
    figure = new_figure(2.6 * rows + 0.4)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, group in zip(grid, groups, strict=False):
        for k, one in enumerate(curves):
            if group in one.thrust:
                _draw(axes, one.thrust[group], k)
        dress(axes, "Thrust [N]" if axes.get_subplotspec().is_first_col() else "", "Command u")
        axes.set_xlim(-1.0, 1.0)
        name_panel(axes, group.replace("_", " "))
    for axes in grid[len(groups) :]:
        axes.set_visible(False)
    legend_above(figure, _handles(labels), 3)
    return figure


def added_mass_figure(labels: Sequence[str], curves: Sequence[Curves]) -> Figure:
    """Added mass by direction."""
    figure = new_figure(1.4 + 0.3 * len(labels))
    step = 0.8 / len(labels)
    for axes, names, unit in zip(
        figure.subplots(1, 2), (DIRECTIONS[:3], DIRECTIONS[3:]), ("kg", "kg m²"), strict=True
    ):  # fmt: skip
        for row, name in enumerate(names):
            for k, one in enumerate(curves):
                mass, place = one.added_mass[name], row - 0.4 + step * (k + 0.5)
                axes.barh(place, mass.y[0], height=0.85 * step, color=look(k)["color"], alpha=0.55, zorder=2)
                if np.isfinite(mass.low[0]):
                    axes.plot([mass.low[0], mass.high[0]], [place] * 2, color="#222222", linewidth=1.4, zorder=3)
        dress(axes, "", f"Added mass [{unit}]")
        axes.set_yticks(range(3), names)
        axes.invert_yaxis()
        axes.set_xlim(left=0)
    interval = Line2D([], [], color="#222222", linewidth=1.4, label="95 % interval")
    blocks = [Line2D([], [], color=look(k)["color"], alpha=0.55, linewidth=6, label=l) for k, l in enumerate(labels)]
    known = any(np.isfinite(one.added_mass["surge"].low[0]) for one in curves)
    legend_above(figure, [*blocks, *([interval] if known else [])], 4)
    return figure


def _draw(axes: Axes, curve: Curve, k: int) -> None:
    style = look(k)
    if np.all(np.isfinite(curve.low)):
        axes.fill_between(curve.x, curve.low, curve.high, color=style["color"], alpha=0.2, linewidth=0.0, zorder=2)
    axes.plot(curve.x, curve.y, **style, zorder=3 + k)
    if k == 0:
        axes.axhline(0, color="#666666", linewidth=0.5, zorder=1.5)


def _handles(labels: Sequence[str]) -> list[Any]:
    return [Line2D([], [], **look(k), label=label) for k, label in enumerate(labels)]
