"""One hour of the served twin under a client at full rate: memory flat, periods in time."""

import pytest
from tests.links.soak import soak


@pytest.mark.slow
def test_an_hour_of_full_telemetry(record_property):
    found = soak(60.0)
    record_property("soak", found)
    assert found["messages_per_s"] > 900  # seven messages of two drones at 50 to 100 Hz
    assert found["late_ms_p99"] < 5.0
    assert found["slipped_s"] == 0.0
    early, late = found["memory"][4], found["memory"][-1]
    assert late[1] - early[1] < 5.0 and late[2] - early[2] < 5.0, found["memory"]
