"""From an autopilot's section to its blocks; it knows how noisy its sensors are, not how they fail."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rovtwin.core.block import Block
from rovtwin.core.flow import Measurements, Mission, Slot
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.sensors import kind_of
from rovtwin.core.types import Scalar
from rovtwin.gnc.allocation.prioritised import PriorityAllocation
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.control.reference_model import ReferenceModel
from rovtwin.gnc.control.tracking import PathReference, Tracking
from rovtwin.gnc.guidance.course_keeping import CourseKeeping
from rovtwin.gnc.guidance.crab_heading import Bow
from rovtwin.gnc.guidance.path_following import PathGuidance
from rovtwin.gnc.guidance.terrain_following import TerrainFollowing
from rovtwin.gnc.navigation import tuning as navigation
from rovtwin.gnc.navigation.filter import NavigationFilter
from rovtwin.gnc.safety.contingency import Contingency
from rovtwin.gnc.safety.control_authority import ControlAuthority
from rovtwin.gnc.safety.rules import RULES
from rovtwin.gnc.safety.supervisor import Supervisor
from rovtwin.gnc.safety.thruster_diagnosis import ThrusterHealth
from rovtwin.gnc.scales import HEAVE, VehicleScales
from rovtwin.gnc.thesis.ekf import Ekf, EkfTuning
from rovtwin.gnc.thesis.ekf_tuning import SENSOR_STD
from rovtwin.gnc.thesis.los_guidance import Guidance
from rovtwin.runs.compose.acoustic import acoustic_mount, as_white
from rovtwin.runs.compose.own_blocks import whole_autopilot, with_own_blocks
from rovtwin.runs.compose.sensors import displaced, mount_of
from rovtwin.runs.compose.supervisor import THESIS_RULES, rules_of, units
from rovtwin.scenario.schema import AutopilotSection, ModelBasedSection, Scenario, ThesisSection
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.analysis.stability import afloat
from rovtwin.vehicle.description.identified import fingerprint

LEAST_BIAS = {"gyro": (1e-5, 1e-8), "accelerometer": (0.03, 1e-5)}  # and its walk, in SI, see `Tuning.of`


def autopilot_of(
    scenario: Scenario,
    model: Model,
    sensors: dict[str, Sensor],
    mission: Mission,
    thrusters: list[str],
    own: Mapping[str, Block] | None = None,
) -> Block:
    """The autopilot that the scenario asks for, around a model.

    Args:
        scenario: What to fly.
        model: What the autopilot knows of the vehicle.
        sensors: On board.
        mission: Way-points.
        thrusters: Their names, which say which fail together.
        own: Blocks that were handed over in Python, by key of the scenario's autopilot.

    Raises:
        ConfigError: A block of one's own cannot be used.
    """
    ours, section = _ours(scenario, model, sensors, mission, thrusters), scenario.autopilot
    if not isinstance(section, ModelBasedSection) or not section.own_blocks:
        return ours
    dt, where, own = scenario.control_dt, f"{scenario.name}: autopilot", own or {}
    empty = _empty(sensors, scenario.substeps)
    offered = {"model": model, "sensors": {name: mount_of(one) for name, one in sensors.items()}, "dt": dt}
    made = with_own_blocks(ours, section, own, offered, empty, where)
    return whole_autopilot(made, section, own, empty, dt, where)


def _empty(sensors: dict[str, Sensor], substeps: int) -> Measurements:
    """As `Twin.empty`."""
    return {name: Slot.empty(one.capacity(substeps), one.size) for name, one in sensors.items()}


def _ours(
    scenario: Scenario, model: Model, sensors: dict[str, Sensor], mission: Mission, thrusters: list[str]
) -> Autopilot:
    """The autopilot of our own blocks."""
    section = scenario.autopilot
    surface = afloat(model) if scenario.world.surface else None
    if isinstance(section, ThesisSection):
        made, rules = _thesis(section, model, sensors, mission, scenario.control_dt), THESIS_RULES
        contingency = Contingency.of(model, surface)
    else:
        made, rules = _model_based(section, model, sensors, mission), RULES
        # No pilot gets more than the reference gives.
        bow = None if _steered(section, model) else Bow.of(model)
        contingency = Contingency.of(model, surface, **_rates(section), bow=bow)
    autopilot = replace(
        made,
        supervisor=Supervisor(rules_of(scenario, model, sensors, rules)),
        contingency=contingency,
        terrain=_terrain(model, sensors, mission, contingency.surface),
    )
    if section.supervisor.thruster_failed.action == "ignore" or rules is THESIS_RULES:
        return autopilot
    together = units(thrusters)
    return replace(autopilot, monitor=ThrusterHealth.of(model, together), ability=ControlAuthority.of(model, together))


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
    control, steered = section.control, _steered(section, model)
    return Autopilot(
        observer=navigation_filter(section, model, sensors),
        supervisor=Supervisor(),
        guidance=PathGuidance.of(model, steered),
        contingency=Contingency.of(model),
        reference=PathReference.of(model, **_rates(section)),
        control=Tracking.of(model, control.bandwidth, control.damping_ratio, control.integral),
        allocation=PriorityAllocation.of(model),
        mission=mission,
        health=model.thrusters.health,
        course=CourseKeeping.of(model, section.guidance.lookahead) if steered else None,
    )


def _rates(section: ModelBasedSection) -> dict[str, float | None]:
    """Largest rates of dives [m/s] and of turns [rad/s] that the section asks for; None: the vehicle's own."""
    turn = section.control.turn_rate_deg
    return {"dive": section.control.dive_speed, "turn": None if turn is None else math.radians(turn)}


def _terrain(model: Model, sensors: dict[str, Sensor], mission: Mission, surface: Scalar) -> TerrainFollowing | None:
    """With place and direction of the first altimeter on board; None where no way-point has an altitude."""
    if mission.altitude is None:
        return None
    name, altimeter = next((name, one) for name, one in sensors.items() if one.kind == "altimeter")
    lead = 1.6 / VehicleScales.of(model).bandwidth[HEAVE]  # by what the depth's reference lags
    return TerrainFollowing(altimeter.lever, altimeter.rotation[:, 0], surface, lead=as_array(lead), name=name)


def _steered(section: ModelBasedSection, model: Model) -> bool:
    """Whether the bow is turned to where the vehicle goes: where it is asked for, or sway is weak or not there."""
    kind = section.guidance.steering
    return not VehicleScales.of(model).crabs if kind == "auto" else kind == "los"


def navigation_filter(section: ModelBasedSection, model: Model, sensors: dict[str, Sensor]) -> NavigationFilter:
    """The error-state filter for these sensors."""
    walk = {"force_walk": VehicleScales.of(model).force_walk}
    given = walk | _biases(sensors) | section.navigation.model_dump(exclude_none=True)
    mounts = {
        n: mount_of(sensor) if sensor.errors is None else acoustic_mount(sensor, model, given["force_walk"])
        for n, sensor in sensors.items()
        if sensor.kind in navigation.SENSOR_STD
    }
    return NavigationFilter(model, navigation.Tuning.of(model, mounts, **given))


def _biases(sensors: dict[str, Sensor]) -> dict[str, float]:
    """What the filter is given for the biases of inertial sensors that are worse than table 5.7's."""
    biases: dict[str, float] = {}
    for sensor in sensors.values():
        if sensor.kind in LEAST_BIAS:
            least, slowest = LEAST_BIAS[sensor.kind]
            bias, walk = (float(np.max(np.abs(np.asarray(value)))) for value in (sensor.bias, sensor.bias_walk))
            of_kind = {f"{sensor.kind}_bias": max(bias, least), f"{sensor.kind}_bias_walk": max(walk, slowest)}
            biases |= {key: max(value, biases.get(key, 0.0)) for key, value in of_kind.items()}
    return biases


def _thesis(
    section: ThesisSection, model: Model, sensors: dict[str, Sensor], mission: Mission, control_dt: float
) -> Autopilot:
    walk = VehicleScales.of(model).force_walk
    white = {name: as_white(sensor, model, walk) for name, sensor in sensors.items()}
    thesis = Autopilot.thesis(
        model,
        Ekf(model, _tuning_of(section, model, white, control_dt), displaced(sensors)),
        mission,
        gains=section.controller.gains,
    )
    damping, frequency = as_array([section.reference.damping] * 6), as_array([section.reference.frequency] * 6)
    return replace(
        thesis,
        guidance=Guidance(look_ahead=section.guidance.lookahead),
        reference=ReferenceModel(damping, frequency, as_array([jnp.inf] * 6), section.reference.obey_speed),
    )


def _tuning_of(section: ThesisSection, model: Model, sensors: dict[str, Sensor], control_dt: float) -> EkfTuning:
    if section.observer.tuning == "as_printed":
        return EkfTuning.as_printed(control_dt)
    walk = section.observer.force_walk
    noise = {name: float(np.asarray(one.noise)[0]) for name, one in sensors.items() if kind_of(name) in SENSOR_STD}
    std = {name: value or SENSOR_STD[kind_of(name)] for name, value in noise.items()}
    return EkfTuning.consistent(std, force_walk=VehicleScales.of(model).force_walk if walk is None else walk)
