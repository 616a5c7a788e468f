"""In which order cells and laps are flown, and how each of them.

Each task can be flown in several forms: a cell from either side, beginning at either end; a lap from any of its
corners. Whatever the order, the best forms follow by dynamic programming along it; the order itself starts from the
nearest neighbour and is mended by moving tasks and turning round stretches (2-opt, or-opt) while that helps.

Reference: Lin and Kernighan (1973), An effective heuristic for the traveling-salesman problem, Oper. Res. 21(2).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.survey.lines import Line
from rovtwin.survey.pace import Pace
from rovtwin.survey.room import Room
from rovtwin.survey.ways import Ways

ROUNDS = 20  # of mending
SAME = 1e-3  # points nearer than this are one [m]
STRAIGHT = 1e-4  # less is no bend [rad]


@dataclass(frozen=True, eq=False)
class Path:
    """A way of straight legs.

    Attributes:
        points: In n [m].
        sees: Whether each leg is one that the survey counts on.
    """

    points: Float[np.ndarray, "n 2"]
    sees: Bool[np.ndarray, " legs"]

    @classmethod
    def joined(cls, paths: Sequence["Path"], ways: "Network") -> "Path":
        """Paths one after the other, with the shortest ways between them."""
        points, sees = [paths[0].points], [paths[0].sees]
        for before, after in zip(paths[:-1], paths[1:], strict=True):
            way = ways.way(before.points[-1], after.points[0])
            points += [way[1:-1], after.points]
            sees += [np.zeros(len(way) - 1, dtype=bool), after.sees]
        return cls(np.concatenate(points), np.concatenate(sees)).simple()

    @property
    def corners(self) -> Float[np.ndarray, "k 2"]:
        """Where the way bends, and its ends: the way-points [m]. On a straight the vehicle flies on."""
        course = _course(self.points)
        bends = np.linalg.norm(np.diff(course, axis=0), axis=1) > STRAIGHT
        return self.points[np.r_[True, bends, True]]

    def simple(self) -> "Path":
        """Without points that lie on each other, and those on straight stretches of one kind."""
        keep = np.r_[True, np.linalg.norm(np.diff(self.points, axis=0), axis=1) > SAME]
        points, sees = self.points[keep], self.sees[keep[1:]]
        course = _course(points)
        bends = (np.linalg.norm(np.diff(course, axis=0), axis=1) > STRAIGHT) | (sees[1:] != sees[:-1])
        return Path(points[np.r_[True, bends, True]], sees[np.r_[True, bends]])


def _course(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "legs 2"]:
    legs = np.diff(points, axis=0)
    return legs / np.linalg.norm(legs, axis=1, keepdims=True)


class Network:
    """Ways within the free region, or, where there is none, through its surroundings."""

    def __init__(self, room: Room) -> None:
        """Lay the graphs."""
        self._near = Ways(room.free)
        self._wide = self._near if room.wider is room.free else Ways(room.wider)

    def lengths(self, a: Float[np.ndarray, "m 2"], b: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m n"]:
        """Lengths of the shortest ways from points a to points b [m]."""
        near = self._near.lengths(a, b)
        return near if np.isfinite(near).all() else np.where(np.isfinite(near), near, self._wide.lengths(a, b))

    def way(self, a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 2"]:
        """Corners of the shortest way, both ends included."""
        way = self._near.way(a, b)
        way = self._wide.way(a, b) if way is None else way
        assert way is not None  # rooms have no part that cannot be reached
        return way


def cell_forms(cell: Sequence[Line], lead_in: float, lead_out: float, ways: Network) -> list[Path]:
    """The ways to mow a cell: from either side, beginning at either end."""
    orders = [cell] if len(cell) == 1 else [cell, cell[::-1]]
    leads = np.array([False, True, False])
    return [
        Path.joined([Path(l.flown((i % 2 == 1) != flip, lead_in, lead_out), leads) for i, l in enumerate(order)], ways)
        for order in orders
        for flip in (False, True)
    ]


def lap_forms(ring: Float[np.ndarray, "n 2"]) -> list[Path]:
    """The ways to fly a closed ring (n, 2): from each corner."""
    corners = ring[:-1]
    rings = [np.concatenate([np.roll(corners, -i, axis=0), corners[i : i + 1]]) for i in range(len(corners))]
    return [Path(points, np.ones(len(points) - 1, dtype=bool)) for points in rings]


def route(tasks: Sequence[Sequence[Path]], pace: Pace, ways: Network, limit: float = np.inf) -> Path | None:
    """All tasks, each in one of its forms, in a short order; None where that cannot take less time than a limit [s]."""
    cost = [np.array([sum(map(np.sum, pace.times(form.corners))) for form in forms]) for forms in tasks]
    first = [np.array([form.points[0] for form in forms]) for forms in tasks]
    last = [np.array([form.points[-1] for form in forms]) for forms in tasks]
    whole = pace.leg(ways.lengths(np.concatenate(last), np.concatenate(first)))
    cuts = np.cumsum([len(forms) for forms in tasks])[:-1]
    links = [np.split(rows, cuts, axis=1) for rows in np.split(whole, cuts, axis=0)]
    # Each task but the last is left by a link, at best by its shortest.
    away = np.array([[block.min() for block in row] for row in links]) + np.diag(np.full(len(tasks), np.inf))
    shortest = np.sort(away.min(axis=1))[:-1] if len(tasks) > 1 else np.zeros(0)
    if sum(each.min() for each in cost) + shortest.sum() >= limit:
        return None

    def time(order: Sequence[int]) -> float:
        return _best_forms(order, cost, links)[0]

    order = _mended(min((_nearest(start, away) for start in range(len(tasks))), key=time), time)
    chosen = _best_forms(order, cost, links)[1]
    return Path.joined([tasks[task][form] for task, form in zip(order, chosen, strict=True)], ways)


def _best_forms(order: Sequence[int], cost: list[np.ndarray], links: list[list[np.ndarray]]) -> tuple[float, list[int]]:
    """Shortest time over the forms of tasks in an order [s], and the form of each."""
    totals = [cost[order[0]]]
    for before, after in zip(order[:-1], order[1:], strict=True):
        totals.append((totals[-1][:, None] + links[before][after]).min(axis=0) + cost[after])
    forms = [int(totals[-1].argmin())]
    for i in range(len(order) - 2, -1, -1):
        forms.append(int((totals[i] + links[order[i]][order[i + 1]][:, forms[-1]]).argmin()))
    return float(totals[-1].min()), forms[::-1]


def _nearest(start: int, away: Float[np.ndarray, "n n"]) -> list[int]:
    """Always on to the task that is nearest; `away` (n, n) between tasks."""
    order, left = [start], set(range(len(away))) - {start}
    while left:
        order.append(min(left, key=lambda task: away[order[-1], task]))
        left.remove(order[-1])
    return order


def _mended(order: list[int], time: Callable[[Sequence[int]], float]) -> list[int]:
    """Stretches turned round and tasks moved as long as that saves time."""
    best, better = time(order), True
    for _ in range(ROUNDS):
        if not better:
            break
        better = False
        for i in range(len(order)):
            for j in range(i + 1, len(order) + 1):
                for trial in _changed(order, i, j):
                    found = time(trial)
                    if found < best - 1e-9:
                        best, order, better = found, trial, True
    return order


def _changed(order: list[int], i: int, j: int) -> list[list[int]]:
    """The stretch i to j turned round; the task at i moved to j."""
    moved = order[:i] + order[i + 1 :]
    moved.insert(j - 1, order[i])
    return [order[:i] + order[i:j][::-1] + order[j:], moved]
