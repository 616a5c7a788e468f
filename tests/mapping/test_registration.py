"""Overlaps put lines together: on surveys whose errors were drawn, with ties that are good, false, or say nothing."""

import numpy as np
import pytest
from scipy.stats import chi2
from tests.mapping.overlaps import ideal_ties, known_points, with_false
from tests.mapping.surveys import survey

from rovtwin.core.errors import LogError
from rovtwin.mapping.alignment.calibration import calibration_findings
from rovtwin.mapping.alignment.ground_points import CALIBRATION, ground_points
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.alignment.registration import register
from rovtwin.mapping.alignment.ties import ControlPoints, Ties, observe
from rovtwin.mapping.alignment.uncertainty import point_uncertainty
from rovtwin.mapping.georeference import Georeference

CORNERS = [[0.7, 0.2], [5.3, 0.2], [0.7, 2.8], [5.3, 2.8]]
ALIGNED = dict.fromkeys(CALIBRATION, 0.0) | {"boresight_roll": 0.03, "boresight_pitch": 0.03, "boresight_yaw": 0.03}


@pytest.fixture(scope="module")
def flown():
    return survey(seed=3)


@pytest.fixture(scope="module")
def ties(flown):
    return ideal_ties(flown.strips, np.random.default_rng(4), every=0.5)


def errors(one, joint=None):
    """Of points all over the mosaic, and what is stated of them; after a registration if it is given."""
    t, pixel = one.grid()
    truth, where, later = ground_points(one.truth, t, pixel), one.stated, 0.0
    if joint is not None:
        mount, later = joint.mounted(where.mount)
        where = Georeference(where.imager, mount, joint.applied(where.navigation), where.floor)
    seen = ground_points(where, t + later, pixel)
    stated = point_uncertainty(one.joint if joint is None else joint, seen)
    return (seen.point - truth.point)[:, :2], stated


def rms(e):
    return np.sqrt(np.mean(np.sum(e**2, axis=1)))


def registered(one, ties, control=None, **given):
    return register(one.joint, observe(one.joint, one.stated, ties, control), **given)


@pytest.mark.system
def test_stated_and_true_errors_agree_before_and_after():
    """Over surveys: absolutely, within the mosaic, and in the ties' own test."""
    before, after, within, nis = [], [], [], []
    for seed in range(6):
        one = survey(seed)
        found = registered(one, ideal_ties(one.strips, np.random.default_rng(seed + 50)))
        nis.append(found.nis)
        for e, stated, kept in ((*errors(one), before), (*errors(one, found.joint), after)):
            kept.append(np.mean(np.einsum("mi,mij,mj->m", e, np.linalg.inv(stated.absolute), e)))
            if kept is after:
                e = e - e.mean(axis=0)
                within.append(np.mean(np.einsum("mi,mij,mj->m", e, np.linalg.inv(stated.within), e)))
    assert 1.2 < np.mean(before) < 3.0 and 1.2 < np.mean(after) < 3.0 and 1.2 < np.mean(within) < 3.0
    assert np.mean(nis) == pytest.approx(1.0, abs=0.2)


def test_nothing_is_claimed_beyond_the_key_frames(flown, ties):
    (_, end), first = flown.lines[1], flown.lines[0]
    joint = JointErrors.of(flown.keys, first[0], end, dict.fromkeys(CALIBRATION, 0.0))
    t, pixel = flown.grid()
    seen = ground_points(flown.stated, t, pixel)
    inside = t <= joint.t[-1]
    found = point_uncertainty(joint, seen)
    assert inside.any() and (~inside).any()
    assert np.isfinite(found.sigma()[inside]).all() and np.isnan(found.sigma()[~inside]).all()
    part = point_uncertainty(joint, ground_points(flown.stated, t[inside], pixel[inside]))
    assert np.allclose(found.sigma("within")[inside], part.sigma("within"))
    kept = observe(joint, flown.stated, ties)
    assert len(kept.d) == (ties.t <= joint.t[-1]).all(axis=1).sum() and np.isfinite(kept.H.toarray()).all()
    late = ControlPoints(np.array([flown.lines[3][0] + 2.0]), np.array([100.0]), np.zeros((1, 2)), np.ones(1), ("A",))
    with pytest.raises(LogError, match=r"point A \(.* outside the smoothed track's key frames"):
        observe(joint, flown.stated, ties, late)


def test_lines_come_together_and_known_points_bring_the_whole_home(flown, ties):
    e, _ = errors(flown)
    alone, _ = errors(flown, registered(flown, ties).joint)
    points = known_points(flown.strips, CORNERS, np.random.default_rng(5))
    assert len(points.t) == 4
    home, stated = errors(flown, registered(flown, ties, points).joint)
    assert rms(alone - alone.mean(0)) < 0.6 * rms(e - e.mean(0))
    assert rms(home) < 0.5 * rms(alone) and rms(home) < 0.025
    assert rms(home) == pytest.approx(np.sqrt(np.mean(stated.sigma() ** 2)), rel=0.5)


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_false_ties_are_dropped_and_cost_next_to_nothing(flown, ties, share):
    mixed, bad = with_false(ties, share, np.random.default_rng(6))
    found = registered(flown, mixed)
    good = np.setdiff1d(np.arange(len(mixed.t)), bad)
    assert not found.used[bad].any() and found.used[good].mean() > 0.97
    clean, _ = errors(flown, registered(flown, ties).joint)
    e, _ = errors(flown, found.joint)
    assert rms(e - e.mean(0)) < 1.2 * rms(clean - clean.mean(0))


def test_one_false_tie_spoils_a_mosaic_that_does_not_look(flown, ties):
    mixed, _ = with_false(ties, 1.0 / len(ties.t), np.random.default_rng(6))
    trusting, _ = errors(flown, registered(flown, mixed, false_alarm=1e-300).joint)
    clean, _ = errors(flown, registered(flown, ties).joint)
    assert rms(trusting) > 1.5 * rms(clean)


def test_ties_that_contradict_each_other_are_refused(flown, ties):
    mixed, _ = with_false(ties, 0.8, np.random.default_rng(7), size=1.0)
    with pytest.raises(LogError, match="contradict"):
        registered(flown, mixed)


def test_nothing_to_go_by_is_refused(flown):
    none = Ties(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    with pytest.raises(LogError, match="no ties"):
        registered(flown, none)
    lost = ControlPoints(np.array([1e5]), np.array([3.0]), np.zeros((1, 2)), np.array([0.01]), ("buoy",))
    with pytest.raises(LogError, match="point buoy"):
        registered(flown, none, lost)


def test_boresight_comes_out_of_lines_of_opposite_courses():
    truth = np.radians([1.0, -1.0, 1.0])
    one = survey(seed=9, std=(0.02, 0.001), misaligned=truth, prior=ALIGNED)
    found = registered(one, ideal_ties(one.strips, np.random.default_rng(1), every=0.5))
    for finding, true, within in zip(calibration_findings(one.joint, found.joint), truth, (0.3, 0.3, 0.6), strict=True):
        assert not finding.refused
        assert abs(finding.value - true) < min(np.radians(within), 3.5 * finding.std)
    straight, _ = errors(one, found.joint)
    crooked, _ = errors(one)
    assert rms(straight - straight.mean(0)) < 0.6 * rms(crooked - crooked.mean(0))


WIDE = ALIGNED | {"clock": 0.5, "lever_x": 0.2}


def test_pitch_clock_and_lever_are_refused_at_one_speed_and_the_clock_is_found_at_two():
    rng = np.random.default_rng(2)
    one = survey(seed=9, std=(0.02, 0.001), prior=WIDE)
    same = calibration_findings(one.joint, registered(one, ideal_ties(one.strips, rng)).joint)
    by_name = {finding.name: finding for finding in same}
    for name in ("boresight_pitch", "clock", "lever_x"):
        assert by_name[name].refused, name
    assert not by_name["boresight_roll"].refused
    two = survey(seed=9, std=(0.02, 0.001), prior=WIDE, speeds=(0.2, 0.2, 0.45, 0.45))
    found = registered(two, ideal_ties(two.strips, rng)).joint
    clock = {f.name: f for f in calibration_findings(two.joint, found)}["clock"]
    assert not clock.refused and abs(clock.value) < 3.5 * clock.std


def test_the_gate_is_that_of_pairs(flown, ties):
    """Good ties pass a gate of 1 % but for about one in a hundred."""
    found = registered(flown, ties, false_alarm=1e-2)
    assert found.used.mean() > 0.93 and found.statistics[found.used].max() <= chi2.isf(1e-2, 2)


def test_lines_outside_the_smoothed_track_are_refused(flown):
    from tests.gnc.test_sensor_constants import key_frames

    with pytest.raises(LogError, match="smooth the run"):
        JointErrors.of(key_frames(), 0.0, 100.0)
