"""Figure of the path over ground: north up, east to the right."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from rovtwin.core.log import Series
from rovtwin.report.flight import Flight
from rovtwin.report.parts.style import (
    BLACK,
    ESTIMATE,
    GREEN,
    GREY,
    REFERENCE,
    SKY,
    SMALL,
    TINY,
    TRUTH,
    YELLOW,
    dress,
    new_figure,
)

MISSION: dict[str, Any] = {"color": GREEN, "linewidth": 4.0, "alpha": 0.28, "solid_capstyle": "round", "zorder": 1}
WALL: dict[str, Any] = {"edgecolor": "#7a5c3e", "linewidth": 1.6, "zorder": 1.2}
ANCHOR: dict[str, Any] = {
    "marker": "^", "markersize": 11, "color": YELLOW, "markeredgecolor": BLACK, "linestyle": "none", "zorder": 8
}  # fmt: skip
NUMBERS = 40  # of way-points at most: a survey has hundreds
FIXES: dict[str, Any] = {"color": GREY, "marker": ".", "markersize": 2.4, "linestyle": "none", "alpha": 0.5}


def path(flight: Flight) -> Figure:
    """Mission, truth, estimate, reference and fixes seen from above, with the heading of waves and current."""
    figure = new_figure(height=float(np.clip(5.1 * aspect(flight) + 0.65, 3.2, 7.5)))
    axes, key = figure.subplots(1, 2, width_ratios=[1, 0.3])
    draw_path(axes, flight)
    _key(key, flight)
    return figure


def draw_path(axes: Axes, flight: Flight) -> None:
    """The path in given axes."""
    dress(axes, "North [m]", "East [m]", ticks=8)
    axes.set_aspect("equal", adjustable="box")
    _mission(axes, flight)
    _surroundings(axes, flight)
    if flight.fixes is not None:
        shown = flight.fixes[:: max(1, len(flight.fixes) // 2000)]
        style: dict[str, Any] = {**FIXES, "alpha": float(np.clip(200 / len(shown), 0.2, 0.5))}
        axes.plot(shown[:, 1], shown[:, 0], **style, zorder=1.5, rasterized=True)
    for name, style in _LINES:
        series = flight.get(name)
        if series is not None:
            line = _horizontal(series, _end(flight))
            axes.plot(line[:, 1], line[:, 0], **style)
    main = flight.get("truth/eta") or flight.get("autopilot/eta")
    if main is not None:
        _course(axes, main, flight)
    low, high = extent(flight)
    axes.set(xlim=(low[1], high[1]), ylim=(low[0], high[0]))


_LINES = (("truth/eta", TRUTH), ("autopilot/eta", ESTIMATE), ("autopilot/reference", REFERENCE))


def _end(flight: Flight) -> float:
    """Last time of the line that the square ends [s]: no other goes on beyond it."""
    main = flight.get("truth/eta") or flight.get("autopilot/eta")
    return np.inf if main is None else float(main.t[-1])


def _horizontal(series: Series, end: float, points: int = 3000) -> Float[np.ndarray, "N 2"]:
    """North and east [m] until a time, thinned, the last sample kept."""
    known = series.values[series.t <= end, :2]
    return np.concatenate([known[: -1 : max(1, len(known) // points)], known[-1:]])


def aspect(flight: Flight) -> float:
    """Height of the picture over its width."""
    low, high = extent(flight)
    return float((high - low)[0] / (high - low)[1])


def _legs(flight: Flight) -> list[tuple[float, float, float, float]]:
    """Commanded legs x0, y0, x1, y1 in order: those flown, or, without them, the lines between way-points."""
    leg, mode = flight.get("autopilot/leg"), flight.get("autopilot/mode")
    if leg is not None:
        values = leg.values[:, [0, 1, 3, 4]]
        if mode is not None and "on_leg" in mode.channel.fields:
            on = np.interp(leg.t, mode.t, mode["on_leg"]) > 0.5
            values = values[on] if on.any() else values
        values = values[np.isfinite(values).all(axis=1)]
        # The start may still move in the first moments of a leg: of rows with the same end the last one counts.
        last = np.r_[(np.abs(np.diff(values[:, 2:], axis=0)) > 1e-6).any(axis=1), True] if len(values) else []
        return [(float(a), float(b), float(c), float(d)) for a, b, c, d in values[last]][:500]
    points = [(float(w["x"]), float(w["y"])) for w in flight.waypoints]
    return [(*a, *b) for a, b in zip(points, points[1:], strict=False)]


def _mission(axes: Axes, flight: Flight) -> None:
    for i in range(len(flight.missions)):
        points = np.array([[w["y"], w["x"]] for w in flight.waypoints if w["mission"] == i], float).reshape(-1, 2)
        axes.plot(*points.T, color=GREEN, linewidth=0.8, alpha=0.7, zorder=1)
    for x0, y0, x1, y1 in _legs(flight):
        axes.plot([y0, y1], [x0, x1], **MISSION)
    every = -(-len(flight.waypoints) // NUMBERS)
    for k, point in enumerate(flight.waypoints):
        x, y, radius = float(point["x"]), float(point["y"]), float(point.get("acceptance") or 0.0)
        if radius > 0:
            axes.add_patch(Circle((y, x), radius, fill=False, edgecolor=GREEN, linewidth=0.9, zorder=2))
        if k % every:
            continue
        axes.annotate(
            point["name"], (y, x), _label_side(flight, k), textcoords="offset points", ha="center", va="center",
            fontsize=SMALL, color="#00664b", weight="bold", zorder=8,
        )  # fmt: skip


def _label_side(flight: Flight, k: int) -> tuple[float, float]:
    """Offset of a way-point's number [points]: away from its neighbours, so that it stands clear of the legs."""
    points = np.array([[float(w["y"]), float(w["x"])] for w in flight.waypoints])
    neighbours = [j for j in (k - 1, k + 1) if 0 <= j < len(points)]
    away = np.zeros(2)
    for j in neighbours:
        d = points[k] - points[j]
        away += d / max(float(np.linalg.norm(d)), 1e-9)
    size = float(np.linalg.norm(away))
    away = away / size if size > 0.2 else np.array([0.7, 0.7])
    return float(14 * away[0]), float(14 * away[1])


def _surroundings(axes: Axes, flight: Flight) -> None:
    """Walls of the tank, and where the tethers come from."""
    if flight.tank is not None:
        (south, west), (north, east) = flight.tank
        axes.add_patch(Rectangle((west, south), east - west, north - south, fill=False, **WALL))
    for north, east, _ in flight.anchors.values():
        axes.plot(east, north, **ANCHOR)


def _in_view(flight: Flight, point: Float[np.ndarray, "2"]) -> bool:
    low, high = extent(flight)
    return bool(((low <= point) & (point <= high)).all())


def _course(axes: Axes, series: Series, flight: Flight) -> None:
    """Start, end, arrows along the way, and the time at some of them."""
    xy = series.values[:, [1, 0]]
    good = np.flatnonzero(np.isfinite(xy).all(axis=1))
    if not good.size:
        return
    style: dict[str, Any] = {"markeredgecolor": BLACK, "markersize": 7, "linestyle": "none", "zorder": 9}
    axes.plot(*xy[good[0]], marker="o", markerfacecolor="white", **style)
    axes.plot(*xy[good[-1]], marker="s", markerfacecolor=BLACK, **style)
    xy, t = xy[good], series.t[good]
    low, high = extent(flight)
    room = 0.07 * float((high - low).max())  # [m] between labels, so that none lies on another
    taken = [np.array([float(w["y"]), float(w["x"])]) for w in flight.waypoints] + [xy[0], xy[-1]]
    for i in _halfway(flight, xy, t, room):
        if not any(np.linalg.norm(xy[i] - other) < room for other in taken):
            taken.append(xy[i])
            _arrow(axes, xy, i, f"{t[i]:.0f} s", _off_course(flight, xy[i]))


def _halfway(flight: Flight, xy: Float[np.ndarray, "N 2"], t: Float[np.ndarray, " N"], least: float) -> list[int]:
    """Where half the way of each leg was behind the vehicle; without phases, of eight parts of the whole time."""
    legs = [(p.start, p.end) for p in flight.phases if p.phase == "go"]
    edges = np.linspace(t[0], t[-1], 9)
    marks = []
    for start, end in legs if flight.phases else zip(edges[:-1], edges[1:], strict=True):
        first, last = (int(k) for k in np.searchsorted(t, (start, end)))
        away = np.linalg.norm(xy[first:last] - xy[first], axis=1) if last > first else np.zeros(1)
        if away.max() > least:
            marks.append(first + int(np.argmax(away >= away.max() / 2)))
    return marks[:40]


def _off_course(flight: Flight, point: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    """From the nearest point of the legs to a point (east, north) [m]; zero without legs."""
    legs = np.array(_legs(flight), float).reshape(-1, 4)[:, [1, 0, 3, 2]]
    if not len(legs):
        return np.zeros(2)
    along = legs[:, 2:] - legs[:, :2]
    share = ((point - legs[:, :2]) * along).sum(1) / np.maximum((along**2).sum(1), 1e-12)
    offset = point - legs[:, :2] - np.clip(share, 0, 1)[:, None] * along
    return offset[np.argmin((offset**2).sum(1))]


def _arrow(
    axes: Axes, xy: Float[np.ndarray, "N 2"], i: int, label: str, off: Float[np.ndarray, "2"], reach: float = 0.4
) -> None:
    """An arrow along the course around sample i, and its time on the side that lies away from the leg."""
    near = np.linalg.norm(xy - xy[i], axis=1) > reach
    behind = int(np.flatnonzero(near[:i])[-1]) if near[:i].any() else 0
    ahead = i + int(np.argmax(near[i:])) if near[i:].any() else len(xy) - 1
    course = xy[ahead] - xy[behind]
    if np.hypot(*course) < 0.1:
        return
    course = course / np.hypot(*course)
    axes.annotate(
        "", xy[i] + 0.01 * course, xy[i] - 0.01 * course, zorder=7,
        arrowprops={"arrowstyle": "-|>,head_width=0.36,head_length=0.7", "color": BLACK, "linewidth": 0}
        | {"shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    across = np.array([course[1], -course[0]])
    across = across if across @ off > 0 else -across
    axes.annotate(
        label, xy[i], (18 * float(across[0]), 12 * float(across[1])), textcoords="offset points", ha="center",
        va="center", fontsize=TINY, color="#444444", zorder=8,
        bbox={"facecolor": "white", "alpha": 0.65, "pad": 0.6, "linewidth": 0},
    )  # fmt: skip


def extent(flight: Flight) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Corners (north, east) of what matters, mission and lines, so that an outlying fix does not shrink the picture."""
    end = _end(flight)
    parts = [_horizontal(flight[name], end) for name, _ in _LINES if flight.has(name)]
    points = np.concatenate([*parts, np.array([[w["x"], w["y"]] for w in flight.waypoints], float).reshape(-1, 2)])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        points = np.zeros((1, 2))
    low, high = points.min(axis=0), points.max(axis=0)
    for point in _surrounding_points(flight):
        wider = np.minimum(low, point), np.maximum(high, point)
        if (wider[1] - wider[0]).max() <= 2.5 * max(float((high - low).max()), 1.0):
            low, high = wider
    margin = 0.08 * max(float((high - low).max()), 1.0) + 0.2
    return low - margin, high + margin


def _surrounding_points(flight: Flight) -> list[np.ndarray]:
    """Corners of the tank and anchors (north, east), shown where the path does not become too small for them."""
    corners = [] if flight.tank is None else [np.array(corner) for corner in flight.tank]
    return [*corners, *(anchor[:2] for anchor in flight.anchors.values())]


def _key(axes: Axes, flight: Flight) -> None:
    """Legend, and arrows for waves and current, beside the picture."""
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    handles = legend_entries(flight)
    axes.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(-0.1, 1.0), fontsize=SMALL, frameon=False, borderaxespad=0
    )
    for k, (angle, colour, text) in enumerate(_flows(flight)):
        _heading_arrow(axes, 0.36 - 0.22 * k, angle, colour, text)
    if flight.start_on_map:
        where = "Start " + flight.start_on_map.replace(", ", ",\n")
        axes.text(0.0, -0.02, where, fontsize=TINY, color="#444444", va="top")
    outside = {tuple(np.round(a[:2], 1) + 0.0) for a in flight.anchors.values() if not _in_view(flight, a[:2])}
    for k, (north, east) in enumerate(sorted(outside)):
        axes.text(0.0, 0.06 + 0.05 * k, f"Tether anchor off the map,\nnorth {north:g}, east {east:g} m", fontsize=TINY,
                  color="#444444", va="bottom")  # fmt: skip


def _flows(flight: Flight) -> list[tuple[float, str, str]]:
    """Direction they run to [rad], colour and text of waves and current."""
    flows = []
    if (angle := flight.wave_direction) is not None:
        flows.append((angle, SKY, f"Waves run to\n{np.degrees(angle) % 360:03.0f}°"))
    if flight.current is not None:
        north, east = (float(v) for v in flight.current)
        angle = float(np.arctan2(east, north))
        text = f"Current {np.hypot(north, east):.2f} m/s\nto {np.degrees(angle) % 360:03.0f}°"
        flows.append((angle, "#0b3d91", text))
    return flows


def _heading_arrow(axes: Axes, height: float, angle: float, colour: str, text: str) -> None:
    axes.quiver(
        0.1, height, np.sin(angle), np.cos(angle), color=colour, pivot="middle", angles="uv", units="inches",
        scale_units="inches", scale=2.4, width=0.035, headwidth=4.5, headlength=5, headaxislength=4.5, clip_on=False,
    )  # fmt: skip
    axes.text(0.34, height, text, fontsize=SMALL, va="center", color="#222222")


def legend_entries(flight: Flight) -> list[Any]:
    """Handles for what the picture of this flight shows."""
    entries: list[Any] = []
    if flight.waypoints or flight.has("autopilot/leg"):
        entries.append(Line2D([], [], **MISSION, label="Mission legs"))
    if any(w.get("acceptance") for w in flight.waypoints):
        entries.append(
            Line2D([], [], marker="o", markersize=8, markerfacecolor="none", markeredgecolor=GREEN, linestyle="none",
                   label="Acceptance")
        )  # fmt: skip
    labels = {"truth/eta": "Truth", "autopilot/eta": "Estimate", "autopilot/reference": "Reference"}
    entries += [Line2D([], [], **style, label=labels[name]) for name, style in _LINES if flight.has(name)]
    if flight.fixes is not None:
        style: dict[str, Any] = {**FIXES, "markersize": 5}
        entries.append(Line2D([], [], **style, label="Position fixes"))
    if flight.tank is not None:
        entries.append(Line2D([], [], color=WALL["edgecolor"], linewidth=WALL["linewidth"], label="Tank wall"))
    if any(_in_view(flight, anchor[:2]) for anchor in flight.anchors.values()):
        entries.append(Line2D([], [], **ANCHOR, label="Tether anchor"))
    for marker, face, label in (("o", "white", "Start"), ("s", BLACK, "End")):
        entries.append(
            Line2D([], [], marker=marker, markerfacecolor=face, markeredgecolor=BLACK, linestyle="none", label=label)
        )
    return entries
