"""Orders: whatever a browser says is one within its bounds, or is refused in words."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rovtwin.console import orders

NUMBERS = st.one_of(st.floats(), st.integers(), st.booleans(), st.none(), st.sampled_from([10**400, -1, 1e308]))
VALUES = st.recursive(
    st.one_of(NUMBERS, st.text(max_size=5)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=3)),
    max_leaves=6,
)
DOES = ["stop", "arm", "submit", "check", "goto", "pilot", "pace", "inject", "no such"]
KEYS = ["x", "y", "depth", "speed", "surge", "waypoints", "running", "fault", "thruster", "current", "sensor", "self"]
MESSAGES = st.one_of(
    VALUES,
    st.builds(
        lambda do, rest: {"do": do} | rest,
        st.one_of(st.sampled_from(DOES), VALUES),
        st.dictionaries(st.sampled_from(KEYS), VALUES, max_size=4),
    ),
)


@pytest.mark.system
@given(MESSAGES)
@settings(max_examples=80, deadline=None, database=None)
def test_any_message_is_an_order_within_its_bounds_or_is_refused(message):
    try:
        order = orders.parse(message)
    except ValueError as error:
        assert str(error)
        return
    for key, value in order.model_dump().items():
        if isinstance(value, float):
            assert np.isfinite(value), key
    if isinstance(order, orders.Pilot):
        assert all(abs(v) <= 1 for v in (order.surge, order.sway, order.heave, order.yaw))
    if isinstance(order, orders.Pace):
        assert order.speed is None or 0 < order.speed <= 50


@pytest.mark.parametrize(
    "message, expected_text",
    [
        ({"do": "pilot", "surge": 1.1}, "pilot.surge"),
        ({"do": "pilot", "surge": True}, "pilot.surge"),
        ({"do": "goto", "x": float("nan"), "y": 0.0}, "goto.x"),
        ({"do": "goto", "x": 0.0, "y": 0.0, "depth": -1.0}, "goto.depth"),
        ({"do": "pace", "speed": 0.0}, "pace.speed"),
        ({"do": "pace", "speed": 1e9}, "pace.speed"),
        ({"do": "arm", "now": True}, "arm.now"),
        ({"do": "submit", "waypoints": []}, "submit.waypoints"),
        ({"do": "submit", "waypoints": [{"position": [0.0, 0.0, -1.0]}]}, "submit.waypoints.0"),
        ({"do": "inject", "fault": "current", "current": [9.0, 0.0]}, "inject.current.0"),
        ({"do": "fire"}, "fire"),
        ({}, "None"),
        ("stop", "expected an order"),
    ],
)
def test_what_is_no_order_is_refused_and_says_where(message, expected_text):
    with pytest.raises(ValueError, match=expected_text):
        orders.parse(message)


def test_number_and_time_are_no_part_of_an_order():
    assert orders.parse({"do": "stop", "id": 7, "sent": 1.0}) == orders.Plain(do="stop")
