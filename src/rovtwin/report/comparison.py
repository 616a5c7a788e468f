"""Several runs side by side, and beside what somebody published about them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rovtwin.core.log import Log
from rovtwin.report.flight import Flight
from rovtwin.report.html import save, write_page
from rovtwin.report.path import aspect, draw_path, legend_entries
from rovtwin.report.style import GREY, SERIES, WIDTH, dress, legend_above, line, name_panel, new_figure, note
from rovtwin.report.tables import Table
from rovtwin.report.verdict import scores, verdict


def write_comparison(
    logs: Mapping[str, Log],
    published: Sequence[Sequence[Any]],
    folder: str | Path,
    title: str = "Comparison",
    reports: Mapping[str, str] | None = None,
) -> Path:
    """Write `report.html` that shows runs side by side, and its figures.

    Args:
        logs: Runs by label, in order.
        published: Rows of statement, what was published, what each run measured (one cell per run), and a note.
        folder: Where to write.
        title: On top of the page.
        reports: Links to the report of each run, relative to `folder`, by label.

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
    return write_page(
        folder / "report.html",
        "comparison.html.j2",
        title=title,
        verdicts={label: verdict(flight) for label, flight in flights.items()},
        reports=dict(reports or {}),
        scores=_score_table(flights),
        published=Table("", ["Statement", "Published", *logs, "Note"], rows) if rows else None,
        pictures=pictures,
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
    columns = min(len(flights), 3)
    rows = -(-len(flights) // columns)
    tallest = max(aspect(flight) for flight in flights.values())
    figure = new_figure(height=float(np.clip(rows * (tallest * (WIDTH / columns - 0.6) + 0.5) + 0.8, 3.0, 9.0)))
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    entries: dict[str, Any] = {}
    for axes, (label, flight) in zip(grid, flights.items(), strict=False):
        draw_path(axes, flight)
        name_panel(axes, label)
        if flight.wave_direction is not None:
            note(axes, f"waves run to {np.degrees(flight.wave_direction) % 360:03.0f}°")
        entries |= {str(one.get_label()): one for one in legend_entries(flight)}
    for axes in grid[len(flights) :]:
        axes.set_axis_off()
    legend_above(figure, list(entries.values()), columns=4)
    return figure


def errors(flights: Mapping[str, Flight]) -> Figure:
    """Cross-track and depth error of all runs over the same time."""
    figure = new_figure(height=4.2)
    across, down = figure.subplots(2, 1, sharex=True)
    dress(across, "Cross-track error [m]")
    dress(down, "Depth error [m]", "Time [s]")
    deepest = []
    for colour, flight in zip(_colours(flights), flights.values(), strict=False):
        if flight.cross_track is not None:
            line(across, *flight.cross_track, color=colour)
        if flight.depth_error is not None:
            t, error = flight.depth_error
            line(down, t, error, color=colour)
            deepest.append(error[(t > flight.first_dive_end) & np.isfinite(error)])
    for axes in (across, down):
        axes.axhline(0.0, color=GREY, linewidth=0.8)
    most = max((float(np.abs(e).max()) for e in deepest if e.size), default=1.0)
    down.set_ylim(-1.15 * most, 1.15 * most)
    legend_above(figure, [Line2D([], [], color=c, label=n) for c, n in zip(_colours(flights), flights, strict=False)])
    return figure


def effort(flights: Mapping[str, Flight]) -> Figure:
    """Thruster effort over time: the mean square force of each run in windows."""
    figure = new_figure(height=2.4, width=WIDTH)
    axes = dress(figure.subplots(), "Sum of squared\nthruster forces [N²]", "Time [s]")
    for colour, flight in zip(_colours(flights), flights.values(), strict=False):
        thrust = flight.get("truth/thrust")
        if thrust is not None:
            power = np.nansum(thrust.values**2, axis=1)
            cells = np.array_split(np.arange(len(power)), min(200, len(power)))
            axes.plot(
                [thrust.t[c].mean() for c in cells], [power[c].mean() for c in cells], color=colour, linewidth=1.1
            )
    axes.set_ylim(bottom=0)
    legend_above(figure, [Line2D([], [], color=c, label=n) for c, n in zip(_colours(flights), flights, strict=False)])
    return figure


def _colours(flights: Mapping[str, Flight]) -> list[str]:
    return [SERIES[k % len(SERIES)] for k in range(len(flights))]


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
        "Truth against the commanded path over time; gaps are turns and dives. A longer line is a run that took "
        "longer.",
        errors,
        (),
    ),
    ("effort", "Thruster effort", "What each run asked of its thrusters.", effort, ("truth/thrust",)),
)
