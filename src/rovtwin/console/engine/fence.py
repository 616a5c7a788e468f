"""The fence that an operator draws: a polygon in which the vehicle has to stay, in place of the scenario's."""

import numpy as np
from jaxtyping import Float

from rovtwin.console.orders import MOST_CORNERS
from rovtwin.core.numerics import as_array
from rovtwin.gnc.safety.rules import inside
from rovtwin.scenario.schema import Scenario

LEAST_AREA = 1.0  # [m^2]
_EVERYWHERE = 1e7 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])  # [m]

Corners = Float[np.ndarray, "m 2"]
Polygon = list[list[float]]  # corners [north, east] [m]


def with_fence(scenario: Scenario, polygon: Polygon | None) -> Scenario:
    """A scenario with another polygon for its fence."""
    supervisor = scenario.autopilot.supervisor
    fence = supervisor.geofence.model_copy(update={"polygon": polygon})
    autopilot = {"supervisor": supervisor.model_copy(update={"geofence": fence})}
    return scenario.model_copy(update={"autopilot": scenario.autopilot.model_copy(update=autopilot)})


def padded(polygon: Polygon | None) -> Float[np.ndarray, "m 2"]:
    """Corners in the shape that all fences share here, so that another one needs no other program.

    The last corner is repeated, which adds edges without length. None becomes one that reaches beyond everything.
    """
    corners = _EVERYWHERE if polygon is None else np.asarray(polygon, dtype=float)
    return np.concatenate([corners, np.repeat(corners[-1:], max(MOST_CORNERS - len(corners), 0), axis=0)])


def fault_of(polygon: Polygon, here: Float[np.ndarray, "2"]) -> str:
    """Why a polygon is no fence for a vehicle at a place, north and east [m]; empty where it is one."""
    corners = np.asarray(polygon, dtype=float)
    ahead = np.roll(corners, -1, axis=0)
    area = 0.5 * abs(float(np.sum(corners[:, 0] * ahead[:, 1] - ahead[:, 0] * corners[:, 1])))
    if _crosses_itself(corners):
        return "its outline crosses itself: draw it anew"
    if area < LEAST_AREA:
        return f"found an area of {area:.2g} m², expected at least {LEAST_AREA:g}"
    if not inside(as_array(corners), as_array(here)):
        return (
            f"the vehicle is at north {here[0]:.1f} m, east {here[1]:.1f} m, outside of it: draw it around the vehicle"
        )
    return ""


def legs_outside(corners: Corners, places: Float[np.ndarray, "n 2"]) -> list[int]:
    """Numbers of places, from 1 on, to which the straight way from the one before crosses the outline."""
    ahead = np.roll(corners, -1, axis=0)
    return [i for i in range(1, len(places)) if np.any(_crossing(places[i - 1], places[i], corners, ahead))]


def _crosses_itself(corners: Corners) -> bool:
    ahead = np.roll(corners, -1, axis=0)
    return any(np.any(_crossing(corners[i], ahead[i], corners, ahead)) for i in range(len(corners)))


def _crossing(a: np.ndarray, b: np.ndarray, c: Corners, d: Corners) -> np.ndarray:
    """Whether the line from a to b crosses each of those from c to d; ends that touch do not count."""
    return (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)


def _side(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.sign(
        (b[..., 0] - a[..., 0]) * (p[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (p[..., 0] - a[..., 0])
    )
