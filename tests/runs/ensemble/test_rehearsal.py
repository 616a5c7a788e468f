"""A mission rehearsed: the same flight as `fly` makes, bands that hold a true vehicle and not an untrue one."""

import json

import numpy as np
import pytest
from tests.campaign.identified import identified_vehicle

from rovtwin.core.errors import LogError
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.ensemble.comparison import Sortie, compared, sortie_of
from rovtwin.runs.ensemble.flights import fly_one
from rovtwin.runs.ensemble.forecast import for_page, forecast
from rovtwin.runs.ensemble.rehearsal import Rehearsal, as_known
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario

pytestmark = pytest.mark.system
DRAWS = 19
DRAG = ("linear_damping_ahead", "linear_damping_astern", "quadratic_damping_ahead", "quadratic_damping_astern")
POINTS = [([6.0, 0.0, 1.0], 0.0), ([6.0, 2.0, 1.5], 5.0)]


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """Two legs with a corner, a dive and a stay, over a floor, with a battery that counts."""
    path = identified_vehicle(tmp_path_factory.mktemp("vehicle") / "identified.yaml", 0.25)
    rest = "speed: 0.25, acceptance: 0.3"
    points = [f"{{position: {place}, {rest}, hold_time: {hold}}}" for place, hold in POINTS]
    changes = [f"vehicle={path}", "autopilot=model_based", "world.floor=3", "battery={charge: 0.5}", "name=short"]
    return load_scenario("lawnmower_calm", [*changes, f"mission.waypoints=[{', '.join(points)}]"])


@pytest.fixture(scope="module")
def rehearsal(scenario):
    return Rehearsal(scenario, charge=0.5)


@pytest.fixture(scope="module")
def nominal(rehearsal):
    return rehearsal.nominal()


@pytest.fixture(scope="module")
def drawn(rehearsal):
    shares = []
    flights = rehearsal.drawn(shares.append, DRAWS)
    assert shares == sorted(shares) and shares[-1] == 1.0
    return flights


@pytest.fixture(scope="module")
def predicted(rehearsal, nominal, drawn):
    """As a page and a file have it."""
    return json.loads(to_json(forecast(rehearsal, nominal, drawn)))


@pytest.fixture(scope="module")
def flight(rehearsal, tmp_path_factory):
    """The same mission by `fly`."""
    return fly(rehearsal.scenario, tmp_path_factory.mktemp("run") / "run")


def test_the_vehicle_as_it_is_known_flies_as_fly_does(rehearsal, nominal, flight):
    figures = flight.figures
    assert figures["completed"] and nominal.ended == ""
    assert nominal.lasting == figures["duration_s"]
    assert nominal.whole / 3600.0 == pytest.approx(figures["energy_wh"], rel=0.01)
    mode = flight.log["autopilot/mode"]
    left = mode.t[np.flatnonzero(mode["waypoint"] >= 1)[0]]
    assert nominal.times[0, 3] == pytest.approx(left, abs=0.11)
    assert nominal.remains is not None and 0.4 < nominal.remains < 0.5


def test_what_is_hidden_or_breaks_is_not_rehearsed(scenario):
    hidden = {"mismatch": None, "thruster_health": {"sway": 0.5}}
    broken = scenario.model_copy(update={"world": scenario.world.model_copy(update=hidden)})
    known = as_known(broken)
    assert known.world.thruster_health == {} and known.faults == []
    assert known.duration < 400.0  # the mission's own, and not the scenario's


def test_bands_are_of_drawn_vehicles_and_hold_the_known_one(predicted, rehearsal):
    assert (predicted["draws"], predicted["alike"], predicted["level"]) == (DRAWS, DRAWS, pytest.approx(0.9))
    assert predicted["identified"] and "covariance" in predicted["drawn_from"]
    time = predicted["time_s"]
    assert time["low"] <= time["value"] <= time["high"] and time["high"] - time["low"] < 0.2 * time["value"]
    reached = [point["reached"] for point in predicted["points"]]
    assert len(reached) == len(POINTS) and reached == sorted(reached)
    for point in predicted["points"]:
        assert point["early"] <= point["late"] < 1.3 * point["early"]
        assert -1e-4 <= point["least_margin"] < 1.0 and -1e-4 <= point["margin"] < 1.0
    profile = predicted["profile"]
    low, high, hull, floor = (np.array(profile[name]) for name in ("low", "high", "hull", "floor"))
    assert np.all(low <= high) and np.all(high < hull) and np.all(hull < floor) and floor == pytest.approx(3.0)
    assert predicted["nearest_m"]["the floor"] == pytest.approx((floor - hull).min(), abs=0.01)
    port, starboard = (np.array(predicted["track"][side]) for side in ("port", "starboard"))
    widths = np.hypot(*(starboard - port).T)
    assert 0.05 < np.median(widths) < 0.8  # acoustic positions have a standard deviation of 0.5 m
    assert "inside" not in for_page(predicted)


def test_a_flight_is_read_from_its_log(predicted, rehearsal, nominal, flight):
    one = sortie_of(flight.log, predicted["places"][1:])
    assert one.t[-1] == pytest.approx(nominal.lasting, abs=0.2) and one.power is None and not one.by_hand
    found = compared(predicted, one, rehearsal.base.vehicle, rehearsal.scenario.heading)
    assert found["completed"] and found["reached"] == len(POINTS) and found["verdict"] in ("inside", "near")
    energy = found["energy_wh"]
    assert energy["by"] == "the thrusters' commands"
    assert energy["flown"] == pytest.approx(nominal.whole / 3600.0, rel=0.1)
    with pytest.raises(LogError, match="expected the one that was rehearsed"):
        sortie_of(flight.log, [[0.0, 0.0, 9.0]])


def sortie(flown):
    """Of a flight of the twin, whose battery is measured."""
    power = np.interp(flown.t, flown.t, np.full(len(flown.t), flown.energy / flown.duration))
    return Sortie(flown.t, flown.eta_hat, flown.nu_hat, flown.tau, flown.mode, np.zeros((len(flown.t), 1)), power)


def held_against_it(predicted, rehearsal, run):
    return compared(predicted, sortie(fly_one(run)), rehearsal.base.vehicle, rehearsal.scenario.heading)


def test_another_vehicle_of_the_same_distribution_is_predicted(predicted, rehearsal):
    found = held_against_it(predicted, rehearsal, rehearsal.drawn_run(1000))
    assert found["verdict"] in ("inside", "near") and found["completed"] and found["notes"] == []
    assert all(one["verdict"] == "inside" for one in found["effort"])
    assert {one["axis"] for one in found["axes"]} == {"across", "depth", "heading"}
    assert found["time_s"]["flown"] == pytest.approx(predicted["time_s"]["value"], rel=0.1)
    assert found["energy_wh"]["by"] == "the battery's own power"


def test_a_vehicle_with_twice_the_drag_is_not(predicted, rehearsal):
    model = rehearsal.base.model
    truth = model.replace(**{name: 2.0 * getattr(model, name) for name in DRAG})
    found = held_against_it(predicted, rehearsal, compose(rehearsal.scenario, truth))
    assert found["verdict"] == "outside"
    surge = next(one for one in found["effort"] if one["axis"] == "surge")
    assert surge["verdict"] == "outside" and surge["interval_95"][1] < surge["ratio"] < 2.0  # noise dilutes it
    assert found["energy_wh"]["inside"] is False and found["energy_wh"]["flown"] > found["energy_wh"]["predicted"]


def test_a_flight_that_began_elsewhere_is_compared_from_the_second_leg_on(predicted, rehearsal):
    flown = fly_one(rehearsal.drawn_run(1001))
    flown.eta_hat[: len(flown.t) // 4, :2] += 2.0
    found = compared(predicted, sortie(flown), rehearsal.base.vehicle, rehearsal.scenario.heading)
    assert "began 2.8 m from where it was rehearsed" in found["notes"][0] and found["time_s"] is None
    assert next(one for one in found["axes"] if one["axis"] == "across")["beyond"] < 0.3


def test_a_current_that_is_too_strong_is_in_the_remarks(scenario):
    strong = scenario.world.current.model_copy(update={"velocity": [0.0, 0.45, 0.0]})
    world = scenario.world.model_copy(update={"current": strong})
    rehearsal = Rehearsal(scenario.model_copy(update={"world": world}))
    data = forecast(rehearsal, rehearsal.nominal())
    levels = {one["level"] for one in data["remarks"]}
    assert levels & {"warning", "error"} and data["level"] is None
    assert any(one["points"] for one in data["remarks"])
