"""The served twin's telemetry beside a real BlueROV2's: the same messages, at the same rates, with the same ways."""

import json
from collections import Counter

import pytest
from tests.conftest import shared_folder
from tests.links.mavlink.recorded import COUNT, counted
from tests.links.mavlink.test_server import station
from tests.links.mavlink.vehicle import measured

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")

REAL = json.loads(COUNT.read_text())
# Sent by that vehicle, ArduSub 4.1, and not by this one, 4.5: what answers somebody or comes now and then, the mount
# of a camera that is not here, and what ArduPilot gave up with 4.2.
ELSEWHERE = {"PARAM_VALUE", "TIMESYNC", "MOUNT_STATUS", "SENSOR_OFFSETS", "HEARTBEAT"}
UNEVEN = {"SCALED_PRESSURE2": 2, "VFR_HUD": 10}  # sent more often while the ground station changed its mind
SECONDS = 10.0  # simulated


@pytest.fixture(scope="module")
def messages():
    """All that is reported in ten simulated seconds to a ground station that asks as the recorded one did."""
    with station(speed=10.0, how="tcp") as (served, client):
        for stream, rate in REAL["asked"].items():
            client.mav.request_data_stream_send(1, 1, int(stream), rate, 1)
        assert client.command(512, 148) == 0  # all of that has been received
        while client.connection.recv_msg() is not None:
            pass
        found = []
        for k in range(1, round(SECONDS * 50) + 1):
            served.feed(k * 0.02, measured(k * 0.02, estimate=True))
            while (message := client.connection.recv_msg()) is not None:
                found.append(message)
        assert client.command(512, 148) == 0
        found += [client.next("HEARTBEAT")]
        return found


@pytest.mark.system
def test_the_same_messages_at_the_same_rates(messages):
    counts = Counter(message.get_type() for message in messages)
    for kind, rate in REAL["rates"].items():
        if kind in ELSEWHERE:
            continue
        expected = UNEVEN.get(kind, rate)
        assert counts[kind] / SECONDS == pytest.approx(expected, rel=0.1), kind


def test_named_values_are_the_firmwares(messages):
    names = list(dict.fromkeys(m.name for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"))
    assert names == REAL["named_values"]


@pytest.mark.parametrize("kind", REAL["fields"])
def test_fields_are_within_the_firmwares(messages, kind):
    messages = [m for m in messages if m.get_type() == kind]
    assert messages
    for name, (low, high) in REAL["fields"][kind].items():
        found = {getattr(m, name) for m in messages}
        if (kind, name) == ("GPS_RAW_INT", "vel"):
            assert found == {65535}  # that vehicle's GPS_INPUT said 0; a position sensor does not know
            continue
        assert all(low <= value <= high for value in found), (name, found)


def test_the_count_is_that_of_the_recording():
    assert counted(shared_folder("data", "ardusub_real") / "small.tlog") == REAL
