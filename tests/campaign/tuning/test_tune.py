"""Tuning: space, cost, the search on a toy, what is refused, the file there and back; slow: the claim itself."""

import numpy as np
import pytest
import yaml
from tests.campaign.identified import identified_vehicle

from rovtwin.campaign.tuning.cost import FAILED, TERMS, Cost, floors_of, terms_of, weights_of
from rovtwin.campaign.tuning.flights import CHOOSING, HELD_OUT, TUNING, Crew, failures, fleet_of, seas_of, short_mission
from rovtwin.campaign.tuning.parameters import TUNABLES, Space, chosen, start_of, value_of, with_values
from rovtwin.campaign.tuning.result import Judged, Tuned, TuningRequest, paired
from rovtwin.campaign.tuning.search import Search, search
from rovtwin.campaign.tuning.tune import tune
from rovtwin.campaign.tuning.writing import as_data, write_tuned
from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.autopilot import tuned_for_another
from rovtwin.runs.ensemble.plants import plants_of
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import ModelBasedSection
from rovtwin.vehicle import load_vehicle

BOX = np.array([[-1.0, 1.0]] * 3)
FIGURES = {
    "phase": "finished",
    "completed": True,
    "cross_track_rms_m": 0.2,
    "station_rms_m": None,
    "depth_rms_m": 0.02,
    "heading_rms_deg": 2.0,
    "attitude_rms_deg": 3.0,
    "effort_n2s": 1000.0,
    "duration_s": 100.0,
    "thruster_activity_n_per_s": 4.0,
    "nees_position_mean": 2.0,
}


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("lawnmower_calm", ["autopilot=model_based"])


def bowl(points):
    return [float(np.sum((x - [0.4, -0.3, 0.2]) ** 2)) for x in points]


def test_search_finds_the_bottom_of_a_bowl():
    found = search(bowl, np.zeros(3), BOX, seed=3, evaluations=200)
    assert np.allclose(found.best, [0.4, -0.3, 0.2], atol=0.03) and np.allclose(found.mean, found.best, atol=0.05)
    assert len(found.points) == len(found.costs) == len(found.generations) <= 200 and found.ended


def test_same_seed_same_search():
    one, other, third = (search(bowl, np.zeros(3), BOX, seed=s, evaluations=40) for s in (5, 5, 6))
    assert np.array_equal(one.points, other.points) and one.costs == other.costs
    assert not np.array_equal(one.points, third.points)


def test_search_stays_within_its_bounds_also_where_the_bottom_is_outside():
    found = search(lambda xs: [float(-x.sum()) for x in xs], np.full(3, 0.9), BOX, seed=1, evaluations=100)
    points = np.array(found.points)
    assert points.min() >= -1.0 and points.max() <= 1.0 and found.best.sum() > 2.8


def test_search_ends_when_its_time_is_up_and_when_nothing_gets_better():
    asked = []
    found = search(
        bowl, np.zeros(3), BOX, seed=1, evaluations=500, out_of_time=lambda n: asked.append(n) or len(asked) > 3
    )
    assert "time" in found.ended and len(found.costs) == 3 * asked[0]
    flat = search(lambda xs: [1.0] * len(xs), np.zeros(3), BOX, seed=1, evaluations=500)
    assert "brought less" in flat.ended and len(flat.costs) < 100


def test_a_single_parameter_can_be_searched():
    found = search(lambda xs: [float((x[0] - 0.5) ** 2) for x in xs], np.zeros(1), BOX[:1], seed=1, evaluations=60)
    assert found.best.shape == (1,) and found.best[0] == pytest.approx(0.5, abs=0.03)


def test_space_goes_to_a_section_and_back(scenario):
    space = Space.around(chosen(), start_of(scenario))
    assert (
        len(space.names) == 9
        and np.all(space.bounds[:, 0] <= space.start)
        and np.all(space.start <= space.bounds[:, 1])
    )
    x = space.bounds.mean(axis=1)
    section = space.at(x)
    back = [value_of(section, name) for name in space.names]
    assert np.allclose(np.log(back), x, atol=1e-3)
    assert section.control.bandwidth[3:5] == space.section.control.bandwidth[3:5]  # not searched, not touched
    assert value_of(space.section, "navigation.force_walk") == pytest.approx(0.03, rel=1e-3)  # said, not None


def test_values_beyond_the_usual_bounds_widen_them(scenario):
    odd = with_values(start_of(scenario), {"control.damping_ratio": 3.0})
    space = Space.around(chosen(["control.damping_ratio"]), odd)
    assert space.bounds[0, 1] == pytest.approx(np.log(3.0)) and space.bounds[0, 0] == pytest.approx(np.log(0.5))


@pytest.mark.parametrize("vehicle", ["gladius_mini", "double_blueye", "sf30k"])
def test_the_search_goes_both_ways_from_where_the_vehicle_begins(vehicle):
    """Bounds were the Double Blueye's: a work-class vehicle began on their edge, and was searched one way only."""
    start = start_of(load_scenario("square", [f"vehicle={vehicle}"]))
    space = Space.around(TUNABLES, start)
    assert np.all(space.start - space.bounds[:, 0] > 0.5) and np.all(space.bounds[:, 1] - space.start > 0.5)


def test_every_tunable_can_be_set(scenario):
    section = start_of(scenario)
    for one in TUNABLES:
        assert value_of(with_values(section, {one.name: 0.123456}), one.name) == 0.1235


def cost_of(figures, limit=60.0):
    section = ModelBasedSection.model_validate({"supervisor": {"attitude_limit_deg": limit}})
    return Cost.against(weights_of([]), ["calm"], [figures], floors_of(section))


def test_cost_of_the_hand_tuned_is_one_unless_a_floor_holds():
    cost = cost_of(FIGURES)
    assert cost.of("calm", FIGURES) == pytest.approx(1.0)
    better = FIGURES | {"cross_track_rms_m": 0.1}
    assert cost.of("calm", better) == pytest.approx(1.0 - 0.5 * weights_of([])["path"])
    fine = FIGURES | {"depth_rms_m": 0.001}  # a millimetre in place of half of one is nobody's concern
    floored = cost_of(fine)
    assert floored.scales["calm"]["depth"] == TERMS["depth"].floor and floored.of("calm", fine) < 1.0


def test_swinging_costs_by_the_vehicle_s_limit_also_where_the_hand_tuned_swings():
    still, swings = FIGURES | {"attitude_rms_deg": 0.4}, FIGURES | {"attitude_rms_deg": 12.0}
    share = weights_of([])["attitude"]
    for hand in (still, swings):
        for limit, one in ((60.0, 3.0), (30.0, 1.5)):
            cost = cost_of(hand, limit)
            assert cost.of("calm", swings) - cost.of("calm", still) == pytest.approx(share * 11.6 / one)
    nearly = FIGURES | {"attitude_rms_deg": 0.55}  # what the tuned values change of a Double Blueye's
    assert cost_of(still).of("calm", nearly) - cost_of(still).of("calm", still) < 0.005


@pytest.mark.parametrize(
    "change",
    [{"phase": "aborted", "completed": False}, {"phase": "go", "completed": False}, {"depth_rms_m": float("nan")}],
)
def test_failure_is_dear(change):
    cost = cost_of(FIGURES)
    assert cost.of("calm", FIGURES | change) == FAILED
    assert cost.of("calm", FIGURES | {"cross_track_rms_m": 1e6}) == FAILED  # nor is anything dearer


def test_a_flight_that_was_cut_short_is_no_failure():
    assert terms_of(FIGURES | {"phase": "go", "completed": False, "cut": True}) is not None
    assert terms_of(FIGURES | {"cross_track_rms_m": None, "station_rms_m": 0.3})["path"] == pytest.approx(0.3)


def test_weights_are_shares_and_can_be_given():
    assert sum(weights_of([]).values()) == pytest.approx(1.0)
    only = weights_of(["path=1", *(f"{name}=0" for name in TERMS if name != "path")])
    assert only == dict.fromkeys(TERMS, 0.0) | {"path": 1.0}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: weights_of(["pathh=1"]), "Did you mean 'path'"),
        (lambda: weights_of(["path=much"]), "expected a number"),
        (lambda: weights_of(["path=-1"]), "at least 0"),
        (lambda: weights_of([f"{name}=0" for name in TERMS]), "no weight above 0"),
        (lambda: chosen(["control.bandwith.surge"]), "Did you mean 'control.bandwidth.surge'"),
        (lambda: chosen(["control.integral"] * 2), "twice"),
        (lambda: search(bowl, np.zeros(3), BOX, seed=1, evaluations=0), "expected at least 1"),
        (lambda: seas_of(["stormy"], load_scenario("lawnmower_calm")), "--sea"),
    ],
)
def test_what_is_refused(call, message):
    with pytest.raises(ConfigError, match=message):
        call()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"budget": 0.0}, "--budget-s: found 0, expected more than 0"),
        ({"plants": 0}, "--plants"),
        ({"held_out": 1}, "--held-out"),
        ({"evaluations": 0}, "--evaluations: found 0, expected at least 1"),
        ({"scenario": load_scenario("lawnmower_calm", ["autopilot=thesis"])}, "found thesis, expected model_based"),
        ({"scenario": load_scenario("test_steps_thesis")}, "is a test, not a mission"),
    ],
)
def test_a_request_that_cannot_be_met_is_refused_before_anything_is_compiled(scenario, change, message):
    given = {"scenario": scenario, "tunables": chosen(), "seas": ("calm",), "weights": weights_of([])} | change
    with pytest.raises(ConfigError, match=message):
        tune(TuningRequest(**given))


@pytest.mark.system
@pytest.mark.parametrize(
    ("budget", "pace", "message"),
    [
        (0.5, 0.0, r"found 0.5, expected about \d{3} or more here: composing took \d+ s"),
        (300.0, 9.0, r"found 300, expected about \d{4} or more here: .* flying 4 held-out flights and a single gener"),
    ],
    ids=["before compiling", "before the first flight"],
)
def test_a_budget_that_is_too_short_is_refused_before_any_flight(scenario, monkeypatch, budget, pace, message):
    compiled = []
    monkeypatch.setattr(Crew, "compile", lambda self, runs: compiled.append(runs))
    monkeypatch.setattr(Crew, "pace", lambda self, run: pace)
    monkeypatch.setattr(Crew, "fly", lambda *_: pytest.fail("flown"))
    few = {"plants": 1, "held_out": 2, "budget": budget, "workers": 1}
    with pytest.raises(ConfigError, match=message):
        tune(TuningRequest(scenario=scenario, tunables=chosen(), seas=("calm",), weights=weights_of([]), **few))
    assert bool(compiled) == (pace > 0)


def ended_by(figures):
    """A stand-in for the crew: it flies nothing, and every flight of the search's plants ends so."""

    def fly(_, fleet, sections, tell):
        assert len(fleet.runs) == 1, "the held-out plants were flown before those of the search"
        return [[figures for _ in fleet.runs] for _ in sections]

    return fly


@pytest.mark.system
def test_hand_tuned_that_never_arrives_is_refused_by_its_first_flights_with_plant_and_reason(scenario, monkeypatch):
    tipped = FIGURES | {"phase": "aborted", "completed": False, "ended": "attitude limit after 12 s, at 11.8 s"}
    monkeypatch.setattr(Crew, "compile", lambda self, runs: None)
    monkeypatch.setattr(Crew, "pace", lambda self, run: 0.0)
    monkeypatch.setattr(Crew, "fly", ended_by(tipped))
    few = {"plants": 1, "held_out": 2, "budget": 300.0, "workers": 1}
    message = (
        r"failed on plant 1 of 1 \(waves, seed \d+, mass x \d\.\d+, thrust x \d\.\d+\): attitude limit after 12 s, at"
    )
    with pytest.raises(ConfigError, match=message + r".*calmer seas"):
        tune(TuningRequest(scenario=scenario, tunables=chosen(), seas=("waves",), weights=weights_of([]), **few))


def test_failed_flights_are_listed_with_the_run_s_own_reason():
    failed = FIGURES | {"phase": "aborted", "completed": False, "reason": "saturated"}
    figures = [FIGURES] + [
        failed | {"which": f"plant {i}", "ended": "saturated after 9 s, at 1 m/s", "duration_s": float(i)}
        for i in range(2, 9)
    ]
    listed = "plant 2: saturated after 9 s, at 1 m/s; plant 3: saturated after 3 s; plant 4: saturated after 4 s; "
    assert failures(figures).startswith(listed)
    assert failures(figures).endswith("; and 3 more") and failures([FIGURES]) == ""


@pytest.mark.system
def test_fleets_share_no_plant_and_no_noise_and_are_drawn_again_alike(scenario):
    plants, seas = plants_of(scenario), seas_of(("calm",), scenario)
    fleets = [
        fleet_of(scenario, plants, seas, stream, 2, 1, short=True) for stream in (TUNING, CHOOSING, HELD_OUT, TUNING)
    ]
    seeds = [[run.scenario.seed for run in fleet.runs] for fleet in fleets]
    masses = [[float(run.loop.twin.model.rigid_body_mass[0, 0]) for run in fleet.runs] for fleet in fleets]
    assert seeds[0] == seeds[3] and masses[0] == masses[3]
    assert len({*sum(seeds[:3], [])}) == 6 and len({*sum(masses[:3], [])}) == 6
    estimated = {float(run.model.rigid_body_mass[0, 0]) for fleet in fleets for run in fleet.runs}
    assert len(estimated) == 1  # the autopilot knows nothing of the draws
    assert "was not identified" in plants.description


def test_a_short_mission_that_does_not_fit_is_reported_to_be_one():
    shallow = load_scenario("lawnmower_calm", ["autopilot=model_based", "autopilot.supervisor.depth_limit=1.2",
                                               "mission={waypoints: [{position: [1, 0, 0.6]}]}"])  # fmt: skip
    with pytest.raises(ConfigError, match="short mission of the search .or give --own-mission.*where the supervisor"):
        fleet_of(shallow, plants_of(shallow), seas_of(("calm",), shallow), TUNING, 1, 1, short=True)


def test_own_mismatch_is_what_plants_are_drawn_from():
    hard = load_scenario("lawnmower_hard", ["autopilot=model_based"])
    plants = plants_of(hard)
    plant, model = plants.drawn(np.random.default_rng(1)), plants.drawn(np.random.default_rng(2))
    assert "scenario's mismatch" in plants.description
    assert float(plant.rigid_body_mass[0, 0]) == float(model.rigid_body_mass[0, 0])  # x 1.1, always
    assert float(plant.linear_damping_ahead[0, 0]) != float(model.linear_damping_ahead[0, 0])


@pytest.mark.system
def test_identified_covariance_is_what_plants_are_drawn_from(tmp_path):
    path = identified_vehicle(tmp_path / "identified.yaml")
    plants = plants_of(load_scenario("lawnmower_calm", ["autopilot=model_based", f"vehicle={path}"]))
    assert "covariance of the 2 parameters" in plants.description
    model = load_vehicle(path).model()
    drawn = [plants.drawn(np.random.default_rng(i)) for i in range(200)]
    ratio = np.log([float(m.added_mass[0, 0] / model.added_mass[0, 0]) for m in drawn])
    other = np.log([float(m.quadratic_damping_ahead[0, 0] / model.quadratic_damping_ahead[0, 0]) for m in drawn])
    assert np.std(ratio) == pytest.approx(0.1, rel=0.2) and np.std(other) == pytest.approx(0.2, rel=0.2)
    assert np.corrcoef(ratio, other)[0, 1] == pytest.approx(0.5, abs=0.15)


def test_a_vehicle_that_nothing_turns_has_a_section_that_can_be_written_and_read():
    section = start_of(load_scenario("square", ["vehicle=blueye_pioneer"]))
    assert with_values(section, {"control.integral": 0.1}).control.integral == 0.1


def test_a_short_mission_has_the_time_and_the_depths_of_its_vehicle(scenario):
    slow, quick = (short_mission(load_scenario("square", [f"vehicle={v}"])) for v in ("sparus_ii", "bluerov2"))
    assert short_mission(scenario)["duration"] == pytest.approx(75.0)
    assert slow["duration"] > 150.0 > 60.0 > quick["duration"]
    assert slow["mission"]["waypoints"][0]["acceptance"] > quick["mission"]["waypoints"][0]["acceptance"]


def test_short_mission_begins_where_the_scenario_does(scenario):
    turned = load_scenario("lawnmower_calm", ["autopilot=model_based", "start={position: [5, 6, 1], heading_deg: 90}"])
    first = short_mission(turned)["mission"]["waypoints"][0]
    assert first["position"] == pytest.approx([5.0, 9.0, 1.5]) and first["speed"] == 0.2
    assert short_mission(scenario)["mission"]["waypoints"][-1]["hold_time"] > 0


def test_paired_interval_is_students():
    mean, low, high = paired(np.array([-1.0, 0.0, -2.0, -1.0]))
    assert mean == -1.0 and high - mean == pytest.approx(3.182 * np.sqrt(2 / 3) / 2, rel=1e-3) and low < mean < high


def made(scenario, section: ModelBasedSection, gain: float) -> Tuned:
    """A tuning as it might have come out."""
    command = TuningRequest(scenario, chosen(), ("calm",), weights_of([]), held_out=3)
    after = [FIGURES | {"cross_track_rms_m": 0.2 * (1 - gain) + 0.001 * i} for i in range(3)]
    cost = Cost.against(command.weights, ["calm"] * 3, [FIGURES] * 3, floors_of(section))
    costs = [cost.all_of(["calm"] * 3, one) for one in ([FIGURES] * 3, after)]
    found = search(lambda xs: [1.0] * len(xs), np.zeros(3), BOX, seed=1, evaluations=14)
    judged = Judged(["calm"] * 3, [FIGURES] * 3, after, *costs)
    influence = {one.name: 0.01 for one in command.tunables}
    return Tuned(command, "a hat", section, cost, found, 1.0, ("the best", 1.0, 0.9), influence, judged, {"all": 1.0})


def test_file_flies_and_says_where_it_comes_from(scenario, tmp_path):
    section = with_values(start_of(scenario), {"control.damping_ratio": 1.3})
    files = write_tuned(made(scenario, section, 0.5), tmp_path / "out")
    again = load_scenario("lawnmower_hard", [f"autopilot={files['autopilot']}"]).autopilot
    assert isinstance(again, ModelBasedSection) and again.control == section.control
    assert again.tuned is not None and again.tuned.vehicle == "double_blueye" and again.tuned.plants == "a hat"
    changed = load_scenario("lawnmower_hard", [f"autopilot={files['autopilot']}", "autopilot.control.integral=0.2"])
    assert changed.autopilot.control.integral == 0.2 and changed.autopilot.control.damping_ratio == 1.3
    assert tuned_for_another(again, load_vehicle("double_blueye")) is None
    assert "tuned for double_blueye" in (tuned_for_another(again, load_vehicle("bluerov2")) or "")
    page = files["report"].read_text()
    assert "Better than hand-tuned" in page and "control.bandwidth.surge" in page
    assert {path.stem for path in (tmp_path / "out" / "figures").iterdir()} == {"held_out", "parameters", "search"}


def test_file_beside_a_scenario_is_found(scenario, tmp_path):
    section = with_values(start_of(scenario), {"control.damping_ratio": 1.3})
    write_tuned(made(scenario, section, 0.5), tmp_path, report=False)
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump({"mission": "square", "autopilot": "autopilot.yaml"}))
    assert load_scenario(tmp_path / "mine.yaml").autopilot.control.damping_ratio == 1.3


def test_what_is_no_better_is_reported_to_be(scenario):
    section = start_of(scenario)
    text = as_data(made(scenario, section, -0.5))
    assert not text["better"] and "hand-tuned values stay" in text["verdict"]
    other = with_values(section, {"control.damping_ratio": 1.3})
    assert "Not shown to be better" in as_data(made(scenario, other, 0.005))["verdict"]
    assert "Worse than hand-tuned: the cost rises by" in as_data(made(scenario, other, -0.5))["verdict"]


@pytest.mark.slow
def test_tuned_beats_hand_tuned_on_held_out_plants_and_does_so_again():
    hard = load_scenario("lawnmower_hard", ["autopilot=model_based"])
    command = TuningRequest(hard, chosen(), (), weights_of([]), evaluations=100, budget=3600.0)
    tuned = tune(command)
    assert tuned.held_out.better and len(tuned.held_out.seas) == 20, tuned.held_out.change
    assert not np.any(tuned.held_out.cost_after >= FAILED)


@pytest.mark.slow
def test_same_seed_same_tuning():
    calm = load_scenario("lawnmower_calm", ["autopilot=model_based", "mission=square"])
    command = TuningRequest(
        calm, chosen(["control.damping_ratio", "navigation.force_walk"]), ("calm",), weights_of([]),
        plants=2, held_out=2, evaluations=12, budget=3600.0,
    )  # fmt: skip
    one, other = tune(command), tune(command)
    assert one.section == other.section and one.search.costs == other.search.costs
    assert isinstance(one.search, Search) and np.array_equal(one.held_out.cost_after, other.held_out.cost_after)
