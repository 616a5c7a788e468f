"""The thesis's observer: diverges as printed, follows when mended."""

import functools

import numpy as np
import pytest
from tests.positioning.estimators.test_ekf import EYE, cut, drive, frames_of, seen

from rovtwin.core.block import Start
from rovtwin.positioning.estimators.luenberger import Gains, MarkerLuenberger
from rovtwin.positioning.estimators.run import run_observer
from rovtwin.positioning.images.detection import Detections


@functools.cache
def run(gains="thesis", as_printed=False, markers=3, n=300):
    d = cut(drive(), n)
    found = [[Detections(f.ids[f.ids < markers], f.corners[f.ids < markers])] for (f,) in seen()[:n]]
    block = MarkerLuenberger.of([EYE], getattr(Gains, gains)(), as_printed=as_printed)
    return run_observer(block, frames_of(d, found), Start.at(d.position[0])), d


def rms(out, d):
    return np.sqrt(((out.position - d.position) ** 2).sum(axis=1).mean())


def spread(out, k):
    """Distance between the first two landmarks [m]."""
    return np.linalg.norm(out.landmarks[k, 0] - out.landmarks[k, 1])


@pytest.mark.system
def test_as_printed_landmarks_run_apart_by_a_tenth_in_each_step_with_two_markers():
    """Errata 34: what two landmarks disagree on grows by 1 + L_3."""
    out, _ = run(as_printed=True, markers=2)
    apart = out.landmarks[:, 0] - out.landmarks[:, 1]
    grown = np.linalg.norm(np.diff(apart[250:300:10], axis=0), axis=1)
    assert np.allclose(grown[1:] / grown[:-1], 1.1**10, rtol=0.05)
    assert spread(out, -1) > 1e3


@pytest.mark.system
def test_as_printed_with_one_marker_it_does_not_run_away_so_fast():
    """The only landmark and the vehicle: errors grow by 1 + L_3 - L_1, less than one."""
    out, d = run(as_printed=True, markers=1)
    assert rms(out, d) < 1.0


@pytest.mark.system
def test_mended_it_follows_and_the_velocity_gain_of_the_thesis_is_why_it_lags():
    slow, d = run()
    quick, _ = run(gains="tuned")
    assert spread(slow, -1) < 1.0
    assert 0.1 < rms(slow, d) < 0.4
    assert rms(quick, d) < 0.03
    # The lag is along the way: behind while it moves ahead.
    moving = d.velocity[:, 0] > 0.05
    assert np.mean((d.position - slow.position)[moving, 0]) > 0.05


def test_what_is_not_seen_changes_nothing():
    d = cut(drive(), 50)
    out = run_observer(MarkerLuenberger.of([EYE]), frames_of(d, [[Detections.none()]] * 50), Start.at(d.position[0]))
    assert np.abs(out.position - d.position[0]).max() == 0.0
    assert (out.ids == -1).all()
