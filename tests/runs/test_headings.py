"""Headings that were asked for and not met, on made-up runs of which every sample is known."""

import numpy as np
import pytest
from tests.runs.test_stalls import NO_SWAY, SECONDS, flown

from rovtwin.console.engine.reporting.state import Changes
from rovtwin.core.flow import FINISHED, GO, GOING, HEADING_GIVEN_UP, HOLD
from rovtwin.runs.scoring.decisions import decisions
from rovtwin.runs.scoring.headings import unmet_headings
from rovtwin.runs.scoring.scores import finished
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle, vehicle_from_dict

N = 10 * SECONDS + 1
SCENARIO = load_scenario(
    "square",
    ["mission.waypoints=[{position: [3, 0, 3], speed: 0.2, acceptance: 0.2, hold_time: 60, heading_deg: 90}]"],
)


def run(psi_deg, phase=FINISHED, state=HEADING_GIVEN_UP):
    """At the way-point from 100 s on, heading psi there; the last sample has the phase."""
    eta = np.zeros((N, 6))
    eta[:, 0], eta[:, 2], eta[1000:, 5] = 3.0, 3.0, np.radians(psi_deg)
    mode = np.tile([GO, 0, 0, 1.0], (N, 1))
    mode[1000:, 0] = HOLD
    mode[-1, 0] = phase
    progress = np.full(N, GOING)
    progress[1200:] = state
    return flown(0.0, 0.0, eta=eta, mode=mode, progress=progress)


def test_a_heading_given_up_is_a_decision_with_its_error_and_the_summary_says_so():
    model = vehicle_from_dict(NO_SWAY, "made up").model()
    (one,) = unmet_headings(run(-83.0), SCENARIO)
    assert one.line == "heading 90 deg given up at way-point 1: 173 deg off when it was left"
    reports = [d for d in decisions(run(-83.0), ["a", "b"], [(0.0, SCENARIO)], model) if "heading" in d["what"]]
    assert [d["t"] for d in reports] == [120.0] and reports[0]["what"] == "heading 90 deg given up at way-point 1"
    why = "the current comes from the side and {}: it turned its bow into the current to hold its place; "
    why += "173 deg off when the way-point was left"
    assert reports[0]["cause"] == why.format("there is no thrust in sway to hold against it")
    weak = load_vehicle("double_blueye").model()
    reports = [d for d in decisions(run(-83.0), ["a", "b"], [(0.0, SCENARIO)], weak) if "heading" in d["what"]]
    assert reports[0]["cause"] == why.format("is more than thrust in sway can hold against")


def test_a_heading_that_was_met_or_not_yet_reached_is_none():
    assert unmet_headings(run(95.0), SCENARIO) == []
    assert unmet_headings(run(-83.0, phase=HOLD), SCENARIO) == []


def test_a_heading_is_judged_as_control_holds_it():
    """East, and pitched by 100 degrees: as Euler angles a pitch of 80, turned over, heading west."""
    whole = run(0.0)
    whole.eta[1000:, 3:] = np.radians([180.0, 80.0, -90.0])
    assert unmet_headings(whole, SCENARIO) == []
    (one,) = unmet_headings(run(0.0), SCENARIO)
    assert one.off == pytest.approx(90.0)


def test_one_that_nobody_gave_up_counts_too():
    (one,) = unmet_headings(run(40.0, state=GOING), SCENARIO)
    assert one.what == "heading 90 deg not met at way-point 1" and not one.given_up


def test_the_console_says_at_once_that_a_heading_is_given_up_and_when_no_longer():
    changes = Changes()
    reports = [changes.of("hold", "", gives_up) for gives_up in (False, True, True, False)]
    assert reports == [
        None, ("warning", "heading given up to keep the place"), None, ("info", "heading no longer given up"),
    ]  # fmt: skip


def test_each_mission_is_judged_by_its_own_way_points():
    """Flown one after the other from the console: the second has no heading that could be missed."""
    model = load_vehicle("double_blueye").model()
    free = load_scenario("square", ["mission.waypoints=[{position: [3, 0, 3], speed: 0.2, acceptance: 0.2}]"])

    def headings(*missions):
        return [d["t"] for d in decisions(run(-83.0), ["a", "b"], missions, model) if "heading" in d["what"]]

    assert headings((0.0, free), (50.0, SCENARIO)) == [120.0]
    assert headings((0.0, SCENARIO), (50.0, free)) == []
    assert headings() == []  # armed, and nothing was started


def test_a_part_of_a_run_has_its_own_instants_and_all_control_ticks():
    whole = run(-83.0)
    part = whole.during(50.0, 100.0)
    assert (part.t[0], part.t[-1]) == (50.0, 99.9) and len(part.eta) == len(part.mode) == len(part.t) == 500
    assert part.progress is not None and len(part.progress) == 500 and part.thrust is whole.thrust
    assert finished(whole) and not finished(part)
