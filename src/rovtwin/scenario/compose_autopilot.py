"""From an autopilot's section to its blocks; it knows how noisy its sensors are, not how they fail."""

import math
from dataclasses import replace

import numpy as np

from rovtwin.core.flow import Mission
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.gnc.ability import Ability
from rovtwin.gnc.allocation import reachable_share
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.contingency import Contingency
from rovtwin.gnc.ekf_tuning import SENSOR_STD
from rovtwin.gnc.guidance import Guidance
from rovtwin.gnc.navigation import tuning as navigation
from rovtwin.gnc.navigation.filter import NavigationFilter
from rovtwin.gnc.observer import Ekf, EkfTuning
from rovtwin.gnc.path_guidance import PathGuidance
from rovtwin.gnc.priority_allocation import PriorityAllocation
from rovtwin.gnc.reference import ReferenceModel
from rovtwin.gnc.rules import RULES
from rovtwin.gnc.steering import Steering
from rovtwin.gnc.supervisor import Supervisor
from rovtwin.gnc.terrain import TerrainFollowing
from rovtwin.gnc.thruster_health import ThrusterHealth
from rovtwin.gnc.tracking import PathReference, Tracking
from rovtwin.scenario.compose_supervisor import THESIS_RULES, rules_of, units
from rovtwin.scenario.schema import AutopilotSection, ModelBasedSection, Scenario, ThesisSection
from rovtwin.simulation.sensors import Sensor
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.identified import fingerprint
from rovtwin.vehicle.trim import afloat

UP = 0.2  # depth to come up to in a world without a surface [m]
DESIGN_FORCE_WALK = 0.03  # disturbance that filters and bounds are laid out for where nothing else is said [N/sqrt(s)]


def autopilot_of(
    scenario: Scenario, model: Model, sensors: dict[str, Sensor], mission: Mission, thrusters: list[str]
) -> Autopilot:
    """The autopilot that the scenario asks for, around a model; names of thrusters say which fail together."""
    section = scenario.autopilot
    contingency = Contingency(surface=afloat(model) if scenario.world.surface else UP)
    if isinstance(section, ModelBasedSection):  # no pilot gets more than the reference gives
        control = section.control
        fastest = [0.5, 0.5, control.dive_speed, math.radians(control.turn_rate_deg)]
        contingency = replace(contingency, fastest=as_array(fastest))
    if isinstance(section, ThesisSection):
        made, rules = _thesis(section, model, sensors, mission, scenario.control_dt), THESIS_RULES
    else:
        made, rules = _model_based(section, model, sensors, mission), RULES
    autopilot = replace(
        made,
        supervisor=Supervisor(rules_of(scenario, model, rules)),
        contingency=contingency,
        terrain=_terrain(sensors, mission, contingency.surface),
    )
    if section.supervisor.thruster_failed.action == "ignore" or rules is THESIS_RULES:
        return autopilot
    together = units(thrusters)
    return replace(autopilot, monitor=ThrusterHealth.of(model, together), ability=Ability.of(model, together))


def tuned_for_another(section: AutopilotSection, vehicle: Vehicle) -> str | None:
    """One line where `rovtwin tune` found these values for other parts than the vehicle has; None else."""
    note = section.tuned if isinstance(section, ModelBasedSection) else None
    now = fingerprint(vehicle.file)
    if note is None or note.made_with == now:
        return None
    return (
        f"the autopilot was tuned for {note.vehicle} with the parts {note.made_with}, but {vehicle.name} has {now}: it "
        "flies, with the new vehicle's model, but run rovtwin tune again"
    )


def _model_based(section: ModelBasedSection, model: Model, sensors: dict[str, Sensor], mission: Mission) -> Autopilot:
    control = section.control
    return Autopilot(
        observer=navigation_filter(section, model, sensors),
        supervisor=Supervisor(),
        guidance=PathGuidance.of(model, _steering(section, model)),
        contingency=Contingency(),
        reference=PathReference.of(dive=control.dive_speed, turn=math.radians(control.turn_rate_deg)),
        control=Tracking.of(model, control.bandwidth, control.damping_ratio, control.integral),
        allocation=PriorityAllocation.of(model),
        mission=mission,
        health=model.thrusters.health,
    )


def _terrain(sensors: dict[str, Sensor], mission: Mission, surface: Array) -> TerrainFollowing | None:
    """With the altimeter's place and direction; None where no way-point has an altitude."""
    if mission.altitude is None:
        return None
    altimeter = sensors["altimeter"]
    return TerrainFollowing(altimeter.lever, altimeter.rotation[:, 0], surface)


def _steering(section: ModelBasedSection, model: Model) -> Steering | None:
    """Line of sight where it is asked for, and where thrusters cannot push sideways."""
    kind = section.guidance.steering
    if kind == "auto":
        kind = "crab" if reachable_share(model.thrusters.configuration)[1] > 0.5 else "alos"
    return None if kind == "crab" else Steering.of(kind, section.guidance.lookahead)


def navigation_filter(section: ModelBasedSection, model: Model, sensors: dict[str, Sensor]) -> NavigationFilter:
    """The error-state filter for these sensors."""
    known = {name: sensor for name, sensor in sensors.items() if name in navigation.SENSOR_STD}
    mounts = {name: _mount(name, sensor) for name, sensor in known.items()}
    given = {"force_walk": DESIGN_FORCE_WALK} | section.navigation.model_dump(exclude_none=True)
    return NavigationFilter(model, navigation.Tuning.of(mounts, **given))


def _mount(name: str, sensor: Sensor) -> navigation.Mount:
    """A sensor without noise is believed as far as one of its kind is."""
    std = float(np.asarray(sensor.noise)[0]) or navigation.SENSOR_STD[name]
    return navigation.Mount(std, sensor.lever, sensor.rotation)


def _thesis(
    section: ThesisSection, model: Model, sensors: dict[str, Sensor], mission: Mission, control_dt: float
) -> Autopilot:
    thesis = Autopilot.thesis(
        model,
        Ekf(model, _tuning_of(section, sensors, control_dt)),
        mission,
        gains=section.controller.gains,
    )
    damping, frequency = as_array([section.reference.damping] * 6), as_array([section.reference.frequency] * 6)
    return replace(
        thesis,
        guidance=Guidance(look_ahead=section.guidance.lookahead),
        reference=ReferenceModel(damping, frequency, as_array([jnp.inf] * 6), section.reference.obey_speed),
    )


def _tuning_of(section: ThesisSection, sensors: dict[str, Sensor], control_dt: float) -> EkfTuning:
    if section.observer.tuning == "as_printed":
        return EkfTuning.as_printed(control_dt)
    walk = section.observer.force_walk
    std = {name: float(np.asarray(sensor.noise)[0]) for name, sensor in sensors.items() if name in SENSOR_STD}
    known = {name: value for name, value in std.items() if value > 0}
    return EkfTuning.consistent(known, force_walk=DESIGN_FORCE_WALK if walk is None else walk)
