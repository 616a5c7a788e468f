"""Picture of a planned test: what thrusters are sent, where the vehicle goes in its tank, what is learnt."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from rovtwin.report.identification.words import is_coupling
from rovtwin.report.parts.style import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    SERIES,
    SMALL,
    TINY,
    dress,
    line,
    name_panel,
    new_figure,
    note,
)

SHOWN = 24  # bars at most: those that the plan improves most


@dataclass(frozen=True, eq=False)
class PlannedTest:
    """What the picture shows.

    Attributes:
        title: For people.
        t: [s].
        shares: Command on each axis; names in `axes`.
        axes: Names of those axes, k of them.
        position: CO along the path, n [m].
        tank: Length, width, depth [m]; the start is in the middle.
        names: Of the parameters.
        prior: Standard deviation before.
        plan: Expected after it.
        steady: Expected after the thesis's steady steps in the same time.
        minutes: Whole minutes of the test.
        left: Geometric mean of the standard deviation over the prior's after each.
    """

    title: str
    t: Float[np.ndarray, " n"]
    shares: Float[np.ndarray, "n k"]
    axes: Sequence[str]
    position: Float[np.ndarray, "n 3"]
    tank: tuple[float, float, float]
    names: Sequence[str]
    prior: Float[np.ndarray, " p"]
    plan: Float[np.ndarray, " p"]
    steady: Float[np.ndarray, " m"]
    minutes: Float[np.ndarray, " m"]
    left: Float[np.ndarray, " m"]


def draw_test_plan(test: PlannedTest) -> Figure:
    """Commands on top; path from above and from the side; expected standard deviations; what each minute buys."""
    figure = new_figure(9.6)
    halves = figure.add_gridspec(2, 1, height_ratios=[1.0, 1.55])
    upper, lower = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    strips = np.atleast_1d(upper.subplots(len(test.axes), 1, sharex=True))
    for axes, name, share, colour in zip(strips, test.axes, test.shares.T, SERIES, strict=False):
        dress(axes, name, ticks=2)
        line(axes, test.t / 60.0, share, points=3000, color=colour, linewidth=0.6)
        axes.set_ylim(-1.1, 1.1)
    dress(strips[-1], test.axes[-1], "Time [min]", ticks=2)
    name_panel(strips[0], f"{test.title}: commands, shares of full")
    sides = lower.add_gridspec(1, 2, width_ratios=[1.0, 1.35])
    left, right = lower.add_subfigure(sides[0]), lower.add_subfigure(sides[1])
    above, side, gain = left.subplots(3, 1, height_ratios=[1.2, 0.8, 1.0])
    _path(above, test, 1, 0)
    _path(side, test, 0, 2)
    _gain(gain, test)
    _bars(right.subplots(), test)
    return figure


def _path(axes: Axes, test: PlannedTest, across: int, up: int) -> None:
    """The predicted path of CO in one plane of the tank."""
    labels = ("North [m]", "East [m]", "Depth [m]")
    length, width, depth = test.tank
    low = np.array([-length / 2, -width / 2, 0.0])
    size = np.array([length, width, depth])
    if across == 1:  # from above the longer side lies flat
        across, up = 0, 1
    dress(axes, labels[up], labels[across], ticks=3)
    axes.add_patch(Rectangle((low[across], low[up]), size[across], size[up], fill=False, edgecolor=GREY, linewidth=1.2))
    axes.plot(test.position[::10, across], test.position[::10, up], color=BLACK, linewidth=0.5)
    axes.set_aspect("equal")
    axes.margins(0.04)
    if up == 2:
        axes.invert_yaxis()
    name_panel(axes, "CO in the tank, from the side" if up == 2 else "CO in the tank, from above")


def _gain(axes: Axes, test: PlannedTest) -> None:
    dress(axes, "sd / sd before", "Time of test [min]")
    axes.plot(test.minutes, test.left, color=BLUE, marker="o", markersize=2.5, linewidth=1.0)
    axes.set_ylim(0, None)
    name_panel(axes, "What each minute buys")
    note(axes, "geometric mean")


def _bars(axes: Axes, test: PlannedTest) -> None:
    """Standard deviations over the prior's, the best learnt on top; couplings between directions are left out."""
    ratio = np.where([is_coupling(name) for name in test.names], np.inf, test.plan / test.prior)
    order = [i for i in np.argsort(ratio)[:SHOWN][::-1] if np.isfinite(ratio[i])]
    rows = np.arange(len(order))
    axes.set_xscale("log")
    dress(axes, "", "sd over the one before the test")
    axes.barh(rows, ratio[order], height=0.7, color=BLUE, label="this plan")
    # A mark, not a bar: bars of one colour would hide the other wherever it is shorter.
    axes.plot((test.steady / test.prior)[order], rows, "D", color=ORANGE, markersize=3.5, label="steady steps")
    axes.set_yticks(rows, [str(test.names[i]).replace("_", " ").replace(".", " ") for i in order], fontsize=TINY)
    axes.grid(False, axis="y")
    axes.set_xlim(min(2e-3, 0.9 * float(ratio.min())), 1.05)
    axes.set_ylim(-0.6, len(order) - 0.4)
    axes.legend(fontsize=SMALL, loc="upper right", framealpha=0.9)
    name_panel(axes, "What is learnt, expected")
