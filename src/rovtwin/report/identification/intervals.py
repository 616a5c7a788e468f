"""Figure of an identification's intervals: every parameter before and after the tests, on one scale."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from rovtwin.report.identification.figures import shortened
from rovtwin.report.identification.tables import estimated, pretty
from rovtwin.report.parts.style import BLUE, FONT, GREY, ORANGE, TINY, dress, legend_above, new_figure

_Z = 1.96
_ROW = 0.17  # height of a row [inch]
_WIDEST = 6.0  # standard deviations of the prior; what lies farther off is drawn at the edge
_TRUE: dict[str, Any] = {"color": ORANGE, "marker": "x", "linestyle": "none", "markersize": 4.5, "zorder": 5}


def intervals_figure(result: Any, chosen: Sequence[int], truth: Float[np.ndarray, " chosen"]) -> Figure:
    """95 % intervals as distances from the middle of the prior, in its standard deviations, a row each.

    Args:
        result: What `identify` returns.
        chosen: Places of the parameters to show, the first on top.
        truth: True values of these in their units, shape (len(chosen),), NaN where none is known.
    """
    figure = new_figure(0.8 + _ROW * len(chosen))
    axes = figure.subplots()
    width = np.sqrt(np.diag(result.prior.covariance))
    middle, half = (result.theta - result.prior.mean) / width, _Z * result.std / width
    axes.axvspan(-_Z, _Z, facecolor=GREY, alpha=0.22, linewidth=0, zorder=0)
    for row, i in enumerate(chosen):
        axes.plot([middle[i] - half[i], middle[i] + half[i]], [row, row], color=BLUE, linewidth=1.6, zorder=3)
        axes.plot([middle[i]], [row], color=BLUE, marker="o", markersize=3.2, zorder=4)
        if np.isfinite(truth[row]):
            off = (result.parameters.free[i].theta(float(truth[row])) - result.prior.mean[i]) / width[i]
            axes.plot([np.clip(off, -_WIDEST, _WIDEST)], [row], **_TRUE)
    dress(axes, "", "Standard deviations of the prior, from its middle")
    _name_rows(axes, result, chosen)
    handles = [
        Patch(facecolor=GREY, alpha=0.22, label="95 % of the prior"),
        Line2D([], [], color=BLUE, linewidth=1.6, marker="o", markersize=3.2, label="estimate, 95 %"),
    ]
    legend_above(figure, [*handles, *([Line2D([], [], **_TRUE, label="truth")] if np.isfinite(truth).any() else [])])
    return figure


def _name_rows(axes: Axes, result: Any, chosen: Sequence[int]) -> None:
    """Names on the left, estimates with their units on the right."""
    free = result.parameters.free
    labels = [
        f"{estimated(result.values[free[i].name], *result.interval(free[i].name))} {pretty(free[i].unit)}".strip()
        for i in chosen
    ]
    axes.set_yticks(range(len(chosen)), [shortened(free[i].name) for i in chosen], fontsize=TINY)
    axes.set_ylim(len(chosen) - 0.4, -0.6)
    far = float(np.max(np.abs(axes.get_xlim())))
    axes.set_xlim(-min(far, _WIDEST), min(far, _WIDEST))
    right = axes.secondary_yaxis("right")
    right.set_yticks(range(len(chosen)), labels, fontsize=TINY)
    right.tick_params(length=0)
    right.spines["right"].set_visible(False)
    axes.xaxis.label.set_fontsize(FONT)
