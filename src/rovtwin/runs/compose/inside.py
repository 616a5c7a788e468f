"""Whether a run fits its tank: the hull between the walls at the start, and way-points that it can reach."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import turn_about_z
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import as_array
from rovtwin.runs.compose.world import relief_of
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

# Axis of n, which end of the tank, in words.
_SIDES = ((0, 0, "southern wall"), (0, 1, "northern wall"), (1, 0, "western wall"), (1, 1, "eastern wall"))


def require_inside(scenario: Scenario, model: Model) -> None:
    """ConfigError where the start or a way-point leaves no room for the hull.

    Args:
        scenario: Uses floor and tank, start and mission.
        model: Uses the corners of the hull.
    """
    corners = np.asarray(model.hull.corners)
    start = np.asarray(scenario.start.position, dtype=float)
    level = corners @ turn_about_z(scenario.heading).T
    for where, room in _beyond(scenario, start + level):
        raise ConfigError(
            f"start.position: found {_in_words(start)}, where the hull reaches {room:.2g} m beyond the {where}. "
            "Start further inside, or give it a larger tank"
        )
    for i, what in unreachable(scenario, model):
        raise ConfigError(f"mission.waypoints[{i}]: {what}")


def unreachable(scenario: Scenario, model: Model) -> Iterator[tuple[int, str]]:
    """Way-points that leave no room for the hull: number from 0, and the reason; arguments as above."""
    corners = np.asarray(model.hull.corners)
    # The heading at a way-point is guidance's business: the narrowest side of the hull must fit.
    half = 0.5 * np.ptp(corners, axis=0)
    narrow = np.array([min(half[:2]), min(half[:2]), 0.0])
    bottom = np.array([0.0, 0.0, corners[:, 2].max()])
    for i, waypoint in enumerate(scenario.waypoints):
        place = np.asarray(waypoint.placed(scenario.origin), dtype=float)
        for where, room in _beyond(scenario, np.stack([place - narrow, place + narrow, place + bottom]))[:1]:
            if room > waypoint.acceptance:
                what = (
                    f"found {_in_words(place)}, where the hull would reach {room:.2g} m beyond the {where}, more than"
                )
                yield i, f"{what} the acceptance radius of {waypoint.acceptance:g} m: it can never be reached"


def _beyond(scenario: Scenario, points: Float[np.ndarray, "m 3"]) -> list[tuple[str, float]]:
    """Which floor and walls some points (m, 3) are beyond, and how far [m], the farthest first."""
    world, found = scenario.world, []
    if world.floor is not None:
        lowest = points[np.argmax(points[:, 2])]
        relief = relief_of(world)
        floor = world.floor if relief is None else float(relief.under(as_array(lowest[:2]))[0])
        found.append((f"floor at {floor:.4g} m", float(lowest[2]) - floor))
    if world.tank is not None:
        spans = (world.tank.north, world.tank.east)
        for axis, end, name in _SIDES:
            sign, at = (-1.0, 1.0)[end], spans[axis][end]
            found.append((f"{name} at {at:g} m", float((sign * (points[:, axis] - at)).max())))
    return sorted((entry for entry in found if entry[1] > 1e-9), key=lambda entry: -entry[1])


def _in_words(place: Float[np.ndarray, "3"]) -> str:
    return "[" + ", ".join(f"{x:g}" for x in place) + "] m"
