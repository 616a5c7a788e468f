"""Picture of a planned survey: north up, east to the right."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from rovtwin.report.parts.style import BLACK, BLUE, GREY, SKY, SMALL, dress, name_panel, new_figure

SEEN: dict[str, Any] = {"facecolor": SKY, "alpha": 0.35, "linewidth": 0, "zorder": 1}
GAP: dict[str, Any] = {"facecolor": "#D55E00", "edgecolor": "#D55E00", "linewidth": 0.6, "zorder": 2}
HOLE: dict[str, Any] = {"facecolor": "#d9d3cb", "edgecolor": "#7a5c3e", "hatch": "////", "linewidth": 1.2, "zorder": 3}
EDGE: dict[str, Any] = {"facecolor": "none", "edgecolor": BLACK, "linewidth": 1.4, "zorder": 4}
AROUND: dict[str, Any] = EDGE | {"linestyle": "--", "linewidth": 1.0}
LINE: dict[str, Any] = {"color": BLUE, "linewidth": 1.0, "zorder": 6}
BETWEEN: dict[str, Any] = {"color": GREY, "linewidth": 0.8, "zorder": 5}
SMALLEST_GAP = 1e-3  # of the area: less cannot be seen in the picture, and comes of rounding
ARROWS = 40  # at most


@dataclass(frozen=True, eq=False)
class SurveyPicture:
    """What the picture shows. Regions are shapely's in the plane of n: x north, y east [m].

    Attributes:
        title: For people.
        area: To be surveyed, with holes.
        seen: Within the swath.
        gaps: Not seen.
        points: The way [m].
        sees: Whether each leg is a line or a lap rather than a lead or a way between.
        around: The whole area where only gaps in it are to be surveyed; None: the area itself.
    """

    title: str
    area: Any
    seen: Any
    gaps: Any
    points: Float[np.ndarray, "n 2"]
    sees: Bool[np.ndarray, " legs"]
    around: Any = None


def draw_survey(survey: SurveyPicture) -> Figure:
    """Area, holes, what the swath covers, gaps, lines, ways between, start and end."""
    low, high = _extent(survey)
    tall = float((high - low)[0] / (high - low)[1])
    figure = new_figure(height=float(np.clip(6.9 * tall + 1.0, 3.6, 9.5)))
    axes = figure.subplots()
    dress(axes, "North [m]", "East [m]", ticks=8)
    axes.set_aspect("equal", adjustable="box")
    _regions(axes, survey)
    _way(axes, survey)
    axes.set(xlim=(low[1], high[1]), ylim=(low[0], high[0]))
    name_panel(axes, survey.title)
    figure.legend(handles=_entries(survey), loc="outside lower center", ncols=4, fontsize=SMALL, frameon=False)
    return figure


def _extent(survey: SurveyPicture) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    bounds = np.array((survey.around or survey.area).bounds).reshape(2, 2)
    low, high = np.minimum(bounds[0], survey.points.min(0)), np.maximum(bounds[1], survey.points.max(0))
    margin = 0.03 * float((high - low).max())
    return low - margin, high + margin


def _regions(axes: Axes, survey: SurveyPicture) -> None:
    _fill(axes, survey.seen, SEEN)
    if _has_gaps(survey):
        _fill(axes, survey.gaps, GAP)
    for part in (survey.around or survey.area).geoms:
        for ring in part.interiors:
            axes.add_patch(PathPatch(Outline(_east_north(ring.coords)), **HOLE))
    if survey.around is not None:
        _fill(axes, survey.around, AROUND)
    _fill(axes, survey.area, EDGE)


def _has_gaps(survey: SurveyPicture) -> bool:
    return survey.gaps.area > SMALLEST_GAP * survey.area.area


def _fill(axes: Axes, region: Any, style: dict[str, Any]) -> None:
    """A polygon, a multi-polygon or a collection with them."""
    for part in getattr(region, "geoms", [region]):
        if part.geom_type == "Polygon" and not part.is_empty:
            rings = [Outline(_east_north(ring.coords), closed=True) for ring in (part.exterior, *part.interiors)]
            axes.add_patch(PathPatch(Outline.make_compound_path(*rings), **style))


def _east_north(coords: Any) -> Float[np.ndarray, "n 2"]:
    return np.asarray(coords)[:, [1, 0]]


def _way(axes: Axes, survey: SurveyPicture) -> None:
    points, sees = survey.points[:, ::-1], survey.sees
    for style, which in ((BETWEEN, ~sees), (LINE, sees)):
        legs = np.full((int(which.sum()), 3, 2), np.nan)  # NaN lifts the pen
        legs[:, 0], legs[:, 1] = points[:-1][which], points[1:][which]
        axes.plot(*legs.reshape(-1, 2).T, **style)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    lines = np.flatnonzero(sees & (length > 0.05 * length.max()))
    for i in lines[:: max(1, -(-len(lines) // ARROWS))]:
        middle, along = 0.5 * (points[i] + points[i + 1]), (points[i + 1] - points[i]) / length[i]
        arrow = {"arrowstyle": "-|>,head_width=0.22,head_length=0.5", "color": BLUE, "linewidth": 0}
        axes.annotate("", middle + 0.01 * along, middle - 0.01 * along, zorder=7,
                      arrowprops=arrow | {"shrinkA": 0, "shrinkB": 0})  # fmt: skip
    for point, (marker, face, _) in zip((points[0], points[-1]), _ENDS, strict=True):
        axes.plot(*point, marker=marker, markerfacecolor=face, markeredgecolor=BLACK, markersize=8, zorder=9)


_ENDS = (("o", "white", "Start"), ("s", BLACK, "End"))


def _entries(survey: SurveyPicture) -> list[Any]:
    entries: list[Any] = [
        Patch(label="Area" if survey.around is None else "Gap", facecolor="none", edgecolor=BLACK, linewidth=1.4),
        Line2D([], [], **LINE, label="Line or lap"),
        Line2D([], [], **BETWEEN, label="Lead, turn, way between"),
        Patch(label="Seen", facecolor=SKY, alpha=0.35),
    ]
    if survey.around is not None:
        entries.append(Patch(label="Area", facecolor="none", edgecolor=BLACK, linewidth=1.0, linestyle="--"))
    if any(part.interiors for part in (survey.around or survey.area).geoms):
        entries.append(Patch(label="Hole", facecolor=HOLE["facecolor"], edgecolor=HOLE["edgecolor"], hatch="////"))
    if _has_gaps(survey):
        entries.append(Patch(label="Not seen", facecolor=GAP["facecolor"]))
    for marker, face, label in _ENDS:
        entries.append(
            Line2D([], [], marker=marker, markerfacecolor=face, markeredgecolor=BLACK, linestyle="none", label=label)
        )
    return entries
