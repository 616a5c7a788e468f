"""The report of a tuning: what the search tried, what became of the parameters, and the verdict of held-out plants."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rovtwin.report.parts.page import save, write_page
from rovtwin.report.parts.style import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    SERIES,
    SMALL,
    TINY,
    dress,
    legend_above,
    new_figure,
    note,
)
from rovtwin.report.parts.tables import Table
from rovtwin.report.parts.verdict import Verdict

DEAR = 2.0  # the axis of costs ends where a flight costs twice what the hand-tuned one does


@dataclass(frozen=True)
class Moved:
    """A parameter: name, unit, bounds of its search, before and after, and what putting it back alone would cost."""

    name: str
    unit: str
    low: float
    high: float
    before: float
    after: float
    influence: float


@dataclass(frozen=True, eq=False)
class TuningResult:
    """What the report shows.

    Attributes:
        title, verdict: For people; whether the tuned autopilot is better, in plain sentences.
        costs, generations: Of all that was tried.
        start_cost: Of the hand-tuned values on the same plants.
        parameters: What was searched.
        seas: Of the held-out flights.
        before, after: Their costs.
        change: Mean of the paired differences and its 95 % interval.
        terms: By name: unit, weight, means before and after, relative change and its 95 % interval.
        extra: Rows beside them that the cost does not see: name, before, after.
        cost_rows, provenance: Name and value.
        autopilot: The file.
    """

    title: str
    verdict: Verdict
    costs: Float[np.ndarray, " n"]
    generations: Float[np.ndarray, " n"]
    start_cost: float
    parameters: Sequence[Moved]
    seas: Sequence[str]
    before: Float[np.ndarray, " m"]
    after: Float[np.ndarray, " m"]
    change: tuple[float, float, float]
    terms: Mapping[str, Mapping[str, Any]]
    extra: Sequence[tuple[str, str, str]]
    cost_rows: Sequence[tuple[str, str]]
    provenance: Sequence[tuple[str, str]]
    autopilot: str


def write_tuning_report(result: TuningResult, folder: Path) -> Path:
    """Write `report.html` and its figures; a report that is there is replaced."""
    pictures = [
        save(
            draw_held_out(result),
            folder,
            "held_out",
            "Held-out plants",
            "Left: each dot is a plant with its sea and noise, flown by both autopilots; the bar is the mean of the "
            "paired differences with its 95 % interval, below zero the tuned one is better. Right: the same of each "
            "term of the cost, as a share of the hand-tuned mean.",
        ),
        save(
            draw_parameters(result),
            folder,
            "parameters",
            "Parameters",
            "From the hand-tuned value (ring) to the tuned one (dot) between the bounds of the search. Bars: what the "
            "tuned autopilot's cost would rise by if this parameter alone were put back.",
        ),
        save(
            draw_search(result),
            folder,
            "search",
            "The search",
            "Cost of every autopilot that was tried, on the search's own plants; the line is the cheapest so far.",
        ),
    ]
    return write_page(
        folder / "report.html",
        "tuning.html.j2",
        title=result.title,
        verdict=result.verdict,
        terms=_terms(result),
        parameters=_parameters(result),
        pictures=pictures,
        cost=Table("", ["", ""], [list(row) for row in result.cost_rows]),
        provenance=Table("", ["", ""], [list(row) for row in result.provenance]),
        autopilot=result.autopilot,
    )


def _terms(result: TuningResult) -> Table:
    rows = [
        [
            f"{one['description']} [{one['unit']}]",
            f"{100 * one['weight']:.0f} %",
            f"{one['before']:.3g}",
            f"{one['after']:.3g}",
            "{:+.1f} % ({:+.1f} to {:+.1f})".format(*(100 * x for x in one["change"])),
        ]
        for one in result.terms.values()
    ]
    rows += [[name, "–", before, after, ""] for name, before, after in result.extra]
    head = ["Held-out flights", "Weight", "Hand-tuned", "Tuned", "Change of the mean (95 % interval)"]
    return Table("", head, rows)


def _parameters(result: TuningResult) -> Table:
    rows = [
        [f"{p.name} [{p.unit}]", f"{p.before:.3g}", f"{p.after:.3g}", f"{p.low:g} to {p.high:g}", f"{p.influence:+.3f}"]
        for p in result.parameters
    ]
    return Table("", ["Parameter", "Hand-tuned", "Tuned", "Searched", "Cost of putting it back"], rows)


def draw_search(result: TuningResult) -> Figure:
    """Cost over evaluations."""
    figure = new_figure(2.4)
    axes = dress(figure.subplots(), "cost", "autopilots tried")
    k = np.arange(1, len(result.costs) + 1)
    axes.plot(k, np.minimum(result.costs, DEAR), ".", color=BLUE, ms=4, alpha=0.6)
    axes.plot(k, np.minimum(np.minimum.accumulate(result.costs), DEAR), color=BLUE, drawstyle="steps-post", lw=1.3)
    axes.axhline(result.start_cost, color=BLACK, lw=0.9, ls="--")
    dear = int(np.sum(result.costs > DEAR))
    note(axes, f"{len(result.costs)} tried, {dear} dearer than {DEAR:g}" if dear else f"{len(result.costs)} tried")
    handles = [
        Line2D([], [], color=BLUE, marker=".", ls="", label="one autopilot, mean over plants"),
        Line2D([], [], color=BLUE, label="cheapest so far"),
        Line2D([], [], color=BLACK, ls="--", label="hand-tuned"),
    ]
    legend_above(figure, handles)
    return figure


def draw_parameters(result: TuningResult) -> Figure:
    """Old and new values between their bounds, and what each is worth."""
    shown = sorted(result.parameters, key=lambda p: p.influence)
    figure = new_figure(0.7 + 0.34 * len(shown))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(2, 1))
    for axes in (left, right):
        dress(axes)
        axes.set_yticks(range(len(shown)), [p.name for p in shown])
    for i, p in enumerate(shown):
        place = [np.log(x / p.low) / np.log(p.high / p.low) for x in (p.before, p.after)]
        left.plot([0, 1], [i, i], color=GREY, lw=0.6, zorder=1)
        left.annotate("", (place[1], i), (place[0], i), arrowprops={"arrowstyle": "-", "color": BLUE, "lw": 1.4})
        left.plot(place[0], i, "o", ms=6, mfc="white", mec=BLACK, mew=0.9)
        left.plot(place[1], i, "o", ms=5, color=BLUE)
        # One below, one above: what hardly moved stays readable.
        for x, value, away in zip(place, (p.before, p.after), (-11, 5), strict=True):
            left.annotate(f"{value:.3g}", (x, i), (0, away), textcoords="offset points", ha="center", fontsize=TINY)
    left.set(xlim=(-0.05, 1.05), xticks=[0, 0.5, 1], ylim=(-0.6, len(shown) - 0.3))
    left.set_xticklabels(["lower bound", "(logarithmic)", "upper bound"], fontsize=SMALL)
    right.barh(range(len(shown)), [p.influence for p in shown], color=BLUE, height=0.5)
    right.axvline(0, color=BLACK, lw=0.7)
    right.set_xlabel("cost of putting it back", fontsize=SMALL)
    right.tick_params(labelleft=False)
    handles = [
        Line2D([], [], marker="o", ls="", mfc="white", mec=BLACK, label="hand-tuned"),
        Line2D([], [], marker="o", ls="", color=BLUE, label="tuned"),
    ]
    legend_above(figure, handles)
    return figure


def draw_held_out(result: TuningResult) -> Figure:
    """Paired differences, and those of each term."""
    figure = new_figure(2.9)
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1))
    seas = list(dict.fromkeys(result.seas))
    difference = result.after - result.before
    dress(left, "cost, tuned less hand-tuned")
    for k, sea in enumerate(seas):
        here = np.array([name == sea for name in result.seas])
        left.plot(np.flatnonzero(here) + 1, difference[here], "o", ms=4, color=SERIES[k % len(SERIES)], label=sea)
    mean, low, high = result.change
    at = len(difference) + 2
    left.errorbar(at, mean, [[mean - low], [high - mean]], color=BLACK, marker="s", ms=5, capsize=4, lw=1.3)
    left.axhline(0, color=BLACK, lw=0.7)
    left.set_xticks([1, len(difference), at], ["plant 1", str(len(difference)), "mean,\n95 %"], fontsize=SMALL)
    note(left, f"mean {mean:+.3f} ({low:+.3f} to {high:+.3f})")
    left.legend(fontsize=TINY, frameon=False)
    _terms_panel(right, result)
    return figure


def _terms_panel(axes: Axes, result: TuningResult) -> None:
    names = list(result.terms)[::-1]
    dress(axes, "", "change [% of the hand-tuned mean]")
    for i, name in enumerate(names):
        mean, low, high = (100 * x for x in result.terms[name]["change"])
        colour = BLUE if high < 0 else ORANGE if low > 0 else GREY
        axes.errorbar(mean, i, xerr=[[mean - low], [high - mean]], color=colour, marker="s", ms=5, capsize=4, lw=1.3)
    axes.axvline(0, color=BLACK, lw=0.7)
    axes.set_yticks(range(len(names)), names, fontsize=SMALL)
    axes.set_ylim(-0.6, len(names) - 0.4)
