"""The swath that an eye sweeps, from the poses that the vehicle estimates and the height over the floor."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull, QhullError

from rovtwin.console.swath.cells import Cells
from rovtwin.console.swath.eyes import Eye, Sounder
from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.imaging.footprint import LEVELEST
from rovtwin.runs.mapping.request import COURSE, TURN

STALE = 1.0  # a reading, or a link, that is older says nothing any more [s]
GAP = 3.0  # between two poses, over which no strip is drawn [s]
LEAP, FASTEST = 0.5, 2.0  # an estimate that goes farther [m], at more than that speed [m/s], was put right: no strip
UNJUDGED = "no pose yet"  # why nothing is painted before the first instant is judged
FINEST = 0.02  # of the swath: the vehicle moves on so far before it is painted again, or half a cell


@dataclass(frozen=True)
class Instant:
    """An instant of a flight.

    Attributes:
        t: When [s].
        eta: Estimated pose in n.
        floor: Depth of the floor below [m]; no number where nobody knows.
        why: Why nothing can be seen then, "" where something can.
    """

    t: float
    eta: Float[np.ndarray, "6"]
    floor: float
    why: str = ""


class Depths:
    """How deep the floor below the vehicle is: by its altimeter, without one by the world's floor.

    Attributes:
        names: Of the altimeters.
        source: What says so.
    """

    def __init__(self, sounders: list[Sounder], floor: float | None):
        """`floor` is the world's [m]."""
        self._sounders, self._floor = sounders, floor
        self.names = [one.name for one in sounders]
        self.source = ", ".join(self.names) or ("the world's floor" if floor is not None else "")

    def instant(self, state: dict[str, Any]) -> Instant | None:
        """Of a state as the engine reports it; None where it has no pose."""
        t, eta = float(state["t"]), np.asarray(state.get("eta"), float)
        if eta.shape != (6,) or not np.isfinite(eta).all():
            return None
        if (state.get("link_age") or 0.0) > STALE:
            return Instant(t, eta, np.nan, "nothing comes from the vehicle")
        floor, why = self._below(eta, state.get("sensors", {}))
        return Instant(t, eta, floor, why)

    def _below(self, eta: Float[np.ndarray, "6"], sensors: dict[str, Any]) -> tuple[float, str]:
        if not self._sounders:
            return (np.nan, "the height over the floor is not known") if self._floor is None else (self._floor, "")
        R_nb = rotation_from_euler(eta[3:])
        for one in self._sounders:
            status = sensors.get(one.name) or {}
            value, age = status.get("value"), status.get("age")
            if value is not None and age is not None and age <= STALE and np.isfinite(value[0]):
                return float(eta[2] + (R_nb @ (one.position + float(value[0]) * one.direction))[2]), ""
        return np.nan, f"no height by {' or '.join(self.names)}"


class Painter:
    """Paints cells with what an eye sees; an instant is painted once it is known whether the vehicle turns in it.

    Attributes:
        eye: That sees.
        cells: What it has seen.
        why: Why nothing was painted of the last instant that was judged, "" where something was.
        course: From when on [s] that was so, each time it changed.
        height: Of the vehicle's origin over the floor then [m]; None where it is not known.
        began, ended: First and last instant that was painted [s]; None before.
        floor: Its depth at the last instant that was painted [m]; None before.
    """

    def __init__(self, eye: Eye, cells: Cells | None = None):
        self.eye, self.cells = eye, cells or Cells()
        self.why = UNJUDGED
        self.course = [(0.0, self.why)]
        self.height: float | None = None
        self.began: float | None = None
        self.ended: float | None = None
        self.floor: float | None = None
        self._window: deque[Instant] = deque()  # the instants of a turn's measurement
        self._next = 0  # of them, the first that is not painted yet
        self._edge: tuple[Instant, np.ndarray] | None = None  # the last swath painted: when, and its outline

    def take(self, now: Instant) -> None:
        """One more instant; it is painted when those of half a COURSE after it have come."""
        if self._window and now.t <= self._window[-1].t:
            return
        self._window.append(now)
        self._paint(now.t - 0.5 * COURSE)
        while len(self._window) > 2 and self._window[1].t < now.t - 2.0 * COURSE and self._next > 1:
            self._window.popleft()
            self._next -= 1

    def finish(self) -> None:
        """Paint what is left: no more instants come."""
        self._paint(np.inf)

    def _paint(self, until: float) -> None:
        while self._next < len(self._window) and self._window[self._next].t <= until:
            now = self._window[self._next]
            self._next += 1
            self.why = now.why or ("turning" if abs(self._turn_rate(now.t)) > TURN else "")
            self.height = None if np.isnan(now.floor) else now.floor - float(now.eta[2])
            outline = None if self.why else self._outline(now)
            if outline is None:
                self._edge = None
            else:
                self._sweep(now, outline)
            if self.why != self.course[-1][1]:
                self.course.append((now.t, self.why))

    def _turn_rate(self, t: float) -> float:
        """Of the heading over COURSE about a time, as `mapping.navigation` has it [rad/s]."""
        at = np.array([one.t for one in self._window])
        heading = np.unwrap([float(one.eta[5]) for one in self._window])
        ends = np.clip([t - 0.5 * COURSE, t + 0.5 * COURSE], at[0], at[-1])
        begin, end = np.interp(ends, at, heading)
        return float(end - begin) / max(float(ends[1] - ends[0]), 1e-3)

    def _outline(self, now: Instant) -> Float[np.ndarray, "k 2"] | None:
        """Where the rays meet a level floor, north and east [m], no number where they do not; None: none does."""
        points, seen = footprint(self.eye, now.eta, now.floor)
        if not seen.any():
            below = self.height is not None and self.height <= 0.0
            self.why = "below the floor" if below else f"no ray meets the floor within {self.eye.reach:g} m"
            return None
        return points

    def _sweep(self, now: Instant, outline: Float[np.ndarray, "k 2"]) -> None:
        """Paint what lies between this outline and the one before, and, of a picture, within it."""
        before = self._edge if self._edge is not None and self._continues(self._edge[0], now) else None
        self._note(now)
        if before is not None and self._is_still(before[1], outline):
            self._edge = now, before[1]  # as if it still were there, so that a hovering vehicle leaves no gap
            return
        if (hull := _hull(outline if before is None else np.concatenate([before[1], outline]))) is not None:
            self.cells.paint(hull, now.t)
        self._edge = now, outline

    def _continues(self, before: Instant, now: Instant) -> bool:
        """Whether a vehicle can have gone from one instant to the next."""
        time, way = now.t - before.t, float(np.linalg.norm(now.eta[:3] - before.eta[:3]))
        return time <= GAP and way <= LEAP + FASTEST * time

    def _is_still(self, before: Float[np.ndarray, "k 2"], outline: Float[np.ndarray, "k 2"]) -> bool:
        """Whether an outline lies where the one before does, the same rays being seen."""
        seen = np.isfinite(outline[:, 0])
        if (seen != np.isfinite(before[:, 0])).any():
            return False
        size = float(np.hypot(*np.ptp(outline[seen], axis=0)))
        moved = np.linalg.norm(outline[seen] - before[seen], axis=1)
        return float(moved.max()) < max(0.5 * self.cells.cell, FINEST * size)

    def _note(self, now: Instant) -> None:
        self.began, self.ended = now.t if self.began is None else self.began, now.t
        self.floor = now.floor


def footprint(
    eye: Eye, eta: Float[np.ndarray, "6"], floor: float
) -> tuple[Float[np.ndarray, "k 2"], Bool[np.ndarray, " k"]]:
    """Where an eye's rays meet a level floor at a depth [m]: north and east [m], no number of those that do not.

    A ray does not where it is flatter than maps allow for, or longer than the eye's reach.
    """
    R_nb = rotation_from_euler(eta[3:])
    origin, direction = eta[:3] + eye.origin @ R_nb.T, eye.direction @ R_nb.T
    with np.errstate(divide="ignore", invalid="ignore"):
        way = (floor - origin[:, 2]) / direction[:, 2]
    seen = (direction[:, 2] >= LEVELEST) & (way > 0.0) & (way <= eye.reach)
    points = origin[:, :2] + way[:, None] * direction[:, :2]
    return np.where(seen[:, None], points, np.nan), seen


def swath_of(eye: Eye, height: float) -> tuple[float, Float[np.ndarray, "2"]] | None:
    """Width that is seen across by a level vehicle so high over the floor, and its middle ahead and to the right [m].

    Of a picture it is that across its middle. None where nothing is seen.
    """
    points, seen = footprint(eye, np.zeros(6), height)
    if not seen.any():
        return None
    points = points[seen]
    ahead = 0.5 * float(points[:, 0].min() + points[:, 0].max())
    right = points[:, 1]
    if (hull := _hull(points)) is not None:
        crossed = [_crossing(a, b, ahead) for a, b in zip(hull, np.roll(hull, -1, axis=0), strict=True)]
        right = np.array([y for y in crossed if y is not None])
    return float(np.ptp(right)), np.array([ahead, 0.5 * (right.min() + right.max())])


def _crossing(a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"], ahead: float) -> float | None:
    """To the right, where an edge crosses the line that is so far ahead [m]; None where it does not."""
    if (a[0] - ahead) * (b[0] - ahead) > 0.0 or a[0] == b[0]:
        return None
    return float(a[1] + (ahead - a[0]) / (b[0] - a[0]) * (b[1] - a[1]))


def _hull(points: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "m 2"] | None:
    """Corners of the convex hull, counter-clockwise; None where it has no area."""
    points = points[np.isfinite(points[:, 0])]
    if len(points) < 3:
        return None
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:  # all on one line
        return None
