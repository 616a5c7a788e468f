"""Whatever a ground station asks of the endpoint gets an answer within a second: what it wants, or a refusal."""

import time
from dataclasses import replace

import numpy as np
import pytest
from tests.links.mavlink.test_server import Client, station
from tests.links.mavlink.vehicle import PLACE, measured, soon

from rovtwin.links.mavlink.telemetry.streams import RATES

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")
from pymavlink import mavutil

MAV = mavutil.mavlink
WITHIN = 1.0  # [s]
CAMERA = 100  # component
DENIED, UNSUPPORTED, FAILED = MAV.MAV_RESULT_DENIED, MAV.MAV_RESULT_UNSUPPORTED, MAV.MAV_RESULT_FAILED
LATITUDE, LONGITUDE = 634501000, 103600000  # 11 m north of the origin
PLACE_ONLY = 0b110111111000
NO_BYTES = [0] * 251


@pytest.fixture(scope="module")
def vehicle():
    with station() as (served, client):
        served.feed(1.0, measured(1.0, estimate=True))
        yield served, client


def place(client, *first):
    """DO_REPOSITION as a COMMAND_INT; `first` are its first parameters."""
    values = [*first, *[0.0] * (4 - len(first))]
    client.mav.command_int_send(1, 1, 6, MAV.MAV_CMD_DO_REPOSITION, 0, 0, *values, LATITUDE, LONGITUDE, -3.0)


def long(number, *values, component=1):
    """A request: a COMMAND_LONG."""
    padded = [*values, *[0.0] * (7 - len(values))]
    return lambda client: client.mav.command_long_send(1, component, number, 0, *padded)


# What is asked, what answers, and fields of the answer.
ASKED = {
    "camera's parameters": (lambda c: c.mav.param_ext_request_list_send(1, CAMERA), "STATUSTEXT", {}),
    "gps": (long(512, 24), "GPS_RAW_INT", {"fix_type": 3}),
    "global place": (long(512, 33), "GLOBAL_POSITION_INT", {"relative_alt": -2500}),
    "home": (long(410), "HOME_POSITION", {"latitude": 634500000}),
    "home by message": (long(512, 242), "HOME_POSITION", {"longitude": 103600000}),
    "origin": (long(512, 49), "GPS_GLOBAL_ORIGIN", {"latitude": 634500000}),
    "estimator": (long(512, 193), "EKF_STATUS_REPORT", {"flags": 831}),
    "second attitude": (long(512, 178), "AHRS2", {}),
    "hull pressure": (long(512, 29), "SCALED_PRESSURE", {}),
    "water pressure": (long(512, 137), "SCALED_PRESSURE2", {}),
    "channels": (long(512, 65), "RC_CHANNELS", {"chan3_raw": 1500, "chan9_raw": 1100}),
    "power": (long(512, 125), "POWER_STATUS", {"Vcc": 5000}),
    "vibration": (long(512, 241), "VIBRATION", {"clipping_0": 0}),
    "named values": (long(512, 251), "COMMAND_ACK", {"command": 512, "result": FAILED}),
    "interval of named values": (long(511, 251, 1e6), "COMMAND_ACK", {"command": 511, "result": DENIED}),
    "reposition by a long": (long(192, -1, 1), "COMMAND_ACK", {"command": 192, "result": UNSUPPORTED}),
    "arming by 2": (long(400, 2), "COMMAND_ACK", {"command": 400, "result": UNSUPPORTED}),
    "range": (long(512, 173), "RANGEFINDER", {"distance": 7.25}),
    "distance": (long(512, 132), "DISTANCE_SENSOR", {"current_distance": 725}),
    "landed": (long(512, 245), "EXTENDED_SYS_STATE", {"landed_state": 0}),
    "no such message": (long(512, 99999), "COMMAND_ACK", {"command": 512, "result": FAILED}),
    "interval of no such message": (long(511, 105, 5000), "COMMAND_ACK", {"command": 511, "result": DENIED}),
    "banner": (long(42428), "STATUSTEXT", {"text": "Frame: VECTORED_6DOF"}),
    "checks": (long(401), "COMMAND_ACK", {"command": 401, "result": 0}),
    "reposition out of guided": (place, "COMMAND_ACK", {"command": 192, "result": DENIED}),
    "take-off": (long(22, 0, 0, 0, 0, 0, 0, 10), "COMMAND_ACK", {"command": 22, "result": UNSUPPORTED}),
    "land": (long(21), "COMMAND_ACK", {"command": 21, "result": 0}),
    "return": (long(20), "COMMAND_ACK", {"command": 20, "result": UNSUPPORTED}),
    "stay": (long(17), "COMMAND_ACK", {"command": 17, "result": 0}),
    "turn out of guided": (long(115, 90), "COMMAND_ACK", {"command": 115, "result": FAILED}),
    "speed": (long(178, 1, 1), "COMMAND_ACK", {"command": 178, "result": UNSUPPORTED}),
    "motor test": (long(209, 1), "COMMAND_ACK", {"command": 209, "result": UNSUPPORTED}),
    "mission start": (long(300), "COMMAND_ACK", {"command": 300, "result": FAILED}),
    "item by command": (long(224, 3), "COMMAND_ACK", {"command": 224, "result": DENIED}),
    "fence on": (long(207, 1), "COMMAND_ACK", {"command": 207, "result": UNSUPPORTED}),
    "fence off": (long(207, 0), "COMMAND_ACK", {"command": 207, "result": 0}),
    "gyro calibration": (long(241, 1), "COMMAND_ACK", {"command": 241, "result": UNSUPPORTED}),
    "compass calibration": (long(42424), "COMMAND_ACK", {"command": 42424, "result": UNSUPPORTED}),
    "reboot": (long(246, 1), "COMMAND_ACK", {"command": 246, "result": UNSUPPORTED}),
    "gripper": (long(211, 1), "COMMAND_ACK", {"command": 211, "result": UNSUPPORTED}),
    "winch": (long(42600, 1), "COMMAND_ACK", {"command": 42600, "result": UNSUPPORTED}),
    "gimbal": (long(1000), "COMMAND_ACK", {"command": 1000, "result": UNSUPPORTED}),
    "no such command": (long(31999), "COMMAND_ACK", {"command": 31999, "result": UNSUPPORTED}),
    "camera": (long(521, 1, component=CAMERA), "COMMAND_ACK", {"command": 521, "result": UNSUPPORTED}),
    "camera by message": (long(512, 259, component=CAMERA), "COMMAND_ACK", {"command": 512, "result": UNSUPPORTED}),
    "picture": (long(2000, component=CAMERA), "COMMAND_ACK", {"command": 2000, "result": UNSUPPORTED}),
    "ping": (lambda c: c.mav.ping_send(123, 7, 0, 0), "PING", {"seq": 7, "target_system": 255}),
    "time": (lambda c: c.mav.timesync_send(0, 42), "TIMESYNC", {"ts1": 42}),
    "setting an origin": (
        lambda c: c.mav.set_gps_global_origin_send(1, 600000000, 50000000, 0),
        *("GPS_GLOBAL_ORIGIN", {"latitude": 634500000}),  # it has positions: it knows where it is
    ),
    "mission": (lambda c: c.mav.mission_request_list_send(1, 1, 0), "MISSION_COUNT", {"mission_type": 0}),
    "fence": (lambda c: c.mav.mission_request_list_send(1, 1, 1), "MISSION_COUNT", {"mission_type": 1}),
    "rally": (lambda c: c.mav.mission_request_list_send(1, 1, 2), "MISSION_COUNT", {"mission_type": 2}),
    "no such item": (lambda c: c.mav.mission_request_int_send(1, 1, 9, 0), "MISSION_ACK", {"type": 1}),
    "stray item": (
        lambda c: c.mav.mission_item_int_send(1, 1, 0, 6, 16, 0, 1, 0, 0, 0, 0, LATITUDE, LONGITUDE, -2.0, 0),
        *("MISSION_ACK", {"type": 1}),
    ),
    "clear": (lambda c: c.mav.mission_clear_all_send(1, 1, 0), "MISSION_ACK", {"type": 0, "mission_type": 0}),
    "clear all": (lambda c: c.mav.mission_clear_all_send(1, 1, 255), "MISSION_ACK", {"type": 3, "mission_type": 255}),
    "current item": (lambda c: c.mav.mission_set_current_send(1, 1, 0), "MISSION_CURRENT", {"seq": 0}),
    "part of a mission": (lambda c: c.mav.mission_write_partial_list_send(1, 1, 0, 1, 0), "MISSION_ACK", {"type": 3}),
    "logs": (lambda c: c.mav.log_request_list_send(1, 1, 0, 65535), "LOG_ENTRY", {"num_logs": 0}),
    "log data": (lambda c: c.mav.log_request_data_send(1, 1, 1, 0, 90), "LOG_DATA", {"id": 1, "count": 0}),
    "log erase": (lambda c: c.mav.log_erase_send(1, 1), "STATUSTEXT", {}),
    "shell": (lambda c: c.mav.serial_control_send(10, 6, 0, 0, 4, [108, 115, 10, 0] + [0] * 66), "SERIAL_CONTROL", {}),
    "files": (
        lambda c: c.mav.file_transfer_protocol_send(0, 1, 1, [5, 0, 0, 3, *NO_BYTES[4:]]),
        *("FILE_TRANSFER_PROTOCOL", {}),
    ),
    "no such parameter": (
        lambda c: c.mav.param_request_read_send(1, 1, b"SYS_X", -1),
        *("STATUSTEXT", {"text": "No parameter SYS_X"}),
    ),
    "tune": (lambda c: c.mav.play_tune_send(1, 1, b"A"), "STATUSTEXT", {"text": "PLAY_TUNE is not supported"}),
    "attitude": (
        lambda c: c.mav.set_attitude_target_send(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0.5),
        *("STATUSTEXT", {"text": "Attitudes count in GUIDED only"}),
    ),
    "set-point out of guided": (
        lambda c: c.mav.set_position_target_local_ned_send(0, 1, 1, 1, PLACE_ONLY, 1, 1, 1, *[0] * 8),
        *("STATUSTEXT", {"text": "Set-points count in GUIDED only"}),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ASKED)
def test_answered_within_a_second(vehicle, name):
    _, client = vehicle
    ask, kind, fields = ASKED[name]
    while client.connection.recv_msg():  # what came before is no answer
        pass
    began = time.monotonic()
    ask(client)
    answer = client.next(kind, WITHIN, **fields)
    assert answer is not None, f"no {kind} {fields}"
    assert time.monotonic() - began < WITHIN
    component = CAMERA if "camera" in name or name == "picture" else 1
    assert kind == "STATUSTEXT" or answer.get_srcComponent() == component


def received_messages(client, seconds=0.5):
    """All that comes within a time."""
    end = time.monotonic() + seconds
    found = []
    while time.monotonic() < end:
        if message := client.connection.recv_match(blocking=True, timeout=0.05):
            found.append(message)
    return found


@pytest.mark.system
def test_refusals_say_why():
    """Once to a client, and in pieces where the text is long."""
    with station() as (_, client):
        for _ in range(2):
            long(22)(client)
        texts = [m for m in received_messages(client) if m.get_type() == "STATUSTEXT"]
        assert [m.text for m in texts] == ["No take-off: a submarine dives, in ALT_HOLD"]
        long(420)(client)
        first, second = (m for m in received_messages(client) if m.get_type() == "STATUSTEXT")
        assert first.text + second.text == "No failures by command: give a scenario's faults to serve"
        assert first.id == second.id > 0 and (first.chunk_seq, second.chunk_seq) == (0, 1)


def test_what_is_reported_once_is_bounded(monkeypatch):
    from rovtwin.links.mavlink.services import conversation

    monkeypatch.setattr(conversation, "MOST_TEXTS", 5)
    with station() as (served, client):
        for i in range(20):
            client.mav.param_request_read_send(1, 1, f"X{i}".encode(), -1)
        texts = [m.text for m in received_messages(client) if m.get_type() == "STATUSTEXT"]
    assert texts == [f"No parameter X{i}" for i in range(5)]


def test_another_component_answers_for_itself():
    with station() as (_, client):
        camera = Client(f"udpout:127.0.0.1:{client.connection.destination_addr[1]}", 1)
        camera.mav.srcComponent = CAMERA
        camera.mav.heartbeat_send(MAV.MAV_TYPE_CAMERA, 8, 0, 0, 0)
        assert camera.next("HEARTBEAT")
        long(521, 1, component=CAMERA)(client)
        assert client.next("COMMAND_ACK", 0.5, command=521) is None
        camera.connection.close()


def test_without_a_position_it_says_so():
    with station() as (served, client):
        bare = [m for m in measured(200.0) if m.sensor not in ("position", "dvl")]
        served.feed(200.0, bare)  # the position of time 0 is too old
        newest = {m.get_type(): m for m in received_messages(client)}
    gps, status = newest["GPS_RAW_INT"], newest["SYS_STATUS"]
    assert (gps.fix_type, gps.lat, gps.lon, gps.satellites_visible) == (1, 0, 0, 255)
    assert status.onboard_control_sensors_present & 0x20 and not status.onboard_control_sensors_health & 0x20
    assert newest["EKF_STATUS_REPORT"].flags & 128  # constant position


def test_position_is_health():
    """MAVSDK waits for the GPS bits of SYS_STATUS and for home before it goes anywhere."""
    with station() as (served, client):
        served.feed(1.0, measured(1.0))
        newest = {m.get_type(): m for m in received_messages(client)}
    status, gps = newest["SYS_STATUS"], newest["GPS_RAW_INT"]
    bits = status.onboard_control_sensors_present & status.onboard_control_sensors_enabled
    assert bits & status.onboard_control_sensors_health & 0x20
    place = [63.45 + 3 / 111_466, 10.36 - 4 / 49_900]
    np.testing.assert_allclose([gps.lat * 1e-7, gps.lon * 1e-7], place, atol=2e-6)
    assert gps.fix_type == 3 and gps.alt == -2500 and gps.eph == 65535


def test_reposition_goes_there():
    with station() as (served, client):
        served.feed(1.0, measured(1.0, estimate=True))
        assert client.command(400, 1) == 0
        place(client, -1.0, 1.0)  # with the flag that changes the mode
        assert client.next("COMMAND_ACK", command=192).result == 0
        assert soon(lambda: served.commands and served.commands[-1].target is not None)
        np.testing.assert_allclose(served.commands[-1].target[:3], (11.15, 0.0, 3.0), atol=0.05)
        assert client.command(512, 87) == 0 and client.next("POSITION_TARGET_GLOBAL_INT").lat_int == LATITUDE
        assert client.command(115, 90.0) == 0
        assert soon(lambda: abs(served.commands[-1].target[3] - np.pi / 2) < 1e-6)
        client.mav.command_int_send(1, 1, 6, 192, 0, 0, 0, 0, 0, 0, 2**31 - 1, 0, 0.0)
        assert client.next("COMMAND_ACK", command=192).result == DENIED


def test_home_is_where_it_is_set():
    with station() as (served, client):
        served.feed(1.0, measured(1.0, estimate=True))
        client.mav.command_int_send(1, 1, 0, 179, 0, 0, 0, 0, 0, 0, LATITUDE, LONGITUDE, -1.0)
        home = client.next("HOME_POSITION", latitude=LATITUDE)  # told without being asked
        assert (home.latitude, home.longitude, home.altitude) == (LATITUDE, LONGITUDE, -1000)
        assert home.x == pytest.approx(11.15, abs=0.05) and home.z == pytest.approx(1.0)
        served.feed(2.0, measured(2.0, estimate=True))
        assert client.next("GLOBAL_POSITION_INT", time_boot_ms=2000).relative_alt == -1500
        client.mav.command_int_send(1, 1, 0, 179, 0, 0, 1, 0, 0, 0, 0, 0, 0.0)  # here
        assert client.next("HOME_POSITION", altitude=round(-1000 * PLACE[2]))
        client.mav.command_int_send(1, 1, 0, 179, 0, 0, 0, 0, 0, 0, 0, 0, 0.0)  # no place: here
        assert client.next("COMMAND_ACK", command=179, result=0)
        assert client.next("HOME_POSITION", altitude=round(-1000 * PLACE[2]))  # after it, as ArduPilot sends it


def upload(client, kind, items):
    """Send a list as ground stations do; the result of the last acknowledgement."""
    client.mav.mission_count_send(1, 1, len(items), kind)
    while True:
        message = client.next(["MISSION_REQUEST", "MISSION_ACK"], mission_type=kind)
        if message.get_type() == "MISSION_ACK":
            return message.type
        frame, command, param1, x, y = items[message.seq]
        client.mav.mission_item_int_send(1, 1, message.seq, frame, command, 0, 1, param1, 0, 0, 0, x, y, -2.0, kind)


WAY = [(6, 16, 0.0, LATITUDE + 100 * i, LONGITUDE) for i in range(4)]


def test_mission_comes_back_as_it_went():
    with station() as (_, client):
        assert upload(client, 0, WAY) == 0
        client.mav.mission_request_list_send(1, 1, 0)
        assert client.next("MISSION_COUNT").count == 4
        for i, item in enumerate(WAY):
            client.mav.mission_request_int_send(1, 1, i, 0)
            found = client.next("MISSION_ITEM_INT", seq=i)
            kept = (3, *item[1:])  # as ArduPilot keeps a height over home
            assert (found.frame, found.command, found.param1, found.x, found.y) == kept and found.z == -2.0
        client.mav.mission_request_send(1, 1, 1, 0)
        assert client.next("MISSION_ITEM", seq=1).x == pytest.approx(63.45011, abs=1e-5)
        client.mav.mission_set_current_send(1, 1, 2)
        assert client.next("MISSION_CURRENT", seq=2).total == 3
        assert client.command(176, 1, 3) == FAILED  # AUTO
        client.mav.mission_clear_all_send(1, 1, 0)
        assert client.next("MISSION_ACK").type == 0
        client.mav.mission_request_list_send(1, 1, 0)
        assert client.next("MISSION_COUNT").count == 0


@pytest.mark.parametrize(
    ("kind", "items", "result"),
    [
        (0, [(1, 16, 0.0, 0, 0)], 2),  # a local frame
        (0, [(6, 5003, 5.0, 0, 0)], 3),  # a fence's item
        (0, [(6, 16, 0.0, 2**31 - 1, 0)], 10),
        (0, [(6, 16, 0.0, 0, 2**31 - 1)], 11),
        (0, [(6, 16, 0.0, 0, 0)] * 501, 4),
        (1, [(0, 5003, 0.0, 0, 0)], 1),  # a circle without a radius
        (1, [(0, 5001, 3.0, 0, 0)] * 2, 1),  # a polygon that lacks a corner
        (1, [(0, 5001, 4.0, 0, 0)] * 4 + [(0, 5004, 5.0, 0, 0)], 0),
        (2, [(0, 16, 0.0, 0, 0)], 3),  # no rally point
        (2, [(0, 5100, 0.0, 0, 0)], 0),
    ],
)
def test_lists_that_are_wrong_are_refused_and_change_nothing(kind, items, result):
    with station() as (_, client):
        assert upload(client, 0, WAY) == 0
        assert upload(client, kind, items) == result
        client.mav.mission_request_list_send(1, 1, 0)
        assert client.next("MISSION_COUNT").count == 4


@pytest.mark.system
def test_an_upload_asks_again_and_gives_up(monkeypatch):
    from rovtwin.links.mavlink.services import mission_service

    monkeypatch.setattr(mission_service, "SILENT", 1.5)
    monkeypatch.setattr(mission_service, "ASK_AGAIN", 0.3)
    with station() as (_, client):
        client.mav.mission_count_send(1, 1, 2, 0)
        for _ in range(3):
            assert client.next("MISSION_REQUEST", seq=0)
        assert client.next("MISSION_ACK", type=15)  # cancelled
        assert upload(client, 0, WAY) == 0


def test_two_clients_do_not_mix_their_missions():
    with station() as (served, client):
        other = Client(f"udpout:127.0.0.1:{client.connection.destination_addr[1]}", 254)
        other.mav.heartbeat_send(6, 8, 0, 0, 0)
        client.mav.mission_count_send(1, 1, 2, 0)
        assert client.next("MISSION_REQUEST")
        other.mav.mission_count_send(1, 1, 1, 0)
        assert other.next("MISSION_ACK").type == 14
        other.mav.mission_item_int_send(1, 1, 0, 6, 16, 0, 1, 0, 0, 0, 0, LATITUDE, LONGITUDE, -2.0, 0)
        assert other.next("MISSION_ACK").type == 14
        other.connection.close()


def test_an_origin_is_taken_where_there_are_no_positions():
    bare = [m for m in measured(1.0) if m.sensor not in ("position", "dvl")]
    with station(readings=bare) as (served, client):
        served.feed(2.0, [replace(m, t_valid=2.0) for m in bare])
        newest = {m.get_type(): m for m in received_messages(client)}
        assert newest["GPS_RAW_INT"].fix_type == 0
        assert not newest["SYS_STATUS"].onboard_control_sensors_present & 0x20
        assert client.command(410) == FAILED  # no home yet
        client.mav.set_gps_global_origin_send(1, 600000000, 50000000, 0)
        origin = client.next("GPS_GLOBAL_ORIGIN")
        assert (origin.latitude, origin.longitude) == (600000000, 50000000)
        client.mav.set_gps_global_origin_send(1, 2**31 - 1, 0, 0)
        assert client.next("GPS_GLOBAL_ORIGIN").latitude == 600000000


def test_vibration_and_tether_are_measured():
    with station(how="tcp", rates=dict.fromkeys(RATES, 0.0)) as (served, client):
        rng = np.random.default_rng(1)
        for k in range(1, 801):
            readings = [m for m in measured(k * 0.01) if m.sensor in ("attitude", "accelerometer")]
            readings[0].value[2] = 0.02 * k  # from 2 rad to 16: nine quarters, all but a bit
            readings[1].value[:] += rng.normal(0.0, 0.5, 3)
            served.feed(k * 0.01, readings)
        assert client.command(512, 241) == 0
        shaken = client.next("VIBRATION", time_usec=8_000_000)
        assert shaken.vibration_x == pytest.approx(0.5, rel=0.4)  # less the slow part, which the mean follows
        client.mav.request_data_stream_send(1, 1, 2, 2, 1)
        assert client.command(512, 148) == 0
        served.feed(8.01, [m for m in measured(8.01) if m.sensor == "pressure"])
        turned = client.next("NAMED_VALUE_FLOAT", name="TetherTrn")
        assert turned.value == 2.0
