"""Stacks of panels over time that share the axis, the shading of the phases and one legend."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Shaped
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from rovtwin.report.flight import Flight
from rovtwin.report.parts.style import (
    WIDTH,
    dress,
    fault_patch,
    legend_above,
    mark_faults,
    new_figure,
    phase_patch,
    ribbon,
    shade,
)

TIME = "Time [s]"


@dataclass
class Panels:
    """A figure with a ribbon of phases over each column of panels.

    Attributes:
        figure: The figure.
        axes: Panels.
        handles: What the legend holds.
        phases: Phases that the legend has to name, because the ribbon has no room for them.
        faults: Whether faults are marked.
    """

    figure: Figure
    axes: Shaped[np.ndarray, "rows columns"]
    handles: list[Artist] = field(default_factory=list)
    phases: list[str] = field(default_factory=list)
    faults: bool = False

    def entry(self, label: str, **style: Any) -> None:
        """One line of the legend."""
        self.handles.append(Line2D([], [], label=label, **style))

    def done(self, columns: int = 6) -> Figure:
        """The figure with its legend."""
        faults = [fault_patch()] if self.faults else []
        legend_above(self.figure, [*self.handles, *faults, *map(phase_patch, self.phases)], columns)
        return self.figure


def panels(flight: Flight, labels: Sequence[Sequence[str]], height: float = 1.25, shaded: bool = True) -> Panels:
    """Empty panels over time.

    Args:
        flight: Gives phases and the span of time.
        labels: Label of each panel's vertical axis, by rows.
        height: Of one panel [inch].
        shaded: Whether the phases also show behind the data, not only in the ribbon.
    """
    rows, columns = len(labels), len(labels[0])
    strip = [0.13 / height] if flight.phases else []
    figure = new_figure(height=height * rows + 0.75)
    grid = figure.subplots(len(strip) + rows, columns, sharex=True, squeeze=False, height_ratios=strip + [1.0] * rows)
    body = grid[len(strip) :]
    body[0, 0].set_xlim(*flight.span)
    for i, (row, names) in enumerate(zip(body, labels, strict=True)):
        for axes, label in zip(row, names, strict=True):
            dress(axes, label)
            shade(axes, flight.phases) if shaded else None
            mark_faults(axes, flight.faults, numbered=i == 0)
    width = (WIDTH - 0.6 * columns) / columns
    unnamed = [ribbon(axes, flight.phases, width) for axes in (grid[0] if strip else [])]
    for axes in body[-1]:
        axes.set_xlabel(TIME, fontsize=9)
    body[0, 0].xaxis.set_major_locator(MaxNLocator({1: 9, 2: 6}.get(columns, 4), steps=[1, 2, 2.5, 5, 10]))
    return Panels(figure, body, phases=sorted(unnamed[0]) if unnamed else [], faults=bool(flight.faults))
