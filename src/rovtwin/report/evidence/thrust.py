"""Figures of thrust: bollard tests with their curves, and thrust with damping from free-running speeds."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from rovtwin.report.parts.style import BLACK, BLUE, GREY, ORANGE, SMALL, dress, limits, new_figure, series_colours


def thrust_figure(tests: Sequence[Any]) -> Figure:
    """Force over command of each test, and what the curves leave over.

    Args:
        tests: `rovtwin.identification.steady.thrust.Bollard`s.
    """
    figure = new_figure(4.6)
    force, left = figure.subplots(2, 1, height_ratios=[3, 1], sharex=True)
    u = np.linspace(-1, 1, 401)
    rest = []
    for one, colour in zip(tests, series_colours(len(tests)), strict=True):
        name = one.source if one.voltage is None else f"{one.voltage:g} V"
        command, measured = one.points.T
        force.plot(command, measured, color=colour, linestyle="none", marker=".", markersize=2.5, alpha=0.6)
        text = f"{name}: n {one.both.values[2]:.2f}, dead band {one.both.values[1]:.2f}"
        force.plot(u, one.both.force(u), color=colour, linewidth=1.2, label=text)
        rest.append(one.both.force(command) - measured)
        left.plot(command, rest[-1], color=colour, linewidth=0.9)
    force.legend(fontsize=SMALL, frameon=False, loc="upper left")
    dress(force, "Force [N]", ticks=7)
    dress(left, "Fit less test [N]", "Command", ticks=3)
    left.set_ylim(*limits(*rest, share=1.0, symmetric=True))
    left.axhline(0.0, color=GREY, linewidth=0.7)
    return figure


def thrust_and_damping_figure(
    joint: Any, command: Float[np.ndarray, " n"], velocity: Float[np.ndarray, " n"], dof: str
) -> Figure:
    """Thrust over command beside damping over speed.

    Args:
        joint: `rovtwin.identification.steady.thrust_damping.JointFit`.
        command: Shares of full.
        velocity: [m/s or rad/s].
        dof: surge to yaw.
    """
    speed, unit = ("rad/s", "N m") if dof in ("roll", "pitch", "yaw") else ("m/s", "N")
    figure = new_figure(3.2)
    thrust, drag = figure.subplots(1, 2)
    u = np.linspace(min(0.0, command.min()), max(0.0, command.max()), 200)
    thrust.plot(u, joint.thrust[0] * u, color=ORANGE, linestyle=(0, (4, 2)), linewidth=1.2, label="linear in command")
    thrust.plot(u, joint.force(u), color=BLUE, linewidth=1.4, label=f"found: exponent {joint.thrust[2]:.2f}")
    thrust.plot(command, joint.force(command), color=BLUE, linestyle="none", marker="o", markersize=4)
    thrust.legend(fontsize=SMALL, frameon=False)
    dress(thrust, f"Thrust [{unit}]", "Command")
    v = np.linspace(min(0.0, 1.1 * velocity.min()), max(0.0, 1.1 * velocity.max()), 200)
    middle, half = joint.drag(v), 1.96 * joint.drag_sd(v)
    drag.fill_between(v, middle - half, middle + half, color=BLUE, alpha=0.15, linewidth=0)
    straight = joint.as_linear[0] * v + joint.as_linear[1] * np.abs(v) * v
    drag.plot(v, straight, color=ORANGE, linestyle=(0, (4, 2)), linewidth=1.2, label="if thrust were linear")
    drag.plot(v, middle, color=BLUE, linewidth=1.4, label="found, with 95 % band")
    drag.plot(velocity, joint.force(command), color=BLACK, linestyle="none", marker="o", markersize=4, label="runs")
    drag.legend(fontsize=SMALL, frameon=False)
    dress(drag, f"Damping [{unit}]", f"{dof.capitalize()} velocity [{speed}]")
    return figure
