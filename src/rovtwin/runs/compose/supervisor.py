"""From the supervisor's section to its rules, and which thrusters fail together."""

import math
from collections.abc import Collection

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.sensors import kind_of
from rovtwin.gnc.safety.off_course import limits_of
from rovtwin.gnc.safety.rules import RULES, Rule, Rules
from rovtwin.gnc.scales import VehicleScales
from rovtwin.runs.compose.faults import units_of
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.schema.supervisor import AngleRuleSection, RuleSection
from rovtwin.vehicle import Model
from rovtwin.vehicle.physics.actuation import wrench_limits

_NAMES = {"attitude limit": "attitude_limit_deg", "estimate lost": "position_std_limit"}
_CARRIED = np.array([False, False, False, True, True, False])  # roll and pitch right themselves
_SENSORS = {"altitude_limit": "altimeter", "battery_low": "battery", "battery_critical": "battery", "leak": "leak"}
NEARER = 0.35  # share of the least altitude that a mission asks for, below which the altitude limit acts by itself
SHORT = 0.1  # of an axis's largest wrench, by which the controller may be short of what it wants
# The thesis's autopilot has no fail-safes; those that its own weaknesses would call are off unless asked for.
WEAK = ("filter diverged", "positions lost", "thruster failed", "saturated", "off course", "off depth")
THESIS_RULES = RULES | {name: RULES[name]._replace(action="ignore") for name in WEAK}


def rules_of(scenario: Scenario, model: Model, sensors: Collection[str], defaults: dict[str, Rule] = RULES) -> Rules:
    """The rules of a scenario's supervisor, for the sensors that are on board.

    Raises:
        ConfigError: A rule about what no sensor on board tells.
    """
    section = scenario.autopilot.supervisor
    _require_what_it_watches(scenario, sensors, defaults)
    course = limits_of(model)
    of_vehicle = zip(("off course", "off depth"), course.limit, course.after, strict=True)
    own = {name: defaults[name]._replace(limit=float(m), after=float(s)) for name, m, s in of_vehicle}
    changes = {
        name: _rule(getattr(section, key), default)
        for name, default in (defaults | own).items()
        if hasattr(section, key := _NAMES.get(name, name.replace(" ", "_")))
    }
    altitudes = [w.altitude for w in scenario.waypoints if w.altitude]
    if altitudes and section.altitude_limit.limit is None:
        changes["altitude limit"] = changes["altitude limit"]._replace(limit=NEARER * min(altitudes))
    lower, upper = (np.asarray(limit) for limit in wrench_limits(model.thrusters))
    allowance = np.where(_CARRIED, np.inf, SHORT * np.maximum(-lower, upper))
    nearer = 1.6 * VehicleScales.of(model).length  # as near home as counts as there
    return Rules.of(defaults | changes, section.geofence.polygon, allowance, nearer, sensors, course.step)


def _require_what_it_watches(scenario: Scenario, sensors: Collection[str], defaults: dict[str, Rule]) -> None:
    """Raise where somebody asks for a rule that nothing on board could call."""
    section = scenario.autopilot.supervisor
    where = f"{scenario.name}: autopilot.supervisor"
    for key, sensor in _SENSORS.items():
        rule: RuleSection = getattr(section, key)
        asked = rule.limit is not None or rule.action not in (None, "ignore")
        if asked and not any(kind_of(name) == sensor for name in sensors):
            raise ConfigError(f"{where}.{key}: no {sensor} is on board; set sensors.{sensor}.on_board to true")
    if defaults is not RULES and section.thruster_failed.action not in (None, "ignore"):
        raise ConfigError(f"{where}.thruster_failed: the thesis's autopilot does not look; use autopilot=model_based")


def _rule(given: RuleSection, default: Rule) -> Rule:
    limit = default.limit if given.limit is None else given.limit
    if given.limit is not None and isinstance(given, AngleRuleSection):
        limit = math.radians(limit)
    return Rule(limit, default.after if given.after is None else given.after, given.action or default.action)


def units(names: list[str]) -> tuple[tuple[int, ...], ...]:
    """Numbers of the thrusters of each part of several that have some: they fail together."""
    parts = units_of(names)
    groups = [tuple(i for i, name in enumerate(names) if name.startswith(f"{part}.")) for part in parts]
    return tuple(groups) if len(groups) > 1 else ()
