"""Figures of forces: thrusters against their limits, the desired wrench, and disturbances."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.arrays.stretches import stretches
from rovtwin.core.log import Series
from rovtwin.report.flight import Flight
from rovtwin.report.parts.panels import TIME, panels
from rovtwin.report.parts.style import (
    BLACK,
    BLUE,
    ESTIMATE,
    FONT,
    GREY,
    LIMIT,
    ORANGE,
    WIDTH,
    dress,
    fault_patch,
    legend_above,
    limits,
    line,
    mark_faults,
    name_panel,
    new_figure,
    note,
    phase_patch,
    ribbon,
)
from rovtwin.report.run.vehicle import force_limits, thruster_names
from rovtwin.report.series import at, slow_mean

_WRENCH_NAMES = ("surge force", "sway force", "heave force", "roll moment", "pitch moment", "yaw moment")
_WRENCH = ("$X$ [N]", "$Y$ [N]", "$Z$ [N]", "$K$ [N m]", "$M$ [N m]", "$N$ [N m]")


def forces(flight: Flight) -> Figure:
    """Force of each thruster between its limits, and the wrench that the controller asked for."""
    thrust, tau = flight.get("truth/thrust"), flight.get("autopilot/tau")
    axes_used = [] if tau is None else [k for k in range(6) if np.nanmax(np.abs(tau.values[:, k]), initial=0.0) > 1e-9]
    columns = [n for n in (0 if thrust is None else len(thrust.channel.fields), len(axes_used)) if n]
    figure = new_figure(height=max(1.0 * max(columns, default=1) + 0.9, 3.0))
    grid = figure.add_gridspec(1, max(len(columns), 1))
    strip = 0.13 / max(columns, default=1)
    handles: list[Any] = []
    unnamed: set[str] = set()
    if thrust is not None:
        axes, unnamed = _column(figure, grid[0, 0], flight, strip, ["[N]"] * columns[0])
        handles += _thrusters(axes, flight, thrust)
    if tau is not None and axes_used:
        axes, unnamed = _column(figure, grid[0, -1], flight, strip, [_WRENCH[k] for k in axes_used])
        handles += _wrench(axes, flight, tau, axes_used)
    handles += [fault_patch()] if flight.faults else []
    legend_above(figure, [*handles, *map(phase_patch, sorted(unnamed))])
    return figure


def _thrusters(axes: list[Axes], flight: Flight, thrust: Series) -> list[Any]:
    bounds = force_limits(flight, len(axes))
    for k, (one, name) in enumerate(zip(axes, thruster_names(flight, thrust.channel.fields), strict=True)):
        line(one, thrust.t, thrust.values[:, k], color=BLACK, linewidth=0.7)
        name_panel(one, name.replace("_", " ").replace(".", " "))
        mark_faults(one, [f for f in flight.faults if name in f.thrusters], numbered=True)
        if bounds is not None:
            low, high = bounds[0][k], bounds[1][k]
            one.axhline(low, **LIMIT)
            one.axhline(high, **LIMIT)
            pad = 0.12 * max(high - low, 1e-6)
            one.set_ylim(low - pad, high + pad)
    shown = [Line2D([], [], color=BLACK, linewidth=0.9, label="Thruster force")]
    return shown if bounds is None else [*shown, Line2D([], [], **LIMIT, label="its limits")]


def _wrench(axes: list[Axes], flight: Flight, tau: Series, axes_used: list[int]) -> list[Any]:
    cut = flight.get("autopilot/saturated")
    for one, k in zip(axes, axes_used, strict=True):
        line(one, tau.t, tau.values[:, k], color=BLUE, linewidth=0.7)
        name_panel(one, _WRENCH_NAMES[k])
        mark_faults(one, flight.faults, numbered=k == axes_used[0])
        one.set_ylim(*limits(tau.values[:, k], share=0.9995, least=0.05))
        if cut is not None:
            _saturated(one, cut.t, cut.values[:, k] > 0.5)
    handles = [Line2D([], [], color=BLUE, linewidth=0.9, label="Desired wrench")]
    if cut is not None and (cut.values > 0.5).any():
        handles.append(Line2D([], [], color=ORANGE, linewidth=3, label="cut by a limit"))
    return handles


def _column(figure: Figure, cell: Any, flight: Flight, strip: float, labels: list[str]) -> tuple[list[Axes], set[str]]:
    """Panels below each other, and the phases that the ribbon has no room for.

    The ribbon on top takes the share `strip` of the column, whatever the number of panels.
    """
    grid = cell.subgridspec(len(labels) + 1, 1, height_ratios=[strip * len(labels)] + [1.0] * len(labels))
    axes = [figure.add_subplot(grid[k + 1]) for k in range(len(labels))]
    for one, label in zip(axes, labels, strict=True):
        dress(one, label, ticks=4)
    for one in axes[:-1]:
        one.sharex(axes[-1])
        one.tick_params(labelbottom=False)
    axes[-1].set_xlabel(TIME, fontsize=FONT)
    axes[-1].set_xlim(*flight.span)
    axes[-1].xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    if not flight.phases:
        return axes, set()
    return axes, ribbon(figure.add_subplot(grid[0], sharex=axes[-1]), flight.phases, WIDTH / 2 - 0.6)


def _saturated(axes: Axes, t: Float[np.ndarray, " N"], cut: Bool[np.ndarray, " N"]) -> None:
    """A bar at the foot of the panel where a limit cut the wrench, and its share of the time."""
    found = np.array(stretches(cut))
    if not found.size:
        return
    starts, ends = t[found[:, 0]], t[np.minimum(found[:, 1], len(t) - 1)]
    bars = _joined(np.column_stack([starts, ends]), gap=(t[-1] - t[0]) / 800)
    axes.broken_barh(bars, (0.0, 0.045), transform=axes.get_xaxis_transform(), facecolors=ORANGE, linewidth=0.4,
                     edgecolors=ORANGE, zorder=6)  # fmt: skip
    note(axes, f"cut {100 * cut.mean():.1f} % of the time")


def _joined(spans: Float[np.ndarray, "n 2"], gap: float) -> list[tuple[float, float]]:
    """Spans [start, end] as (start, width), those nearer to each other than `gap` in one."""
    found = [list(spans[0])]
    for start, end in spans[1:]:
        if start - found[-1][1] < gap:
            found[-1][1] = end
        else:
            found.append([start, end])
    return [(a, max(b - a, gap / 2)) for a, b in found]


def disturbance(flight: Flight) -> Figure:
    """The disturbance that the observer estimates, beside the true external wrench."""
    labels = (("North force [N]", "Roll moment [N m]"), ("East force [N]", "Pitch moment [N m]"),
              ("Down force [N]", "Yaw moment [N m]"))  # fmt: skip
    sheet = panels(flight, labels, height=1.35)
    true, bias = _true_wrench(flight), flight.get("autopilot/bias")
    if true is not None:
        t, wrench = true
        slow = slow_mean(t, wrench)
        sheet.entry("True external wrench", color=GREY, linewidth=0.8)
        sheet.entry("its mean over 20 s", color=BLACK, linewidth=1.2)
    if bias is not None:
        sheet.entry("Estimated bias", **ESTIMATE)
    for k in range(6):
        axes = sheet.axes[k % 3, k // 3]
        shown = []
        if true is not None:
            line(axes, t, wrench[:, k], color=GREY, linewidth=0.6, alpha=0.7)
            line(axes, t, slow[:, k], color=BLACK, linewidth=1.2, zorder=4)
            shown.append(wrench[:, k])
        if bias is not None:
            line(axes, bias.t, bias.values[:, k], **ESTIMATE)
            shown.append(bias.values[bias.t > bias.t[0] + 0.02 * (bias.t[-1] - bias.t[0]), k])
        axes.set_ylim(*limits(*shown, least=0.05 if k < 3 else 0.01))
    return sheet.done()


def _true_wrench(flight: Flight) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, "N 6"]] | None:
    """True external wrench with the force in n and the moment in b, as the observer's bias has them."""
    series, pose = flight.get("truth/external_wrench"), flight.get("truth/eta")
    if series is None or pose is None:
        return None
    pick = np.unique(np.linspace(0, len(series) - 1, min(len(series), 8000)).astype(int))
    t, values = series.t[pick], series.values[pick]
    euler = at(pose, t, angles=slice(3, 6))[:, 3:]
    R_nb = rotation_from_euler(euler)
    return t, np.hstack([np.einsum("kij,kj->ki", R_nb, values[:, :3]), values[:, 3:]])
