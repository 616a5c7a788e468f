"""The supervisor's state machine and every one of its rules: that it acts, when, with what cause, and who ends it."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import estimate_of

from rovtwin.core import flow
from rovtwin.core.block import Start
from rovtwin.core.flow import (
    ABORT,
    ARM,
    NO_REASON,
    NO_REQUEST,
    NOT_A_NUMBER,
    OPERATOR,
    PAUSE,
    PILOT,
    REASONS,
    RESUME,
    Host,
    Slot,
)
from rovtwin.core.frames import quaternion_multiply
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.interfaces import (
    MODE_ABORTED,
    MODE_HOLDING,
    MODE_IDLE,
    MODE_PAUSED,
    MODE_PILOTED,
    MODE_RETURNING,
    MODE_RUNNING,
    MODE_SURFACING,
    Mode,
)
from rovtwin.gnc.safety.control_authority import FINE, HEAVE_LOST, UNABLE
from rovtwin.gnc.safety.rules import ACTIONS, RULES, VITAL, Rules, SupervisorInput, inside
from rovtwin.gnc.safety.supervisor import Supervisor

DT = 0.5
FENCE = [[-20.0, -20.0], [20.0, -20.0], [20.0, 20.0], [-20.0, 20.0]]
LIMITS = {
    "depth limit": 20.0,
    "attitude limit": 0.8,
    "estimate lost": 3.0,
    "geofence": 15.0,
    "altitude limit": 1.0,
    "off course": 4.0,
    "off depth": 2.0,
}
SHARES = [2.0, 1.0, 2.0, np.inf, np.inf, 0.5]
CHANGES = {name: RULES[name]._replace(limit=limit) for name, limit in LIMITS.items()}
SUPERVISOR = Supervisor(Rules.of(CHANGES, FENCE, SHARES))
STEP = jax.jit(lambda supervisor, memory, input: supervisor.step(memory, input, DT))
EMPTY = {name: Slot.empty(1, size) for name, size in (("altimeter", 1), ("battery", 2), ("leak", 1), ("position", 2))}


def at(std=0.01, **changes):
    eta = {"x": 1, "y": 2, "z": 3, "phi": 0.1, "theta": -0.1, "psi": 3.0} | changes
    made = estimate_of(list(eta.values()), std=std)
    # A position is accepted in every tick, as well as the filter says.
    received = jnp.asarray([0.0, 0.0, 0.0, 2.0])
    return dataclasses.replace(made, nis=received, nis_dof=received)


def reading(name, value):
    slot = EMPTY[name]
    return {name: Slot(slot.value.at[0, 0].set(value), ~slot.valid, slot.t_valid)}


def watched(
    request=NO_REQUEST,
    estimate=None,
    readings=None,
    host=None,
    shortfall=None,
    ability=FINE,
    saturated=False,
    desired_position=None,
):
    return SupervisorInput(
        at() if estimate is None else estimate,
        jnp.asarray(request),
        EMPTY | (readings or {}),
        Host() if host is None else host,
        jnp.zeros(6) if shortfall is None else jnp.asarray(shortfall),
        jnp.asarray(ability),
        jnp.broadcast_to(jnp.asarray(saturated), 6),
        jnp.full(3, jnp.nan) if desired_position is None else jnp.asarray(desired_position),
    )


def begun(mode=MODE_RUNNING, reason=NO_REASON, supervisor=SUPERVISOR):
    memory = supervisor.init(jax.random.key(0), Start.at())
    return dataclasses.replace(memory, mode=Mode(jnp.asarray(mode), jnp.asarray(reason)))


def go_on(memory, input, seconds=DT, supervisor=SUPERVISOR):
    """Memory, mode and reason after so long."""
    for _ in range(round(seconds / DT)):
        memory, output = STEP(supervisor, memory, input)
    return memory, int(output.mode), int(output.reason)


def ask(mode, request=NO_REQUEST, reason=NO_REASON, **others):
    return go_on(begun(mode, reason), watched(request, **others))[1:]


REQUESTS = (NO_REQUEST, PAUSE, RESUME, ABORT, ARM, PILOT)
TABLE = {
    MODE_IDLE: (MODE_RUNNING, MODE_IDLE, MODE_RUNNING, MODE_ABORTED, MODE_PAUSED, MODE_PILOTED),
    MODE_RUNNING: (MODE_RUNNING, MODE_PAUSED, MODE_RUNNING, MODE_ABORTED, MODE_RUNNING, MODE_PILOTED),
    MODE_PILOTED: (MODE_PILOTED, MODE_PAUSED, MODE_RUNNING, MODE_ABORTED, MODE_PILOTED, MODE_PILOTED),
    MODE_PAUSED: (MODE_PAUSED, MODE_PAUSED, MODE_RUNNING, MODE_ABORTED, MODE_PAUSED, MODE_PILOTED),
}
CASES = [(mode, request, after) for mode in TABLE for request, after in zip(REQUESTS, TABLE[mode], strict=True)]


@pytest.mark.parametrize(("mode", "request_", "after"), CASES)
def test_what_the_operator_may_do(mode, request_, after):
    assert ask(mode, request_) == (after, OPERATOR if after == MODE_ABORTED else NO_REASON)


FAIL_SAFE = (MODE_HOLDING, MODE_RETURNING, MODE_SURFACING, MODE_ABORTED)


@pytest.mark.parametrize("mode", FAIL_SAFE)
@pytest.mark.parametrize("request_", [NO_REQUEST, PAUSE, RESUME, PILOT])
def test_nothing_but_arm_ends_a_fail_safe(mode, request_):
    assert ask(mode, request_, reason=flow.LEAK) == (mode, flow.LEAK)


@pytest.mark.parametrize("mode", FAIL_SAFE)
def test_arm_leads_to_paused_once_the_cause_is_over(mode):
    memory, after, reason = go_on(begun(mode, flow.DEPTH_LIMIT), watched(ARM))
    assert (after, reason) == (MODE_PAUSED, NO_REASON)
    assert go_on(memory, watched(RESUME))[1:] == (MODE_RUNNING, NO_REASON)
    deep = watched(ARM, at(z=20.1))
    assert go_on(begun(mode, flow.DEPTH_LIMIT), deep)[1] == MODE_ABORTED, "still too deep"


def test_arm_overrules_a_rule_that_still_applies_until_it_has_ceased_once():
    """Near the floor a vehicle holds; the operator has to be able to fly it away from there."""
    low, clear = TRIGGERS["altitude limit"]
    memory, mode, _ = go_on(begun(), low, 2.0)
    assert mode == MODE_HOLDING
    memory, mode, reason = go_on(memory, dataclasses.replace(low, request=jnp.asarray(ARM)))
    assert (mode, reason) == (MODE_PAUSED, NO_REASON)
    memory, mode, _ = go_on(memory, dataclasses.replace(low, request=jnp.asarray(RESUME)), 5.0)
    assert mode == MODE_RUNNING
    memory, mode, _ = go_on(memory, clear, 2.0)
    assert go_on(memory, low, 2.0)[1] == MODE_HOLDING, "it counts again"


def test_other_rules_count_while_one_is_overruled():
    low, leak = TRIGGERS["altitude limit"][0], TRIGGERS["leak"][0]
    memory, _, _ = go_on(begun(), low, 2.0)
    memory, mode, _ = go_on(memory, dataclasses.replace(low, request=jnp.asarray(ARM)))
    both = dataclasses.replace(low, measurements=low.measurements | reading("leak", 1.0))
    assert mode == MODE_PAUSED and go_on(memory, both, 2.0)[1:] == (MODE_SURFACING, flow.LEAK) and leak


@pytest.mark.parametrize("name", ["leak", "link lost", "operator silent", "battery low", "saturated", "geofence"])
def test_while_idle_no_rule_starts_a_thruster(name):
    """On deck, in somebody's hands."""
    waiting = dataclasses.replace(TRIGGERS[name][0], request=jnp.asarray(PAUSE))
    assert go_on(begun(MODE_IDLE), waiting, 60.0)[1:] == (MODE_IDLE, NO_REASON)


def test_while_idle_no_position_is_missed():
    refused = dataclasses.replace(at(), nis=jnp.zeros(4), nis_dof=jnp.zeros(4))
    memory, mode, _ = go_on(begun(MODE_IDLE), watched(PAUSE, refused), 200.0)
    assert mode == MODE_IDLE and go_on(memory, watched(estimate=refused), 10.0)[1] == MODE_RUNNING


def test_near_the_floor_on_its_way_home_it_goes_up():
    assert go_on(begun(MODE_RETURNING, flow.BATTERY_LOW), TRIGGERS["altitude limit"][0], 2.0)[1] == MODE_SURFACING


def pitched(pitch_deg, roll_deg=0.0):
    """Turned about the pitch axis, then about the roll axis."""
    pitch, roll = np.radians([pitch_deg, roll_deg])
    about_y = jnp.array([np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0])
    about_x = jnp.array([np.cos(roll / 2), np.sin(roll / 2), 0.0, 0.0])
    return watched(estimate=dataclasses.replace(at(), attitude=quaternion_multiply(about_y, about_x)))


def test_the_attitude_limit_is_of_the_tilt_also_beyond_a_pitch_of_ninety_degrees():
    """A roll of Euler angles is 45 degrees at a pitch of 89 and 1 degree of noise, and turns over beyond 90."""
    rule = RULES["attitude limit"]._replace(limit=np.radians(100.0))
    supervisor = Supervisor(Rules.of({"attitude limit": rule}))
    for pitch, roll in ((85.0, 1.0), (89.0, 1.0), (90.0, 0.0), (95.0, 3.0), (-99.0, 0.0), (0.0, 99.0)):
        assert go_on(begun(), pitched(pitch, roll), DT, supervisor)[1] == MODE_RUNNING, pitch
    for pitch, roll in ((101.0, 0.0), (-101.0, 2.0), (179.0, 0.0), (0.0, -101.0), (0.0, 180.0)):
        assert go_on(begun(), pitched(pitch, roll), DT, supervisor)[1] == MODE_ABORTED, pitch


def test_roll_and_pitch_together_tilt_by_more_than_either():
    assert go_on(begun(), pitched(40.0, 40.0))[1] == MODE_ABORTED  # 54 degrees of 46
    assert go_on(begun(), pitched(30.0, 30.0))[1] == MODE_RUNNING  # 41


def test_a_negative_variance_is_no_knowledge():
    broken = eqx.tree_at(lambda e: e.covariance, at(), -jnp.eye(12))
    assert ask(MODE_RUNNING, estimate=broken) == (MODE_ABORTED, flow.ESTIMATE_LOST)


# Rule: what calls it (a SupervisorInput), and what just does not.
SHORT = [0.0, 1.1, 0.0, 0.0, 0.0, 0.0]
CUT, ROLL = np.arange(6) == 2, np.arange(6) == 3
TRIGGERS = {
    "depth limit": (watched(estimate=at(z=20.1)), watched(estimate=at(z=19.9))),
    "attitude limit": (watched(estimate=at(theta=-0.81)), watched(estimate=at(theta=-0.79))),
    "estimate lost": (watched(estimate=at(std=3.1)), watched(estimate=at(std=2.9))),
    "leak": (watched(readings=reading("leak", 1.0)), watched(readings=reading("leak", 0.0))),
    "battery critical": (watched(readings=reading("battery", 0.09)), watched(readings=reading("battery", 0.11))),
    "battery low": (watched(readings=reading("battery", 0.19)), watched(readings=reading("battery", 0.21))),
    "thruster failed": (watched(ability=UNABLE), watched(ability=FINE)),
    "saturated": (watched(saturated=CUT), watched(saturated=ROLL, shortfall=[1.9, 0.9, 1.9, 99.0, 99.0, 0.4])),
    "link lost": (watched(host=Host(link_age=jnp.asarray(5.1))), watched(host=Host(link_age=jnp.asarray(4.9)))),
    "deadline missed": (watched(host=Host(lateness=jnp.asarray(6.0))), watched(host=Host(lateness=jnp.asarray(0.9)))),
    "operator silent": (
        watched(host=Host(operator_age=jnp.asarray(61.0))),
        watched(host=Host(operator_age=jnp.asarray(59.0))),
    ),
    "geofence": (watched(estimate=at(x=12.0, y=9.1)), watched(estimate=at(x=12.0, y=8.9))),
    "altitude limit": (watched(readings=reading("altimeter", 0.9)), watched(readings=reading("altimeter", 1.1))),
    # Of 0.01 m of standard deviation three are added: at (1, 2, 3).
    "off course": (watched(desired_position=[4.3, 4.5, 3.0]), watched(desired_position=[4.1, 4.5, 9.0])),
    "off depth": (watched(desired_position=[1.0, 2.0, 5.1]), watched(desired_position=[9.0, 2.0, 4.9])),
}
RUNNING_OUT = {
    "positions lost",
    "filter diverged",
    "time out",
    "not a number",
    "operator",
    "sensor silent",
    "no way home",
}


def only(name, action=None):
    """A supervisor with this rule alone."""
    rule = CHANGES.get(name, RULES[name])
    others = {other: rule._replace(action="ignore") for other, rule in RULES.items() if other != name}
    return Supervisor(Rules.of(others | {name: rule._replace(action=action or rule.action)}, FENCE, SHARES))


def test_every_rule_has_a_test():
    assert set(TRIGGERS) | RUNNING_OUT == set(RULES) == set(REASONS[1:])


@pytest.mark.parametrize("name", list(TRIGGERS))
def test_a_rule_acts_after_its_time_and_latches(name):
    input, fine = TRIGGERS[name]
    rule, supervisor = CHANGES.get(name, RULES[name]), only(name)
    expected = MODE_PAUSED + ACTIONS.index(rule.action)
    assert go_on(begun(), fine, rule.after + 10.0, supervisor)[1:] == (MODE_RUNNING, NO_REASON)
    if rule.after >= DT:
        assert go_on(begun(), input, rule.after, supervisor)[1:] == (MODE_RUNNING, NO_REASON), "too soon"
    memory, mode, reason = go_on(begun(), input, rule.after + 2 * DT, supervisor)
    assert (mode, REASONS[reason]) == (expected, name)
    assert go_on(memory, fine, 5.0, supervisor)[1:] == (expected, reason), "it went back by itself"


@pytest.mark.parametrize("name", list(TRIGGERS))
def test_a_rule_can_be_ignored_or_answered_otherwise(name):
    input, _ = TRIGGERS[name]
    for action in ACTIONS:
        _, mode, _ = go_on(begun(), input, RULES[name].after + 2 * DT, only(name, action))
        expected = MODE_RUNNING if action == "ignore" else MODE_PAUSED + ACTIONS.index(action)
        if (name, action) == ("altitude limit", "return"):
            expected = MODE_SURFACING  # home along the floor is no way
        assert mode == expected


@pytest.mark.system
@pytest.mark.parametrize("name", VITAL)
def test_a_sensor_that_falls_silent_is_missed_after_3_s_and_one_that_is_not_there_never(name):
    reported = {one: Slot(jnp.zeros((1, 3)), jnp.ones(1, dtype=bool), jnp.zeros(1)) for one in VITAL}
    mute = reported | {name: Slot(jnp.zeros((1, 3)), jnp.zeros(1, dtype=bool), jnp.zeros(1))}
    odd = reported | {name: Slot(jnp.full((1, 3), jnp.nan), jnp.ones(1, dtype=bool), jnp.zeros(1))}
    assert go_on(begun(), watched(readings=odd), 4.0, only("sensor silent"))[1] == MODE_SURFACING
    supervisor = only("sensor silent")
    memory, mode, _ = go_on(begun(), watched(readings=reported), 10.0, supervisor)
    assert mode == MODE_RUNNING
    memory, mode, _ = go_on(memory, watched(readings=mute), 3.0, supervisor)
    assert mode == MODE_RUNNING
    assert go_on(memory, watched(readings=mute), 2 * DT, supervisor)[1:] == (MODE_SURFACING, flow.SENSOR_SILENT)
    assert go_on(memory, watched(readings=reported), 10.0, supervisor)[1] == MODE_RUNNING, "it speaks again"
    assert go_on(begun(), watched(), 10.0, supervisor)[1] == MODE_RUNNING, "there is none on board"


def test_a_return_that_does_not_come_nearer_is_given_up():
    far, near = watched(estimate=at(x=12.0)), watched(estimate=at(x=0.3, y=0.3))
    memory, mode, _ = go_on(begun(MODE_RETURNING, flow.BATTERY_LOW), far, 60.0)
    assert mode == MODE_RETURNING
    assert go_on(memory, far, 3 * DT)[1:] == (MODE_SURFACING, flow.NO_WAY_HOME)
    memory, mode, _ = go_on(memory, watched(estimate=at(x=11.0)), 59.0)
    assert mode == MODE_RETURNING, "it came nearer"
    assert go_on(memory, near, 200.0)[1] == MODE_RETURNING, "it is there"
    assert go_on(begun(), far, 200.0)[1] == MODE_RUNNING, "it does not want to go home"


def path(supervisor, places, expected, mode=MODE_RUNNING, std=0.01):
    """Mode after ticks at these places (n, 3) with set-points (n, 3)."""
    memory = begun(mode, supervisor=supervisor)
    for (x, y, z), place in zip(places, np.broadcast_to(expected, np.shape(places)), strict=True):
        memory, mode, _ = go_on(
            memory, watched(estimate=at(std, x=x, y=y, z=z), desired_position=place), DT, supervisor
        )
    return mode


def line(seconds, speed, start=0.0):
    """Places on a line to the north at 3 m."""
    x = start + speed * DT * np.arange(round(seconds / DT))
    return np.stack([x, 0.0 * x, 3.0 + 0.0 * x], axis=1)


@pytest.mark.system
def test_what_comes_nearer_or_follows_is_not_off_course():
    """Limits: 4 m, 0.5 m nearer within 30 s."""
    rule = only("off course")
    assert path(rule, line(120, -0.2, 30.0), [0.0, 0.0, 3.0]) == MODE_RUNNING, "it comes back"
    assert path(rule, line(90, 0.2), [3.0, 0.0, 3.0]) == MODE_RETURNING, "it is swept on, past its place"
    assert path(rule, line(60, 0.0), line(60, 0.5)) == MODE_RETURNING, "it stays behind"
    assert path(rule, line(120, 0.1), line(120, 0.5)) == MODE_RUNNING, "slow, but it goes where its set-point goes"
    jump = np.concatenate([line(60, 0.0), line(40, 0.0, 20.0), line(120, -0.2, 20.0)])
    assert path(rule, jump[:150], [0.0, 0.0, 3.0]) == MODE_RUNNING, "the position jumped, and it has 30 s"
    far = np.concatenate([line(60, 0.0), line(60, 0.1)])
    away = np.concatenate([np.tile([0.0, 0.0, 3.0], (120, 1)), np.tile([50.0, 0.0, 3.0], (120, 1))])
    assert path(rule, far, away) == MODE_RUNNING, "the next way-point is far off"
    assert path(rule, line(120, 0.0, 9.0), [0.0, 0.0, 3.0], std=2.0) == MODE_RUNNING, "nobody knows where it is"


@pytest.mark.system
@pytest.mark.parametrize("mode", [MODE_HOLDING, MODE_RETURNING])
def test_what_a_fail_safe_cannot_hold_goes_up(mode):
    assert path(only("off course"), line(60, 0.2), [-1.0, 0.0, 3.0], mode) == MODE_SURFACING
    assert path(only("off course", "hold"), line(60, 0.2), [-1.0, 0.0, 3.0], mode) == MODE_SURFACING
    assert path(only("off course", "ignore"), line(60, 0.2), [-1.0, 0.0, 3.0], mode) == mode


def test_positions_that_are_rare_tell_of_a_filter_that_has_diverged():
    """One in ten seconds."""
    off = dataclasses.replace(at(), nis=7.0 * at().nis)
    silent = dataclasses.replace(at(), nis=jnp.zeros(4), nis_dof=jnp.zeros(4))
    memory, mode = begun(), MODE_RUNNING
    for _ in range(6):
        memory, mode, _ = go_on(memory, watched(estimate=off))
        memory, mode, reason = go_on(memory, watched(estimate=silent), 9.5)
    assert (mode, reason) == (MODE_SURFACING, flow.FILTER_DIVERGED)


def test_a_flicker_is_no_trigger():
    input, fine = TRIGGERS["saturated"]
    memory = begun()
    for _ in range(5):
        memory, mode, _ = go_on(memory, input, 20.0)
        memory, mode, _ = go_on(memory, fine)
    assert mode == MODE_RUNNING


def test_a_wrench_that_thrusters_do_not_make_counts_as_saturated():
    assert go_on(begun(), watched(shortfall=SHORT), 32.0, only("saturated"))[1] == MODE_SURFACING


def test_the_graver_action_takes_over_and_stays():
    silent, leak = TRIGGERS["operator silent"][0], TRIGGERS["leak"][0]
    memory, mode, reason = go_on(begun(), silent, 2.0)
    assert (mode, reason) == (MODE_HOLDING, flow.OPERATOR_SILENT)
    memory, mode, reason = go_on(memory, leak, 2.0)
    assert (mode, reason) == (MODE_SURFACING, flow.LEAK)
    memory, mode, reason = go_on(memory, silent, 70.0)
    assert (mode, reason) == (MODE_SURFACING, flow.LEAK)
    assert go_on(memory, watched(estimate=at(z=25.0)))[1:] == (MODE_ABORTED, flow.DEPTH_LIMIT)


def test_of_equals_the_first_reason_counts():
    assert ask(MODE_RUNNING, estimate=at(z=20.1, phi=1.0)) == (MODE_ABORTED, flow.DEPTH_LIMIT)


def test_without_heave_thrusters_stop_instead_of_surfacing():
    assert ask(MODE_RUNNING, ability=HEAVE_LOST) == (MODE_ABORTED, flow.THRUSTER_FAILED)


def test_positions_that_the_filter_does_not_believe_are_lost():
    refused = dataclasses.replace(at(), nis=jnp.zeros(4), nis_dof=jnp.zeros(4))
    memory, mode, _ = go_on(begun(), watched(estimate=refused), 119.0)
    assert mode == MODE_RUNNING
    assert go_on(memory, watched(estimate=refused), 3.0)[1:] == (MODE_SURFACING, flow.POSITIONS_LOST)
    memory, _, _ = go_on(memory, watched())
    assert go_on(memory, watched(estimate=refused), 90.0)[1] == MODE_RUNNING, "one that is believed starts it anew"


def test_a_vehicle_without_positions_does_not_lose_them():
    none = dataclasses.replace(watched(), measurements={"leak": EMPTY["leak"]})
    assert go_on(begun(), none, 50.0)[1] == MODE_RUNNING
    assert float(go_on(begun(), none, 200.0)[0].watch.silence) == 0.0


SECOND = {"leak_2": 1.0, "battery_2": 0.05, "altimeter_2": 0.5}


@pytest.mark.system
@pytest.mark.parametrize("name", SECOND)
def test_the_second_sensor_of_a_kind_is_heeded_while_the_first_says_that_all_is_well(name):
    """They speak in turn: what one says does not undo what the other said."""
    well = {"leak": 0.0, "battery": 1.0, "altimeter": 9.0}
    kind = name.removesuffix("_2")
    pair = Supervisor(Rules.of(CHANGES, FENCE, SHARES, sensors=["position", *well, name]))
    empty = EMPTY | {name: EMPTY[kind]}
    estimate = at()
    received = jnp.where(jnp.arange(5) == sorted(empty).index("position"), 2.0, 0.0)
    estimate = dataclasses.replace(estimate, nis=received, nis_dof=received)
    first = watched(estimate=estimate, readings={name: EMPTY[kind]} | reading(kind, well[kind]))
    second = watched(estimate=estimate, readings={name: reading(kind, SECOND[name])[kind]})
    memory = begun(supervisor=pair)
    modes = []
    for _ in range(12):
        memory, *_ = go_on(memory, second, supervisor=pair)
        memory, mode, reason = go_on(memory, first, supervisor=pair)
        modes.append(mode)
    expected = {
        "leak_2": (MODE_SURFACING, flow.LEAK),
        "battery_2": (MODE_SURFACING, flow.BATTERY_CRITICAL),
        "altimeter_2": (MODE_HOLDING, flow.ALTITUDE_LIMIT),
    }
    assert (modes[-1], reason) == expected[name]


def test_positions_of_a_second_sensor_count():
    estimate = at()
    received = jnp.asarray([0.0, 0.0, 0.0, 0.0, 2.0])  # `position` is silent
    two = {"position_2": EMPTY["position"]}
    second = watched(estimate=dataclasses.replace(estimate, nis=received, nis_dof=received), readings=two)
    memory, mode, _ = go_on(begun(), second, 130.0)
    assert mode == MODE_RUNNING and float(memory.watch.silence) == 0.0
    none = watched(estimate=dataclasses.replace(estimate, nis=0 * received, nis_dof=0 * received), readings=two)
    assert go_on(memory, none, 122.0)[1:] == (MODE_SURFACING, flow.POSITIONS_LOST)
    off = watched(estimate=dataclasses.replace(estimate, nis=7.0 * received, nis_dof=received), readings=two)
    assert go_on(begun(), off, 20.0)[1:] == (MODE_SURFACING, flow.FILTER_DIVERGED)


def test_a_filter_whose_positions_disagree_has_diverged():
    off = dataclasses.replace(at(), nis=7.0 * at().nis)
    assert go_on(begun(), watched(estimate=off), 10.0)[1] == MODE_RUNNING
    assert go_on(begun(), watched(estimate=off), 20.0)[1:] == (MODE_SURFACING, flow.FILTER_DIVERGED)
    nearly = dataclasses.replace(at(), nis=5.0 * at().nis)
    assert go_on(begun(), watched(estimate=nearly), 60.0)[1] == MODE_RUNNING


def test_time_runs_out_from_the_beginning_of_the_mission_and_is_wound_up_by_arm():
    clock = Supervisor(Rules.of(CHANGES | {"time out": RULES["time out"]._replace(limit=100.0)}, FENCE, SHARES))
    memory, mode, _ = go_on(begun(MODE_IDLE), watched(PAUSE), 50.0, clock)
    assert mode == MODE_IDLE and float(memory.watch.elapsed) == 0.0
    memory, mode, _ = go_on(memory, watched(), 100.0, clock)
    assert mode == MODE_RUNNING
    memory, mode, reason = go_on(memory, watched(), 2.0, clock)
    assert (mode, reason) == (MODE_RETURNING, flow.TIME_OUT)
    memory, mode, _ = go_on(memory, watched(ARM), DT, clock)
    assert mode == MODE_PAUSED and float(memory.watch.elapsed) < 1.0


@pytest.mark.parametrize("part", ["position", "attitude", "nu", "bias", "covariance"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_a_number_aborts(part, value):
    fine = at()
    broken = eqx.tree_at(lambda e: getattr(e, part), fine, getattr(fine, part).at[-1].set(value))
    assert ask(MODE_RUNNING, estimate=broken) == (MODE_ABORTED, NOT_A_NUMBER)


def test_readings_that_are_no_numbers_change_nothing():
    broken = watched(readings=reading("battery", np.nan) | reading("altimeter", np.nan) | reading("leak", np.nan))
    assert go_on(begun(), broken, 20.0)[1] == MODE_RUNNING


def test_begins_idle_and_thrusters_are_on_in_all_modes_but_idle_and_aborted():
    memory = SUPERVISOR.init(jax.random.key(0), Start.at())
    assert int(memory.mode.mode) == MODE_IDLE and not memory.mode.active
    active = [bool(Mode(jnp.asarray(m), jnp.asarray(0)).active) for m in range(8)]
    assert active == [False, *[True] * 6, False]


def test_a_polygon_that_is_not_convex():
    corners = jnp.asarray([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]])
    places = {(1.0, 1.0): True, (2.0, 0.5): True, (2.0, 2.0): False, (3.8, 3.0): True, (-0.1, 1.0): False}
    assert {place: bool(inside(corners, jnp.asarray(place))) for place in places} == places
    outside = watched(estimate=at(x=0.0, y=-20.5))
    wide = Supervisor(Rules.of({"geofence": RULES["geofence"]}, FENCE))
    assert go_on(begun(), outside, 2.0, wide)[1:] == (MODE_RETURNING, flow.GEOFENCE)
