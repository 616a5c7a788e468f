"""The vehicle of a scenario, and what an autopilot's section leaves to it, filled in: for the log, and for searches."""

import math

from rovtwin.gnc.guidance.course_keeping import CourseKeeping
from rovtwin.gnc.navigation.tuning import disturbance_levels
from rovtwin.gnc.scales import VehicleScales
from rovtwin.scenario.schema import AutopilotSection, ModelBasedSection, Scenario
from rovtwin.vehicle import Model, Vehicle, load_vehicle, vehicle_from_dict


def vehicle_of(scenario: Scenario) -> Vehicle:
    """The vehicle that the scenario names, or describes itself."""
    if isinstance(scenario.vehicle, str):
        return load_vehicle(scenario.vehicle)
    return vehicle_from_dict(scenario.vehicle, f"{scenario.name}: vehicle")


def with_vehicle_defaults(section: AutopilotSection, model: Model) -> AutopilotSection:
    """The section with numbers in place of what it leaves to the vehicle; the thesis's own leaves nothing to it."""
    if not isinstance(section, ModelBasedSection):
        return section
    scales = VehicleScales.of(model)
    course = CourseKeeping.of(model)
    control = {
        "bandwidth": scales.bandwidth.tolist(),
        "dive_speed": scales.dive_speed or None,
        "turn_rate_deg": math.degrees(scales.turn_rate) or None,
    }
    guidance = {"lookahead": float(course.cruise) / float(course.gain) or None}
    own = {"control": control, "guidance": guidance, "navigation": disturbance_levels(model)}
    return section.model_copy(
        update={
            name: part.model_copy(update={k: v for k, v in own[name].items() if getattr(part, k) is None})
            for name in own
            if (part := getattr(section, name)) is not None
        }
    )
