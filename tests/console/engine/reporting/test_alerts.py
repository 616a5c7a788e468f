"""What an operator sees at once, and by which sensors."""

import pytest
from tests.console import messages

from rovtwin.console.engine.reporting.alerts import alerts

DEAD = {"position": {"age": 40.0, "value": [0, 0]}}


@pytest.mark.parametrize(
    "sensors, message",
    [
        (DEAD, ["no position for 40 s"]),
        (DEAD | {"position_2": {"age": 0.5, "value": [0, 0]}}, []),
        (DEAD | {"position_2": {"age": 12.0, "value": [0, 0]}}, ["no position for 12 s"]),
        (DEAD | {"position_2": {"age": None, "value": None}}, ["no position for 40 s"]),
        ({"leak": {"age": 0.1, "value": [0.0]}, "leak_2": {"age": 0.1, "value": [1.0]}}, ["LEAK"]),
        ({"leak": {"age": None, "value": None}}, []),
    ],
)
def test_every_sensor_of_a_kind_counts(sensors, message):
    state = messages.state(sensors=sensors, health=[1.0] * 4)
    assert [alert["what"] for alert in alerts(state, messages.THRUSTERS)] == message


@pytest.mark.parametrize(("variance", "radius"), [(0.5, None), (4.0, 4)])
def test_a_position_that_is_known_badly_is_an_alert(variance, radius):
    state = messages.state(sensors={}, health=[1.0] * 4, ellipse=[[variance, 0.0], [0.0, 0.1]])
    found = [alert["what"] for alert in alerts(state, messages.THRUSTERS)]
    assert found == ([] if radius is None else [f"position uncertain: known to no better than {radius} m (95 %)"])
