"""Why a mission does not get on, in words: where it stalled, what was asked of the thrusters, what to change.

The vehicle makes headway towards a way-point while its distance, on a dive its depth error, on a turn its heading
error, goes on reaching new lows. It stalls where for PATIENCE lengths of the vehicle at the leg's speed there is none.
What pushes it is `pushes`' business.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Shaped

from rovtwin.core.arrays.rotations import wrapped
from rovtwin.core.flow import DIVE, GO, HOLD, PAUSED, PILOTED, TURN
from rovtwin.core.user_files.quantity import plain
from rovtwin.runs.feasibility.mission import baseline_of_another
from rovtwin.runs.limits import Limits, compass_point
from rovtwin.runs.scoring.pushes import FELT, disturbance, explained, lifted, pushed
from rovtwin.runs.scoring.scores import Flown
from rovtwin.scenario.schema import Scenario, ThesisSection, Waypoint
from rovtwin.vehicle import Model, Vehicle

PATIENCE = 20.0  # lengths of the vehicle at the leg's speed
HEADWAY = 0.25  # of a length, of a turn as many radians: a smaller step is no headway
LIMIT = 0.9  # share of a limit from which thrust counts as used up
TILTED = math.radians(15.0)  # mean roll or pitch that explains something
DEEP, AIMED = (
    0.16,
    0.1,
)  # errors at which a dive is complete: lengths of the vehicle, radians (`gnc.guidance.path_following`)
BEFORE = 5.0  # what tips a vehicle has its effect within this time [s]
SPARE, SETTLING = 1.2, 10.0  # of a proposed duration: times what is left, and more [s]
SURGE, PITCH = 0, 4
MOVING = (GO, DIVE, TURN)


@dataclass(frozen=True)
class Stall:
    """A stretch of a run without headway.

    Attributes:
        start, end: [s].
        waypoint: Index of the one aimed at.
        phase: One of MOVING.
        nearest: Least distance [m] or angle [rad] in it.
        patience: Time without headway after which it counted as one [s].
    """

    start: float
    end: float
    waypoint: int
    phase: int
    nearest: float
    patience: float


def stalls(flown: Flown, scenario: Scenario, model: Model) -> list[Stall]:
    """Stretches of a mission without headway, in order of time."""
    found, length = [], Limits.of(model).length
    for rows, phase, waypoint in _stretches(flown):
        point = scenario.waypoints[min(waypoint, len(scenario.waypoints) - 1)]
        step = HEADWAY if phase == TURN else HEADWAY * length
        patience = PATIENCE * length / (point.speed or 1.0)
        left, t = _left(flown, rows, phase), flown.t[rows]
        lowest = np.floor(np.minimum.accumulate(left) / step)
        changes = np.flatnonzero(np.diff(lowest, prepend=lowest[0] + 1.0))
        ends = np.append(changes[1:], len(t) - 1)
        for a, b in zip(changes, ends, strict=True):
            if t[b] - t[a] > patience:
                nearest = float(left[a : b + 1].min())
                found.append(Stall(float(t[a]), float(t[b]), waypoint, phase, nearest, patience))
    return found


def _stretches(flown: Flown) -> Iterator[tuple[slice, int, int]]:
    """Samples, phase and way-point of each stretch on its way somewhere."""
    state = flown.mode[:, [0, 2]].astype(int)
    starts = np.flatnonzero(np.any(np.diff(state, axis=0, prepend=-1), axis=1))
    for a, b in zip(starts, np.append(starts[1:], len(state)), strict=True):
        if state[a, 0] in MOVING and b - a > 1:
            yield slice(a, b), int(state[a, 0]), int(state[a, 1])


def _left(flown: Flown, rows: slice, phase: int) -> Float[np.ndarray, " n"]:
    """What is left to go in a phase, by the estimate [m or rad]."""
    eta, leg = flown.eta_hat[rows], flown.leg[rows]
    if phase == DIVE:
        return np.abs(eta[:, 2] - leg[:, 5])
    if phase == TURN and flown.setpoint is not None:
        return _aside(flown, rows)
    return np.hypot(*(eta[:, :2] - leg[:, 3:5]).T)


def _aside(flown: Flown, rows: slice | Shaped[np.ndarray, " rows"]) -> Float[np.ndarray, " n"]:
    """Heading error, as a size [rad]; 0 where no set-point was logged."""
    if flown.setpoint is None:
        return np.zeros(len(flown.t[rows]))
    return np.abs(wrapped(flown.eta_hat[rows, 5] - flown.setpoint[rows, 5]))


def unfinished(flown: Flown, scenario: Scenario, model: Model, vehicle: Vehicle) -> str:
    """Why a mission that was not completed, and that no rule ended, is where it is; one sentence."""
    phase, waypoint = int(flown.mode[-1, 0]), int(flown.mode[-1, 2])
    if phase in (PAUSED, PILOTED):
        return f"{'paused' if phase == PAUSED else 'flown by hand'} at the end; nobody asked it to resume the mission"
    if not scenario.waypoints:
        return "the test is longer than that"
    last = [stall for stall in stalls(flown, scenario, model) if stall.end >= flown.t[-1] - 1e-6]
    if last:
        return f"{_numbered(waypoint, scenario)} was not reached: {cause(last[-1], flown, scenario, model, vehicle)}"
    return _under_way(flown, scenario, phase, waypoint)


def _numbered(waypoint: int, scenario: Scenario) -> str:
    return f"way-point {waypoint + 1} of {len(scenario.waypoints)}"


def _under_way(flown: Flown, scenario: Scenario, phase: int, waypoint: int) -> str:
    """It makes headway, and the time is too short: how far it is, and how long it would take."""
    at = flown.eta_hat[-1]
    where = "at" if phase == HOLD else "diving at" if phase == DIVE else "on its way to"
    clauses = f"{where} {_numbered(waypoint, scenario)}, ({at[0]:.1f}, {at[1]:.1f}) at {at[2]:.1f} m depth"
    seconds = _seconds_left(flown, scenario, phase, waypoint)
    enough = 10.0 * math.ceil((flown.duration + SPARE * seconds + SETTLING) / 10.0)
    return f"{clauses}; what is left takes about {seconds:.0f} s more: raise duration to {enough:.0f}"


def _seconds_left(flown: Flown, scenario: Scenario, phase: int, waypoint: int) -> float:
    """What is left of a mission at the way-points' speeds, and at the pace on the legs so far if that is slower [s]."""
    on_leg = flown.mode[:, 3] > 0.5
    made = float(np.mean(np.hypot(flown.nu_hat[on_leg, 0], flown.nu_hat[on_leg, 1]))) if on_leg.sum() > 50 else np.inf
    places = [np.asarray(w.placed(scenario.origin)) for w in scenario.waypoints[waypoint:]]
    before, seconds = flown.eta_hat[-1, :3], 0.0
    for i, (place, point) in enumerate(zip(places, scenario.waypoints[waypoint:], strict=True)):
        if i or phase != HOLD:
            seconds += float(np.linalg.norm(place - before)) / max(min(point.speed, made), 0.01)
        before = place
        held = float(np.sum(flown.mode[:, 0] == HOLD)) * float(np.median(np.diff(flown.t))) if i == 0 else 0.0
        seconds += max(point.hold_time - (held if phase == HOLD else 0.0), 0.0)
    return seconds


def cause(stall: Stall, flown: Flown, scenario: Scenario, model: Model, vehicle: Vehicle | None = None) -> str:
    """Where the vehicle was, what was asked of its thrusters, what pushes it, and, of a vehicle, what would help."""
    rows = (flown.t >= stall.start - 1e-9) & (flown.t <= stall.end + 1e-9)
    point = scenario.waypoints[min(stall.waypoint, len(scenario.waypoints) - 1)]
    clauses = [_place(stall, flown, rows, point, model), _asked(stall, flown, rows, model)]
    vertical = _vertical(stall, flown, rows, model)
    clauses += [
        lifted(flown, rows, model) if vertical else pushed(flown, rows, model),
        _tilted(flown, rows),
        _misled(flown, rows, point),
    ]
    text = "; ".join(part for part in clauses if part)
    return f"{text}: {_advice(stall, flown, rows, scenario, model, point, vehicle)}" if vehicle else text


def _place(stall: Stall, flown: Flown, rows: Shaped[np.ndarray, " rows"], point: Waypoint, model: Model) -> str:
    """Where it was, and how near it came."""
    eta, leg = flown.eta_hat[rows], flown.leg[rows][-1]
    began = f"from {stall.start:.0f} s the vehicle"
    if stall.phase == DIVE:
        off, named = float(np.mean(eta[:, 2])) - leg[5], _axes(stall, flown, rows, model)
        deep = f"stayed {plain(abs(off))} m {'below' if off > 0 else 'above'} its depth of {plain(leg[5], 3)} m"
        turned = f"{math.degrees(np.mean(_aside(flown, rows))):.0f} deg off the heading of the leg"
        if _YAW not in named:
            return f"{began} {deep}"
        return f"{began} {deep}, {turned}" if _HEAVE in named else f"{began} was at its depth and stayed {turned}"
    if stall.phase == TURN:
        return f"{began} came no nearer than {math.degrees(stall.nearest):.0f} deg to the heading of the leg"
    off, x, y = eta[:, :2].mean(axis=0) - leg[3:5], *eta[:, :2].mean(axis=0)
    reach, accepted = float(np.hypot(*eta[:, :2].std(axis=0))), f"acceptance {point.acceptance:g} m"
    if reach > max(float(np.hypot(*off)), 4.0 * (point.acceptance or 0.0)):
        near = f"came no nearer than {plain(stall.nearest)} m ({accepted})"
        return f"{began} went to and fro within {plain(reach)} m (rms) and {near}"
    if _leaves(eta, point, model):
        off, (x, y) = eta[-1, :2] - leg[3:5], eta[-1, :2]
        side = compass_point(math.atan2(off[1], off[0]))
        went = f"{began} went away, to {plain(float(np.hypot(*off)))} m {side} of it at {stall.end:.0f} s"
        return f"{went}, at ({x:.1f}, {y:.1f}); no nearer than {plain(stall.nearest)} m ({accepted})"
    side = compass_point(math.atan2(off[1], off[0]))
    near = f"{began} stayed {plain(float(np.hypot(*off)))} m {side} of it at ({x:.1f}, {y:.1f})"
    return f"{near}, no nearer than {plain(stall.nearest)} m ({accepted})"


def _leaves(eta: Float[np.ndarray, "n 6"], point: Waypoint, model: Model) -> bool:
    """Whether a vehicle went further in one direction, between the first and last quarter, than it moved about."""
    quarter = max(len(eta) // 4, 1)
    first, last = eta[:quarter, :2], eta[-quarter:, :2]
    way = float(np.hypot(*(last.mean(axis=0) - first.mean(axis=0))))
    about = float(np.hypot(*np.vstack([first - first.mean(axis=0), last - last.mean(axis=0)]).std(axis=0)))
    return way > max(2.0 * about, Limits.of(model).length, 2.0 * (point.acceptance or 0.0))


def _asked(stall: Stall, flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model) -> str:
    """Mean force or moment that was asked of each axis in question, of what it has."""
    if flown.tau is None:
        return ""
    clauses, limits = [], Limits.of(model)
    for axis, name, unit in _axes(stall, flown, rows, model):
        has, mean = limits.both_ways(axis), float(np.mean(np.abs(flown.tau[rows, axis])))
        clauses.append(f"no thrust in {name}" if has <= 0.0 else f"{mean:.2g} of {has:.3g} {unit} in {name}")
    return "asked for " + ", ".join(clauses)


_HEAVE, _YAW = (2, "heave", "N"), (5, "yaw", "N m")


def _axes(stall: Stall, flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model) -> list[tuple[int, str, str]]:
    """Axes in question: number, name, unit. A dive waits for its depth and for the heading of the leg behind it."""
    if stall.phase == TURN:
        return [_YAW]
    if stall.phase != DIVE:
        return [(0, "surge", "N"), (1, "sway", "N")]
    off = abs(float(np.mean(flown.eta_hat[rows, 2]) - flown.leg[rows][-1, 5]))
    deep = off > DEEP * Limits.of(model).length
    turned = float(np.mean(_aside(flown, rows))) > AIMED
    return [_HEAVE] * (deep or not turned) + [_YAW] * turned


def _vertical(stall: Stall, flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model) -> bool:
    """Whether it is the depth alone that does not get on: no current is to blame for that."""
    return stall.phase == DIVE and _YAW not in _axes(stall, flown, rows, model)


def _tilted(flown: Flown, rows: Shaped[np.ndarray, " rows"]) -> str:
    mean = dict(zip(("roll", "pitch"), flown.eta_hat[rows, 3:5].mean(axis=0), strict=True))
    tilts = [f"a {name} of {math.degrees(angle):.0f} deg" for name, angle in mean.items() if abs(angle) > TILTED]
    return f"it lay at {' and '.join(tilts)}" if tilts else ""


def _misled(flown: Flown, rows: Shaped[np.ndarray, " rows"], point: Waypoint) -> str:
    """Where the truth is known: by how much the filter was wrong, if that alone would explain it."""
    error = float(np.mean(np.hypot(*(flown.eta_hat - flown.eta)[rows, :2].T)))
    return f"the filter was wrong by {plain(error)} m" if error > 2.0 * max(point.acceptance or 0.0, 0.25) else ""


def _advice(
    stall: Stall,
    flown: Flown,
    rows: Shaped[np.ndarray, " rows"],
    scenario: Scenario,
    model: Model,
    point: Waypoint,
    vehicle: Vehicle,
) -> str:
    """What to change, the likeliest first."""
    spent = _spent(stall, flown, rows, model)
    if spent:
        more = "less buoyancy or weight (rovtwin vehicle ballast)" if "heave" in spent else "a weaker current"
        return f"thrust in {' and '.join(spent)} is used up; it takes {more}, or stronger thrusters"
    if isinstance(scenario.autopilot, ThesisSection):
        weak = "the Double Blueye's" if baseline_of_another(scenario, vehicle) else "too weak for it here"
        return f"the gains of this baseline are {weak}; fly it with autopilot model_based"
    limits, flow = Limits.of(model), float(np.hypot(*disturbance(flown, rows, model)[1]))
    vertical = _vertical(stall, flown, rows, model)
    known = explained(flown, rows, model)
    if known is False and flow > FELT and not vertical:
        return "check its thrusters one by one, and its tether (rovtwin watch compares its forces with other runs)"
    if FELT < limits.through_water < flow and not vertical:
        why = "to stay level" if limits.through_water < float(limits.top[:2].max()) else "with all its thrust"
        less = "wait for less current" if known else "wait for less current, or check its thrusters"
        return f"it goes no faster than {limits.through_water:.2g} m/s through the water {why}: {less}"
    if vertical:
        return "check its heave thrusters and its weight and buoyancy (rovtwin vehicle show, rovtwin vehicle ballast)"
    if stall.phase != GO:
        return "raise duration, or look at the trim of the vehicle (rovtwin vehicle show)"
    wider = 0.1 * math.ceil(10.0 * 1.2 * stall.nearest)
    raised = f"raise the way-point's acceptance to {wider:.1f} m"
    if not limits.can(1):
        return f"without thrust in sway it comes nearer only bow first; {raised}, or leave more room before it"
    return f"{raised}, or its speed"


def _spent(stall: Stall, flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model) -> list[str]:
    """Names of the axes on which nearly all of the thrust was asked for, on average."""
    if flown.tau is None:
        return []
    mean, limits = np.abs(flown.tau[rows]).mean(axis=0), Limits.of(model)
    names = [(axis, name) for axis, name, _ in _axes(stall, flown, rows, model) if limits.can(axis)]
    return [name for axis, name in names if mean[axis] > LIMIT * limits.both_ways(axis)]
