"""Figures of an identification: force curves with bands, added mass, correlations, residuals."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from rovtwin.report.identification.test_figures import component_name
from rovtwin.report.parts.curves import DIRECTIONS, FORCE_UNITS, SPEED_UNITS, Curve, Curves
from rovtwin.report.parts.style import (
    BAND,
    BLUE,
    FONT,
    GREY,
    ORANGE,
    SMALL,
    TINY,
    dress,
    legend_above,
    name_panel,
    new_figure,
    note,
)  # fmt: skip

FAINT: dict[str, Any] = {"color": GREY, "alpha": 0.22, "linewidth": 0.0, "zorder": 1}
BEFORE: dict[str, Any] = {"color": "#777777", "linewidth": 1.0, "linestyle": (0, (4, 2)), "zorder": 2.2}
NOW_BAND: dict[str, Any] = BAND | {"alpha": 0.35}
NOW: dict[str, Any] = {"color": BLUE, "linewidth": 1.4, "zorder": 3}
_ROOM = 1.8  # a prior band is cut at so many times the height of what it turned into
_SLIVER = 0.06  # of commands that nobody gave, not worth a shade
Ranges = Mapping[str, Sequence[float]]


def damping_figure(now: Curves, before: Curves) -> Figure:
    """Damping against speed by direction, with the bands before and after."""
    shown = now.estimated
    columns, rows = min(3, len(shown)), -(-len(shown) // 3)
    figure = new_figure(2.4 * rows + 0.2)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for k, (axes, i) in enumerate(zip(grid, shown, strict=False)):
        name = DIRECTIONS[i]
        _before_and_after(axes, before.damping[name], now.damping[name])
        last = k + columns >= len(shown)
        unit = k % columns == 0 or FORCE_UNITS[i] != FORCE_UNITS[shown[k - 1]]
        dress(axes, f"Damping [{FORCE_UNITS[i]}]" if unit else "", f"Speed [{SPEED_UNITS[i]}]" if last else "")
        if not last:
            axes.set_xlabel(f"[{SPEED_UNITS[i]}]", fontsize=FONT)
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        name_panel(axes, name)
        wide = _at_fastest(now.damping[name])
        note(axes, f"±{100 * wide:.2g} % at the fastest" if np.isfinite(wide) else "not estimated")
    for axes in grid[len(shown) :]:
        axes.set_visible(False)
    legend_above(figure, _before_after_handles(), 4)
    return figure


def thrust_figure(now: Curves, before: Curves, tested: Ranges) -> Figure:
    """Thrust of one thruster of each group against its command, with the bands before and after."""
    groups = list(now.thrust)
    columns = min(3, len(groups))
    rows = -(-len(groups) // columns)
    figure = new_figure(2.6 * rows + 0.4)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, group in zip(grid, groups, strict=False):
        _before_and_after(axes, before.thrust[group], now.thrust[group])
        dress(axes, "Thrust [N]" if axes.get_subplotspec().is_first_col() else "", "Command u")
        axes.set_xlim(-1.0, 1.0)
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 5, 10]))
        name_panel(axes, group.replace("_", " "))
        _shade_untested(axes, tested.get(f"thrusters.{group}"))
    for axes in grid[len(groups) :]:
        axes.set_visible(False)
    untested = [Patch(facecolor="#efe6d6", label="not tested")] if _any_untested(tested, groups) else []
    legend_above(figure, [*_before_after_handles(), *untested], 5)
    return figure


def _any_untested(tested: Ranges, groups: Sequence[str]) -> bool:
    ranges = [tested[f"thrusters.{g}"] for g in groups if f"thrusters.{g}" in tested]
    return any(low + 1 > _SLIVER or 1 - high > _SLIVER for low, high in ranges)


def _shade_untested(axes: Axes, tested: Sequence[float] | None) -> None:
    if tested is None:
        return
    for start, end in ((-1.0, max(tested[0], -1.0)), (min(tested[1], 1.0), 1.0)):
        if end - start > _SLIVER:
            axes.axvspan(start, end, facecolor="#efe6d6", zorder=0, linewidth=0)


def _before_and_after(axes: Axes, before: Curve, now: Curve) -> None:
    axes.fill_between(before.x, before.low, before.high, **FAINT)
    axes.plot(before.x, before.y, **BEFORE)
    axes.fill_between(now.x, now.low, now.high, **NOW_BAND)
    axes.plot(now.x, now.y, **NOW)
    axes.axhline(0, color="#666666", linewidth=0.5, zorder=1.5)
    # What is known now decides the scale; a prior of a factor of two would flatten it.
    ends = np.concatenate([now.low, now.high, now.y, before.y])
    low, high = np.nanmin(ends), np.nanmax(ends)
    wide = np.concatenate([before.low, before.high])
    if np.any(np.isfinite(wide)):
        low = max(np.nanmin(wide), _ROOM * low) if low < 0 else low
        high = min(np.nanmax(wide), _ROOM * high) if high > 0 else high
    margin = 0.05 * max(high - low, 1e-9)
    axes.set_ylim(low - margin, high + margin)


def _before_after_handles() -> list[Any]:
    return [
        Line2D([], [], **NOW, label="identified"),
        Patch(facecolor=BLUE, alpha=0.35, label="95 %"),
        Line2D([], [], **BEFORE, label="prior"),
        Patch(facecolor=GREY, alpha=0.22, label="95 % of the prior"),
    ]


def _at_fastest(curve: Curve) -> float:
    return float(curve.half_width[np.argmax(np.abs(curve.x))])


def added_mass_figure(now: Curves, before: Curves) -> Figure:
    """Added mass by direction with 95 % intervals, before and after."""
    figure = new_figure(2.4)
    for axes, names, unit in zip(figure.subplots(1, 2), (DIRECTIONS[:3], DIRECTIONS[3:]), ("kg", "kg m²"), strict=True):
        for row, name in enumerate(names):
            for curves, shift, colour, face in ((before, 0.2, GREY, "#d5d5d5"), (now, -0.2, BLUE, "#a9cde8")):
                one = curves.added_mass[name]
                axes.barh(row + shift, one.y[0], height=0.34, color=face, zorder=2)
                if np.isfinite(one.low[0]):
                    axes.plot([one.low[0], one.high[0]], [row + shift] * 2, color=colour, linewidth=1.6, zorder=3)
                    for end in (one.low[0], one.high[0]):
                        axes.plot([end] * 2, [row + shift - 0.1, row + shift + 0.1], color=colour, linewidth=1.2)
        dress(axes, "", f"Added mass [{unit}]")
        axes.set_yticks(range(len(names)), names)
        axes.invert_yaxis()
        axes.set_xlim(left=0)
    legend_above(figure, [
        Patch(facecolor="#a9cde8", label="identified"), Patch(facecolor="#d5d5d5", label="prior"),
        Line2D([], [], color="#444444", linewidth=1.6, label="95 % interval"),
    ])  # fmt: skip
    return figure


def correlation_figure(names: Sequence[str], covariance: Float[np.ndarray, "n n"]) -> Figure:
    """Correlations of the estimate as a map; columns carry the numbers of the rows."""
    std = np.sqrt(np.diag(covariance))
    n = len(names)
    figure = new_figure(1.1 + min(5.4, 0.5 + 0.16 * n))
    figure.get_layout_engine().set(w_pad=0.2)  # type: ignore[union-attr]  (long labels, hinted differently when saved)
    axes = figure.subplots()
    image = axes.imshow(
        covariance / np.outer(std, std), cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest", aspect="auto"
    )
    size = min(TINY, 72 * 5.4 / max(n, 1) / 1.25)
    axes.xaxis.tick_top()
    axes.set_xticks(range(n), [str(i + 1) for i in range(n)], fontsize=min(size, 160 / max(n, 1) + 1.5))
    axes.set_yticks(range(n), [f"{shortened(name)}  {i + 1}" for i, name in enumerate(names)], fontsize=size)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    for edge in _family_edges(names):
        axes.axhline(edge - 0.5, color="#555555", linewidth=0.5)
        axes.axvline(edge - 0.5, color="#555555", linewidth=0.5)
    bar = figure.colorbar(image, ax=axes, shrink=0.6, pad=0.02)
    bar.ax.tick_params(labelsize=SMALL)
    bar.set_label("Correlation", fontsize=FONT)
    return figure


def shortened(name: str) -> str:
    """`quadratic damping, surge` of `quadratic_damping.surge`."""
    if name.startswith("thrusters."):
        _, group, what = name.split(".")
        name = f"{group} thrusters, {what}"
    return name.replace("restoring.", "").replace("tether.", "tether ").replace(".", ", ").replace("_", " ")


def _family_edges(names: Sequence[str]) -> list[int]:
    families = [name.rsplit(".", 1)[0] for name in names]
    return [i for i in range(1, len(names)) if families[i] != families[i - 1]]


def whiteness_figure(residuals: Mapping[str, Any]) -> Figure:
    """Autocorrelation of the residuals of each signal component, with the 95 % band of white noise."""
    names = list(residuals)
    columns = 3
    rows = -(-len(names) // columns)
    figure = new_figure(1.35 * rows + 0.5)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    every = np.concatenate([r.autocorrelation for r in residuals.values()])
    for axes, name in zip(grid, names, strict=False):
        r = residuals[name]
        band = 1.96 / np.sqrt(max(len(r.t), 1))
        lags = np.arange(1, len(r.autocorrelation) + 1)
        axes.axhspan(-band, band, **BAND)
        outside = np.abs(r.autocorrelation) > band
        axes.vlines(lags, 0, r.autocorrelation, color=np.where(outside, ORANGE, BLUE), linewidth=1.6)
        axes.axhline(0, color="#666666", linewidth=0.5)
        k = names.index(name)
        dress(axes, "", "Lag [readings]" if k // columns == rows - 1 else "", ticks=3)
        axes.tick_params(labelbottom=len(names) - k <= columns)
        name_panel(axes, component_name(name))
        note(axes, f"{len(r.t)} readings")
    for axes in grid[len(names) :]:
        axes.set_visible(False)
    grid[0].set_ylim(min(1.15 * float(every.min()), -0.12), max(1.15 * float(every.max()), 0.12))
    figure.supylabel("Autocorrelation", fontsize=FONT)
    legend_above(figure, [
        Patch(facecolor=BLUE, alpha=0.18, label="95 % band of white noise"),
        Line2D([], [], color=BLUE, linewidth=1.6, label="inside"),
        Line2D([], [], color=ORANGE, linewidth=1.6, label="outside"),
    ])  # fmt: skip
    return figure
