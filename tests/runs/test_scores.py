"""Scores on runs whose answers are known."""

import numpy as np
import pytest

from rovtwin.core.flow import DIVE, FINISHED, GO, HOLD
from rovtwin.runs.scoring.scores import (
    Flown,
    after_first_dive,
    distance_to_leg,
    nees,
    nees_interval,
    score,
)


def flown(**changes) -> Flown:
    """A run along a leg to the north, 0.3 m east of it and 0.1 m too deep, estimate exact but for 0.5 m north."""
    n = 1001
    t = np.linspace(0, 100, n)
    eta = np.zeros((n, 6))
    eta[:, 0], eta[:, 1], eta[:, 2] = t / 10, 0.3, 3.1
    eta_hat = eta.copy()
    eta_hat[:, 0] += 0.5
    covariance = np.tile(np.eye(12) * 0.25, (n, 1, 1))
    mode = np.tile([GO, 0, 0, 1], (n, 1)).astype(float)
    mode[:100, 0], mode[:100, 3] = DIVE, 0
    mode[-1] = [FINISHED, 0, 1, 0]
    leg = np.tile([0, 0, 3, 10, 0, 3], (n, 1)).astype(float)
    base = {
        "t": t, "eta": eta, "nu": np.zeros((n, 6)), "eta_hat": eta_hat, "nu_hat": np.zeros((n, 6)),
        "covariance": covariance, "leg": leg, "mode": mode, "thrust": np.full((5001, 2), 3.0),
        "saturated": np.arange(5001) < 500, "control_dt": 0.02, "duration": 100.0,
    }  # fmt: skip
    return Flown(**(base | changes))


def test_largest_roll_and_pitch_of_the_run_either_way():
    eta = np.zeros((1001, 6))
    eta[5, 3], eta[7, 4], eta[9, 4] = np.radians([12.0, 20.0, -35.0])
    result = score(flown(eta=eta))
    assert (result["roll_max_deg"], result["pitch_max_deg"]) == pytest.approx((12.0, 35.0))


def test_heading_is_judged_as_control_holds_it():
    """At a pitch of 89.9 degrees roll and psi of 20 are one turn there and back: the attitude is 0.03 degrees off."""
    eta, reference = np.zeros((2, 1001, 6))
    reference[:, 4] = np.radians(89.9)
    eta[:, 3:] = np.radians([20.0, 89.9, 20.0])
    assert score(flown(eta=eta, reference=reference))["heading_rms_deg"] < 0.05
    eta[:, 3:] = np.radians([0.0, 0.0, 20.0])
    assert score(flown(eta=eta, reference=eta * 0.5))["heading_rms_deg"] == pytest.approx(10.0)


def test_swing_is_about_the_mean():
    """A trim of 5 degrees is none; a pitch of 4 degrees amplitude and a roll of 3 make 3.5 degrees rms."""
    eta, t = np.zeros((1001, 6)), np.arange(1001) * 0.1
    eta[:, 3], eta[:, 4] = np.radians(3.0 * np.sin(t)), np.radians(5.0 + 4.0 * np.cos(t))
    assert score(flown(eta=eta))["attitude_rms_deg"] == pytest.approx(np.sqrt(12.5), rel=0.01)


def test_scores_of_a_known_run():
    result = score(flown())
    assert result["completed"] and result["phase"] == "finished" and result["reason"] == ""
    assert result["cross_track_rms_m"] == pytest.approx(0.3)
    assert result["cross_track_max_m"] == pytest.approx(0.3)
    assert result["depth_rms_m"] == pytest.approx(0.1)
    assert result["position_error_rms_m"] == pytest.approx([0.5, 0.0])
    assert result["nees_position_mean"] == pytest.approx(0.5**2 / 0.25)
    assert result["effort_n2s"] == pytest.approx(2 * 9.0 * 5001 * 0.02)
    assert result["saturated_share"] == pytest.approx(500 / 5001)
    assert result["thruster_activity_n_per_s"] == 0.0
    assert result["station_rms_m"] is None


def test_the_first_dive_does_not_count():
    mode = np.zeros((6, 4))
    mode[:, 0] = [DIVE, DIVE, GO, DIVE, GO, HOLD]
    assert after_first_dive(mode).tolist() == [False, False, True, True, True, True]
    run = flown()
    run.eta[:100, 1:3] = 50.0
    assert score(run)["cross_track_max_m"] == pytest.approx(0.3)
    assert score(run)["depth_rms_m"] == pytest.approx(0.1)


def test_the_way_to_another_depth_is_no_error_of_depth():
    run = flown()
    run.mode[500:600, 0], run.mode[500:600, 3] = DIVE, 0
    run.eta[500:600, 2] = 0.5
    assert score(run)["depth_rms_m"] == pytest.approx(0.1)


def test_a_leg_is_a_segment_not_a_line():
    leg = np.array([[0, 0, 3, 10, 0, 3.0]] * 3 + [[2, 2, 3, 2, 2, 3.0]])
    position = np.array([[5, 4, 3], [13, 4, 3], [-3, 4, 3], [2, 5, 3.0]])
    assert distance_to_leg(position, leg) == pytest.approx([4.0, 5.0, 5.0, 3.0])


def test_position_error_wraps_angles():
    run = flown()
    run.eta[:, 5], run.eta_hat[:, 5] = np.pi - 0.1, -np.pi + 0.1
    expected = 0.5**2 / 0.25 + 0.2**2 / 0.25
    assert nees(run)[:, 1] == pytest.approx(expected)


def test_an_estimate_that_is_not_a_number_has_infinite_nees():
    run = flown()
    run.eta_hat[500] = np.nan
    assert np.isinf(nees(run)[500]).all() and np.isfinite(nees(run)[499]).all()


def test_a_run_that_never_dived_has_no_path_scores():
    run = flown()
    run.mode[:, 0] = DIVE
    result = score(run)
    assert not result["completed"]
    assert result["cross_track_rms_m"] is None and result["depth_rms_m"] is None


def test_nees_interval_is_that_of_chi_square():
    # 10 independent samples of 2 degrees: chi-square of 20 degrees is in 9.591 .. 34.170 with 95 %.
    runs = [{"nees_effective_samples": 1.0}] * 10
    assert nees_interval(runs) == pytest.approx((0.9591, 3.4170), abs=1e-4)
