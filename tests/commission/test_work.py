"""What a stage works with: the line that steers has the socket of STOP, one that only looks does not take it; where
positions come from.
"""

from contextlib import contextmanager

import numpy as np
import pytest
from tests.commission.people import Scripted
from tests.commission.waterside import Yes

from rovtwin.commission import work as working
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.request import Request
from rovtwin.commission.run import commission
from rovtwin.commission.stage import Outcome, Stage
from rovtwin.commission.work import Work, positions_of, scenario_of
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.gnc.navigation.accuracy_bound import _schedule
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.sensors import sensors_of
from rovtwin.vehicle import load_vehicle


def test_the_line_that_steers_is_stopped_past_the_stage(tmp_path, monkeypatch):
    given = []

    @contextmanager
    def connect(url, scenario, clock, observe=False, stop_at=None):
        given.append((observe, stop_at))
        yield None

    monkeypatch.setattr(working, "connect", connect)
    request, stop = Request("double_blueye", "twin://"), tmp_path / "stop"

    def run(work):
        with work.connected(None) as there, work.connected(None, observe=True, beside=there):
            return Outcome()

    stages = [Stage("one", "One", "a purpose", "next", True, run)]
    commission(request, tmp_path / "c", stages, Yes(), stop_at=stop)
    assert given == [(False, stop), (True, None)]
    given.clear()
    run(Work(Dossier.open(tmp_path / "c"), tmp_path, Yes()))
    assert given == [(False, None), (True, None)], "in a terminal Ctrl-C does it"


BENCH = {"sensors": [{"name": "position", "noise": [0.004, 0.005], "rate_hz": 20.0}]}


@pytest.fixture
def located(tmp_path):
    """A vehicle with a locator that was fitted badly."""
    sensor = {"name": "position", "kind": "position", "pose": {"position": [0.1, 0, 0]}, "noise": 0.4, "rate_hz": 1}
    sensor |= {"bias": 0.3, "latency": 0.5, "outlier": 0.1, "errors": "acoustic"}
    locator = {"name": "ugps", "mass": 0.1, "volume": 1e-4, "shape": {"sphere": 0.03}, "sensors": [sensor]}
    path = tmp_path / "located.yaml"
    path.write_text(dump_yaml({"name": "located", "parts": [{"name": "rov", "part": "double_blueye"}, locator]}))
    return str(path)


@pytest.mark.parametrize("beside", [(), ("ugps://127.0.0.1",)])
def test_positions_that_a_part_measures_are_as_its_file_says(located, beside):
    """Also where they come over an instrument: the locator is on board."""
    assert positions_of(load_vehicle(located), BENCH, beside) is None
    assert (positions_of(load_vehicle("double_blueye"), BENCH, beside) or {})["noise"] == 0.005


def test_motion_capture_takes_the_place_of_a_locator(located):
    """It was asked for where the locator was too poor for the tank, and then changed nothing."""
    positions = positions_of(load_vehicle(located), BENCH, ("dvl://127.0.0.1", "qtm://127.0.0.1/rov"))
    scenario = scenario_of(Request(located, "twin://"), located, positions, {})
    sensor = sensors_of(scenario, vehicle_of(scenario))["position"]
    assert (float(sensor.noise[0]), sensor.rate, sensor.errors, sensor.latency_steps) == (0.005, 20_000, None, 0)
    assert not any(x.any() for x in map(np.asarray, (sensor.lever, sensor.bias, sensor.outlier, sensor.bias_walk)))


def test_readings_that_are_late_may_be_a_twins_that_this_machine_has_no_time_for():
    assert "too busy for 1 times" in Request("double_blueye", "twin://").too_busy
    assert "too busy for 4 times" in Request("double_blueye", "blueye://127.0.0.2,127.0.0.3", speed=4.0).too_busy
    assert Request("double_blueye", "blueye://192.168.1.101,192.168.1.102").too_busy == ""


@pytest.mark.parametrize("counted", [15.001, 14.9987, 19.96, 0.873, 1.26, 4.93, 33.3, 0.02])
def test_positions_at_a_counted_rate_have_an_accuracy(counted):
    """The prediction of a flight stopped: "rates [15.001, 100.0] Hz have no short common period"."""
    bench = {"sensors": [{"name": "position", "noise": [0.005, 0.005], "rate_hz": counted}]}
    rate = (positions_of(load_vehicle("double_blueye"), bench) or {})["rate_hz"]
    assert rate == pytest.approx(counted, rel=0.21) or counted < 0.1
    assert 0.0 < _schedule([rate, 100.0])[0] <= _schedule([rate, 50.0])[0] <= 0.02


def test_it_is_known_whether_thrusters_may_turn(tmp_path):
    entered = []

    def run(work):
        assert work.may_move("May it fly?")
        work.at_rest()
        work.person.no = ("again",)
        assert not work.may_move("May it fly again?")
        return Outcome()

    request, stages = Request("double_blueye", "twin://"), [Stage("one", "One", "a purpose", "next", True, run)]
    commission(request, tmp_path / "c", stages, Scripted(), enter=entered.append)
    assert entered == ["asking", "turning", "resting", "asking", "resting"]
