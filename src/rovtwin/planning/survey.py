"""A survey for a vehicle: laid out over an area, and written as a scenario that flies it."""

import math
import pathlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.gnc.scales import VehicleScales
from rovtwin.planning.survey_imaging import Imaging, imaging_of
from rovtwin.planning.survey_place import altitude_of, clearance_of, datum_from, depth_of, eye_of, middle_of
from rovtwin.planning.survey_request import SurveyRequest, refuse_doubles
from rovtwin.planning.survey_scenario import scenario_of
from rovtwin.report.plans.survey import SurveyPicture, draw_survey
from rovtwin.runs.compose.fitting import own_values
from rovtwin.runs.compose.sensors import measures
from rovtwin.runs.limits import Limits
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.survey.area import Area, read_area
from rovtwin.survey.crosshatch import crosshatched
from rovtwin.survey.energy import Budget, budget
from rovtwin.survey.fill import plan_fill, read_gaps
from rovtwin.survey.offset import corners_of_co
from rovtwin.survey.pace import Pace, line_speed
from rovtwin.survey.plan import SurveyPlan, plan_survey
from rovtwin.survey.room import Swath
from rovtwin.vehicle import Model, load_vehicle

MARGIN = 1.5  # between hull and obstacle, in acceptances: twice the cross-track rms of docs/scenarios.md
SETTLING = 2.0  # at speed before a line, in time constants 1/w of the vehicle's control
UNNOTICED = 1e-3  # way of an imager from the vehicle's origin [m]


@dataclass(frozen=True, eq=False)
class Survey:
    """A survey that is laid out.

    Attributes:
        request: What was requested.
        scenario: To fly.
        plan: The way and what it sees.
        budget: What it takes from the batteries.
        clearance: From holes [m].
        depth: Of the lines [m].
        remarks: What the user should know before flying it.
        imaging: Of the imager; None where only a swath is known.
        around: The area that gaps lie in, where only these are flown; else None.
    """

    request: SurveyRequest
    scenario: Scenario
    plan: SurveyPlan
    budget: Budget
    clearance: float
    depth: float
    remarks: list[str]
    imaging: Imaging | None = None
    around: Any = None

    def figures(self) -> dict[str, Any]:
        """Plain numbers, SI, for tables and JSON."""
        plan, share = self.plan, self.budget.share
        imaging = self.imaging.figures(plan.pace.speed, plan.seeing) if self.imaging else {}
        return {
            "heading_deg": math.degrees(plan.lines.heading),
            "lines": len(plan.all_lines),
            "cells": len(plan.lines.cells),
            "laps": len(plan.room.laps),
            "line_spacing_m": plan.lines.spacing,
            "waypoints": len(plan.path.corners),
            "turns": plan.turns,
            "length_m": plan.length,
            "seeing_m": plan.seeing,
            "duration_s": plan.seconds,
            "area_m2": float(plan.room.area.area),
            "coverage": plan.coverage,
            "coverage_of_reachable": plan.coverage_of_reachable,
            "outside_m": plan.outside,
            "lead_in_m": plan.pace.lead_in,
            "clearance_m": self.clearance,
            "depth_m": self.depth,
            "speed_m_s": plan.pace.speed,
            "energy_wh": float(self.budget.used_wh.sum()) if self.budget.names else None,
            "battery_share": share,
            "propulsion_w": self.budget.propulsion_w,
            "hotel_w": self.budget.hotel_w,
            "remarks": self.remarks,
        } | imaging


def lay_out(request: SurveyRequest, progress: Callable[[float], None] = lambda share: None) -> Survey:
    """A survey as requested.

    Raises:
        ConfigError: Area, vehicle or numbers that cannot be used, or a way longer than a mission may be.
    """
    refuse_doubles(request)
    base = load_scenario(request.scenario, request.settings)
    area = read_area(request.area, datum_from(request.datum, base))
    name = request.vehicle or base.vehicle
    if not isinstance(name, str):
        raise ConfigError(f"{request.scenario}: describes its vehicle itself; name one: --vehicle double_blueye")
    vehicle = load_vehicle(name)
    model = vehicle.model()
    echoes = measures(base, vehicle, "altimeter")
    depth = depth_of(request, base, model, echoes)
    eye, imaging = eye_of(vehicle, request.sees), None
    if request.mapping is not None:
        imaging = imaging_of(request.mapping, vehicle, request.sees, *altitude_of(request, base, depth))
    swath = imaging.swath if imaging else request.swath
    assert swath is not None
    own = own_values(Limits.of(model), request.speed)
    usual = _usual_speed(request, own["speed"], model)
    speed = imaging.speed() if imaging and request.mapping and request.mapping.square else usual
    pace = Pace.of(model, speed, SETTLING / VehicleScales.of(model).level_bandwidth)
    clearance = clearance_of(model, MARGIN * own["acceptance"]) if request.clearance is None else request.clearance
    if not clearance >= 0:
        raise ConfigError(f"clearance: found {clearance:g} m, expected 0 or more")
    lever = middle_of(request, eye, imaging)
    room = clearance + float(np.linalg.norm(lever))  # for what sees: its vehicle is beside it
    plan = _plan(request, area, swath, pace, room, own["acceptance"], progress)
    moved = float(np.linalg.norm(lever)) >= UNNOTICED
    points = corners_of_co(plan.path, lever) if moved else plan.path.corners
    legs, turns = pace.times(plan.path.corners)
    # Down from the surface at the lines' speed.
    down = depth / pace.speed
    cost = budget(vehicle, model, speed, float(legs.sum()), float(turns.sum()) + down)
    scenario = scenario_of(
        request, base, name, plan, points, area.datum, depth, own["acceptance"], bool(cost.names), echoes
    )
    remarks = _remarks(plan, cost, clearance) + (imaging.remarks(speed, usual) if imaging else [])
    if moved:
        named = None if request.middle is not None else eye
        remarks.append(_moved(named.name if named else "the swath's middle", lever, bool(named and imaging)))
    around = area.shape if request.gaps is not None else None
    return Survey(request, scenario, plan, cost, clearance, depth, remarks, imaging, around)


def _usual_speed(request: SurveyRequest, own: float, model: Model) -> float:
    """As asked for, or the vehicle's own as far as half of its thrust reaches it [m/s]."""
    if request.speed is not None:
        return request.speed
    return min(own, line_speed(model)) if line_speed(model) > 0.0 else own


def _moved(name: str, lever: Float[np.ndarray, "2"], swath: bool) -> str:
    """That way-points are not on the lines."""
    x, y = np.round(lever, 3)
    where = "whose swath has its middle" if swath else "which sits"
    return (
        f"the lines are those of {name}, {where} {x:g} m ahead and {y:g} m to the right of the vehicle's origin: "
        "way-points are moved by that"
    )


def _plan(
    request: SurveyRequest,
    area: Area,
    swath: Swath,
    pace: Pace,
    room: float,
    acceptance: float,
    progress: Callable[[float], None],
) -> SurveyPlan:
    """Over all of the area, or over its gaps."""
    if request.gaps is not None:
        is_file = isinstance(request.gaps, str | pathlib.Path)
        gaps = read_gaps(request.gaps, area.datum, area.shape) if is_file else request.gaps
        return plan_fill(area.shape, gaps, swath, pace, room, request.inside, acceptance)
    heading = None if request.heading_deg is None else math.radians(request.heading_deg)
    plan = plan_survey(area.shape, swath, pace, room, heading, request.inside, acceptance, progress)
    if request.mapping and request.mapping.crosshatch:
        return crosshatched(plan, area.shape, room, acceptance)
    return plan


def _remarks(plan: SurveyPlan, cost: Budget, clearance: float) -> list[str]:
    """What a user should know before flying."""
    out, half, area = [], 0.5 * plan.room.swath.width, plan.room.area.area
    blocked = area - plan.room.reachable.area
    if blocked > 1e-3 * area:
        out.append(
            f"{blocked:.3g} m2 ({blocked / area:.1%}) cannot be seen from where the vehicle may be: half the swath is "
            f"{half:.2g} m, the --clearance {clearance:.2g} m"
        )
    if plan.outside > 0.01:
        out.append(f"leads and turns reach {plan.outside:.2g} m out of the area; --inside keeps the vehicle in it")
    if plan.detours > 0.1:
        out.append(f"{plan.detours:.3g} m of ways lead far outside, between parts of the area")
    if plan.short_leads:
        out.append(
            f"{plan.short_leads} ends of lines have no room for a whole lead: the vehicle is not yet steady there"
        )
    if cost.share is not None and cost.share > 0.8:
        verdict = "does not last" if cost.share > 1 else "is nearly emptied"
        out.append(f"the battery {verdict}: {cost.share:.0%} of it before current, waves and tether")
    return out


def write_survey(survey: Survey, path: pathlib.Path) -> None:
    """The scenario, and in its head what it was laid out for.

    Raises:
        ConfigError: It cannot be written.
    """
    request, plan = survey.request, survey.plan
    head = [
        f"# Laid out by rovtwin plan-survey: {pathlib.Path(request.area).name}, swath {plan.room.swath.width:.4g} m, "
        f"overlap {plan.room.swath.overlap:g};",
        f"# lines at {math.degrees(plan.lines.heading):.0f} deg, {plan.length:.0f} m, about {plan.seconds / 60:.0f} "
        f"minutes, {plan.coverage:.1%} of {plan.room.area.area:.0f} m2 seen.",
    ]
    data = {"name": survey.scenario.name, "vehicle": survey.scenario.vehicle}
    # A speed that happens to be the schema's default is still what was asked for: left out, it would be the vehicle's.
    data |= survey.scenario.model_dump(mode="json", exclude_unset=True)
    body = dump_yaml(data, default_flow_style=None)
    try:
        write_text(path, "\n".join(head) + "\n" + body)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from None


def survey_picture(survey: Survey) -> Figure:
    """Area, holes, lines, what is seen and what is not."""
    plan, figures = survey.plan, survey.figures()
    return draw_survey(
        SurveyPicture(
            title=f"{pathlib.Path(survey.request.area).name}: {figures['length_m']:.0f} m in "
            f"{figures['duration_s'] / 60:.0f} min, {figures['lines']} lines at {figures['heading_deg']:.0f}°, "
            f"{figures['coverage']:.1%} seen",
            area=plan.room.area,
            seen=plan.seen,
            gaps=plan.gaps,
            points=plan.path.points,
            sees=plan.path.sees,
            around=survey.around,
        )
    )
