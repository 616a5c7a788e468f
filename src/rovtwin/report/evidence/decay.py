"""Figure of decay tests: the angle as measured and as fitted, and what is left over."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rovtwin.report.parts.style import BLACK, BLUE, GREY, SMALL, dress, limits, name_panel, new_figure


def decay_figure(decays: Sequence[Any], names: Sequence[str], axis: str) -> Figure:
    """Angle and residuals of each test.

    Args:
        decays: `rovtwin.identification.decay.scale.Decay`s.
        names: Of the tests.
        axis: roll or pitch.
    """
    figure = new_figure(2.6 * len(decays) + 0.5)
    grid = figure.subplots(2 * len(decays), 1, squeeze=False, height_ratios=[2.6, 1] * len(decays))[:, 0]
    for k, (one, name) in enumerate(zip(decays, names, strict=True)):
        angle, left = grid[2 * k], grid[2 * k + 1]
        t = one.t - one.start
        angle.plot(t, np.degrees(one.angle), color=BLACK, linestyle="none", marker=".", markersize=3, label="measured")
        angle.plot(t, np.degrees(one.fitted), color=BLUE, linewidth=1.3, label="fitted")
        angle.axhline(np.degrees(one.offset), color=GREY, linewidth=0.8, linestyle=(0, (4, 2)), label="at rest")
        angle.tick_params(labelbottom=False)
        dress(angle, f"{axis} [deg]")
        name_panel(angle, name)
        if k == 0:
            # Where the swing is not: it begins on the side of the tilt and ends at rest.
            corner = "lower right" if one.state[0] < 0 else "upper right"
            angle.legend(fontsize=SMALL, frameon=False, loc=corner, ncols=3)
        residual = np.degrees(one.fitted - one.angle)
        left.plot(t, residual, color=BLACK, linestyle="none", marker=".", markersize=2.5)
        left.axhline(0.0, color=BLUE, linewidth=0.9)
        dress(left, "left over [deg]", "time since the fit begins [s]" if k == len(decays) - 1 else "", ticks=3)
        left.set_ylim(*limits(residual, symmetric=True))
    return figure
