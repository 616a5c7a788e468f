"""Where a survey is flown: depth and height of its lines, its datum, and the place of what sees."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.datum import Datum, latitude_longitude
from rovtwin.core.errors import ConfigError
from rovtwin.planning.survey_imaging import Imaging
from rovtwin.planning.survey_request import SurveyRequest
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.description.totals.assembly import Mounted


def eye_of(vehicle: Vehicle, name: str | None) -> Mounted | None:
    """What sees: the imager or camera of a name, or the first imager; None for the vehicle's origin.

    Raises:
        ConfigError: There is none of that name.
    """
    imagers = [one for one in vehicle.sensors if getattr(one.item, "kind", "") == "imager" and not one.spare]
    if name is None:
        return imagers[0] if imagers else None
    found = {one.name: one for one in (*imagers, *vehicle.cameras)}
    if name not in found:
        there = ", ".join(found) or "none"
        raise ConfigError(f"--sees {name}: {vehicle.name} has no such imager or camera; there are: {there}")
    return found[name]


def middle_of(request: SurveyRequest, eye: Mounted | None, imaging: Imaging | None) -> Float[np.ndarray, "2"]:
    """Middle of what is seen, ahead of the vehicle's origin and to the right of it [m]: the lines are its lines."""
    if request.middle is not None:
        return np.asarray(request.middle, float)
    if imaging is not None:
        return np.asarray(imaging.footprint.middle)
    return np.zeros(2) if eye is None else np.asarray(eye.position[:2])


def datum_from(text: str | None, base: Scenario) -> Datum | None:
    """Of `--datum`: the scenario's, latitude and longitude, or None for the area's middle.

    Raises:
        ConfigError: It is neither.
    """
    if text is None:
        return base.origin
    if text == "auto":
        return None
    place = latitude_longitude(text, "--datum", "latitude,longitude [deg] or auto")
    return Datum(*place, base.datum.height, base.datum.utc_start)


def clearance_of(model: Model, margin: float) -> float:
    """The hull turns on the spot beside an obstacle: its widest reach, and a margin [m]."""
    corners = np.asarray(model.hull.corners)
    return float(np.linalg.norm(corners[:, :2], axis=1).max()) + margin


def depth_of(request: SurveyRequest, base: Scenario, model: Model, echoes: bool) -> float:
    """Of the lines [m]; `echoes`: whether an altimeter is on board.

    Raises:
        ConfigError: Depth and altitude contradict each other, or lead into the floor or too deep.
    """
    floor = base.world.floor
    if request.altitude is not None and request.depth is not None and echoes:
        depth = request.depth  # safe where the altimeter says nothing
    elif request.altitude is not None:
        if request.depth is not None:
            raise ConfigError("--depth and --altitude: found both, expected one (both with an altimeter on board)")
        if floor is None:
            raise ConfigError(f"--altitude: {request.scenario} has no floor; say how deep it is: --floor 12")
        depth = floor - request.altitude
    else:
        depth = 3.0 if request.depth is None else request.depth
    limit = base.autopilot.supervisor.deepest
    if not 0 <= depth < limit:
        raise ConfigError(
            f"--depth: found {depth:g} m, expected from 0 to less than {limit:g} m, the supervisor's limit"
        )
    lowest = depth + float(np.asarray(model.hull.corners)[:, 2].max())
    if floor is not None and lowest >= floor:
        raise ConfigError(
            f"--depth: at {depth:g} m the hull reaches down to {lowest:.2f} m, into the floor at {floor:g} m"
        )
    return depth


def altitude_of(request: SurveyRequest, base: Scenario, depth: float) -> tuple[float | None, bool]:
    """Of the vehicle's origin over the floor [m], None where nobody has said how deep that is; whether it was given."""
    if request.altitude is not None:
        return request.altitude, True
    floor = base.world.floor
    return (None if floor is None else floor - depth), False
