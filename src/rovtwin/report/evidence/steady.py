"""Figures of steady tests: towing and free running. Data, windows, and the fitted damping with its band."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from rovtwin.report.parts.style import (
    BAND,
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    SERIES,
    SMALL,
    dress,
    legend_above,
    line,
    name_panel,
    new_figure,
)

MARK: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 4.5, "zorder": 5}


def towing_figure(towing: Any, dof: str = "surge") -> Figure:
    """Speed and force of each run with its steady windows, beside net force against speed and the fit.

    Args:
        towing: A `rovtwin.identification.steady.towing.Towing`.
        dof: Name of the direction.
    """
    figure = new_figure(4.4)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1))
    speed, force = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    curve = figure.add_subplot(grid[:, 1])
    force.sharex(speed)
    for i, (run, filtered) in enumerate(zip(towing.runs, towing.filtered, strict=True)):
        colour = SERIES[i % len(SERIES)]
        t = run.t - run.t[0]
        line(speed, t, run.speed, color=colour, linewidth=0.8)
        line(force, t, run.force, points=600, color=colour, alpha=0.16, linewidth=0.5)
        line(force, t, filtered, color=colour, linewidth=0.9)
        for pull in (p for p in towing.pulls if p.run == run.name):
            span = np.array([pull.window.start, pull.window.end]) - run.t[0]
            style: dict[str, Any] = {"color": BLACK, "linewidth": 2.0, "solid_capstyle": "butt", "zorder": 6}
            speed.plot(span, [pull.speed] * 2, **style)
            force.plot(span, [pull.force + pull.tare + pull.rig] * 2, **style)
    dress(speed, "speed [m/s]")
    dress(force, "force [N]", "time in the run [s]")
    # Peaks of a brisk start would flatten what matters.
    logged = np.array([0.0] + [p.force + p.tare + p.rig for p in towing.pulls])
    margin = 0.5 * float(np.ptp(logged)) + 1e-6
    force.set_ylim(logged.min() - margin, logged.max() + margin)
    speed.tick_params(labelbottom=False)
    name_panel(speed, f"{len(towing.runs)} runs; force low-passed at {towing.cutoff:.3g} Hz")
    used = [(p.speed, p.force, p.std) for p in towing.pulls if p.used]
    _curve(curve, towing.fit, used, [(p.speed, p.force) for p in towing.pulls if not p.used])
    dress(curve, "force of the vehicle [N]", f"{dof} speed [m/s]", ticks=7)
    handles = [
        Line2D([], [], color=GREY, alpha=0.4, linewidth=0.8, label="as logged, one colour a run"),
        Line2D([], [], color=BLACK, linewidth=2.0, label="steady window"),
    ]
    legend_above(figure, handles + _handles(any(not p.used for p in towing.pulls)), 3)
    return figure


def free_running_figure(result: Any, dof: str, thesis: Any = None) -> Figure:
    """Velocity in one direction with its steady windows, beside force against velocity and the fit.

    Args:
        result: A `rovtwin.identification.steady.free_running.FreeRunning`.
        dof: One of its directions.
        thesis: Damping of the same logs by the thesis's method, to show beside it.
    """
    figure = new_figure(3.4)
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1))
    motion, curve = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    unit = "rad/s" if dof in ("roll", "pitch", "yaw") else "m/s"
    runs = [run for run in result.runs if run.dof == dof]
    for i, history in enumerate(h for h in result.histories if dof in h.velocity):
        colour = SERIES[i % len(SERIES)]
        v, std = history.velocity[dof], history.std[dof]
        t = history.t - history.t[0]
        motion.fill_between(t, v - 1.96 * std, v + 1.96 * std, color=colour, alpha=0.2, linewidth=0)
        line(motion, t, v, color=colour)
        for run in (r for r in runs if r.record == history.record):
            span = np.array([run.start, run.end]) - history.t[0]
            motion.plot(span, [run.velocity] * 2, color=BLACK, linewidth=2.0, zorder=6, solid_capstyle="butt")
    dress(motion, f"{dof} velocity [{unit}]", "time in the test [s]")
    name_panel(motion, "smoothed, with 95 % band")
    _curve(curve, result.fits[dof], [(r.velocity, r.force, r.force_std) for r in runs if r.used], [
        (r.velocity, r.force) for r in runs if not r.used
    ])  # fmt: skip
    handles = [Line2D([], [], color=BLACK, linewidth=2.0, label="steady window")]
    if thesis is not None:
        velocities = np.array([0.0] + [run.velocity for run in runs])
        v = np.linspace(1.08 * velocities.min(), 1.08 * velocities.max(), 100)
        style: dict[str, Any] = {"color": ORANGE, "linestyle": (0, (4, 2)), "linewidth": 1.0}
        curve.plot(v, thesis.force(v), **style)
        handles.append(Line2D([], [], label="the thesis's method", **style))
    dress(curve, "drag [N m]" if unit == "rad/s" else "drag [N]", f"{dof} velocity [{unit}]", ticks=7)
    legend_above(figure, handles + _handles(any(not r.used for r in runs)), 5)
    return figure


def _curve(axes: Axes, fit: Any, used: list[tuple[float, float, float]], idle: list[tuple[float, float]]) -> None:
    """Points, the curve and the 95 % band of the force."""
    speeds = np.array([p[0] for p in used] + [p[0] for p in idle])
    low, high = min(0.0, 1.08 * speeds.min()), max(0.0, 1.08 * speeds.max())
    v = np.linspace(low, high, 200)
    bottom, top = fit.force_band(v)
    if np.all(np.isfinite(bottom)):
        axes.fill_between(v, bottom, top, **BAND)
    axes.plot(v, fit.force(v), color=BLUE, linewidth=1.2)
    for speed, force, std in used:
        axes.errorbar(speed, force, 1.96 * std, color=BLACK, elinewidth=0.8, capsize=2, **MARK)
    for speed, force in idle:
        axes.plot(speed, force, markerfacecolor="white", markeredgecolor=GREY, **MARK)
    axes.axhline(0, color="#666666", linewidth=0.5)
    sides = ("ahead", "astern") if len(fit.coefficients) == 4 else ("",)
    words = [
        f"{side + ': ' if side else ''}$d_l$ = {fit.coefficients[2 * k]:.3g} ± {1.96 * fit.std[2 * k]:.2g}, "
        f"$d_q$ = {fit.coefficients[2 * k + 1]:.4g} ± {1.96 * fit.std[2 * k + 1]:.2g}"
        for k, side in enumerate(sides)
    ]
    upward = high > -low
    axes.text(
        0.02 if upward else 0.98,
        0.98 if upward else 0.02,
        "\n".join(words),
        transform=axes.transAxes,
        ha="left" if upward else "right",
        va="top" if upward else "bottom",
        fontsize=SMALL,
    )


def _handles(idle: bool) -> list[Any]:
    point = Line2D([], [], color=BLACK, label="mean of a window, 95 %", **MARK)
    out = [point, Line2D([], [], color=BLUE, label="fit"), Patch(facecolor=BLUE, alpha=0.18, label="its 95 % band")]
    if idle:
        hollow: dict[str, Any] = MARK | {"markerfacecolor": "white", "markeredgecolor": GREY}
        out.append(Line2D([], [], label="left out", **hollow))
    return out
