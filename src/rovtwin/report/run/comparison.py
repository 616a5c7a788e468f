"""Several runs side by side, and beside what somebody published about them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rovtwin.core.log import Log
from rovtwin.report.flight import Flight
from rovtwin.report.parts.page import save, write_page
from rovtwin.report.parts.style import (
    SMALL,
    WIDTH,
    dress,
    legend_above,
    line,
    name_panel,
    new_figure,
    note,
    series_colours,
)
from rovtwin.report.parts.tables import Table
from rovtwin.report.run.path import draw_path, extent, legend_entries
from rovtwin.report.run.verdict import scores, verdict


def write_comparison(
    logs: Mapping[str, Log],
    published: Sequence[Sequence[Any]],
    folder: str | Path,
    title: str = "Comparison",
    reports: Mapping[str, str] | None = None,
    camera: tuple[Figure, Table] | str | None = None,
    payload: tuple[Table, Table] | None = None,
) -> Path:
    """Write `report.html` that shows runs side by side, and its figures.

    Args:
        logs: Runs by label, in order.
        published: Rows of statement, what was published, what each run measured (one cell per run), and a note.
        folder: Where to write.
        title: On top of the page.
        reports: Links to the report of each run, relative to `folder`, by label.
        camera: What a run's own camera saw, and what was identified from it; or why there is none.
        payload: What a payload changes, and what was identified with it.

    Returns:
        The path of the page.
    """
    if not logs:
        raise ValueError("no runs to compare: expected at least one log")
    for row in published:
        if len(row) != len(logs) + 3:
            raise ValueError(
                f"published row {row!r}: {len(row)} cells, expected statement, published, {len(logs)} measured, note"
            )
    folder, flights = Path(folder), {label: Flight(log) for label, log in logs.items()}
    pictures = [
        save(draw(flights), folder, name, heading, caption)
        for name, heading, caption, draw, needs in _FIGURES
        if any(flight.has(*needs) for flight in flights.values())
    ]
    rows = [[str(cell) for cell in row] for row in published]
    seen, learnt = (None, None) if camera is None or isinstance(camera, str) else camera
    return write_page(
        folder / "report.html",
        "comparison.html.j2",
        title=title,
        verdicts={label: verdict(flight) for label, flight in flights.items()},
        reports=dict(reports or {}),
        scores=_score_table(flights),
        published=Table("", ["Statement", "Published", *logs, "Note"], rows) if rows else None,
        pictures=pictures,
        seen=None if seen is None else save(seen, folder, "camera", *_SEEN),
        learnt=learnt,
        no_camera=camera if isinstance(camera, str) else "",
        payload=payload,
    )


_SEEN = (
    "What the vehicle saw, and its track",
    "A picture of the port camera as the twin renders it, with the markers that were found; position and velocity from "
    "all pictures, and the truth.",
)


def _score_table(flights: Mapping[str, Flight]) -> Table:
    columns = {label: {s.name: s for s in scores(flight.summary)} for label, flight in flights.items()}
    names = list(dict.fromkeys(name for column in columns.values() for name in column))
    rows = []
    for name in names:
        found = [column.get(name) for column in columns.values()]
        unit = next(s.unit for s in found if s)
        rows.append([f"{name} [{unit}]", *(_cell(s.value, s.beside) if s else "-" for s in found)])
    return Table("Scores", ["", *flights], rows)


def _cell(value: str, beside: str) -> str:
    return f"{value} ({beside})" if beside else value


def paths(flights: Mapping[str, Flight]) -> Figure:
    """Paths over ground, side by side at the same scale."""
    columns = min(len(flights), 2)
    rows = -(-len(flights) // columns)
    corners = [extent(flight) for flight in flights.values()]
    low, high = np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)
    shape = float((high - low)[0] / (high - low)[1])
    figure = new_figure(height=float(np.clip(rows * (shape * (WIDTH / columns - 0.6) + 0.55) + 0.7, 3.0, 10.0)))
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    entries: dict[str, Any] = {}
    for axes, (label, flight) in zip(grid, flights.items(), strict=False):
        draw_path(axes, flight)
        axes.set(xlim=(low[1], high[1]), ylim=(low[0], high[0]))
        name_panel(axes, label)
        if flight.wave_direction is not None:
            note(axes, f"waves run to {np.degrees(flight.wave_direction) % 360:03.0f}°")
        entries |= {str(one.get_label()): one for one in legend_entries(flight)}
    if len(grid) > len(flights):
        grid[-1].set_axis_off()
        grid[-1].legend(handles=list(entries.values()), loc="center", fontsize=SMALL, frameon=False)
    else:
        legend_above(figure, list(entries.values()), columns=4)
    return figure


def errors(flights: Mapping[str, Flight]) -> Figure:
    """Cross-track error over time, and the share of time within a given cross-track and depth error."""
    figure = new_figure(height=4.4)
    upper, left, right = figure.subplot_mosaic([["time", "time"], ["across", "down"]]).values()
    dress(upper, "Cross-track error [m]", "Time [s]")
    dress(left, "Share of time on legs [%]", "Cross-track error up to [m]")
    dress(right, "Share of time [%]", "Depth error up to [m]")
    for colour, flight in zip(series_colours(len(flights)), flights.values(), strict=False):
        if flight.cross_track is not None:
            line(upper, *flight.cross_track, color=colour)
            _distribution(left, flight.cross_track[1], colour)
        if flight.depth_error is not None:
            t, error = flight.depth_error
            _distribution(right, error[t > flight.first_dive_end], colour)
    upper.set_ylim(bottom=min(0.0, upper.dataLim.y0))
    for axes in (left, right):
        axes.set(ylim=(0, 102))
        axes.set_xlim(left=0)
    _name(figure, flights)
    return figure


def _distribution(axes: Axes, values: Float[np.ndarray, "..."], colour: str) -> None:
    """The share [%] of the values whose size is at most x."""
    size = np.sort(np.abs(values[np.isfinite(values)]))
    if size.size:
        share = 100 * np.arange(1, size.size + 1) / size.size
        pick = np.unique(np.linspace(0, size.size - 1, 400).astype(int))
        axes.plot(np.r_[0, size[pick]], np.r_[0, share[pick]], color=colour, linewidth=1.2)


def effort(flights: Mapping[str, Flight]) -> Figure:
    """The integral of the summed squared thruster forces up to each time."""
    figure = new_figure(height=2.4)
    axes = dress(figure.subplots(), "Effort so far [N² s]", "Time [s]")
    for colour, flight in zip(series_colours(len(flights)), flights.values(), strict=False):
        thrust = flight.get("truth/thrust")
        if thrust is not None:
            power = np.nansum(thrust.values**2, axis=1)
            total = np.r_[0.0, np.cumsum(np.diff(thrust.t) * (power[1:] + power[:-1]) / 2)]
            line(axes, thrust.t, total, color=colour, linewidth=1.2)
    axes.set_ylim(bottom=0)
    _name(figure, flights)
    return figure


def _name(figure: Figure, flights: Mapping[str, Flight]) -> None:
    colours = zip(series_colours(len(flights)), flights, strict=True)
    legend_above(figure, [Line2D([], [], color=colour, label=label) for colour, label in colours])


_FIGURES = (
    (
        "paths",
        "Paths over ground",
        "The same mission in each run, at the same scale. Look at how far truth leaves the legs, and to which side.",
        paths,
        (),
    ),
    (
        "errors",
        "Cross-track and depth error",
        "Truth against the commanded path: over time (gaps are turns and dives; a longer line is a run that took "
        "longer), and the share of the time within a given error, after the first dive (further to the left is "
        "better; a run that waits long at one place is judged mostly there).",
        errors,
        (),
    ),
    (
        "effort",
        "Thruster effort",
        "What each run asked of its thrusters so far; the end of a line is its whole effort.",
        effort,
        ("truth/thrust",),
    ),
)
