"""The public face: what is shown, what it does, and that it does not change unnoticed."""

import copy
import doctest
import inspect
from pathlib import Path

import numpy as np
import pytest

import rovtwin
from rovtwin import api

ROOT = Path(__file__).parents[1]
PUBLIC = ROOT / "tests" / "public_names.txt"
# Examples that need recordings, or take minutes.
NEED_FILES = {"map_classify", "map", "plan_experiment", "run_campaign", "smooth", "track", "tune"}
FUNCTIONS = [name for name in rovtwin.__all__ if inspect.isfunction(getattr(rovtwin, name))]


def signature(name):
    found = getattr(rovtwin, name)
    return f"{name}({', '.join(inspect.signature(found).parameters)})" if inspect.isfunction(found) else name


def test_what_is_public_changes_with_the_changelog():
    """A name or an argument that comes or goes is written into tests/public_names.txt and into CHANGELOG.md."""
    assert PUBLIC.read_text(encoding="utf-8").split("\n")[:-1] == [signature(name) for name in rovtwin.__all__]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    missing = [name for name in rovtwin.__all__ if f"`{name}" not in changelog and f"`rovtwin.{name}" not in changelog]
    assert not missing, f"CHANGELOG.md does not name {missing}"


def test_nothing_else_is_shown():
    assert dir(rovtwin) == sorted(rovtwin.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        rovtwin.nonsense  # noqa: B018  (reading it is what must fail)


@pytest.mark.parametrize("name", rovtwin.__all__)
def test_every_name_says_what_it_is(name):
    if name != "__version__":
        assert len(inspect.getdoc(getattr(rovtwin, name)) or "") > 20


@pytest.mark.system
@pytest.mark.parametrize("name", FUNCTIONS)
def test_examples_of_the_docstrings_run(name):
    assert ">>>" in (inspect.getdoc(getattr(api, name)) or "")
    (test,) = doctest.DocTestFinder(recurse=False).find(getattr(api, name), name, globs={"rovtwin": rovtwin})
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    assert runner.run(test).failed == 0
    assert runner.tries > 0 or name in NEED_FILES, "an example that no test runs"


def test_a_dictionary_is_as_good_as_a_file(tmp_path):
    data = {"name": "tube", "mass": 9.8, "volume": 0.0098, "shape": {"cylinder": {"length": 0.6, "radius": 0.07}}}
    thrusters = [{"name": "stern", "position": [-0.3, 0, 0], "direction": [1, 0, 0], "force": 20.0}]
    data |= {"thrusters": thrusters, "center_of_buoyancy": [0, 0, -0.02]}
    vehicle = rovtwin.load_vehicle(data)
    assert vehicle.name == "tube" and rovtwin.load_vehicle(vehicle) is vehicle
    path = rovtwin.simulate(data, {"stern": np.full(300, 0.5)})
    assert path.nu.attrs["frame"] == "b" and path.to_xarray().sizes["time"] == 301
    assert float(path.nu.sel(axis="u")[-1]) > 0.1 and float(path.position.sel(direction="north")[-1]) > 0.1
    with pytest.raises(rovtwin.ConfigError, match="mass"):
        rovtwin.load_vehicle(data | {"mass": "much"})


def test_a_scenario_from_a_dictionary():
    given = rovtwin.load_scenario("square").model_dump(mode="json")
    before = copy.deepcopy(given)
    assert rovtwin.load_scenario(given | {"seed": 5}, ["duration=10", "world.current=[0.1,0,0]"]).duration == 10.0
    assert given == before, "a dictionary that was handed over stays as it was"
    with pytest.raises(rovtwin.ConfigError, match="durations"):
        rovtwin.load_scenario(given | {"durations": 3})


@pytest.mark.parametrize(
    ("commands", "why"),
    [
        (np.zeros((3, 2)), "expected \\(steps, 6\\)"),
        ({"nobody": [0.0]}, "no thruster 'nobody'"),
        ({"port.surge": [0.0, 0.1], "starboard.surge": [0.0]}, "as many for each"),
        (np.full((3, 6), 2.0), "from -1 to 1"),
        (np.full((3, 6), np.nan), "from -1 to 1"),
        (np.zeros((0, 6)), "at least one step"),
        ([[0.0], [0.0, 1.0]], "expected numbers"),
        ({"port.surge": [["fast"]]}, "expected numbers"),
        ({"port.surge": [[0.1], [0.2]]}, "one number a step"),
    ],
)
def test_commands_that_cannot_be(commands, why):
    with pytest.raises(rovtwin.ConfigError, match=why):
        rovtwin.simulate("double_blueye", commands)


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"dt": 0.0}, "dt: found 0 s"),
        ({"dt": -0.1}, "dt: found -0.1 s"),
        ({"dt": 2.0}, "at most 0.1"),
        ({"dt": np.nan}, "dt: expected finite"),
        ({"heading": np.nan}, "heading: expected finite"),
        ({"position": (0.0, 0.0)}, "position: found the shape"),
        ({"current": 0.1}, "current: found the shape"),
    ],
)
def test_settings_of_a_simulation_that_cannot_be(settings, why):
    with pytest.raises(rovtwin.ConfigError, match=why):
        rovtwin.simulate("double_blueye", np.zeros((3, 6)), **settings)


@pytest.mark.parametrize(
    ("call", "why"),
    [
        (lambda: rovtwin.load_vehicle(5), "vehicle: found int"),
        (lambda: rovtwin.load_scenario(5), "scenario: found int"),
        (lambda: rovtwin.fly("square", report=True), "needs a folder"),
        (lambda: rovtwin.plan_experiment(rovtwin.load_vehicle("double_blueye"), 3.0), "expected a name or a path"),
        (lambda: rovtwin.track("log.mcap", "double_blueye", "ekff"), "method: found 'ekff'"),
        (lambda: rovtwin.track("log.mcap", "double_blueye", video="a.mp4"), "video: no such setting"),
        (lambda: rovtwin.tune("square", nonsense=1), "nonsense: no such setting"),
    ],
)
def test_what_cannot_be_is_refused_in_words(call, why):
    with pytest.raises(rovtwin.ConfigError, match=why):
        call()


@pytest.mark.system
def test_what_a_scenario_leaves_out_is_the_vehicles_own_whichever_way_it_is_given():
    quiet, overrides = {"say": lambda line: None}, ["vehicle=gladius_mini", "duration=0.1"]
    square = rovtwin.load_scenario("square")
    flights = [
        rovtwin.fly("square", overrides=overrides, **quiet),
        rovtwin.fly(square, overrides=overrides, **quiet),
        rovtwin.fly(rovtwin.load_scenario("square", overrides), **quiet),
        rovtwin.fly("square", overrides=overrides, autopilot="model_based", **quiet),
    ]
    flown = [[(point.speed, point.acceptance) for point in flight.scenario.waypoints] for flight in flights]
    assert flown[0] == flown[1] == flown[2] == flown[3]
    assert flown[0][0] != (square.waypoints[0].speed, square.waypoints[0].acceptance)


@pytest.mark.system
def test_a_log_is_one_line_in_a_notebook_and_a_channel_of_it_a_netcdf_file(tmp_path):
    log = rovtwin.fly("square", overrides=["duration=0.1"], say=lambda line: None).log
    assert repr(log).startswith("<Log log: ") and len(repr(log)) < 80
    log["truth/eta"].to_xarray().to_netcdf(tmp_path / "eta.nc")
    assert (tmp_path / "eta.nc").stat().st_size > 1000
