"""Campaign files: what is drawn, that it can be drawn again, and every kind of bad input."""

import numpy as np
import pytest
import yaml
from scipy import stats

from rovtwin.campaign.distributions import Choice, Integers, LogNormal, Normal, Uniform
from rovtwin.campaign.samples import draws, scenario_at, tasks
from rovtwin.campaign.schema import Campaign, load_campaign
from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.fitting import fitted, own_values
from rovtwin.runs.limits import Limits
from rovtwin.vehicle import load_vehicle

VARY = {
    "world.current.velocity[1]": {"distribution": "uniform", "low": -0.1, "high": 0.1},
    "world.mismatch.mass": {"distribution": "normal", "mean": 1.0, "sd": 0.1, "least": 0.9},
    "sensors.position.noise": {"distribution": "lognormal", "median": 0.5, "factor": 1.5},
    "mission.waypoints[*].speed": {"distribution": "uniform", "low": 0.15, "high": 0.3},
    "autopilot": {"distribution": "choice", "values": ["thesis", "thesis_placed"]},
    "vehicle.parts[0].mass": {"distribution": "normal", "mean": 9.0, "sd": 0.1},
}
GOOD = {"scenario": "lawnmower_waves", "samples": 40, "seed": 3, "set": {"world.mismatch": True}, "vary": VARY}


def written(tmp_path, **changes):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(GOOD | changes))
    return path


@pytest.fixture(scope="module")
def campaign(tmp_path_factory) -> Campaign:
    return load_campaign(written(tmp_path_factory.mktemp("campaign")))


def test_draws_depend_on_seed_number_and_path_alone(campaign):
    first = [draws(campaign, index) for index in range(40)]
    assert [draws(campaign, index) for index in reversed(range(40))] == first[::-1]
    larger = campaign.model_copy(update={"samples": 1000})
    assert [draws(larger, index) for index in range(40)] == first
    fewer = campaign.model_copy(update={"vary": {k: v for k, v in campaign.vary.items() if k != "autopilot"}})
    assert all(draws(fewer, i).items() <= first[i].items() for i in range(40))  # the others' draws stay
    assert draws(campaign.model_copy(update={"seed": 4}), 0) != first[0]
    assert len({one["seed"] for one in first}) == 40


def test_a_sample_is_the_scenario_with_its_draws(campaign):
    drawn, scenario = draws(campaign, 5), scenario_at(campaign, 5)
    assert scenario.seed == drawn["seed"] and scenario.world.current.velocity == [
        0,
        drawn["world.current.velocity[1]"],
        0,
    ]
    assert scenario.world.mismatch.mass == drawn["world.mismatch.mass"] >= 0.9
    assert {w.speed for w in scenario.waypoints} == {drawn["mission.waypoints[*].speed"]}
    assert scenario.vehicle["parts"][0]["mass"] == drawn["vehicle.parts[0].mass"]
    assert {scenario_at(campaign, i).autopilot.reference.obey_speed for i in range(8)} == {True, False}


def test_a_complete_campaign_is_complete(campaign, tmp_path):
    """Its file in the folder of results needs no other file, and reading it changes nothing."""
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(campaign.model_dump(mode="json") | {"made_with": "0"}))
    again = load_campaign(tmp_path)
    assert again == campaign and again.name == "mine"
    assert isinstance(again.scenario["vehicle"], dict) and len(again.scenario["mission"]["waypoints"]) > 1


def test_a_vehicle_that_is_drawn_flies_with_its_own_speed_acceptance_and_time(tmp_path):
    """Unless they are drawn as well, or the scenario says them."""
    vehicles = {"distribution": "choice", "values": ["double_blueye", "bluerov2_heavy"]}
    slower = {"mission.waypoints[0].speed": {"distribution": "uniform", "low": 0.05, "high": 0.1}}
    points = [{"position": [x, 0, 2]} for x in (90, 0, 90)]
    drawn = load_campaign(written(tmp_path, set={"mission.waypoints": points}, vary={"vehicle": vehicles} | slower))
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(drawn.model_dump(mode="json")))
    assert load_campaign(tmp_path) == drawn
    for index in range(6):
        scenario = scenario_at(drawn, index)
        model = load_vehicle(scenario.vehicle).model()
        made, own = fitted(scenario, model), own_values(Limits.of(model))
        assert [w.acceptance for w in made.waypoints] == [own["acceptance"]] * 3
        assert [w.speed for w in made.waypoints[1:]] == [own["speed"]] * 2 and made.duration > 1500
        assert 0.05 <= made.waypoints[0].speed <= 0.1
    assert {scenario_at(drawn, i).vehicle for i in range(6)} == set(vehicles["values"])
    timed = {"vehicle": vehicles, "duration": {"distribution": "uniform", "low": 100, "high": 200}}
    assert 100 <= scenario_at(load_campaign(written(tmp_path, vary=timed)), 0).duration <= 200
    with pytest.raises(ConfigError, match="spede: no such key"):
        load_campaign(written(tmp_path, vary={"vehicle": vehicles, "mission.waypoints[*].spede": UNIFORM}))


def test_a_seed_that_is_set_is_not_drawn(tmp_path):
    fixed = load_campaign(written(tmp_path, set={"world.mismatch": True, "seed": 5}))
    assert "seed" not in fixed.vary and scenario_at(fixed, 3).seed == 5
    counted = VARY | {"seed": {"distribution": "integers", "low": 1, "high": 10}}
    assert 1 <= scenario_at(load_campaign(written(tmp_path, vary=counted)), 3).seed <= 10


@pytest.mark.parametrize(
    ("distribution", "law"),
    [
        (Uniform(distribution="uniform", low=-1.0, high=3.0), stats.uniform(-1, 4)),
        (Normal(distribution="normal", mean=2.0, sd=0.5), stats.norm(2, 0.5)),
        (Normal(distribution="normal", mean=0.0, sd=1.0, least=0.0, most=1.0), stats.truncnorm(0, 1)),
        (LogNormal(distribution="lognormal", median=2.0, factor=1.5), stats.lognorm(np.log(1.5), 0, 2)),
    ],
)
def test_distributions_are_what_they_are_called(distribution, law):
    values = [distribution.at(share) for share in np.random.default_rng(1).random(2000)]
    assert stats.kstest(values, law.cdf).pvalue > 0.01


def test_choices_and_integers():
    shares = (np.arange(6000) + 0.5) / 6000
    choice = Choice(distribution="choice", values=["a", "b", "c"], weights=[1, 0, 2])
    drawn = [choice.at(share) for share in shares]
    assert drawn.count("a") == 2000 and drawn.count("b") == 0
    integers = [Integers(distribution="integers", low=-1, high=1).at(share) for share in shares]
    assert [integers.count(k) for k in (-1, 0, 1)] == [2000] * 3


def test_portions_hold_what_one_program_flies(campaign):
    expected = list(range(3, 40))
    assert tasks(campaign, expected, 1) == [[index] for index in expected]
    portions = tasks(campaign, expected, 8)
    assert sorted(sum(portions, [])) == expected and max(map(len, portions)) == 8
    assert all(len({draws(campaign, i)["autopilot"] for i in portion}) == 1 for portion in portions)


UNIFORM = {"distribution": "uniform", "low": 0.0, "high": 1.0}
BAD = [
    ({"scenario": "lawnmower_clam"}, "no such scenario"),
    ({"scenario": "test_mixed", "set": {}, "vary": {}}, "is a test, not a mission"),
    ({"samples": 0}, "samples: found 0, expected a number of at least 1"),
    ({"sample": 3}, "sample: no such key. Did you mean 'samples'?"),
    ({"vary": {"world.curent.velocity[1]": UNIFORM}}, "world.curent: no such key. Did you mean 'current'?"),
    ({"vary": {"world.current.velocity[3]": UNIFORM}}, "has 3 elements, counted from 0"),
    ({"vary": {"world.current.velocity": UNIFORM}}, "expected a number's path"),
    ({"vary": {"world.current": UNIFORM}}, "expected a number's path; name one of type, velocity in it"),
    ({"vary": {"world.current..velocity": UNIFORM}}, "is no path"),
    ({"vary": {"world.net_buoyancy.x": UNIFORM}}, "is 0.0, expected a mapping"),
    ({"vary": {"[0]": UNIFORM}}, "is no path"),
    ({"vary": {"vehicle.nothing.x": UNIFORM}}, "vehicle.nothing: no such key"),
    ({"vary": {"vehicle.mass": UNIFORM}}, "vehicle.mass is what its parts add up to"),
    ({"set": {}}, "the scenario has no world.mismatch; switch it on: set: {world.mismatch: true}"),
    ({"set": {"world.mismach": True}}, "set: world.mismach: no such key"),
    ({"vary": {"seed": {"distribution": "unifrom"}}}, "Did you mean 'uniform'?"),
    ({"vary": {"duration": {"distribution": "uniform", "low": 2, "high": 1}}}, "expected the lower number first"),
    ({"vary": {"duration": {"distribution": "normal", "mean": 2, "sd": 0}}}, "sd: found 0"),
    ({"vary": {"duration": {"distribution": "normal", "mean": 0, "sd": 1, "least": 50}}}, "leave nothing"),
    ({"vary": {"duration": {"distribution": "choice", "values": [1, "a"]}}}, "expected values of one kind"),
    ({"vary": {"duration": {"distribution": "choice", "values": [1], "weights": [1, 2]}}}, "2 weights for 1 values"),
    (
        {"vary": {"duration": {"uniform": [1, 2]}}},
        "duration: found a mapping with uniform, expected the key 'distribution'",
    ),
    ({"vary": 3}, "expected a mapping"),
]


@pytest.mark.parametrize(("changes", "message"), BAD)
def test_bad_files_are_refused_with_the_place_and_the_fix(tmp_path, changes, message):
    with pytest.raises(ConfigError) as error:
        load_campaign(written(tmp_path, **changes))
    assert message in str(error.value) and "mine.yaml" in str(error.value) or "no such scenario" in message


def test_a_draw_that_makes_no_scenario_names_the_sample(tmp_path):
    wild = load_campaign(written(tmp_path, vary={"sensors.position.noise": UNIFORM | {"low": -1.0, "high": -0.5}}))
    with pytest.raises(ConfigError, match=r"sample 2.*sensors\.position\.noise.*\n.*drew seed = \d+, .*noise = -0\."):
        scenario_at(wild, 2)
