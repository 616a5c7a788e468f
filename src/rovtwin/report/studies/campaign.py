"""The report of a campaign: failures first, distributions of the scores, what they go with, cost."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Real
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from rovtwin.report.parts.page import save, write_page
from rovtwin.report.parts.style import (
    BLUE,
    ORANGE,
    SMALL,
    TINY,
    dress,
    legend_above,
    new_figure,
    note,
)
from rovtwin.report.parts.tables import Table
from rovtwin.report.parts.verdict import Verdict

# Column: name, unit, factor from SI
NAMES: dict[str, tuple[str, str, float]] = {
    "duration_s": ("Duration", "s", 1),
    "cross_track_rms_m": ("Cross-track error, rms", "m", 1),
    "cross_track_max_m": ("Cross-track error, largest", "m", 1),
    "station_rms_m": ("Distance to the station, rms", "m", 1),
    "station_max_m": ("Distance to the station, largest", "m", 1),
    "depth_rms_m": ("Depth error, rms", "m", 1),
    "position_error_rms_m": ("Position error per axis, rms", "m", 1),
    "nees_position_mean": ("NEES of position", "", 1),
    "effort_n2s": ("Effort", "N² s", 1),
    "energy_wh": ("Energy", "Wh", 1),
    "saturated_share": ("Time saturated", "%", 100),
    "thruster_activity_n_per_s": ("Thruster activity", "N/s", 1),
}
SHOWN_FAILURES, SHOWN_VARIED, SHOWN_NAME = 200, 12, 30
ACROSS = 4  # panels beside each other


@dataclass(frozen=True, eq=False)
class CampaignResult:
    """What the report shows.

    Attributes:
        title, description: For people.
        samples: How many the campaign has.
        completed: Of each sample that was flown.
        interval: 95 % interval of the share completed.
        scores: Columns by name, NaN where a flight has none; those of `NAMES` are shown.
        varied: Numbers that were drawn, by path.
        scatter: Names of the scores that are plotted against what varies.
        rank: Rank correlation of a path and a score, None where there is none.
        failures: Rows of what did not complete: index, reason, and what was drawn.
        replay: Command that flies a sample again, by its index.
        drawn: What varies and how, in words, by path.
        cost: Lines about time and processors, name and value.
        provenance: Name and value.
        campaign: The complete file.
    """

    title: str
    description: str
    samples: int
    completed: Bool[np.ndarray, " n"]
    interval: tuple[float, float]
    scores: Mapping[str, Float[np.ndarray, " n"]]
    varied: Mapping[str, Real[np.ndarray, " n"]]
    scatter: Sequence[str]
    rank: Callable[[str, str], float | None]
    failures: Sequence[Mapping[str, Any]]
    replay: Callable[[int], str]
    drawn: Mapping[str, str]
    cost: Sequence[tuple[str, str]]
    provenance: Sequence[tuple[str, str]]
    campaign: str
    shown: list[str] = field(init=False)

    def __post_init__(self):
        found = [name for name in NAMES if name in self.scores and np.isfinite(self.scores[name]).any()]
        object.__setattr__(self, "shown", found)


def write_campaign_report(result: CampaignResult, folder: Path) -> Path:
    """Write `report.html` and its figures; a report that is there is replaced."""
    pictures = []
    if result.shown:
        sentences = (
            "Bars count missions; the line is the share of the missions with at most that score; dashed the median, "
            "dotted 5 and 95 %. Missions that did not complete are in orange: their scores are of the part they flew."
        )
        pictures.append(save(draw_scores(result), folder, "scores", "Distribution of the scores", sentences))
    if result.varied and any(name in result.shown for name in result.scatter):
        sentences = (
            "Each dot is a mission, orange if it did not complete. Above each panel Spearman's rank correlation: "
            "+1 or -1 if the score only rises or falls with the value, about 0 (within ±2/√n by chance) if it does not "
            "depend on it."
        )
        pictures.append(save(draw_scatter(result), folder, "scatter", "Scores against what varied", sentences))
    return write_page(
        folder / "report.html",
        "campaign.html.j2",
        title=result.title,
        description=result.description,
        verdict=_verdict(result),
        failures=_failure_table(result),
        scores=_score_table(result),
        drawn=Table("", ["Path", "Drawn from"], [[path, how] for path, how in result.drawn.items()]),
        pictures=pictures,
        cost=Table("", ["", ""], [list(row) for row in result.cost]),
        provenance=Table("", ["", ""], [list(row) for row in result.provenance]),
        campaign=result.campaign,
    )


def _verdict(result: CampaignResult) -> Verdict:
    flown, completed = len(result.completed), int(result.completed.sum())
    if not flown:
        return Verdict(None, f"None of {result.samples} samples is flown", [], [])
    low, high = result.interval
    sentences = [
        f"Completed: {100 * completed / flown:.1f} %, 95 % interval {100 * low:.1f} to {100 * high:.1f} % "
        "(Clopper-Pearson)."
    ]
    if flown < result.samples:
        sentences.append(f"{result.samples - flown} samples are left to fly; run the same command again.")
    return Verdict(completed == flown, f"{completed} of {flown} missions completed", sentences, [])


def _failure_table(result: CampaignResult) -> Table | None:
    if not result.failures:
        return None
    paths = list(result.drawn)
    rows = [
        [str(row["index"]), str(row["reason"]), result.replay(row["index"]), *(_number(row[path]) for path in paths)]
        for row in result.failures[:SHOWN_FAILURES]
    ]
    more = len(result.failures) - len(rows)
    note = f"{more} more are in the table of samples." if more else ""
    return Table("", ["Sample", "Reason", "To fly it again", *paths], rows, note)


def _score_table(result: CampaignResult) -> Table:
    rows = []
    for name in result.shown:
        label, unit, factor = NAMES[name]
        values = factor * _finite(result.scores[name])
        low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
        rows.append(
            [f"{label} [{unit}]" if unit else label, *map(_number, (low, middle, high, values.max())), str(values.size)]
        )
    return Table("", ["Score", "5 %", "Median", "95 %", "Largest", "Missions"], rows)


def draw_scores(result: CampaignResult) -> Figure:
    """Histogram and share below of each score."""
    columns = 3
    rows = -(-len(result.shown) // columns)
    figure = new_figure(0.35 + 1.75 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(grid, result.shown, strict=False):
        _distribution(axes, result, name)
    for axes in grid[len(result.shown) :]:
        axes.set_axis_off()
    legend_above(figure, _outcomes())
    return figure


def _distribution(axes: Axes, result: CampaignResult, name: str) -> None:
    label, unit, factor = NAMES[name]
    values = factor * result.scores[name]
    usable = np.isfinite(values)
    # A mission that got lost must not squeeze all others into one bar: what lies far out counts in the last bar.
    low, high = _range(values[usable])
    edges = np.linspace(low, high, 1 + int(np.clip(2 * np.sqrt(usable.sum()), 6, 30)))
    dress(axes, "", f"{label} [{unit}]" if unit else label, ticks=4)
    axes.xaxis.label.set_fontsize(SMALL)
    groups = [np.clip(values[usable & (result.completed == done)], low, high) for done in (True, False)]
    axes.hist(groups, bins=list(edges), stacked=True, color=[BLUE, ORANGE], alpha=0.75)
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    order = np.sort(values[usable])
    share = axes.twinx()
    share.plot(
        np.r_[low, order, high],
        np.r_[0, np.arange(1, order.size + 1) / order.size, 1],
        color="#333333",
        lw=0.9,
        drawstyle="steps-post",
    )
    share.set(ylim=(0, 1.04), yticks=[0, 0.5, 1], xlim=(low, high))
    share.tick_params(labelsize=TINY, length=2, width=0.5, color="#666666")
    share.spines[["top"]].set_visible(False)
    for value, style in zip(np.quantile(order, (0.05, 0.5, 0.95)), (":", "--", ":"), strict=True):
        share.axvline(float(value), color="#333333", linewidth=0.8, linestyle=style)
    note(
        axes,
        f"median {_number(float(np.median(order)))}"
        + (f", {beyond} beyond" if (beyond := int((order > high).sum())) else ""),
    )


def _range(values: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Ends of an axis [same unit]: all of the values, but for what lies far beyond nearly all of them."""
    low, high = float(values.min()), float(values.max())
    quarter, most = np.quantile(values, (0.25, 0.95))
    far = most + 3.0 * (most - quarter)
    high = float(far) if high > far > low else high
    return (low, high) if high > low else (low - 0.5 * max(abs(low), 1e-3), high + 0.5 * max(abs(high), 1e-3))


def draw_scatter(result: CampaignResult) -> Figure:
    """Each chosen score, a row, against each number that varies, a column; what has no room goes below."""
    scores = [name for name in result.scatter if name in result.shown]
    paths = list(result.varied)[:SHOWN_VARIED]
    blocks = [paths[i : i + ACROSS] for i in range(0, len(paths), ACROSS)]
    figure = new_figure(0.4 + (0.35 + 1.45 * len(scores)) * len(blocks))
    grid = figure.subplots(len(scores) * len(blocks), len(blocks[0]), squeeze=False)
    for axes in grid.ravel():
        axes.set_axis_off()
    for i, block in enumerate(blocks):
        for row, name in zip(grid[i * len(scores) :], scores, strict=False):
            for axes, path in zip(row, block, strict=False):
                axes.set_axis_on()
                _dots(axes, result, path, name, first=path == block[0], last=name == scores[-1])
    legend_above(figure, _outcomes())
    return figure


def _dots(axes: Axes, result: CampaignResult, path: str, name: str, first: bool, last: bool) -> None:
    """One panel; the first of a row names the score, the last of a column the path."""
    label, unit, factor = NAMES[name]
    dress(axes, _in_lines(label, unit), _short(path), ticks=3)
    axes.yaxis.label.set(fontsize=TINY, visible=first)
    axes.xaxis.label.set(fontsize=TINY, visible=last)
    axes.tick_params(labelsize=TINY, labelleft=first, labelbottom=last)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    for done, colour in ((True, BLUE), (False, ORANGE)):
        here = result.completed == done
        axes.plot(result.varied[path][here], factor * result.scores[name][here], ".", color=colour, ms=3.5, mew=0)
    rho = result.rank(path, name)
    note(axes, "" if rho is None else f"rank correlation {rho:+.2f}")
    low, high = _range(factor * _finite(result.scores[name]))
    axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    axes.margins(x=0.05)


def _outcomes() -> list[Patch]:
    """What the colours mean."""
    return [Patch(color=BLUE, alpha=0.75, label="Completed"), Patch(color=ORANGE, alpha=0.75, label="Not completed")]


def _in_lines(label: str, unit: str) -> str:
    text = f"{label} [{unit}]" if unit else label
    return text.replace(", ", ",\n").replace(" per axis", "\nper axis")


def _short(path: str) -> str:
    """The end of a path, as long as there is room for."""
    while len(path) > SHOWN_NAME and "." in path:
        path = path.partition(".")[2]
    return path


def _finite(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    return values[np.isfinite(values)]


def _number(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.3g}"
    return "–" if value is None else str(value)
