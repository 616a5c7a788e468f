"""A survey that is laid out, as a scenario that flies it."""

import math
import pathlib

import numpy as np
from jaxtyping import Float

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.planning.survey_request import SurveyRequest
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.schema.mission import LONGEST
from rovtwin.survey.plan import SurveyPlan

PATIENCE = 1.5  # share of the planned time after which a flight is given up


def scenario_of(
    request: SurveyRequest,
    base: Scenario,
    vehicle: str,
    plan: SurveyPlan,
    corners: Float[np.ndarray, "n 2"],
    datum: Datum,
    depth: float,
    acceptance: float,
    battery: bool,
    echoes: bool,
) -> Scenario:
    """The scenario.

    Args:
        request: What was requested.
        base: To start from.
        vehicle: Library name or file.
        plan: The way.
        corners: Its way-points, for CO [m].
        datum: Origin of n.
        depth: Of the lines [m].
        acceptance: Radius within which a way-point counts as reached [m].
        battery: Whether the vehicle has one.
        echoes: Whether an altimeter is on board.

    Raises:
        ConfigError: More way-points than a mission may have, or longer than a run may be.
    """
    points, swath = np.round(corners, 3) + 0.0, plan.room.swath
    if len(points) > LONGEST:
        raise ConfigError(
            f"area: the survey has {len(points)} way-points, a mission at most {LONGEST}: split the area or take a "
            "wider swath"
        )
    duration = 60.0 * math.ceil((PATIENCE * plan.seconds + 60.0 + depth / plan.pace.speed) / 60.0)
    if duration > 86_400:
        raise ConfigError(f"area: the survey takes {plan.seconds / 3600:.1f} h, a run at most 24 h: split the area")
    # With an altimeter on board the floor is followed, and the depth is what holds where it says nothing.
    follows = {"altitude": request.altitude} if request.altitude and echoes else {}
    first = points[1] - points[0]
    area = pathlib.Path(request.area)
    data = base.model_dump(mode="json", exclude_defaults=True) | {
        "name": f"survey_{''.join(c if c.isalnum() else '_' for c in area.stem)}",
        "description": f"Survey of {area.name}, swath {swath.width:.4g} m, overlap {swath.overlap:.0%}",
        "vehicle": vehicle,
        "duration": duration,
        "datum": {"latitude": datum.latitude, "longitude": datum.longitude, "height": datum.height}
        | {"utc_start": datum.utc_start},
        "start": {
            "position": [*points[0].tolist(), min(depth, 0.5)],
            "heading_deg": round(math.degrees(math.atan2(first[1], first[0])), 1) + 0.0,
        },
        "mission": {
            "name": "survey",
            "description": f"{len(plan.all_lines)} lines, {len(plan.room.laps)} laps, {plan.length:.0f} m over ground",
            "waypoints": [
                {"position": [*point.tolist(), depth], "speed": plan.pace.speed, "acceptance": acceptance} | follows
                for point in points
            ],
        },
    }
    data |= {key: getattr(base, key) for key in ("name", "description", "duration") if request.sets(key)}
    # The thesis's own gains stop short and its reference has no speed (docs/guidance_and_control.md).
    data.setdefault("autopilot", "model_based")
    if battery and not request.sets("battery"):
        data.setdefault("battery", True)
    return parse(Scenario, data, data["name"])
