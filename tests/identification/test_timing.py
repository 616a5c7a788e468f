"""Clocks: offset and drift of a second recording are found, with an uncertainty that holds, or refused."""

from dataclasses import replace

import numpy as np
import pytest
from tests.identification.flown import fly

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.evidence_file import LogSpec
from rovtwin.identification.logs.readers import read_record
from rovtwin.identification.logs.timing import align, align_series
from rovtwin.vehicle import load_vehicle

FINE = np.arange(0.0, 120.0, 1e-3)


def seen_twice(seed, offset, drift, noise=0.05):
    """One motion seen by two sensors, the second with a clock of its own: t = t_file (1 + drift) + offset."""
    rng = np.random.default_rng(seed)
    f, phase, size = rng.uniform(0.05, 0.8, (3, 8)), rng.uniform(0, 6, (3, 8)), rng.uniform(0.1, 0.5, (3, 8))
    motion = (size * np.sin(2 * np.pi * f * FINE[:, None, None] + phase)).sum(axis=2)
    t_a, t_b = np.sort(rng.uniform(0, 120, 6000)), np.sort(rng.uniform(10, 100, 4500))
    a, b = (np.stack([np.interp(t, FINE, axis) for axis in motion.T], axis=1) for t in (t_a, t_b))
    a, b = (x + rng.normal(0, noise, x.shape) for x in (a, b))
    return t_a, a, (t_b - offset) / (1.0 + drift), b


@pytest.mark.parametrize(
    ("offset", "drift"), [(0.0, 0.0), (1.0, 0.0), (-3.217, 5e-5), (1.7e9 + 12.3, -3e-5), (40.0, 2e-4)]
)
def test_offset_and_drift_are_found(offset, drift):
    t_a, a, t_b, b = seen_twice(1, offset, drift)
    fit = align_series(t_a, a, t_b, b)
    middle = 0.5 * (t_b[0] + t_b[-1])
    error = middle * (1 + fit.drift) + fit.offset - middle * (1 + drift) - offset
    assert abs(error) < 3e-3
    assert abs(fit.drift - drift) < 6e-5
    assert fit.correlation > 0.95


@pytest.mark.system
def test_the_uncertainty_is_honest():
    errors = []
    for seed in range(12):
        t_a, a, t_b, b = seen_twice(seed, 0.7, 0.0)
        fit = align_series(t_a, a, t_b, b)
        middle = 0.5 * (t_b[0] + t_b[-1])
        errors.append((middle * fit.drift + fit.offset - 0.7) / fit.offset_std)
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.6


def test_recordings_of_different_motions_are_refused():
    signals, others = (fly("bluerov2", "multisine", seed, 40.0).signals for seed in (1, 2))
    with pytest.raises(IdentificationError, match="do not agree"):
        align({"gyro": signals["gyro"]}, {"gyro": others["gyro"]}, "b.csv")
    with pytest.raises(IdentificationError, match="nothing in common"):
        align({"gyro": signals["gyro"]}, {"depth": others["depth"]}, "b.csv")


def test_a_gyro_meets_motion_capture():
    """Body rates of an IMU and an attitude from elsewhere are the same quantity."""
    signals = fly("bluerov2", "multisine", 3, 40.0).signals
    late = replace(signals["attitude"], t=signals["attitude"].t - 2.5)
    fit = align({"gyro": signals["gyro"]}, {"attitude": late}, "mocap")
    assert fit.offset + 20 * fit.drift == pytest.approx(2.5, abs=0.01)


def save(path, t, value, names):
    np.savetxt(path, np.column_stack([t, value]), delimiter=",", header=",".join(["t", *names]), comments="")


def test_files_of_one_test_are_put_on_one_clock(tmp_path):
    """Motion capture, an IMU and the commands, each with a clock of its own; the commands are timed by the model."""
    vehicle = load_vehicle("bluerov2")
    record = fly("bluerov2", "multisine", 4, 60.0)
    s = record.signals
    save(tmp_path / "imu.csv", s["gyro"].t, s["gyro"].value, "pqr")
    save(tmp_path / "mocap.csv", s["attitude"].t + 100.0, s["attitude"].value, ("phi", "theta", "psi"))
    save(tmp_path / "commands.csv", record.t_command - 7.0, record.command, vehicle.thruster_names)
    spec = LogSpec.model_validate(
        {
            "files": [
                {"file": "imu.csv"},
                {"file": "mocap.csv", "clock": "estimate"},
                {"file": "commands.csv", "clock": "estimate"},
            ]
        }
    )
    read = read_record(tmp_path, vehicle, spec)
    # Everything back in step, by the same readings and the same commands.
    zero = s["gyro"].t[np.argmin(np.abs(s["gyro"].value - read.signals["gyro"].value[0]).sum(axis=1))]
    zero -= read.signals["gyro"].t[0]
    for row in (50, 1500):
        same = np.argmin(np.abs(s["attitude"].value - read.signals["attitude"].value[row]).sum(axis=1))
        assert read.signals["attitude"].t[row] + zero == pytest.approx(s["attitude"].t[same], abs=0.01)
    at = np.array([20.0, 30.0, 40.0])
    lags = np.arange(-0.5, 0.5, 0.01)
    wrong = [np.abs(read.command_at(at + lag - zero) - record.command_at(at)).sum() for lag in lags]
    assert abs(lags[int(np.argmin(wrong))]) < 0.15
    assert sum("clock: offset" in note for note in read.notes) == 2


def test_the_first_file_keeps_its_clock(tmp_path):
    save(tmp_path / "a.csv", np.arange(9.0), np.zeros((9, 3)), "pqr")
    spec = LogSpec.model_validate({"files": [{"file": "a.csv", "clock": "estimate"}]})
    with pytest.raises(IdentificationError, match="first file has the clock"):
        read_record(tmp_path, load_vehicle("bluerov2"), spec)
