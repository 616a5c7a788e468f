"""The two four-corner missions of a commissioning: a square in open water, and a box that fits the tank."""

import math
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.planning.room import MARGIN
from rovtwin.planning.tank import Tank
from rovtwin.runs.compose.fitting import PATIENCE, own_values
from rovtwin.runs.limits import Limits
from rovtwin.vehicle import Model, Vehicle

SIDE = 10.0  # of the square, and most of the box, in lengths of the vehicle: 3 m for a Double Blueye
LEAST = 1.5  # side of a box that is worth a flight, in lengths of the vehicle
CLEAR = 0.1  # least distance of the hull from the walls, wherever it strays [m]
STRAYS = 4.0  # off its path at most, in standard deviations of the estimated position: 3.4 in 79 flights of 100 s
STAY = 10.0  # at the first corner before it is left, and at the end [s]
FIRST = 1  # way-point that is the first corner: the one before it is where the leg to it begins
PERIOD = 5.0  # of the peak of a fully developed sea, over the root of its significant height [s/m^0.5]


def open_water(model: Model) -> dict[str, Any]:
    """The square of `rovtwin fly square`, sized by the vehicle: 10 lengths a side, 10 lengths deep.

    Returns:
        `start`, `mission` and `duration` of a scenario.
    """
    limits = Limits.of(model)
    side = round(SIDE * limits.length, 1)
    corners = [(side, 0.0, side), (side, side, side), (0.0, side, side), (0.0, 0.0, side)]
    start = [0.0, 0.0, round(0.15 * side, 2)]
    return {"start": {"position": start}} | _mission("square", limits, start, corners)


def sea(height: float, direction_deg: float) -> dict[str, Any] | None:
    """`world.waves` of a fully developed sea (Pierson and Moskowitz 1964) in deep water; None: it is calm.

    Args:
        height: Significant height Hs [m]; the peak's period is 5.0 sqrt(Hs) s.
        direction_deg: Where the waves run to.
    """
    if height <= 0.0:
        return None
    period = PERIOD * math.sqrt(height)
    return {
        "model": "airy",
        "spectrum": "pierson_moskowitz",
        "significant_height": height,
        "peak_period": period,
        "direction_deg": direction_deg,
    }


def in_tank(vehicle: Vehicle, tank: Tank, accuracy: float, strays: float = 0.0) -> dict[str, Any]:
    """Four corners about the tank's middle, two shallow and two deep, as large as the room allows.

    A leg leads to the first corner, where it stays for 10 s before it goes on: so it begins alike wherever it came
    from, also its heading. It ends there.
    Where positions are poor the vehicle strays, whatever it estimates, and the box is smaller.

    Args:
        vehicle: That flies.
        tank: Whose walls it stays off.
        accuracy: Standard deviation of the estimated position, each axis [m].
        strays: By how much more it was seen to leave its path, as one without sway does at corners [m].

    Returns:
        `mission` and `duration` of a scenario.

    Raises:
        ConfigError: The tank leaves no room for it; says how large one has to be.
    """
    model = vehicle.model()
    limits = Limits.of(model)
    values = own_values(limits)
    away = np.abs(np.asarray(model.hull.corners)).max(axis=0)
    clear = CLEAR + max(values["acceptance"], STRAYS * accuracy) + strays
    round_about = float(np.hypot(*np.asarray(model.hull.corners)[:, :2].T).max()) + clear
    upright = float(away[2]) + MARGIN * limits.length
    half = np.minimum(0.5 * np.array(tank.sizes[:2]) - round_about, 0.5 * SIDE * limits.length)
    least = 0.5 * LEAST * limits.length
    if half.min() < least:
        need = math.ceil(20.0 * (round_about + least)) / 10.0
        room = Tank(max(tank.length, need), max(tank.width, need), tank.depth)
        raise ConfigError(
            f"--tank: found {tank}, which leaves {vehicle.name} no room for four corners {clear:.2g} m off the walls "
            f"(positions are known to {accuracy:.2g} m); expected better positions, or a tank of at least {room}"
        )
    north, east = (round(float(x), 2) for x in half)
    middle = tank.middle[2]
    heave = round(max(min(0.5 * (middle - upright), limits.length), 0.0), 2) if limits.can(2) else 0.0
    round_again = [
        (-north, -east, middle - heave),
        (north, -east, middle - heave),
        (north, east, middle + heave),
        (-north, east, middle + heave),
    ]
    made = _mission("four corners", limits, tank.middle, round_again + round_again[: FIRST + 1])
    for i in (FIRST, -1):
        made["mission"]["waypoints"][i]["hold_time"] = STAY
    return made | {"duration": made["duration"] + 2.0 * STAY}


def _mission(name: str, limits: Limits, start: list[float], corners: list[tuple[float, float, float]]) -> Any:
    """Way-points at the vehicle's own speed, and the time after which a mission has failed."""
    values = own_values(limits)
    places = np.array([start, *corners])
    way = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    points = [{"position": [round(float(x), 3) for x in place]} | values for place in corners]
    return {
        "mission": {"name": name, "waypoints": points},
        "duration": 100.0 * math.ceil(PATIENCE * way / values["speed"] / 100.0),
    }
