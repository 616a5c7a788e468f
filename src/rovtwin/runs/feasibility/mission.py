"""Before a mission: what the vehicle cannot do, with the numbers, and what is done or has to be changed instead.

Horizontal motion is judged through the water. On a leg that points along chi, in a current with the part c_a along the
leg and c_x across it, a vehicle that turns its bow into the current makes good

    U = sqrt(w^2 - c_x^2) + c_a,

w being its top speed ahead; one that looks along the leg and pushes sideways w + c_a, if its top speed in sway is more
than c_x. A place is held where c is less than w, a heading with it where each axis stems its part of c. Top speeds are
those of one axis alone (`Limits`), by thrust and by what keeps the vehicle level: what is refused here is impossible,
what is not may still be hard.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.core.errors import ConfigError
from rovtwin.core.sensors import SENSORS
from rovtwin.gnc.guidance.path_following import SLOWEST
from rovtwin.gnc.safety.rules import RULES
from rovtwin.gnc.scales import ANY, VehicleScales
from rovtwin.runs.compose.sensors import sensors_of, together
from rovtwin.runs.compose.world import current_at
from rovtwin.runs.feasibility.point_numbers import counted
from rovtwin.runs.feasibility.tilting import tilts
from rovtwin.runs.limits import TURNING, Limits, compass_point
from rovtwin.scenario.schema import (
    Scenario,
    ThesisSection,
    Waypoint,
    WorldSection,
)
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.physics.actuation import size, wrench_limits

SPARE = 0.9  # share of a top speed that guidance plans with: the rest is the feedback's
ACROSS = 1.5  # times the flow in which it turns, beyond which the bow never comes round: flown, 1.1 does, 1.8 not
TILTED = 15.0  # roll or pitch of a dive that is said beforehand, or half of the attitude limit [deg]
SOME = 0.01  # current that counts [m/s]
SURGE, SWAY, HEAVE, ROLL, PITCH, YAW = range(6)
_BASELINE_OF = "double_blueye"
_KEEPS = "this autopilot keeps its heading and is carried off: fly it with model_based, steering {}"


@dataclass(frozen=True)
class Finding:
    """One thing that the vehicle cannot do.

    Attributes:
        what: With its numbers.
        instead: What to change where it is refused, what will be done where it is not.
        refused: Whether nothing useful can be flown.
    """

    what: str
    instead: str
    refused: bool

    @property
    def line(self) -> str:
        """Both, as one line."""
        return f"{self.what}; {self.instead}"


@dataclass(frozen=True)
class _Leg:
    """From a place to a way-point: its name, length [m], direction [rad], way-point, depth change [m]."""

    name: str
    length: float
    direction: float
    point: Waypoint
    down: float
    depth: float


def judge(
    scenario: Scenario, model: Model, known_world: bool = True, sensors: dict[str, Sensor] | None = None
) -> list[Finding]:
    """What the vehicle cannot do of the scenario's mission, the gravest first; NumPy, milliseconds.

    Args:
        scenario: Its mission, start and world; a test has its own checks.
        model: Of the vehicle as it truly is.
        known_world: False where the vehicle is somewhere else, behind a link: current and tank do not count then.
        sensors: That fly; None: the usual ones.
    """
    if not scenario.waypoints:
        return []
    limits, legs = Limits.of(model), _legs(scenario)
    found = [*_own(limits, legs, model)]
    if not any(finding.refused for finding in found):
        for leg in legs:
            current = current_at(scenario.world, leg.depth) if known_world else np.zeros(2)
            found += _on_leg(
                limits, leg, current, steers(scenario, model), _turns_bow(scenario), _would_turn(scenario, model)
            )
        if known_world:
            found += [*_in_tank(limits, legs, scenario.world), *_over_nothing(legs, scenario.world), *_unseen(scenario)]
        found += _tilted(legs, scenario, model, known_world, _fixes_std(scenario, sensors))
    return sorted(_once(found), key=lambda finding: not finding.refused)


def require_feasible(
    scenario: Scenario, model: Model, known_world: bool = True, sensors: dict[str, Sensor] | None = None
) -> list[Finding]:
    """What remains to be said of a mission that can be flown; arguments are those of `judge`.

    Raises:
        ConfigError: Nothing useful can be flown; with the numbers and what to change.
    """
    found = judge(scenario, model, known_world, sensors)
    refused = [finding.line for finding in found if finding.refused]
    if refused:
        raise ConfigError(f"{scenario.name}: " + "\n".join(refused))
    return found


def foreseen(scenario: Scenario, vehicle: Vehicle, model: Model, known_world: bool = True) -> list[str]:
    """Lines for whoever is about to fly: what the vehicle cannot do of the mission, and what it does instead.

    Arguments are those of `judge`, and the vehicle's description.

    Raises:
        ConfigError: Nothing useful can be flown.
    """
    sensors = sensors_of(scenario, vehicle)
    lines = [finding.line for finding in require_feasible(scenario, model, known_world, sensors)]
    other = baseline_of_another(scenario, vehicle) if scenario.waypoints else None
    return [*lines, other] if other else lines


def baseline_of_another(scenario: Scenario, vehicle: Vehicle) -> str | None:
    """One line where the gains of the thesis fly another vehicle than the one that they are of; None else."""
    section = scenario.autopilot
    placed = isinstance(section, ThesisSection) and section.controller.gains == "pole_placement"
    if not isinstance(section, ThesisSection) or placed or vehicle.name.startswith(_BASELINE_OF):
        return None
    return (
        f"the baseline thesis has the gains of the Double Blueye, not of {vehicle.name}: expect it to fail, or fly "
        "autopilot=model_based, which is made for the vehicle that it flies"
    )


def _legs(scenario: Scenario) -> list[_Leg]:
    before, legs = np.asarray(scenario.start.position, dtype=float), []
    heading = scenario.heading
    for i, point in enumerate(scenario.waypoints):
        there = np.asarray(point.placed(scenario.origin), dtype=float)
        way = there - before
        length = float(math.hypot(way[0], way[1]))
        heading = math.atan2(way[1], way[0]) if length > 1e-3 else heading
        legs.append(_Leg(f"way-point {i + 1}", length, heading, point, float(way[2]), float(there[2])))
        before = there
    return legs


def _own(limits: Limits, legs: list[_Leg], model: Model) -> Iterator[Finding]:
    """What no water is to blame for: axes without thrusters."""
    longest, deepest = max(leg.length for leg in legs), max(legs, key=lambda leg: abs(leg.down))
    net = float(model.buoyancy) - float(model.weight)
    if not limits.can(HEAVE):
        sinks = f"weight and buoyancy leave {_size(net)} N {'upwards' if net > 0 else 'downwards'}"
        if abs(net) > 1e-3 * float(model.weight):
            yield Finding(
                f"thrusters cannot hold the depth: {sinks}, and thrusters give {_alone(model)}",
                "ballast it (rovtwin vehicle ballast) or give it thrust in heave",
                True,
            )
        elif abs(deepest.down) > 0.5 * limits.length:
            yield Finding(
                f"no thrust in heave, and {deepest.name} lies {abs(deepest.down):.2g} m "
                f"{'deeper' if deepest.down > 0 else 'higher'}: pitch alone is not flown to change depth",
                "start at the mission's depth, or give it thrust in heave",
                True,
            )
    if longest < 0.5 * limits.length:
        return
    if not limits.can(SURGE) and not limits.can(SWAY):
        yield Finding("no thrust in surge or sway both ways: it cannot go to a way-point and stop there",
                      "give it thrusters that push ahead and astern", True)  # fmt: skip
    elif not limits.can(YAW):
        cannot = "no moment in yaw both ways: its heading cannot be controlled"
        if limits.can(SURGE) and limits.can(SWAY):
            yield Finding(cannot, "its heading is left to the water, and it goes sideways where it must", False)
        else:
            yield Finding(cannot, "give it thrusters beside each other, or a lateral one ahead or astern", True)


def _alone(model: Model) -> str:
    """What thrusters give in heave without weight and buoyancy."""
    low, high = (float(np.asarray(limit)[HEAVE]) for limit in wrench_limits(model.thrusters))
    return f"{_size(high)} N down and {_size(low)} N up"


def _size(value: float) -> str:
    """Two digits below 100, whole numbers above: never a power of ten."""
    return f"{abs(value):.0f}" if abs(value) >= 99.5 else f"{abs(value):.2g}"


def steers(scenario: Scenario, model: Model) -> bool:
    """Whether the autopilot turns the bow to where the vehicle has to go; the thesis's, and `crab`, keep a heading."""
    section = scenario.autopilot
    if isinstance(section, ThesisSection) or section.guidance.steering == "crab":
        return False
    return section.guidance.steering == "los" or not VehicleScales.of(model).crabs


def _turns_bow(scenario: Scenario) -> bool:
    """Whether a vehicle that crabs turns its bow into a current that it does not stem sideways."""
    return not isinstance(scenario.autopilot, ThesisSection)


def _would_turn(scenario: Scenario, model: Model) -> str:
    """Steering with which `model_based` would turn where what is flown, the thesis's or `crab`, does not; else empty.

    A vehicle that crabs keeps a heading that is asked for with `auto`, too.
    """
    section = scenario.autopilot
    if not isinstance(section, ThesisSection) and section.guidance.steering != "crab":
        return ""
    return "los" if VehicleScales.of(model).crabs else "auto or los"


def _on_leg(
    limits: Limits, leg: _Leg, current: Float[np.ndarray, "2"], steered: bool, turns: bool, would_turn: str
) -> Iterator[Finding]:
    """What speed, current, heading and corner ask of a leg and of the stay at its end."""
    ahead, size = float(limits.top[SURGE, 1]), float(np.hypot(*current))
    best = max(ahead, float(limits.top[SWAY].max()))
    towards = compass_point(math.atan2(current[1], current[0]))
    flow = f"a current of {size:.2g} m/s to the {towards}"
    if size > SOME and size >= best:
        yield Finding(f"{leg.name}: {flow} is more than its top speed of {best:.2g} m/s: it is carried off at "
                      f"{size - best:.2g} m/s or more, whatever it does",
                      "wait for less current, or give it more thrust", True)  # fmt: skip
        return
    if size > max(limits.through_water, SOME):
        yield _tips(limits, leg, flow)
        return
    if steered and limits.can(YAW) and size > max(limits.turns_in, SOME):
        yield _turned_across(limits, leg, size, flow)
    if leg.length > 0.5 * limits.length:
        yield from _made_good(limits, leg, current, flow, turns and limits.can(YAW))
        yield from _stops(limits, leg)
    if leg.point.heading_deg is not None and size > SOME:
        gives_up = float(limits.through[SURGE, 1]) if steered else 0.0
        yield from _held_heading(limits, leg, current, flow, gives_up, would_turn)
    elif leg.point.hold_time > 0 and size > SOME and not limits.can(SWAY):
        psi = math.degrees(math.atan2(-current[1], -current[0])) % 360
        instead = f"it turns its bow into the current ({psi:.0f} deg)"
        yield Finding(f"{leg.name}: no thrust in sway, and it is to stay there in {flow}",
                      instead if steered else _KEEPS.format("auto or los"), False)  # fmt: skip


def _tips(limits: Limits, leg: _Leg, flow: str) -> Finding:
    """A current through which the vehicle cannot go level, whichever way it looks."""
    best, (ahead, aside) = limits.through_water, limits.level
    what = f"{leg.name}: {flow} would tip it over: it stays level up to {best:.2g} m/s through the water"
    found = [("pitch", PITCH, ahead, "ahead")] + [("roll", ROLL, aside, "abeam")] * limits.can(SWAY)
    found = [one for one in found if one[2] < ANY]
    tips = ", ".join(f"in {name} beyond {speed:.2g} m/s from {side}" for name, _, speed, side in found)
    lacking = [name for name, axis, _, _ in found if not limits.can(axis)]
    more = "raise BG" + (f", give it thrust in {' and '.join(lacking)}" if lacking else "")
    return Finding(f"{what}; Munk's moment turns it {tips}",
                   f"wait for less current, {more}, or lower its added mass in heave", True)  # fmt: skip


def _turned_across(limits: Limits, leg: _Leg, size: float, flow: str) -> Finding:
    """A current through which the vehicle cannot turn its bow."""
    across, has = 0.5 * limits.munk_yaw * size**2, limits.both_ways(YAW)
    munk = f"turns it across itself with up to {across:.2g} N m (Munk's moment)"
    what = f"{leg.name}: {flow} {munk}, and its thrusters have {has:.2g} N m"
    held = f"it turns its bow in up to {limits.turns_in:.2g} m/s"
    if size > ACROSS * limits.turns_in:
        return Finding(what, f"{held}: wait for less current, or give it fins or more moment in yaw", True)
    return Finding(what, f"{held}, and is carried off while it turns", False)


def _made_good(limits: Limits, leg: _Leg, current: Float[np.ndarray, "2"], flow: str, turns: bool) -> Iterator[Finding]:
    along = float(current @ [math.cos(leg.direction), math.sin(leg.direction)])
    across = float(current @ [-math.sin(leg.direction), math.cos(leg.direction)])
    ahead, leg_speed = float(limits.through[SURGE, 1]), leg.point.speed or 0.0
    aside, most = float(limits.through[SWAY, 0 if across > 0 else 1]), limits.made_good(along, across)
    crabs, level = aside > abs(across), ahead < float(limits.top[SURGE, 1])
    name = f"the leg to {leg.name}"
    if most <= 0.0:
        yield Finding(f"{name}: against {flow} it makes no way over ground with {ahead:.2g} m/s, its top speed"
                      f"{' that keeps it level' if level else ''}",
                      "wait for less current, turn the mission round, or give it more thrust", True)  # fmt: skip
    elif leg_speed > (planned := most if level else min(most, SPARE * ahead + along)):
        why = f" in {flow}" if np.hypot(*current) > SOME else ""
        gives = "it stays level up to" if level else "the thrusters give"
        does = f"it is flown at about {planned:.2g} m/s"
        if planned < SLOWEST * leg_speed:
            does = (f"guidance asks for {SLOWEST * leg_speed:.2g} m/s all the same, {SLOWEST:.0%} of the leg's: the "
                    "vehicle falls behind, and may be carried off")  # fmt: skip
        yield Finding(f"{name}: {leg_speed:.2g} m/s are requested, and {gives} {most:.2g} m/s over ground{why}",
                      does, False)  # fmt: skip
    if most > 0.0 and not crabs and abs(across) > SOME and limits.can(SWAY) and leg.point.heading_deg is None:
        pushed = float(limits.top[SWAY, 0 if across > 0 else 1])
        stems = "thrust in sway can stem" if aside >= pushed else "it stems sideways and stays level"
        yield Finding(f"{name}: {abs(across):.2g} m/s of {flow} run across it, more than the {aside:.2g} m/s that "
                      f"{stems}", "it turns its bow into the current" if turns else
                      "looking along the leg it is swept off; lay the leg along the current", False)  # fmt: skip


def _stops(limits: Limits, leg: _Leg) -> Iterator[Finding]:
    """Room to stop and to turn, against the acceptance."""
    speed, accepted = min(leg.point.speed or 0.0, float(limits.top[SURGE, 1])), leg.point.acceptance or math.inf
    room, way = limits.turning_room(speed), limits.stopping(speed)
    if max(leg.length, accepted) < way < math.inf:
        what = f"{leg.name}: from {speed:.2g} m/s it takes {way:.2g} m to stop, and the leg has {leg.length:.2g} m"
        yield Finding(what, "it is flown slower; leave more room", False)
    if room > TURNING * accepted:
        turns = f"without thrust in sway it turns within {room / TURNING:.2g} m at {speed:.2g} m/s"
        what = f"{leg.name}: {turns}, and the acceptance is {accepted:.2g} m"
        yield Finding(what, f"raise the acceptance to {_up(room)} m, or fly slower", False)


def _up(value: float) -> float:
    return round(0.1 * math.ceil(10.0 * value), 1)


def _held_heading(
    limits: Limits, leg: _Leg, current: Float[np.ndarray, "2"], flow: str, ahead: float, would_turn: str
) -> Iterator[Finding]:
    """Whether a place can be held with the heading that is asked for.

    `ahead` is its speed if it gives the heading up by itself, or 0; `would_turn`: as of `_would_turn`.
    """
    psi = math.radians(leg.point.heading_deg or 0.0)
    stem = -heading_rotation(psi).T @ current[:2]  # through the water, in b
    sides = [1 if stem[axis] > 0 else 0 for axis in (SURGE, SWAY)]
    has = [float(limits.through[axis, sides[axis]]) for axis in (SURGE, SWAY)]
    short = [axis for axis in (SURGE, SWAY) if abs(stem[axis]) > max(has[axis], SOME)]
    if not short:
        return
    axis, into = short[0], math.degrees(math.atan2(-current[1], -current[0])) % 360
    name, turned, takes, gives = ("surge", "sway")[axis], ("pitch", "roll")[axis], abs(float(stem[axis])), has[axis]
    thrust = float(limits.top[axis, sides[axis]])
    tips = 0.0 < gives < thrust
    if tips:
        cannot = (
            f"it stays level up to {gives:.2g} m/s in {name} (Munk's moment in {turned}); thrust would give "
            f"{thrust:.2g} m/s"
        )
    else:
        cannot = f"no thrust in {name}" if gives <= 0.0 else f"its top speed in {name} is {gives:.2g} m/s"
    what = (
        f"{leg.name}: {flow} cannot be stemmed heading {leg.point.heading_deg:g} deg: {takes:.2g} m/s in {name}, and "
    )
    if np.hypot(*current) < ahead:
        yield Finding(what + cannot, f"the heading is given up: it looks into the current ({into:.0f} deg)", False)
    else:
        instead = f"wait for less current, or {'raise BG' if tips else 'give it more thrust'}"
        if np.hypot(*current) < float(limits.through[SURGE, 1]) and limits.can(YAW):
            looks = f"ask for a heading near {into:.0f} deg, into the current, or leave it out"
            instead = f"{_KEEPS.format(would_turn)}, or {looks}" if would_turn else f"{looks}, or {instead}"
        yield Finding(what + cannot, instead, True)


def _in_tank(limits: Limits, legs: list[_Leg], world: WorldSection) -> Iterator[Finding]:
    """Whether a tank is long enough to stop in."""
    if world.tank is None:
        return
    room = max(world.tank.north[1] - world.tank.north[0], world.tank.east[1] - world.tank.east[0])
    speed = min(max(leg.point.speed or 0.0 for leg in legs), float(limits.top[SURGE, 1]))
    way = limits.stopping(speed)
    if way < math.inf and 2.0 * way + limits.length > room:
        what = f"from {speed:.2g} m/s it takes {way:.2g} m to stop, and the tank is {room:.2g} m long"
        yield Finding(what, "write slower way-points", False)


def _fixes_std(scenario: Scenario, sensors: dict[str, Sensor] | None) -> float:
    """Of a horizontal position fix [m]; 0 with a Doppler log on board, which tells a fix's error from a motion."""
    if sensors is not None and together(sensors, "dvl"):
        return 0.0
    fixes, given = together(sensors or {}, "position"), scenario.sensors.by_name["position"].noise
    return (fixes[0] if fixes else 0.0) or (SENSORS["position"].std if given is None else float(np.max(given)))


def _tilted(
    legs: list[_Leg], scenario: Scenario, model: Model, known_world: bool, fixes_std: float
) -> Iterator[Finding]:
    """Roll and pitch as a dive begins: beyond half of the attitude limit, or at a speed that somebody asked for.

    At the vehicle's own speed they belong to its dive: the autopilot chose it, and limits it by `level_speed.TILT`.
    """
    section = scenario.autopilot
    if isinstance(section, ThesisSection):
        return  # dives as fast as its gains happen to
    deepest = max(legs, key=lambda leg: abs(leg.down))
    if abs(deepest.down) < size(model):
        return
    current = current_at(scenario.world, deepest.depth) if known_world else np.zeros(2)
    flow = heading_rotation(deepest.direction).T @ current[:2]
    dive = section.control.dive_speed
    limit = scenario.autopilot.supervisor.attitude_limit_deg.limit or math.degrees(RULES["attitude limit"].limit)
    angles = np.degrees(tilts(model, flow, dive, fixes_std))
    most = 0.5 * limit if dive is None else min(TILTED, 0.5 * limit)
    angles_text = [f"{name} by up to {angle:.0f} deg" for name, angle in zip(("roll", "pitch"), angles, strict=True)
            if angle > most]  # fmt: skip
    if angles_text:
        fast = VehicleScales.of(model).dive_speed if dive is None else dive
        water = f" in a current of {np.hypot(*flow):.2g} m/s" if np.hypot(*flow) > SOME else ""
        yield Finding(
            f"the dive to {deepest.name}: at {fast:.2g} m/s{water} it is expected to {' and '.join(angles_text)} "
            f"as it begins (Munk's moment; attitude limit {limit:.0f} deg)",
            "dive slower (autopilot.control.dive_speed), raise BG, or give it thrust in roll and pitch", False,
        )  # fmt: skip


def _over_nothing(legs: list[_Leg], world: WorldSection) -> Iterator[Finding]:
    """Altitudes over a floor that is not there, whoever carries the altimeter: no echo would ever come."""
    for leg in legs:
        if leg.point.altitude and world.floor is None:
            what = f"{leg.name}: an altitude of {leg.point.altitude:g} m is requested, and the world has no floor"
            yield Finding(what, "set world.floor to its depth [m], or leave the altitude out", True)


def _unseen(scenario: Scenario) -> Iterator[Finding]:
    """A rule of the supervisor that somebody asked for, and that nothing simulated could call."""
    for key in ("battery_low", "battery_critical"):
        rule = getattr(scenario.autopilot.supervisor, key)
        if scenario.battery is None and (rule.limit is not None or rule.action not in (None, "ignore")):
            what = f"autopilot.supervisor.{key}: no battery is simulated, so that it could never act"
            yield Finding(what, "set battery to true, or leave the rule out", True)


def _once(found: list[Finding]) -> list[Finding]:
    """What is said of several way-points in the same words but for their number, once, with the other numbers."""
    kept: dict[Any, list[tuple[Finding, str]]] = {}
    for finding in found:
        _, _, rest = finding.what.rpartition("way-point ")
        number, _, words = rest.partition(":")
        kept.setdefault((words or rest, finding.instead), []).append((finding, number))
    return [_of_all(*alike) for alike in kept.values()]


def _of_all(first: tuple[Finding, str], *others: tuple[Finding, str]) -> Finding:
    """A finding that names the way-points of which the same was found."""
    finding, own = first
    points = sorted({int(number) - 1 for _, number in others if number.isdigit() and number != own})
    return replace(finding, instead=f"{finding.instead} (likewise {counted(points)})") if points else finding
