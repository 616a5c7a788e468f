"""How figures look: one palette, sizes in print, axes, phase shading, and thinning of long series.

Figures are made with matplotlib's objects (`Figure`, never `pyplot`) and without touching `rcParams`: there is no
global state, so that reports can be drawn in any thread.

The colours are those of Okabe and Ito (2008), Color Universal Design, for every kind of colour vision. One
meaning keeps one colour and one line style in all figures, so that they also read in black and white.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from rovtwin.report.flight import FaultSpan, Interval

WIDTH = 7.5  # of a figure [inch]: a page of A4 with margins, without scaling
FONT, SMALL, TINY = 9.0, 8.0, 7.0  # axis labels; ticks, legends and titles; labels inside

BLACK, BLUE, ORANGE, GREEN = "#1a1a1a", "#0072B2", "#D55E00", "#009E73"
PURPLE, SKY, YELLOW, GREY = "#CC79A7", "#56B4E9", "#E69F00", "#8c8c8c"

# The estimate lies under the truth and is wider: where both agree, a blue edge still shows.
TRUTH: dict[str, Any] = {"color": BLACK, "linewidth": 0.9, "zorder": 4}
ESTIMATE: dict[str, Any] = {"color": BLUE, "linewidth": 1.5, "alpha": 0.8, "zorder": 3}
REFERENCE: dict[str, Any] = {"color": ORANGE, "linewidth": 1.0, "linestyle": (0, (4, 2)), "zorder": 5}
LIMIT: dict[str, Any] = {"color": PURPLE, "linewidth": 1.0, "linestyle": (0, (6, 2, 1, 2)), "zorder": 2.5}
FAULT = "#b2182b"  # of nothing else
BAND: dict[str, Any] = {"color": BLUE, "alpha": 0.18, "linewidth": 0.0, "zorder": 2}
SERIES = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, SKY, BLACK, GREY)  # runs or parts without a meaning of their own

PHASE_COLOURS = {
    "idle": "#ececec",
    "dive": "#cfe3f5",
    "turn": "#fbe5b0",
    "go": "#ffffff",
    "hold": "#d3ecdc",
    "paused": "#e3dcec",
    "finished": "#ececec",
    "aborted": "#f7cfc4",
    "held": "#fbe3d0",
    "returning": "#fbe3d0",
    "returned": "#fbe3d0",
    "surfacing": "#fbe3d0",
    "surfaced": "#fbe3d0",
}


def series_colours(count: int) -> list[str]:
    """Colours of so many runs or parts; those beyond the palette begin it anew."""
    return [SERIES[k % len(SERIES)] for k in range(count)]


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty white figure [inch] whose parts are laid out without overlap."""
    layout = ConstrainedLayoutEngine(w_pad=0.04, h_pad=0.03, hspace=0.02, wspace=0.03)
    return Figure(figsize=(width, height), layout=layout, facecolor="white")


def dress(axes: Axes, ylabel: str = "", xlabel: str = "", ticks: int = 5) -> Axes:
    """Labels, ticks and a faint grid in the house's sizes."""
    axes.set_ylabel(ylabel, fontsize=FONT)
    axes.set_xlabel(xlabel, fontsize=FONT)
    axes.tick_params(labelsize=SMALL, length=3, width=0.6, color="#666666")
    axes.grid(True, color="#000000", alpha=0.09, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set(linewidth=0.6, color="#666666")
    if axes.get_yscale() == "linear":
        axes.yaxis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 2.5, 5, 10]))
    return axes


def note(axes: Axes, text: str) -> None:
    """A small remark above the right end of an axes, off the data."""
    axes.set_title(text, fontsize=TINY, color="#444444", loc="right", pad=2)


def name_panel(axes: Axes, text: str) -> None:
    """What a panel shows, above its left end, where its axis' label has no room for it."""
    axes.set_title(text, fontsize=SMALL, loc="left", pad=2)


def legend_above(figure: Figure, handles: Sequence[Any], columns: int = 6) -> None:
    """One legend for the whole figure, above it, where it covers nothing."""
    if handles:
        figure.legend(
            handles=list(handles),
            loc="outside upper center",
            ncols=min(columns, len(handles)),
            fontsize=SMALL,
            frameon=False,
            handlelength=2.2,
            columnspacing=1.6,
        )


def shade(axes: Axes, phases: Sequence[Interval]) -> None:
    """Phases as pale colours behind the data; `go` stays white."""
    for name in {interval.phase for interval in phases} - {"go"}:
        bars = [(p.start, p.end - p.start) for p in phases if p.phase == name]
        colour = PHASE_COLOURS.get(name, "#ececec")
        axes.broken_barh(
            bars, (0, 1), transform=axes.get_xaxis_transform(), facecolors=colour, alpha=0.75, zorder=0, linewidth=0
        )


def ribbon(axes: Axes, phases: Sequence[Interval], width: float) -> set[str]:
    """Names of the phases in a strip over the panels below.

    Args:
        axes: The strip.
        phases: What to draw.
        width: Of the strip [inch]; it decides which names fit.

    Returns:
        The phases that take a part of the time worth naming, but whose name found no room anywhere.
    """
    axes.set(ylim=(0, 1), yticks=[])
    axes.tick_params(bottom=False, labelbottom=False)
    axes.spines[:].set_visible(False)
    if not phases:
        return set()
    span = phases[-1].end - phases[0].start
    for name in {interval.phase for interval in phases}:
        bars = [(p.start, p.end - p.start) for p in phases if p.phase == name]
        axes.broken_barh(
            bars, (0, 1), facecolors=PHASE_COLOURS.get(name, "#ececec"), edgecolors="#999999", linewidth=0.4
        )
    named = {"go"}
    for p in phases:
        room = 72 * width * (p.end - p.start) / max(span, 1e-9)
        words = [f"{p.phase} {p.waypoint + 1}", f"{p.waypoint + 1}"] if p.phase in ("go", "hold") else [p.phase]
        fitting = [word for word in words if 0.62 * TINY * len(word) + 2 < room]
        if fitting:
            named.add(p.phase)
            axes.text((p.start + p.end) / 2, 0.45, fitting[0], ha="center", va="center", fontsize=TINY, color="#333333")
    share = {p.phase: sum(q.end - q.start for q in phases if q.phase == p.phase) / max(span, 1e-9) for p in phases}
    return {phase for phase, part in share.items() if part > 0.015} - named


def phase_patch(name: str) -> Patch:
    """The colour of a phase, for a legend."""
    return Patch(facecolor=PHASE_COLOURS.get(name, "#ececec"), edgecolor="#999999", linewidth=0.4, label=name)


def mark_faults(axes: Axes, faults: Sequence[FaultSpan], numbered: bool = False) -> None:
    """Faults as pale spans behind the data, a line where each begins and, where `numbered`, its number on top.

    The limits of the axis of time are set before: they say which numbers have room beside each other.
    """
    across = axes.get_xaxis_transform()
    for fault in faults:
        bar = [(fault.start, fault.end - fault.start)]
        axes.broken_barh(bar, (0, 1), transform=across, facecolors=FAULT, alpha=0.09, linewidth=0, zorder=0.5)
        axes.axvline(fault.start, color=FAULT, linewidth=0.8, zorder=2.4)
    for start, label in _fault_labels(faults, float(np.ptp(axes.get_xlim()))) if numbered else ():
        axes.annotate(
            label,
            (start, 0.98),
            xycoords=across,
            xytext=(2, 0),
            textcoords="offset points",
            va="top",
            fontsize=TINY,
            color=FAULT,
            fontweight="bold",
            zorder=6,
        )


def _fault_labels(faults: Sequence[FaultSpan], span: float, room: float = 0.06) -> list[tuple[float, str]]:
    """Where to write the numbers, and what: behind the last of those nearer to each other than `room` of the span."""
    groups: list[list[FaultSpan]] = []
    for fault in sorted(faults, key=lambda one: one.start):
        if groups and fault.start - groups[-1][-1].start < room * span:
            groups[-1].append(fault)
        else:
            groups.append([fault])
    return [(group[-1].start, _in_short([fault.number for fault in group])) for group in groups]


def _in_short(numbers: list[int]) -> str:
    """1-4 for 1, 2, 3, 4; with commas where some are missing between."""
    if len(numbers) < 3 or numbers != list(range(numbers[0], numbers[-1] + 1)):
        return ",".join(map(str, numbers))
    return f"{numbers[0]}–{numbers[-1]}"


def fault_patch() -> Patch:
    """A fault, for a legend."""
    return Patch(facecolor="#f4dfe2", edgecolor=FAULT, linewidth=0.8, label="Fault, by number")


def thin(
    t: Float[np.ndarray, " N"], y: Float[np.ndarray, " N"], points: int = 1400
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """A long series with few points that looks the same: the least and the largest value of each bin.

    Args:
        t: Times.
        y: Values; NaN is a gap.
        points: About how many to keep.

    Returns:
        Times and values, in order of time; the series itself when it is short.
    """
    if len(t) <= points:
        return t, y
    size = -(-2 * len(t) // points)
    rows = -(-len(t) // size)
    body = np.full(rows * size, np.nan)
    body[: len(t)] = y
    body = body.reshape(rows, size)
    gap = np.isnan(body)
    picked = np.stack([np.where(gap, np.inf, body).argmin(1), np.where(gap, -np.inf, body).argmax(1)], axis=1)
    index = (np.arange(rows)[:, None] * size + np.sort(picked, axis=1)).ravel()
    return t[index], y[index]


def line(axes: Axes, t: Float[np.ndarray, " N"], y: Float[np.ndarray, " N"], points: int = 1400, **style: Any) -> None:
    """A thinned line."""
    axes.plot(*thin(t, y, points), **({"linewidth": 0.9, "solid_joinstyle": "round"} | style))


def limits(
    *values: Float[np.ndarray, "..."], share: float = 0.998, least: float = 1e-9, symmetric: bool = False
) -> tuple[float, float]:
    """Limits of an axis that show `share` of the finite values and a margin, at least `least` wide on either side."""
    finite = np.concatenate([np.asarray(v, float).ravel() for v in values] or [np.zeros(1)])
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return -least, least
    low, high = np.quantile(finite, [(1 - share) / 2, (1 + share) / 2])
    if symmetric:
        high = max(abs(low), abs(high))
        low = -high
    middle, half = (low + high) / 2, max((high - low) / 2 * 1.12, least)
    return middle - half, middle + half
