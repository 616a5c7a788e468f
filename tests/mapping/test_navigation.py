"""Poses between stamps, and stamps that are wrong."""

import numpy as np
import pytest
from tests.imaging.helper import head
from tests.mapping.helper import moving

from rovtwin.core.datum import Datum
from rovtwin.core.errors import LogError
from rovtwin.core.log import Channel, Log
from rovtwin.imaging.lines import LinesFile
from rovtwin.imaging.lines_writer import write_lines
from rovtwin.mapping.navigation import Navigation
from rovtwin.runs.recording.channels import ETA, ETA_UNITS


def test_between_poses_there_are_splines_whatever_the_signs_of_quaternions():
    t = np.arange(0.0, 5.0, 0.1)
    angle = 0.5 * t + 0.1 * np.sin(t)
    q = np.column_stack([np.cos(0.5 * angle), 0 * t, 0 * t, np.sin(0.5 * angle)])
    q[::3] *= -1.0
    found = Navigation(t, np.column_stack([np.sin(t), t, 0 * t]), q)
    at = np.linspace(0.0, 4.9, 333)
    poses = found.at(at)
    assert poses.valid.all() and np.abs(poses.position[:, 0] - np.sin(at)).max() < 1e-5
    heading = np.unwrap(np.arctan2(poses.rotation[:, 1, 0], poses.rotation[:, 0, 0]))
    assert np.abs(heading - 0.5 * at - 0.1 * np.sin(at)).max() < 1e-5
    assert np.abs(found.turn_rates(at[40:-40]) - 0.5 - 0.1 * np.cos(at[40:-40])).max() < 2e-3


def test_there_are_no_poses_in_gaps_and_outside():
    t = np.r_[0.0:1.05:0.1, 2.0:3.05:0.1, 5.0]
    found = Navigation(t, np.outer(t, [1.0, 0, 0]), np.tile([1.0, 0, 0, 0], (len(t), 1)))
    assert np.allclose(found.gaps, [(1.0, 2.0), (3.0, 5.0)])
    poses = found.at(np.array([-0.1, 0.5, 1.5, 2.95, 4.0, 5.0]))
    assert list(poses.valid) == [False, True, False, True, False, False]
    assert np.isnan(poses.position[~poses.valid]).all() and np.allclose(poses.position[[1, 3], 0], [0.5, 2.95])


def test_stamps_that_turn_back_are_named_and_doubles_are_counted():
    t, place, q = np.arange(5.0), np.zeros((5, 3)), np.tile([1.0, 0, 0, 0], (5, 1))
    with pytest.raises(LogError, match=r"the stamp 2.000 s comes 1 s before"):
        Navigation(t[[0, 1, 3, 2, 4]], place, q)
    place[3] = np.nan
    assert Navigation(t[[0, 1, 1, 3, 4]], place, q).dropped == 2
    with pytest.raises(LogError, match="found 1 poses"):
        Navigation(t[:1], place[:1], q[:1])


def test_a_file_of_lines_brings_its_own(tmp_path):
    given = head()
    with LinesFile(write_lines(tmp_path / "l.h5", given, [np.full((7, 12, 5), 100, np.uint16)])) as lines:
        found = Navigation.of_lines(lines)
        assert np.abs(found.position - given.navigation.position).max() < 1e-6
        poses = found.at(given.t[2:4])
        roll, pitch = 0.01, -0.02
        expected = [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)]
        assert np.allclose(poses.rotation[0, 2], expected)
        own = lines.navigation()
        own[1][2], own[2][4] = np.nan, np.nan
        lines.navigation = lambda: own
        holed = Navigation.of_lines(lines)
        assert holed.dropped == 2 and np.isfinite(holed.position).all() and len(holed.t) == len(found.t) - 2
        lines.datum = None
        with pytest.raises(LogError, match="datum"):
            Navigation.of_lines(lines)


def test_a_log_brings_the_truth_or_the_estimate():
    t = np.arange(0.0, 2.0, 0.1)
    eta = np.column_stack([t, 0 * t, 0 * t, 0 * t, 0 * t, 0.3 + 0 * t])
    log = Log.from_arrays([Channel("truth/eta", ETA, ETA_UNITS, "n")], {"truth/eta": (t, eta)}, {})
    found = Navigation.of_log(log, "truth")
    assert np.allclose(found.position[:, 0], t) and found.source == "truth"
    with pytest.raises(LogError, match="no autopilot/eta"):
        Navigation.of_log(log, "estimate")


def test_places_come_back_from_the_middle_of_the_earth():
    datum, place = Datum(-33.0, 151.0, 20.0), np.array([[120.0, -45.0, 12.0], [0.0, 0.0, 3.0]])
    assert np.abs(datum.position_of_ecef(datum.ecef(place)) - place).max() < 1e-6
    assert moving().at(np.array([0.0])).valid.all()
