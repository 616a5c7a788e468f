"""Sensors of a dive against those of the certified flight."""

import numpy as np
import pytest

from rovtwin.commission.after.signals import compared, noise_of
from rovtwin.commission.bench import Readings
from rovtwin.core.log import Channel, Log
from rovtwin.core.sensors import SENSORS
from rovtwin.runs.recording.channels import sensor_channel

RNG = np.random.default_rng(3)


def log(rate=20.0, age=0.02, noise=0.002, surprise=1.0, silent=False, speed=0.0, step=0.0):
    """A minute of depth, down at a speed and up again, and what the filter thought of it."""
    t = np.arange(0.0, 60.0, 1.0 / rate)
    depth = 1.0 + 0.1 * np.sin(0.2 * t) + noise * RNG.normal(size=len(t)) + speed * (30.0 - np.abs(t - 30.0))
    depth = step * np.round(depth / step) if step else depth
    nis = ("autopilot/nis", "autopilot/nis_dof")
    channels = [*(Channel(name, ("pressure",), ("1",), "", "", rate) for name in nis)]
    data = {nis[0]: (t, surprise * RNG.chisquare(1, (len(t), 1))), nis[1]: (t, np.ones((len(t), 1)))}
    if not silent:
        channels.append(sensor_channel("pressure", SENSORS["pressure"]))
        data["sensor/pressure"] = (t, np.column_stack([depth, t - age]))
    return Log.from_arrays(channels, data, {})


@pytest.fixture(scope="module")
def then():
    return log()


def test_a_dive_like_the_certified_one_is_ok(then):
    assert [check.verdict for check in compared(log(), then)] == ["ok"]


@pytest.mark.parametrize(
    ("changed", "what", "words"),
    [
        ({"rate": 10.0}, "pressure", "slower"),
        ({"age": 0.3}, "pressure", "later"),
        ({"noise": 0.006}, "pressure", "noise"),
        ({"silent": True}, "pressure", "no readings"),
        ({"surprise": 4.0}, "filter, pressure", "surprised"),
    ],
)
def test_what_is_other_is_named(then, changed, what, words):
    (found,) = [check for check in compared(log(**changed), then) if check.verdict != "ok"]
    assert found.verdict == "warning" and found.what == what and words in found.text


def test_a_profile_is_no_noise(then):
    assert [check.verdict for check in compared(log(rate=20.0, speed=0.3), then)] == ["ok"]
    noisy = list(compared(log(noise=0.006, speed=0.3), then))
    assert noisy[0].verdict == "warning" and "(3." in noisy[0].text


@pytest.mark.parametrize("speed", [0.0, 0.03, 0.3])
def test_steps_of_the_resolution_are_no_noise(speed):
    level = Log.from_arrays(
        [sensor_channel("pressure", SENSORS["pressure"])],
        {"sensor/pressure": (t := np.arange(0.0, 60.0, 0.05), np.column_stack([np.full(len(t), 1.0), t]))},
        {},
    )
    (found, *_) = compared(log(noise=1e-4, speed=speed, step=0.01, age=0.0), level)
    assert found.verdict == "ok" and "inf" not in found.text


def test_stamps_that_stand_still_or_go_back_and_readings_that_are_no_numbers_are_left_out():
    t = np.arange(0.0, 60.0, 0.05)
    value = 0.3 * t[:, None] + 0.002 * RNG.normal(size=(len(t), 1))
    value[100] = np.nan
    stamps = t.copy()
    stamps[200:204], value[200:204] = stamps[200], value[200]
    stamps[300] = 1.0
    found = noise_of("pressure", Readings(t, stamps, value))
    np.testing.assert_allclose(found, 0.002, rtol=0.1)


def positions(rate, surprise=1.0, silent=False):
    """A minute of positions."""
    t = np.arange(0.0, 60.0, 1.0 / rate)
    channels = [Channel(name, ("position",), ("1",), "", "", rate) for name in ("autopilot/nis", "autopilot/nis_dof")]
    one = np.ones((len(t), 1))
    data = {"autopilot/nis": (t, surprise * one), "autopilot/nis_dof": (t, one)}
    channels += [] if silent else [sensor_channel("position", SENSORS["position"])]
    data |= {} if silent else {"sensor/position": (t, np.column_stack([RNG.normal(size=(len(t), 2)), t]))}
    return Log.from_arrays(channels, data, {})


@pytest.mark.parametrize("dive", [{"rate": 2.0}, {"rate": 2.0, "silent": True}, {"rate": 2.0, "surprise": 9.0}])
def test_acoustics_at_sea_are_not_held_against_motion_capture(dive):
    then = positions(100.0)
    lines = list(compared(positions(**dive), then, ("position",)))
    assert lines and {check.verdict for check in lines} == {"note"} and "then 100 Hz" in lines[0].text
    assert any(check.verdict == "warning" for check in compared(positions(**dive), then))
