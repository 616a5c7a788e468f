"""Planned tests: candidates, tanks, the plan against the thesis's steady steps, and the command."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.arrays.rotations import quaternion_from_euler
from rovtwin.core.errors import ConfigError
from rovtwin.identification.experiment.information import Information
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.planning.candidates import candidates, in_words, thesis_pulls
from rovtwin.planning.experiments import TIPPING, _as_level_as_can_be, _laid_out, _scenario, plan_tests
from rovtwin.planning.known import drawn_models, what_is_known
from rovtwin.planning.rehearsal import Rehearsed, _exact, rehearse
from rovtwin.planning.room import excitation, require_possible
from rovtwin.planning.tank import Tank, counted_on, positions_in_tank
from rovtwin.report.identification.words import is_coupling
from rovtwin.runs.compose.experiment import spans_of
from rovtwin.runs.compose.experiment_scales import ExperimentScales
from rovtwin.runs.compose.sensors import sensors_of
from rovtwin.scenario.files import load_scenario
from rovtwin.simulation.sensors.sensor import usual_sensor
from rovtwin.vehicle import load_vehicle, vehicle_from_dict


def test_tanks_are_read_from_words():
    tank = Tank.parse("6x3x1.5")
    assert (tank.length, tank.width, tank.depth) == (6.0, 3.0, 1.5) and tank.middle == [0, 0, 0.75]
    for text in ("6x3", "6x3xdeep", "6x-3x1", ""):
        with pytest.raises(ConfigError, match="length x width x depth"):
            Tank.parse(text)


def test_the_distance_to_walls_counts_every_side():
    tank, middle = Tank(6.0, 3.0, 1.5), np.array([0, 0, 0.75])
    path = middle + np.array([[[0.0, 0, 0]], [[2.9, 0, 0]], [[0, -1.45, 0]], [[0, 0, 0.74]], [[0, 0, -0.74]]])
    assert tank.nearest(path) == (pytest.approx(0.01), 3)
    assert tank.nearest(path[:3]) == (pytest.approx(0.05), 2)
    assert tank.nearest(middle + np.array([[[3.5, 0, 0]]]))[0] == pytest.approx(-0.5)


def test_a_path_leaves_room_for_a_fence_that_positions_can_hold():
    """Two of sixteen plans in the thesis's tank came so near to a wall that no fence could watch over them."""
    model, tank = load_vehicle("double_blueye").model(), Tank(6.0, 3.0, 1.5)
    out = 1.5 - float(np.abs(np.asarray(model.hull.corners))[:, 1].max())
    east = np.array([0.0, out - 0.16, out - 0.14, 0.16 - out, 0.14 - out])
    position = np.stack([np.zeros(5), east, np.full(5, 0.75)], axis=1).repeat(5, axis=0)
    flown = SimpleNamespace(
        t=np.arange(25.0), position=position, attitude=np.tile([1.0, 0, 0, 0], (25, 1)), aborted_at=None
    )
    assert set(tank.past_a_fence(model, flown, 0.03)) == {*range(10, 15), *range(20, 25)}
    assert len(tank.past_a_fence(model, flown, 0.0)) == 0
    tank.require_fence(model, 0.03)
    with pytest.raises(ConfigError, match=r"err by 0.5 m .* 6x3x1.5 no fence .* qtm://"):
        tank.require_fence(model, 0.5)


def test_the_fence_lies_between_the_flown_paths_and_the_walls():
    model, tank = load_vehicle("double_blueye").model(), Tank(6.0, 3.0, 1.5)
    position = np.array([[0.0, 0.0, 0.75], [1.0, -0.2, 0.8]])
    flown = SimpleNamespace(position=position, attitude=np.tile([1.0, 0, 0, 0], (2, 1)))
    north, east, deepest = tank.fence(model, [flown])
    reach = np.abs(np.asarray(model.hull.corners)).max(axis=0)
    assert [north, east] == pytest.approx([0.5 * (1.0 + 3.0 - reach[0]), 0.5 * (0.2 + 1.5 - reach[1])])
    assert tank.touches(model, flown) == pytest.approx([3.0 - reach[0], 1.5 - reach[1]])
    assert 0.8 < deepest < tank.depth - np.asarray(model.hull.corners)[:, 2].max()
    beyond = SimpleNamespace(position=position + [5.0, 0, 0], attitude=flown.attitude)
    assert tank.fence(model, [beyond])[0] == pytest.approx(6.0), "never inside the path"
    assert tank.fence(model, [flown, beyond])[0] == pytest.approx(6.0), "of any vehicle that may fly it"


def test_a_plan_counts_on_the_positions_that_the_vehicle_measures_itself():
    """Motion capture took the place of a locator: the plan promised what no such positions tell."""
    locator = {"name": "ugps", "part": "ugps_u1", "pose": {"position": [0.0, 0.2, -0.2]}}
    parts = [{"name": "rov", "part": "double_blueye"}, locator]
    own = vehicle_from_dict({"name": "v", "parts": parts})
    spare = vehicle_from_dict({"name": "v", "parts": [parts[0]]})
    tank, rest = Tank(6.0, 3.0, 1.5), [{"manoeuvre": "rest", "duration": 1.0}]

    def flown(vehicle, **given):
        section = positions_in_tank(vehicle) | given
        return sensors_of(_scenario("double_blueye", tank, section, rest), vehicle)["position"]

    carried = flown(own)
    assert carried.rate == 2000 and carried.errors is not None and np.all(np.asarray(carried.noise) == 0.035)
    np.testing.assert_allclose(carried.lever, [0.05, 0.2, -0.2])
    assert np.all(np.asarray(flown(own, noise=0.1).noise) == 0.1), "what was measured of it counts more"
    captured = flown(spare)
    assert captured.rate == 15_000 and captured.errors is None and np.all(np.asarray(captured.lever) == 0.0)
    assert counted_on(own) == []
    (line,) = counted_on(spare)
    assert "motion capture that gives the position of CO to 0.03 m, 15 times a second, as no part of v" in line


def test_candidates_excite_only_what_thrusters_push():
    pair = candidates(ExperimentScales.of(load_vehicle("double_blueye").model()), 1)
    heavy = candidates(ExperimentScales.of(load_vehicle("bluerov2_heavy").model()), 1)

    def axes(found):
        return {axis for one in found for axis in [*one.get("axes", {}), *([one["axis"]] if "axis" in one else [])]}

    assert axes(pair) == {"surge", "sway", "heave", "roll", "yaw"}
    assert axes(heavy) == {"surge", "sway", "heave", "roll", "pitch", "yaw"}
    assert all(in_words(one) for one in pair)
    again = candidates(ExperimentScales.of(load_vehicle("double_blueye").model()), 1)
    assert pair == again


def test_where_nobody_tilts_the_vehicle_no_release_is_a_candidate():
    scales = ExperimentScales.of(load_vehicle("double_blueye").model())
    every, alone = candidates(scales, 1), candidates(scales, 1, by_hand=False)
    assert alone == [one for one in every if one["manoeuvre"] != "release"] and len(alone) < len(every)


def test_the_steady_steps_are_the_thesis_protocol_pull_by_pull():
    pulls = thesis_pulls("double_blueye")
    assert len(pulls) == 6 + 4 + 4 + 5 + 2
    assert all(len(one["levels"]) == 1 for one in pulls if one["manoeuvre"] == "steps")


def test_a_vehicle_without_sway_is_planned_for_without_sway(no_sway):
    vehicle = load_vehicle(no_sway)
    pulls = thesis_pulls(str(no_sway))
    found = candidates(ExperimentScales.of(vehicle.model()), 1)
    for one in (*pulls, *found):
        assert "sway" not in {*one.get("axes", {}), one.get("axis")}
    assert {one["axis"] for one in pulls if "axis" in one} == {"surge", "heave", "yaw"}


def test_times_of_candidates_are_the_vehicles_own(no_sway):
    """A pull lasts as many rises of speed on a light vehicle as on a heavy one."""
    light, heavy = (
        ExperimentScales.of(load_vehicle(no_sway).model()),
        ExperimentScales.of(load_vehicle("double_blueye").model()),
    )
    assert light.unit < heavy.unit

    def halves(scales):
        return sorted({one["half"] for one in candidates(scales, 1) if one["manoeuvre"] == "doublets"})

    ratio = np.array(halves(light)) / halves(heavy)
    assert ratio == pytest.approx(np.full(3, light.unit / heavy.unit), rel=0.02)


def test_a_tank_that_is_too_small_to_turn_in_is_reported_with_the_size_it_takes():
    vehicle = load_vehicle("double_blueye")
    scales = ExperimentScales.of(vehicle.model())
    with pytest.raises(ConfigError, match=r"found 6x1x1.5, but .* only turns on the spot, .* in a tank of 6x1\.\dx1.5"):
        require_possible(vehicle, scales, Tank(6.0, 1.0, 1.5), some=True)
    require_possible(vehicle, scales, Tank(6.0, 3.0, 1.5), some=True)
    with pytest.raises(ConfigError, match="no thruster that pushes and nothing that rights it"):
        require_possible(vehicle, scales, Tank(6.0, 3.0, 1.5), some=False)


@pytest.mark.slow  # ten seconds to compile
def test_a_pull_on_a_scale_is_known_before():
    vehicle = load_vehicle("double_blueye")
    parameters, prior = what_is_known(vehicle, 0.02)
    _, unanchored = what_is_known(vehicle, None)
    i = parameters.names.index("thrusters.surge.force_ahead")
    assert np.sqrt(prior.covariance[i, i]) == pytest.approx(0.02, rel=0.05)
    assert np.sqrt(unanchored.covariance[i, i]) == pytest.approx(0.15)


@pytest.mark.slow  # half a minute to compile
def test_more_caution_keeps_a_strong_vehicle_level_and_off_the_walls():
    vehicle, tank = load_vehicle("bluerov2_heavy"), Tank(6.0, 4.0, 1.5)
    plan = plan_tests(vehicle, "bluerov2_heavy", 2.0, tank, by_hand=False, caution=2.25)
    length = ExperimentScales.of(vehicle.model()).length
    assert np.degrees(plan.flown.tilt.max()) <= 45.0 / 2.25 and plan.room >= 2.25 * 0.1 * length
    assert plan.ratio < 1.0 and len(plan.manoeuvres) >= 5


@pytest.mark.slow  # half a minute to compile
def test_vehicles_that_the_plan_has_not_seen_seldom_leave_their_limits_in_it():
    """Half of those that are as far off as the prior has them tipped over before plans were flown by such vehicles."""
    vehicle, tank, errs = load_vehicle("bluerov2_heavy"), Tank(6.0, 4.0, 1.5), 0.005
    positions = {"noise": errs, "rate_hz": 15, "errors": "none", "dropout": 0.0, "position": [0.0, 0.0, 0.0]}
    plan = plan_tests(vehicle, "bluerov2_heavy", 3.7, tank, seed=2, by_hand=False, positions=positions)
    parameters, prior = what_is_known(vehicle, 0.02)

    def share_that_leaves(spread, seed):
        others = drawn_models(parameters, Gaussian(prior.mean, spread**2 * prior.covariance), 30, seed)
        flown = rehearse([plan.flown.scenario] * len(others), others)
        return np.mean([len(tank.left(plan.model, one, errs)) > 0 for one in flown])

    assert share_that_leaves(1.0, 99) < 0.4 and share_that_leaves(0.5, 98) < 0.1 and plan.ratio < 0.8


@pytest.mark.parametrize(
    ("possible", "expected"),
    [
        ({(0.4, True), (np.inf, True)}, (0.4, True)),
        ({(np.inf, True), (0.4, False)}, (np.inf, True)),
        ({(0.4, False), (TIPPING, False)}, (0.4, False)),
        ({(TIPPING, False)}, (TIPPING, False)),
        ({(np.inf, False)}, (np.inf, False)),
    ],
)
def test_drawn_vehicles_are_kept_off_their_limits_before_the_assumed_one_is_kept_level(possible, expected):
    def lay_out(limit, drawn):
        if (limit, drawn) not in possible:
            raise ConfigError("none")
        return ("laid", limit, drawn), None, [rehearsed(0.0)]

    (laid, *_), remarks = _as_level_as_can_be(lay_out, 0.4)
    assert laid[1:] == expected and bool(remarks) == (expected[0] != 0.4)
    assert ("drawn vehicles" in " ".join(remarks)) == (expected == (np.inf, True))


@pytest.mark.slow  # half a minute to compile, a quarter of an hour of test flown
def test_a_plan_beats_the_steady_steps_fits_its_tank_and_flies(tmp_path):
    out, picture = tmp_path / "plan.yaml", tmp_path / "plan.png"
    args = ["plan-tests", "double_blueye", "--minutes", "15", "--tank", "6x3x1.5", "-o", str(out)]
    result = CliRunner().invoke(app, [*args, "--figure", str(picture), "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    report = json.loads(result.stdout)
    assert report["variance_ratio"] < 0.5, "half the variances, geometric mean"
    assert report["notes"][0].startswith("counted on: motion capture")
    assert report["minutes"] <= 15.0 and report["room_m"] > 0.0
    # Couplings count in the mean above. Single ones are best seen in long pulls, which no tank of 6 m has room for.
    own = [p for p in report["parameters"] if not is_coupling(p["name"])]
    learnt = [p for p in own if p["sd_after"] < 0.5 * p["sd_before"]]
    assert len(learnt) >= 30
    better = [p["name"] for p in learnt if p["sd_after"] < p["sd_after_steady_steps"]]
    assert len(better) > 0.9 * len(learnt)
    minutes = np.array(report["each_minute"])
    assert np.all(np.diff(minutes[:, 1]) <= 0)
    scenario = load_scenario(out)
    assert spans_of(scenario)[-1]["end"] <= 900.0 and scenario.world.tank.north == [-3.0, 3.0]
    assert picture.stat().st_size > 30_000


def test_mistakes_of_the_command_are_reported():
    result = CliRunner().invoke(app, ["plan-tests", "double_blueye", "--tank", "6x3"])
    assert isinstance(result.exception, ConfigError) and "6x3x1.5" in str(result.exception)


def rehearsed(speed, position=(0.0, 0.0, 0.75), aborted_at=None, ticks=100):
    nu = np.zeros((ticks, 6))
    nu[:, 0] = speed
    level = np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1))
    t = 0.02 * np.arange(ticks)
    return Rehearsed(None, t, np.tile(position, (ticks, 1)), level, nu, np.zeros((ticks, 4)), [], aborted_at)


def test_the_tilt_of_a_rehearsal_is_that_of_the_attitude_limit():
    attitude = quaternion_from_euler(np.radians([[0.0, 0.0, 50.0], [45.0, -45.0, 50.0], [180.0, 80.0, 50.0]]))
    tilt = dataclasses.replace(rehearsed(0.0), attitude=attitude).tilt
    np.testing.assert_allclose(np.degrees(tilt), [0.0, 60.0, 100.0], atol=1e-9)


@pytest.mark.parametrize(("reached", "refused"), [(1e-16, True), (0.3, False), (0.6, None)])
def test_a_tank_too_small_to_excite_an_axis_is_reported_with_the_numbers(reached, refused):
    vehicle, tank = load_vehicle("double_blueye"), Tank(6.0, 3.0, 1.5)
    top, able = np.array([1.0, 0.5, 0.5]), np.array([True, False, False, False, False, True])
    pulls = [("surge", rehearsed(0.9, (8.0, 0.0, 0.75)))]
    speeds = np.array([reached, 0, 0, 0, 0, 0])
    if refused:
        with pytest.raises(ConfigError, match=r"surge reaches 1e-16 of 1 m/s, and 0.5 m/s are needed.* a tank of 1\d"):
            excitation(vehicle, tank, top, able, pulls, speeds)
    else:
        lines = excitation(vehicle, tank, top, able, pulls, speeds)
        assert len(lines) == (refused is False) and all("reaches 0.3 of 1 m/s" in line for line in lines)
        assert all("a tank of 1" in line for line in lines)
        roomy = excitation(vehicle, Tank(30.0, 30.0, 1.5), top, able, pulls, speeds)
        assert all("tell linear from quadratic drag: more time would do it" in line for line in roomy)


def test_what_comes_near_a_wall_counts_until_an_abort():
    vehicle, tank = load_vehicle("double_blueye"), Tank(6.0, 3.0, 1.5)
    assert len(tank.near(vehicle, rehearsed(0.0), 0.03)) == 0
    assert len(tank.near(vehicle, rehearsed(0.0, (2.8, 0.0, 0.75)), 0.03)) == 20
    assert len(tank.near(vehicle, rehearsed(0.0, (2.8, 0.0, 0.75), aborted_at=0.5), 0.03)) == 6


def test_a_plan_ends_though_candidates_come_near_walls_in_company():
    """Where all but one touch a wall in the plan, that one is left; where none keeps clear, that is said."""
    prior = Gaussian(np.zeros(1), np.eye(1))
    scenario = load_scenario("test_mixed")

    def laid_out(good):
        reported = Information(np.linspace(2.0, 1.0, 20)[:, None, None], np.zeros(0), np.full(20, 10.0))
        at = {"order": []}

        def fly(order):
            at["order"] = order
            test = scenario.test.model_copy(update={"manoeuvres": scenario.test.manoeuvres[:1] * len(order)})
            at["spans"] = spans_of(scenario.model_copy(update={"test": test}))
            return scenario.model_copy(update={"test": test}), [rehearsed(0.0)]

        def near(_):
            return np.array([s["start"] for s in at["spans"] if at["order"][s["manoeuvre"]] not in good])

        return _laid_out(fly, near, prior, reported, 40.0, lambda what, share: None)[0]

    assert set(laid_out({5})) == {5}
    with pytest.raises(ConfigError, match="no plan keeps clear of the walls and level enough"):
        laid_out(set())


def test_no_draw_of_a_sensor_decides_on_a_plan():
    drawn = {"bias_walk": 0.1, "dropout": 0.14, "outlier": 0.1, "outlier_size": 3.0, "errors": "acoustic"}
    exact = _exact({"position": usual_sensor("position", rate_hz=2.0, **drawn)})["position"]
    assert exact.errors is None and exact.rate == 2000
    assert not any(np.any(getattr(exact, name)) for name in ("noise", "bias", "bias_walk", "dropout", "outlier"))


def test_the_tank_that_nobody_gave_is_the_vehicles():
    small, large = (Tank.of(load_vehicle(name).model()) for name in ("gladius_mini", "minerva"))
    assert small.sizes == (6.0, 3.0, 1.5)
    assert large.length > 12.0 and large.width == pytest.approx(0.5 * large.length, abs=0.1)
    for vehicle, tank in (("gladius_mini", small), ("minerva", large)):
        scales = ExperimentScales.of(load_vehicle(vehicle).model())
        require_possible(load_vehicle(vehicle), scales, tank, some=True)
