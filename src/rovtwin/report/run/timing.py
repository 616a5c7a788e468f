"""How the host of a flight over a link kept time: lateness of its ticks, age of the line."""

import numpy as np
from matplotlib.figure import Figure

from rovtwin.report.flight import Flight
from rovtwin.report.parts.style import BLACK, BLUE, GREY, dress, line, new_figure, note

STEPS = 60  # of the histogram


def timing(flight: Flight) -> Figure:
    """Histogram of lateness, lateness over time, and age of the line over time."""
    series = flight["host/timing"]
    late, age = (np.where(np.isfinite(x), x, 0.0) for x in (series["late_ms"], series["link_age"]))
    figure = new_figure(height=3.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.3))
    histogram = dress(figure.add_subplot(grid[:, 0]), "Ticks [1]", "Late by [ms]")
    most = min(max(float(np.max(late, initial=0.0)), 1.0), 1e6)
    histogram.hist(np.clip(late, 0.0, most), bins=np.linspace(0.0, most, STEPS).tolist(), color=BLUE, log=True)
    p99 = float(np.percentile(late, 99))
    histogram.axvline(p99, color=BLACK, linewidth=0.9, linestyle="--")
    when = dress(figure.add_subplot(grid[0, 1]), "Late by [ms]")
    line(when, series.t, late, color=BLUE)
    note(when, f"median {np.median(late):.1f}, 99 % {p99:.1f}, latest {most:.1f} ms")
    line_age = dress(figure.add_subplot(grid[1, 1], sharex=when), "Age of the line [s]", "Time [s]")
    line(line_age, series.t, age, color=GREY)
    note(line_age, f"longest silence {np.max(age):.2f} s")
    return figure


def about(flight: Flight) -> str:
    """What the caption adds."""
    sent = flight["host/timing"]["thrust_on"]
    return "" if sent.all() else "Thrust was off: zeros were sent, whatever was computed."
