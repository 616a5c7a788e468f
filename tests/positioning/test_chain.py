"""Chapter 8.1 again: what it is compared with, whether the runs are flown to their end, and in short what comes out."""

import json

import numpy as np
import pytest
from tests.positioning.chain import (
    FAMILIES,
    TABLE_8_2,
    TRUTH,
    chain,
    damping_error,
    guessed,
    run,
    steady_speeds,
    terminal,
    true_values,
)
from tests.positioning.tracks import camera

from rovtwin.core.log import Log
from rovtwin.positioning.estimators.ekf import MarkerEkf
from rovtwin.positioning.images.camera_model import sizes_of
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle

FORCES = np.array([4.0, 8.0, 12.0, 16.0, 20.0])


def test_the_thesis_table_is_what_its_notes_state():
    truth = true_values("surge")
    speeds = terminal(truth, FORCES)
    np.testing.assert_allclose(speeds, [0.0697, 0.1357, 0.1985, 0.2586, 0.3162], atol=5e-5)  # errata 36
    assert TABLE_8_2["added_mass"] / truth["added_mass"] - 1 == pytest.approx(0.086, abs=1e-3)
    assert damping_error(TABLE_8_2, truth, speeds) == pytest.approx(0.137, abs=1e-3)


@pytest.mark.parametrize("axis", ["surge", "sway"])
def test_the_guess_is_wrong_along_one_axis_only(axis):
    true, guess = load_vehicle(TRUTH), guessed(load_vehicle(TRUTH), axis)
    at = {"surge": 0, "sway": 1}[axis]
    for family in FAMILIES:
        before, after = (np.array(v.to_dict()["hydrodynamics"][family], float) for v in (true, guess))
        assert abs(after[at] - before[at]) > 0.3 * max(before[at], 1.0)
        np.testing.assert_array_equal(np.delete(after, at), np.delete(before, at))


def test_sizes_hold_where_places_are_unknown():
    sizes = np.asarray(sizes_of({3: 0.3}, default=0.15))
    filter = MarkerEkf.of([camera()], sizes=sizes)
    np.testing.assert_array_equal(np.asarray(filter.sizes)[[2, 3, 4]], [0.15, 0.3, 0.15])


@pytest.mark.slow
@pytest.mark.parametrize("axis", ["surge", "sway"])
def test_the_run_stays_in_the_pool_and_comes_home(axis, tmp_path):
    scenario = load_scenario(f"free_running_{axis}")
    log = fly(scenario, tmp_path / "run").log
    truth = log["truth/eta"]
    assert truth.t[-1] > 155  # not given up on the way
    tank = load_scene("pool").file.tank
    assert tank is not None
    for name, size in (("x", tank.length), ("y", tank.width)):
        assert np.abs(truth[name]).max() < 0.5 * size - 1.0
    assert 0.5 < truth["z"].min() and truth["z"].max() < tank.depth - 0.5
    spans = [s for s in _test(log) if s["what"] == "home"]
    ends = np.array([[np.interp(s["end"], truth.t, truth[name]) for name in "xy"] for s in spans])
    assert np.abs(ends - np.array(scenario.start.position)[:2]).max() < 0.4
    _, speeds = steady_speeds(axis, truth.t, np.stack([truth[name] for name in "xyz"], axis=1), log)
    force = FORCES if axis == "surge" else FORCES / 2
    np.testing.assert_allclose(speeds, terminal(true_values(axis), force), rtol=0.02)


@pytest.mark.slow
def test_parameters_come_out_of_the_pictures(tmp_path):
    pytest.importorskip("cv2")
    pytest.importorskip("gtsam")
    manoeuvre = "{manoeuvre: steps, axis: surge, levels: [0.4, 1.0], duration: 7, alternate: true, hold: [heading]}"
    log = run("surge", tmp_path / "run", ("duration=32", f"test.manoeuvres=[{manoeuvre}]"))
    found, truth = chain("surge", log).parameters, true_values("surge")
    assert found["added_mass"] == pytest.approx(truth["added_mass"], rel=0.15)
    assert abs(damping_error(found, truth, terminal(truth, FORCES[1:]))) < 0.05


def _test(log: Log) -> list[dict]:
    return json.loads(log.metadata["test"])
