"""Readings at rest, judged one sensor at a time."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.commission import bench

SENSOR = SimpleNamespace(rate=15_000, noise=np.array([0.03, 0.03]), latency_steps=0)


def positions(rate, noise, seconds=15.0):
    t = np.arange(0.0, seconds, 1.0 / rate)
    value = noise * np.random.default_rng(2).normal(size=(len(t), 2))
    return bench.Readings(t + 0.02, t, value)


def test_an_instrument_beside_the_vehicle_is_not_held_against_its_file():
    acoustic = positions(1.0, 0.4)
    assert {check.what for check in bench._sensor("position", SENSOR, acoustic)} >= {"position rate", "position noise"}
    (line,) = bench._sensor("position", SENSOR, acoustic, assumed=True)
    assert line.verdict == "ok" and "1 Hz" in line.text


@pytest.mark.parametrize(("assumed", "words"), [(True, "--sensor qtm://"), (False, "take it out of the vehicle file")])
def test_positions_that_never_come_are_asked_for(assumed, words):
    nothing = bench.Readings(np.zeros(0), np.zeros(0), np.zeros((0, 2)))
    (line,) = bench._sensor("position", SENSOR, nothing, assumed)
    assert line.verdict == "warning" and words in line.fix
