"""Scenario and mission files: shipped ones, overrides, mistakes."""

import logging

import pytest
import yaml

from rovtwin.core.errors import ConfigError
from rovtwin.scenario.files import dump_scenario, list_missions, list_scenarios, load_mission, load_scenario, put
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.schema.autopilot import _say_replaced
from rovtwin.scenario.seeds import parse_seeds


def test_all_reference_scenarios_are_shipped():
    assert {name for name in list_scenarios() if not name.startswith(("test_", "free_running_"))} == {
        "lawnmower_calm", "lawnmower_waves", "lawnmower_mismatch", "lawnmower_hard", "lawnmower_dropout",
        "lawnmower_sea", "square", "station_keeping",
        "ardusub_depth_hold", "ardusub_position_hold", "ardusub_waypoint", "terrain_following",
    }  # fmt: skip
    assert {"lawnmower", "square", "station"} <= set(list_missions())


@pytest.mark.parametrize("name", list_scenarios())
def test_shipped_scenarios_load_also_with_a_dvl_and_survive_writing(name):
    plain, dvl = load_scenario(name), load_scenario(f"{name}_dvl")
    assert plain.name == name and not plain.sensors.dvl.on_board
    assert dvl.name == f"{name}_dvl" and dvl.sensors.dvl.on_board
    if not plain.cameras and not name.startswith("ardusub_"):  # in a pool, with the thesis's vehicle; another vehicle
        assert plain.vehicle == "double_blueye" and plain.start.position == [0.0, 0.0, 3.0 if plain.test else 0.5]
    assert plain.rates.physics == 500 and plain.rates.control == 50 and (plain.test or plain.duration == 1500)
    assert Scenario.model_validate(yaml.safe_load(dump_scenario(plain))) == plain


def test_missions_are_those_of_the_thesis():
    table_8_3 = [[6, 0, 3], [6, 3, 3], [0, 3, 3], [0, 6, 3], [6, 6, 3], [6, 9, 3], [0, 9, 3]]
    assert [w.position for w in load_mission("lawnmower").waypoints] == table_8_3
    assert [w.position for w in load_mission("square").waypoints] == [[3, 0, 3], [3, 3, 3], [0, 3, 3], [0, 0, 3]]
    assert {w.acceptance for w in load_mission("lawnmower").waypoints} == {0.2}


def test_overrides_reach_every_depth_and_short_forms():
    scenario = load_scenario(
        "lawnmower_calm",
        ["world.current=[0.1,0,0]", "sensors.position.outlier=5e-2", "autopilot.controller.gains=pole_placement",
         "mission=square", "world.waves.drift=0.1", "world.mismatch=true"],
        seed=7,
    )  # fmt: skip
    assert scenario.world.current.velocity == [0.1, 0, 0]
    assert scenario.sensors.position.outlier == 0.05
    assert scenario.autopilot.controller.gains == "pole_placement"
    assert scenario.mission.name == "square" and scenario.seed == 7
    assert scenario.world.waves is not None and scenario.world.waves.drift == 0.1
    assert scenario.world.mismatch is not None and scenario.world.mismatch.damping == 0.25


def test_a_preset_can_be_named_and_then_changed():
    scenario = load_scenario("square", ["autopilot=thesis_as_printed", "autopilot.controller.gains=table_3_2"])
    assert scenario.autopilot.observer.tuning == "as_printed"
    assert scenario.autopilot.controller.gains == "table_3_2"
    assert load_scenario("square", ["sensors=as_printed"]).sensors.preset == "as_printed"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("wrold.current=1", "wrold: no such key. Did you mean 'world'?"),
        ("world.curent=1", "world.curent: no such key. Did you mean 'current'?"),
        ("world.waves.drift=-1", "world.waves.drift: found -1, expected a number of at least 0"),
        ("world.waves.drift=.nan", "world.waves.drift: found nan, expected a finite number"),
        ("world.current=[1,2]", "world.current: found 2 values, expected 3"),
        ("world.current=0.2", "world.current: found 0.2, expected three numbers [north, east, down]"),
        ("world.current={type: sheared, depths: [5, 0], velocities: [[0,0,0],[0,0,0]]}", "do not increase"),
        ("world.current={type: sheared, depths: [0, 5], velocities: [[0,0,0]]}", "expected 2"),
        ("world.current={type: gauss_markov, sigma: [-1,0,0], time_constant: 10}", "cannot be negative"),
        ("mission.waypoints=[]", "mission.waypoints: found 0 values, expected 1"),
        ("mission=lawnmover", "lawnmover: no such mission"),
        ("seed", "expected key=value"),
        ("seed=-1", "seed: found -1"),
        ("seed=[", "not YAML"),
        ("autopilot=pid", "no autopilot 'pid'"),
        ("autopilot.observer.tuning=printed", "expected 'consistent' or 'as_printed'"),
        ("sensors.gyros.latency=1", "sensors: gyros: no such key. Did you mean 'gyro'?"),
        ("sensors.position.latency=1e12", "sensors.position.latency: found 1000000000000.0"),
        ("sensors.position.blackouts=[[140, 80]]", "begins before it ends"),
        ("duration=true", "duration: found True"),
        ("seed=true", "seed: found True"),
        ("start.position=[0,0,-5]", "expected a depth of at least 0"),
        ("mission.waypoints=[{position: [0, 0, 300]}]", "where the supervisor aborts"),
        ("log.rate=7", "does not divide"),
        ("rates.control=60", "control rate 60 Hz does not divide the physics rate 500 Hz"),
        ("start.heading_deg=720", "start.heading_deg"),
        ("duration=0", "duration: found 0, expected a number greater than 0"),
    ],
)  # fmt: skip
def test_a_bad_override_is_named_with_what_was_expected(override, expected):
    with pytest.raises(ConfigError) as error:
        load_scenario("lawnmower_calm", [override])
    assert expected in str(error.value)


def test_an_override_names_elements_of_a_list_as_campaigns_do(tmp_path):
    changed = load_scenario("square", ["mission.waypoints[1].speed=0.11", "mission.waypoints[*].acceptance=0.7"])
    before = load_scenario("square").mission.waypoints
    assert [w.speed for w in changed.mission.waypoints[:3]] == [before[0].speed, 0.11, before[2].speed]
    assert {w.acceptance for w in changed.mission.waypoints} == {0.7}
    (tmp_path / "my.yaml").write_text("mission: square\nfaults: [{fault: dead, thruster: port.surge, at: 9}]")
    assert load_scenario(tmp_path / "my.yaml", ["faults[0].at=20"]).faults[0].at == 20


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("mission.waypoints[9].speed=1", "mission.waypoints has 4 elements, counted from 0; there is no"),
        ("mission.waypoints[0].sped=1", "mission.waypoints[0].sped"),
        ("mission.waypoints[0]=3", "mission.waypoints[0] is a mapping, expected a number's path"),
        ("faults[0].at=3", "the scenario's file gives no list faults: set it whole, faults=[...]"),
        ("world..water=sea", "'world..water' is no path"),
    ],
)  # fmt: skip
def test_a_path_that_leads_nowhere_is_refused(override, expected):
    with pytest.raises(ConfigError) as error:
        load_scenario("square", [override])
    assert f"--set {override}: " in str(error.value) and expected in str(error.value)


def test_a_mistake_names_the_override_or_the_file_that_it_stands_in(tmp_path):
    (tmp_path / "my.yaml").write_text("mission: square\nworld: {current: [1, 2]}\nduration: 50")
    with pytest.raises(ConfigError) as error:
        load_scenario(tmp_path / "my.yaml", ["duration=-5", "faults=[{fault: ded}]"])
    lines = str(error.value).splitlines()
    assert [line.split(": ")[0] for line in sorted(lines)] == ["--set duration=-5", "--set faults=[{fault", "my.yaml"]


def test_a_missing_scenario_names_a_near_one():
    with pytest.raises(ConfigError, match="lawnmower_clam: no such scenario.*Did you mean 'lawnmower_calm'"):
        load_scenario("lawnmower_clam")


def test_missions_and_vehicles_are_found_beside_the_scenario_file(tmp_path, monkeypatch):
    (tmp_path / "my_mission.yaml").write_text("waypoints: [{position: [1, 2, 3]}]")
    (tmp_path / "my_vehicle.yaml").write_text("name: mine")
    (tmp_path / "my.yaml").write_text("mission: my_mission.yaml\nvehicle: my_vehicle.yaml")
    monkeypatch.chdir("/")
    scenario = load_scenario(tmp_path / "my.yaml")
    assert scenario.mission.waypoints[0].position == [1, 2, 3]
    assert scenario.vehicle == str(tmp_path / "my_vehicle.yaml")


@pytest.mark.parametrize(
    ("file", "name"),
    [("pool.yaml", "pool"), ("my dive 2.yaml", "my_dive_2"), (".hidden.yaml", "hidden"), ("__.yaml", "scenario")],
)
def test_a_scenario_without_a_name_is_called_like_its_file(file, name, tmp_path):
    (tmp_path / file).write_text("mission: square")
    assert load_scenario(tmp_path / file).name == name
    assert load_scenario(tmp_path / file, ["name=other"]).name == "other"
    (tmp_path / file).write_text("name: mine\nmission: square")
    assert load_scenario(tmp_path / file).name == "mine"


def test_seeds():
    assert parse_seeds("1-3,7") == [1, 2, 3, 7]
    assert parse_seeds("3,3,2-4") == [3, 2, 4]
    for bad in ("", "a", "1-", "-3", "5-1", "1-100000000000", "3000000000"):
        with pytest.raises(ConfigError, match="expected"):
            parse_seeds(bad)


@pytest.mark.parametrize("name", list_scenarios())
def test_every_scenario_flies_model_based_unless_it_says_otherwise(name):
    scenario = load_scenario(name)
    assert scenario.autopilot.type == "model_based"
    assert "type: model_based" in dump_scenario(scenario)


@pytest.mark.parametrize(
    "section, expected",
    [
        ("thesis", "thesis"),
        ("thesis_placed", "thesis"),
        ("thesis_as_printed", "thesis"),
        ("{type: thesis}", "thesis"),
        ("{controller: {gains: table_3_2}}", "thesis"),  # files of before: nothing else has these keys
        ("{observer: {force_walk: 0.1}, guidance: {lookahead: 3}}", "thesis"),
        ("{supervisor: {depth_limit: 30}}", "model_based"),
        ("model_based", "model_based"),
    ],
)
def test_which_autopilot_a_section_means(section, expected):
    assert load_scenario("square", [f"autopilot={section}"]).autopilot.type == expected


def test_a_key_of_a_baseline_opens_the_baseline():
    assert (
        load_scenario("square", ["autopilot=thesis", "autopilot.supervisor.depth_limit=30"]).autopilot.type == "thesis"
    )


@pytest.mark.parametrize("steering", ["ilos", "alos"])
def test_steering_that_los_has_replaced_is_flown_as_los_and_reported(steering, caplog, monkeypatch):
    _say_replaced.cache_clear()
    # Libraries of other tests of this process set up logging for themselves.
    monkeypatch.setattr(logging.getLogger("rovtwin.scenario.schema.autopilot"), "disabled", False)
    caplog.set_level("WARNING", "rovtwin")
    changes = [f"autopilot={{type: model_based, guidance: {{steering: {steering}}}}}"]
    for _ in range(2):
        assert load_scenario("square", changes).autopilot.guidance.steering == "los"
    assert [f"{steering} is flown as los" in line for line in caplog.messages] == [True]
    with pytest.raises(ConfigError, match=r"autopilot\.\S*guidance\.steering"):
        load_scenario("square", ["autopilot={type: model_based, guidance: {steering: slos}}"])


def test_elements_that_share_an_alias_are_set_each_by_itself():
    """`<<: *t` shares what is nested: one thruster's force used to be set for all of them."""
    leg = {"position": [1.0, 0.0, 2.0]}
    data = {"mission": {"waypoints": [leg, leg]}}
    put(data, "mission.waypoints[1].speed", 0.11, "a test")
    assert data["mission"]["waypoints"] == [leg, leg | {"speed": 0.11}] and "speed" not in leg
    put(data, "mission.waypoints[*].position", [3.0, 3.0, 1.0], "a test")
    put(data, "mission.waypoints[0].position[0]", 9.0, "a test")
    assert [point["position"][0] for point in data["mission"]["waypoints"]] == [9.0, 3.0]


@pytest.mark.parametrize(
    ("path", "why"),
    [("faults[*].at", "has no elements"), ("mission.waypoints[0]speed", "is no path"), ("faults[0].at", "there is no")],
)
def test_a_path_that_leads_nowhere_is_no_silent_override(path, why):
    with pytest.raises(ConfigError, match=why):
        put({"faults": [], "mission": {"waypoints": [{"position": [1.0, 0.0, 2.0]}]}}, path, 20.0, "a test")
