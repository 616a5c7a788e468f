"""Sensors of a dive against those of the certified flight."""

import numpy as np
import pytest

from rovtwin.commission.after.signals import compared
from rovtwin.core.log import Channel, Log
from rovtwin.core.sensors import SENSORS
from rovtwin.runs.recording.channels import sensor_channel

RNG = np.random.default_rng(3)


def log(rate=20.0, age=0.02, noise=0.002, surprise=1.0, silent=False):
    """A minute of depth, and what the filter thought of it."""
    t = np.arange(0.0, 60.0, 1.0 / rate)
    depth = 1.0 + 0.1 * np.sin(0.2 * t) + noise * RNG.normal(size=len(t))
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
