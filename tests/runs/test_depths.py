"""A mission counts as completed only if its way-points were reached in depth, too."""

import dataclasses

import numpy as np
import pytest
from tests.runs.test_scores import flown

from rovtwin.core.flow import FINISHED
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.scoring.depths import not_at_depth
from rovtwin.runs.scoring.summary import summarise
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle

ONE = ["mission={waypoints: [{position: [10, 0, 3]}]}", "vehicle=double_blueye"]
MODEL = load_vehicle("double_blueye").model()


def at(depth, **changes):
    """The known run north, at a depth all the way."""
    run = flown()
    eta, mode = run.eta.copy(), run.mode.copy()
    eta[:, 2] = depth
    mode[-1] = [FINISHED, 0, 0, 0]
    return dataclasses.replace(run, eta=eta, mode=mode, **changes)


def test_a_way_point_passed_far_above_its_depth_is_none():
    scenario = load_scenario("square", ONE)
    assert not_at_depth(at(3.1), scenario, MODEL) == ""
    text = not_at_depth(at(0.5), scenario, MODEL)
    assert "way-point 1 of 1 was passed at a depth of 0.5 m, and 3 m were asked for" in text


def test_a_moment_at_its_depth_on_the_second_half_of_the_leg_is_enough():
    run = at(np.where(np.arange(1001) < 900, 0.5, 2.9))
    assert not_at_depth(run, load_scenario("square", ONE), MODEL) == ""


@pytest.mark.slow
def test_a_run_that_finished_without_diving_is_not_completed():
    """It was: a run counted as completed as soon as guidance had finished."""
    simulation = compose(load_scenario("square", ONE))
    summary = summarise(at(0.5), simulation, interrupted=False)
    assert not summary["completed"] and "was passed at a depth of 0.5 m" in summary["reason"]
    assert summarise(at(3.0), simulation, interrupted=False)["completed"]
