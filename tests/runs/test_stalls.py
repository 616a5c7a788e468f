"""Why a mission does not get on, in words: on made-up runs of which every sample is known."""

import dataclasses

import numpy as np
import pytest

from rovtwin.core.flow import ABORTED, DIVE, GO, HOLD, PAUSED, REASONS, TURN
from rovtwin.runs.limits import Limits
from rovtwin.runs.scoring.decisions import badly_placed, without_headway
from rovtwin.runs.scoring.endings import fell_short, left_depth, strayed, tipped, why_ended
from rovtwin.runs.scoring.scores import Flown
from rovtwin.runs.scoring.stalls import stalls, unfinished
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.stability import stability

SURGE = {"direction": [1, 0, 0], "force": {"ahead": 14, "astern": 11}}
NO_SWAY = {
    "name": "no_sway",
    "mass": 6.5,
    "inertia": [0.06, 0.11, 0.12],
    "volume": 0.00655,
    "center_of_buoyancy": [0, 0, -0.02],
    "shape": {"box": [0.42, 0.30, 0.20]},
    "thrusters": [
        {"name": "port", "position": [-0.15, -0.11, 0]} | SURGE,
        {"name": "starboard", "position": [-0.15, 0.11, 0]} | SURGE,
        {"name": "heave", "position": [0, 0, 0], "direction": [0, 0, 1], "force": 12},
    ],
}
VEHICLE = vehicle_from_dict(NO_SWAY, "no_sway")
SECONDS = 400


@pytest.fixture(scope="module")
def model():
    return VEHICLE.model()


@pytest.fixture(scope="module")
def scenario():
    legs = "[{position: [3, 0, 3], speed: 0.2, acceptance: 0.2}, {position: [3, 3, 3], speed: 0.2, acceptance: 0.2}]"
    return load_scenario("square", [f"mission.waypoints={legs}"])


def flown(x, y, phase=GO, waypoint=0, **changes):
    """A run at 10 Hz past (x, y) at 3 m, heading north, to way-point 1 at (3, 0) or 2 at (3, 3)."""
    n = 10 * SECONDS + 1
    eta = np.zeros((n, 6))
    eta[:, 0], eta[:, 1], eta[:, 2] = x, y, 3.0
    zero = np.zeros((n, 6))
    mode = np.tile([phase, 0, waypoint, phase == GO], (n, 1)).astype(float)
    leg = np.tile([0, 0, 3, 3, 3 * waypoint, 3], (n, 1)).astype(float)
    base = {
        "t": np.arange(n) / 10, "eta": eta, "nu": zero, "eta_hat": eta, "nu_hat": zero,
        "covariance": np.tile(np.eye(12), (n, 1, 1)), "leg": leg, "mode": mode, "thrust": np.zeros((2, 2)),
        "saturated": np.zeros(n, bool), "control_dt": 0.02, "duration": float(SECONDS), "setpoint": eta,
        "tau": zero, "bias": zero,
    }  # fmt: skip
    return Flown(**(base | changes))


def tips(axis, degrees, speed, **changes):
    """Heading east over ground at a speed, tipped at 100 s; the water runs to the west with 0.2 m/s."""
    eta, nu, water = (np.zeros((10 * SECONDS + 1, n)) for n in (6, 6, 3))
    eta[:, 5], nu[:, 0], water[:, 1] = 0.5 * np.pi, speed, -0.2
    mode = np.tile([GO, 0, 0, 1.0], (len(eta), 1))
    eta[1000:, axis], mode[1000:, :2] = np.radians(degrees), [ABORTED, REASONS.index("attitude limit")]
    nu[1000:, 0] = 0.0
    return flown(0.0, 0.0, **({"eta": eta, "nu": nu, "water": water, "mode": mode} | changes))


def test_what_tipped_it_names_angle_speed_through_the_water_and_what_it_stays_level_up_to(model):
    level = stability(model).pitch_depth_held
    text = tipped(tips(4, -60.0, 0.2 + level), model)
    assert text.startswith("at 100.0 s pitch was -60 deg, and its speed through")
    assert f"through the water had come to {0.4 + level:.2g} m/s; with its depth" in text
    assert f"it stays level up to {level:.2g} m/s: fly slower, or raise BG" in text
    slow = tipped(tips(4, -60.0, 0.0), model)
    assert "fly slower" not in slow and "check its thrusters" in slow, "0.2 m/s are not what tipped it"
    assert f"speed over ground had come to {0.2 + level:.2g}" in tipped(tips(4, -60.0, 0.2 + level, water=None), model)
    rolled = tipped(tips(3, 61.0, 1.0), model)
    assert "roll was 61 deg" in rolled and "which does not tip it: check its thrusters one by one" in rolled


def test_what_tipped_it_names_the_tilt_of_roll_and_pitch_together_and_the_pitch_beyond_ninety(model):
    run = tips(3, 45.0, 0.1)
    run.eta[1000:, 4] = np.radians(-45.0)
    assert "at 100.0 s pitch was -49 deg, tilt 60 deg, and" in tipped(run, model)
    run.eta[1000:, 3:] = np.radians([180.0, 80.0, -90.0])
    assert "at 100.0 s pitch was 100 deg, and" in tipped(run, model)


def test_what_tipped_it_sideways_is_its_speed_in_sway():
    model = load_vehicle("bluerov2_heavy").model()  # heave has more added mass than sway
    level, run = stability(model).roll_static, tips(3, 61.0, 0.1)
    nu = run.nu.copy()
    nu[:1000, 1] = 1.2 * level
    text = tipped(dataclasses.replace(run, nu=nu, water=None), model)
    assert (
        f"{1.2 * level:.2g} m/s of it sideways" in text and f"level up to {level:.2g} m/s in sway: fly slower" in text
    )


def test_what_fell_short_names_force_and_flow(model):
    """Half of the time at 100 s the mission ended for want of thrust; 30 s before are looked at."""
    zero, water = np.zeros((10 * SECONDS + 1, 6)), np.zeros((10 * SECONDS + 1, 3))
    mode = np.tile([GO, 0, 0, 1.0], (len(zero), 1))
    mode[1000:, :2] = [ABORTED, REASONS.index("saturated")]
    tau, water[:, 1] = zero.copy(), 1.2
    tau[:1000, 5] = Limits.of(model).both_ways(5)
    text = fell_short(flown(0.0, 0.0, tau=tau, water=water, mode=mode), model)
    assert text.startswith("over the last 30 s it was asked for 2.4 of 2.4 N m in yaw, at 1.2 m/s through the water")
    assert "it turns its bow in up to" in text and text.endswith("wait for less current")
    assert "in surge" in fell_short(flown(0.0, 0.0, tau=zero + 30.0, mode=mode), model), "the world may be unknown"
    assert why_ended(flown(0.0, 0.0), model, "leak") == ""


def test_what_left_its_course_or_depth_says_how_far_and_what_was_asked(model):
    """To the north-east at 0.1 m/s and down at 0.01 m/s; at 100 s the rule acts."""
    t = np.arange(10 * SECONDS + 1) / 10
    mode, tau = np.tile([GO, 0, 0, 1.0], (len(t), 1)), np.zeros((len(t), 6))
    tau[:, 0], tau[:, 2] = -2.0, 3.0
    eta = flown(0.0, 0.0).eta
    eta[:, 0] = eta[:, 1] = 0.1 * t / np.sqrt(2.0)
    eta[:, 2] += 0.01 * t
    aim = flown(0.0, 0.0).eta
    for rule, say, expected in (
        ("off course", strayed, "it was 10 m north-east of its set-point, "),
        ("off depth", left_depth, "it was 1 m below its depth of 3 m, "),
    ):
        mode[1000:, 1] = REASONS.index(rule)
        run = flown(0.0, 0.0, eta=eta, eta_hat=eta, setpoint=aim, tau=tau, mode=mode)
        text = say(run, model)
        assert text.startswith(f"at 99.9 s {expected}") and "m farther than" in text
        assert why_ended(run, model, rule) == text
        assert ("2 of 22 N in surge on average" in text) == (rule == "off course")
        assert ("3 of 11.5 N in heave on average" in text) == (rule == "off depth")


def test_a_flight_without_positions_says_how_well_it_knew_where_it_was(scenario, model):
    """Known to 0.1 m (1.96 times 0.05 m); from 60 to 80 s as far as 1.96 m; the filter's first seconds do not count."""
    covariance = np.tile(np.eye(12) * 0.05**2, (len(TIME), 1, 1))
    covariance[:50, :2, :2] *= 100.0
    lost = (TIME > 60.0) & (TIME < 80.0)
    covariance[lost, 0, 0] = (0.05 * (TIME[lost] - 59.0)) ** 2
    (reported,) = badly_placed(flown(ARRIVES, 0.0, covariance=covariance), scenario)
    # Beyond the acceptance of 0.2 m from a standard deviation of 0.102 m on.
    assert reported["t"] == pytest.approx(61.1, abs=0.15)
    assert (
        reported["what"] == "until 80 s the position is known to 2 m at worst"
        and "acceptance 0.2 m" in reported["cause"]
    )
    assert badly_placed(flown(ARRIVES, 0.0), scenario) == []


def test_thrusters_that_gave_another_force_are_named(model):
    """2 N ahead were asked for; they gave 1 N astern, of which nobody with a real vehicle knows."""
    t = np.arange(10 * SECONDS + 1) / 10
    mode, tau = np.tile([GO, 0, 0, 1.0], (len(t), 1)), np.zeros((len(t), 6))
    mode[1000:, 1], tau[:, 0] = REASONS.index("off course"), 2.0
    eta = flown(0.0, 0.0).eta
    eta[:, 0] = -0.1 * t
    force = np.linalg.pinv(np.asarray(model.thrusters.configuration)) @ [-1.0, 0, 0, 0, 0, 0]
    run = flown(0.0, 0.0, eta=eta, eta_hat=eta, setpoint=flown(0.0, 0.0).eta, tau=tau, mode=mode)
    simulated = dataclasses.replace(run, thrust=np.tile(force, (len(t), 1)), control_dt=0.1)
    assert "asked for 2 of 22 N in surge (they gave 1 the other way) on average" in strayed(simulated, model)
    assert "asked for 2 of 22 N in surge on average" in strayed(
        dataclasses.replace(run, thrust=np.zeros((2, 1))), model
    )


TIME = np.arange(10 * SECONDS + 1) / 10
ARRIVES = np.minimum(0.02 * TIME, 3.0)  # 150 s to the north of 3 m


def test_beside_the_way_point_in_a_cross_current_without_sway(scenario, model):
    """0.6 N to the east hold it 0.7 m off its leg; surge is hardly asked for anything."""
    bias, tau = np.zeros((len(TIME), 6)), np.zeros((len(TIME), 6))
    bias[:, 1], tau[:, 0] = 0.6, 0.3
    run = flown(ARRIVES, 0.7, bias=bias, tau=tau)
    text = unfinished(run, scenario, model, VEHICLE)
    assert text.startswith("way-point 1 of 2 was not reached: from 1")
    assert "0.7 m east of it at (3.0, 0.7)" in text and "acceptance 0.2 m" in text
    assert "asked for 0.3 of 22 N in surge, no thrust in sway" in text
    assert "to the east pushes it, which takes 0 N in surge and 0.6 N in sway" in text
    assert "raise the way-point's acceptance to 0.9 m" in text
    (stall,) = stalls(run, scenario, model)
    assert 130 < stall.start < 150 and stall.end == SECONDS and stall.nearest == pytest.approx(0.7)
    (reported,) = without_headway(run, scenario, model)
    assert reported["what"].startswith("no headway for 19 s, at way-point 1 of 2")  # 20 lengths of 0.187 m at 0.2 m/s
    assert reported["t"] == pytest.approx(stall.start + 18.7, abs=0.1) and "raise" not in reported["cause"]


def test_a_current_beyond_what_keeps_it_level(scenario, model):
    """A larger acceptance is no help to a vehicle that is carried off."""
    bias = np.zeros((len(TIME), 6))
    bias[:, 1] = 3.1
    text = unfinished(flown(ARRIVES, 0.7, bias=bias), scenario, model, VEHICLE)
    assert "no faster than 0.22 m/s through the water to stay level: wait for less current" in text
    assert "acceptance to" not in text


def test_patience_grows_with_the_vehicle(scenario, model):
    larger = load_vehicle("double_blueye").model()
    run = flown(ARRIVES, 0.7)
    small, large = (stalls(run, scenario, of)[0].patience for of in (model, larger))
    assert large / small == pytest.approx((float(larger.displaced_mass) / float(model.displaced_mass)) ** (1 / 3))


def test_thrust_that_is_used_up(scenario, model):
    tau = np.zeros((len(TIME), 6))
    tau[:, 0] = 21.5
    text = unfinished(flown(1.0, 0.0, tau=tau), scenario, model, VEHICLE)
    assert "asked for 22 of 22 N in surge" in text and "thrust in surge is used up" in text


PLACED = "autopilot.controller.gains=pole_placement"


@pytest.mark.parametrize(
    "vehicle, settings, whose",
    [(VEHICLE, (), "the Double Blueye's"), (VEHICLE, (PLACED,), "too weak for it here"),
     (load_vehicle("double_blueye"), (), "too weak for it here")],
)  # fmt: skip
def test_a_dive_that_hangs(vehicle, settings, whose, model):
    """The thesis's gains have no integral in heave."""
    legs = "mission.waypoints=[{position: [3, 0, 4], speed: 0.2, acceptance: 0.2}]"
    scenario = load_scenario("square", ["autopilot=thesis", legs, *settings])
    leg = np.tile([0, 0, 4, 3, 0, 4], (len(TIME), 1)).astype(float)
    text = unfinished(flown(0.0, 0.0, phase=DIVE, leg=leg), scenario, model, vehicle)
    assert "stayed 1 m above its depth of 4 m" in text and "of 11.5 N in heave" in text
    assert f"the gains of this baseline are {whose}; fly it with autopilot model_based" in text


def test_a_dive_that_waits_for_its_heading(scenario, model):
    """At its depth it is not the depth that is named; off both, both are."""
    setpoint, tau = np.zeros((len(TIME), 6)), np.zeros((len(TIME), 6))
    setpoint[:, 5], tau[:, 5] = 1.0, 2.9
    text = unfinished(flown(0.0, 0.0, phase=DIVE, setpoint=setpoint, tau=tau), scenario, model, VEHICLE)
    assert "the vehicle was at its depth and stayed 57 deg off the heading of the leg" in text and "heave" not in text
    assert "asked for 2.9 of" in text and "thrust in yaw is used up; it takes a weaker current" in text
    leg = np.tile([0, 0, 4, 3, 0, 4], (len(TIME), 1)).astype(float)
    text = unfinished(flown(0.0, 0.0, phase=DIVE, setpoint=setpoint, leg=leg), scenario, model, VEHICLE)
    assert "stayed 1 m above its depth of 4 m, 57 deg off the heading of the leg" in text
    assert "N in heave" in text and "N m in yaw" in text


def test_a_turn_that_never_ends(scenario, model):
    setpoint = np.zeros((len(TIME), 6))
    setpoint[:, 5] = 1.0
    text = unfinished(flown(0.0, 0.0, phase=TURN, setpoint=setpoint), scenario, model, VEHICLE)
    assert "no nearer than 57 deg to the heading of the leg" in text and "N m in yaw" in text


def test_a_vehicle_that_circles(scenario, model):
    run = flown(3 + np.cos(TIME), np.sin(TIME), waypoint=0)
    assert "went to and fro within 1 m (rms) and came no nearer than 1 m" in unfinished(run, scenario, model, VEHICLE)


def test_headway_that_takes_longer_than_there_is_time(scenario, model):
    run = flown(0.005 * TIME, 0.0)
    assert stalls(run, scenario, model) == []
    text = unfinished(run, scenario, model, VEHICLE)
    assert text.startswith("on its way to way-point 1 of 2, (2.0, 0.0) at 3.0 m depth; what is left takes about")
    assert "raise duration to" in text


def test_what_is_left_of_a_hold_is_its_time_and_the_margin_is_in_the_duration(model):
    """It was said to take 522 s, of a hold of 480 s of which 55 s had passed."""
    legs = "[{position: [3, 0, 3], speed: 0.2, hold_time: 480}]"
    scenario = load_scenario("square", [f"mission.waypoints={legs}"])
    run = flown(3.0, 0.0, phase=HOLD)
    run.mode[: 10 * SECONDS + 1 - 600, 0] = GO
    text = unfinished(run, scenario, model, VEHICLE)
    assert text.endswith("what is left takes about 420 s more: raise duration to 920")


def test_neither_holding_nor_pausing_is_a_stall(scenario, model):
    for phase, message in ((HOLD, "at way-point 1 of 2"), (PAUSED, "paused at the end")):
        run = flown(3.0, 0.0, phase=phase)
        assert stalls(run, scenario, model) == []
        assert unfinished(run, scenario, model, VEHICLE).startswith(message)


def test_a_filter_that_is_wrong_is_named(scenario, model):
    estimate = flown(3.0, 0.7).eta
    truth = estimate + np.array([5.0, 0, 0, 0, 0, 0])
    assert "the filter was wrong by 5 m" in unfinished(flown(3.0, 0.7, eta=truth), scenario, model, VEHICLE)


def test_what_is_felt_is_a_current_only_where_the_water_runs(scenario, model):
    """A lost thruster feels as a current does; where the water is known, as in the twin, it tells."""
    bias, water = np.zeros((len(TIME), 6)), np.zeros((len(TIME), 3))
    bias[:, 1] = 3.1

    def result_of(**changes):
        return unfinished(flown(ARRIVES, 0.7, bias=bias, **changes), scenario, model, VEHICLE)

    assert "or it has thrusters that give less than they should (dead, reversed, fouled)" in result_of()
    still = result_of(water=water)
    assert "but the water stood still: the rest is thrusters that give less" in still
    assert "wait for less current" not in still and "check its thrusters" in still
    water[:, 1] = float(result_of().partition("a current of ")[2].partition(" ")[0])
    assert "thrusters that give less" not in result_of(water=water) and result_of(water=water).endswith(
        "wait for less current"
    )


def test_a_current_is_one_though_drag_aside_is_larger(scenario, model):
    """Its force does not point where it runs to: on a vehicle with more drag in sway, further to the side."""
    bias, water, current = np.zeros((len(TIME), 6)), np.zeros((len(TIME), 3)), np.array([0.15, 0.15])
    water[:, :2] = current
    quadratic, linear = (
        np.asarray(getattr(model, f"{k}_damping_ahead")).diagonal()[:2] for k in ("quadratic", "linear")
    )
    bias[:, :2] = linear * current + quadratic * current**2
    assert abs(bias[0, 1] / bias[0, 0] - 1.0) > 0.2
    text = unfinished(flown(ARRIVES, 0.7, bias=bias, water=water), scenario, model, VEHICLE)
    assert "to the north-east" in text and "thrusters that give less" not in text


def test_waves_that_push_are_named_and_no_thruster_is(scenario, model):
    """Drift of waves feels as a current does, too; the twin knows it."""
    bias, water, outside = (np.zeros((len(TIME), n)) for n in (6, 3, 6))
    bias[:, 1], outside[:, 1] = 3.1, 2.9
    text = unfinished(flown(ARRIVES, 0.7, bias=bias, water=water, outside=outside), scenario, model, VEHICLE)
    assert "(waves, their drift and tethers push with 2.9 N to the east)" in text
    assert "thrusters that give less" not in text and "check its thrusters" not in text
    outside[:, 1] = 20.0 * np.sin(2.0 * np.pi * TIME / 7.3)  # to and fro, and nothing on average
    text = unfinished(flown(ARRIVES, 0.7, bias=3.0 * bias, water=water, outside=outside), scenario, model, VEHICLE)
    assert "thrusters that give less" in text
    outside[:, 1] = 1.0  # too little
    text = unfinished(flown(ARRIVES, 0.7, bias=bias, water=water, outside=outside), scenario, model, VEHICLE)
    assert "thrusters that give less" in text


def test_a_vehicle_that_is_carried_off_did_not_stay(scenario, model):
    text = unfinished(flown(3.0, 0.5 * TIME), scenario, model, VEHICLE)
    assert "the vehicle went away, to 200 m east of it at 400 s" in text and "stayed" not in text


def test_no_current_is_blamed_for_a_depth(scenario, model):
    leg, bias, tau = np.tile([0, 0, 4.0, 3, 0, 4], (len(TIME), 1)), np.zeros((len(TIME), 6)), np.zeros((len(TIME), 6))
    bias[:, 0], bias[:, 2] = 3.0, -2.0
    text = unfinished(flown(0.0, 0.0, phase=DIVE, leg=leg, bias=bias), scenario, model, VEHICLE)
    assert "something like 2 N up pushes it, or it has thrusters" in text and "current" not in text
    mode = np.tile([GO, 0, 0, 1.0], (len(TIME), 1))
    mode[1000:, 1], tau[:, 2] = REASONS.index("saturated"), 12.0
    text = fell_short(flown(0.0, 0.0, tau=tau, water=np.zeros((len(TIME), 3)), mode=mode), model)
    assert "in heave: check its heave thrusters" in text and "current" not in text
