"""The twin as an ArduSub: unmodified pymavlink connects, arms, steers and listens."""

import asyncio
import math
import pickle
import socket
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from tests.links.mavlink.vehicle import ATTITUDE, PLACE, endpoint, measured, soon
from tests.links.serving import serving

from rovtwin.core.errors import ConfigError, LinkError
from rovtwin.core.flow import Measurement
from rovtwin.links.mavlink.server import MavlinkServer
from rovtwin.links.mavlink.services.peers import MOST, SILENT, Peer, Peers
from rovtwin.links.mavlink.telemetry.streams import ON_REQUEST, RATES
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import require_loopback

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")
from pymavlink import mavutil

MAV = mavutil.mavlink


class Client:
    """A script's side: pymavlink's own connection."""

    def __init__(self, url: str, system: int = 255):
        self.connection = mavutil.mavlink_connection(url, source_system=system, dialect="ardupilotmega")

    @property
    def mav(self):
        """Its sender; pymavlink makes another one once it has heard MAVLink 2."""
        return self.connection.mav

    def next(self, kind, limit=3.0, **fields):
        """The next message of a kind (with these fields), or None."""
        end = time.monotonic() + limit
        while time.monotonic() < end:
            message = self.connection.recv_match(type=kind, blocking=True, timeout=0.1)
            if message and all(getattr(message, name) == value for name, value in fields.items()):
                return message
        return None

    def command(self, number, *values):
        self.mav.command_long_send(1, 1, number, 0, *values, *[0] * (7 - len(values)))
        return self.next("COMMAND_ACK", command=number).result

    def first(self, kind, number, *values):
        """A message that comes before the acknowledgement of a command, and the result."""
        self.mav.command_long_send(1, 1, number, 0, *values, *[0] * (7 - len(values)))
        return self.next(kind), self.next("COMMAND_ACK", command=number).result


@contextmanager
def station(speed=1.0, system=255, how="udpout", readings=None, **options):
    """A served vehicle that has measured already, and a client that heard it."""
    server = endpoint(**options)
    urls = {
        "udpin": f"udpin:{server.ground_station}",
        "udpout": f"udpout:127.0.0.1:{server.udp_port}",
        "tcp": f"tcp:127.0.0.1:{server.tcp_port}",
    }
    with serving(server, speed=speed) as served:
        assert soon(lambda: bool(served.messages))
        served.feed(0.0, measured(0.0) if readings is None else readings)
        client = Client(urls[how], system)
        try:
            if how == "udpout":
                client.mav.heartbeat_send(6, 8, 0, 0, 0)
            assert client.next("HEARTBEAT").type == 12
            yield served, client
        finally:
            client.connection.close()


@pytest.mark.system
@pytest.mark.parametrize("how", ["udpin", "udpout", "tcp"])
def test_arms_and_flies(how):
    with station(how=how) as (served, client):
        assert client.command(176, 1, 2) == 0
        assert client.command(400, 1) == 0
        client.mav.manual_control_send(1, 500, -250, 750, 100, 0)
        assert soon(lambda: bool(served.commands) and any(served.commands[-1].motion))
        command = served.commands[-1]
        assert command.armed and command.hold_depth and command.hold_level and not command.hold_position
        np.testing.assert_allclose(command.motion, [0.25, -0.125, -0.25, 0, 0, 0.05])  # half, by the pilot's gain
        assert client.next("HEARTBEAT", base_mode=1 | 16 | 64 | 128).custom_mode == 2
        assert client.command(400, 0) == 0
        assert soon(lambda: not served.commands[-1].armed)
        count = len(served.commands)
        time.sleep(0.15)
        assert len(served.commands) == count, "after disarming there is one wish and then silence"


def test_commands_are_repeated_at_10_hz_at_least():
    with station() as (served, client):
        assert client.command(400, 1) == 0
        before = len(served.commands)
        time.sleep(0.5)
        assert len(served.commands) - before >= 5


def test_telemetry_is_the_vehicles():
    with station() as (served, client):
        served.feed(12.5, measured(12.5, estimate=True))
        got = {}

        def received():
            message = client.connection.recv_match(blocking=True, timeout=0.05)
            if message and getattr(message, "time_boot_ms", 12500) == 12500:
                got[message.get_type()] = message
            return set(got) >= set(RATES) - set(ON_REQUEST)

        assert soon(received), sorted(set(RATES) - set(got))
    m = got["ATTITUDE"]
    np.testing.assert_allclose([m.roll, m.pitch, m.yaw], ATTITUDE, atol=1e-6)
    np.testing.assert_allclose([m.rollspeed, m.pitchspeed, m.yawspeed], [0.01, -0.02, 0.03], atol=1e-6)
    m = got["LOCAL_POSITION_NED"]
    np.testing.assert_allclose([m.x, m.y, m.z], PLACE)
    # 0.4 m/s ahead, nose 0.2 rad down: 0.4 sin 0.2 of it downward.
    level = 0.4 * math.cos(0.2)
    np.testing.assert_allclose([m.vx, m.vy, m.vz], [level * math.cos(2), level * math.sin(2), 0.4 * math.sin(0.2)])
    m = got["GLOBAL_POSITION_INT"]
    assert m.relative_alt == -2500 and m.alt == -2500 and m.hdg == round(math.degrees(2.0) * 100)
    np.testing.assert_allclose([m.lat * 1e-7, m.lon * 1e-7], [63.45 + 3 / 111_466, 10.36 - 4 / 49_900], atol=2e-6)
    assert got["VFR_HUD"].alt == -2.5 and got["VFR_HUD"].throttle == 100 and got["VFR_HUD"].heading == 115
    assert got["SYS_STATUS"].battery_remaining == 83
    m = got["BATTERY_STATUS"]
    np.testing.assert_allclose(m.voltages[0] * 1e-3 * m.current_battery * 1e-2, 120.0, rtol=0.01)
    np.testing.assert_allclose(got["SCALED_PRESSURE2"].press_abs, 1013.25 + 1025 * 9.80665 * 2.5 / 100, rtol=1e-6)
    for name in ("RAW_IMU", "SCALED_IMU2"):
        m = got[name]
        np.testing.assert_allclose([m.xacc, m.yacc, m.zacc], [102, 51, -989])
        np.testing.assert_allclose([m.xgyro, m.ygyro, m.zgyro], [10, -20, 30])
    m = got["SERVO_OUTPUT_RAW"]
    assert [m.servo1_raw, m.servo2_raw, m.servo3_raw, m.servo4_raw] == [1700, 1400, 1500, 1900]
    assert got["DISTANCE_SENSOR"].current_distance == 725 and got["DISTANCE_SENSOR"].orientation == 25
    assert got["EKF_STATUS_REPORT"].flags & 1
    assert got["SYSTEM_TIME"].time_unix_usec == 1622541600000000 + 12_500_000


@pytest.mark.system
def test_rates_are_in_simulated_time():
    """Ten simulated seconds within one: the rate counts the vehicle's."""
    with station(speed=10.0, how="tcp") as (served, client):
        assert client.command(511, 30, 50_000) == 0  # 20 Hz
        for k in range(1, 501):
            served.feed(k * 0.02, measured(k * 0.02))
        times = []
        soon(lambda: times.append(client.next("ATTITUDE", 0.3)) or times[-1] is None)
        boots = sorted({m.time_boot_ms for m in times if m})
    assert len(boots) == pytest.approx(200, abs=2)


def test_rates_on_and_off():
    with station(rates={"ATTITUDE": 0.0}) as (served, client):
        found, result = client.first("MESSAGE_INTERVAL", 510, 30)
        assert (found.interval_us, result) == (-1, 0)
        client.mav.request_data_stream_send(1, 1, 10, 25, 1)
        assert client.first("MESSAGE_INTERVAL", 510, 30)[0].interval_us == 40_000
        found, result = client.first("MESSAGE_INTERVAL", 510, 9999)
        assert (found.interval_us, result) == (0, 4)
        served.feed(1.0, measured(1.0))
        assert client.next("ATTITUDE").time_boot_ms == 1000
        assert client.command(511, 30, -1) == 0
        served.feed(2.0, measured(2.0))
        assert client.next("ATTITUDE", 0.2, time_boot_ms=2000) is None
        assert client.command(511, 9999, 1000) == 2 and client.command(511, math.nan, math.nan) == 2


@pytest.mark.system
def test_what_is_not_measured_is_not_sent():
    server = endpoint()
    with serving(server) as served:
        client = Client(f"udpin:{server.ground_station}")
        assert client.next("HEARTBEAT")
        served.feed(1.0, [Measurement("altimeter", np.array([np.inf]), 1.0), *measured(1.0)[3:4]])
        assert client.next("SCALED_PRESSURE2")
        assert client.command(512, 132) == 4 and client.command(512, 30) == 4
        client.connection.close()


def test_arming_is_refused_without_attitude():
    server = endpoint()
    with serving(server) as served:
        client = Client(f"udpin:{server.ground_station}")
        assert client.next("HEARTBEAT")
        client.mav.command_long_send(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0)  # also by force
        texts = [client.next(["STATUSTEXT", "COMMAND_ACK"]) for _ in range(2)]
        assert {m.get_type(): getattr(m, "text", "") or m.result for m in texts} == {
            "STATUSTEXT": "Arm: no attitude yet",
            "COMMAND_ACK": 4,
        }
        assert not served.commands
        client.connection.close()


def test_questions():
    with station() as (served, client):
        assert client.command(512, 148) == 0
        assert client.next("AUTOPILOT_VERSION").capabilities & 8192
        assert client.command(520, 1) == 0 and client.next("AUTOPILOT_VERSION")
        home, result = client.first("HOME_POSITION", 410)
        assert (home.latitude, result) == (634500000, 0)
        assert client.command(22) == 3 and client.command(512, 12345) == 4
        client.mav.mission_request_list_send(1, 1)
        assert client.next("MISSION_COUNT").count == 0
        client.mav.timesync_send(0, 987654321)
        answer = client.next("TIMESYNC")
        assert answer.ts1 == 987654321 and answer.tc1 == 0  # the vehicle's time is 0 here
        client.mav.command_int_send(1, 1, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0)
        assert client.next("COMMAND_ACK", command=400).result == 0


def test_parameters():
    with station() as (served, client):
        client.mav.param_request_list_send(1, 1)
        listed = [client.next("PARAM_VALUE") for _ in range(10)]
        assert [m.param_index for m in listed] == list(range(10)) and {m.param_count for m in listed} == {10}
        client.mav.param_set_send(1, 1, b"FS_PILOT_TIMEOUT", 1.5, 9)
        assert client.next("PARAM_VALUE", param_id="FS_PILOT_TIMEOUT").param_value == 1.5
        client.mav.param_set_send(1, 1, b"FRAME_CONFIG", 1, 2)
        assert client.next("PARAM_VALUE", param_id="FRAME_CONFIG").param_value == 2
        client.mav.param_request_read_send(1, 1, b"NOT_THERE", -1)
        assert client.next("PARAM_VALUE", 0.2) is None


def test_guided():
    with station() as (served, client):
        assert client.command(176, 1, 4) == 0 and client.command(400, 1) == 0
        client.mav.set_position_target_local_ned_send(0, 1, 1, 9, 0b110111111000, 2, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0)
        assert soon(lambda: bool(served.commands) and served.commands[-1].target is not None)
        expected = [3 + 2 * math.cos(2.0), -4 + 2 * math.sin(2.0), 3.5, 2.0]
        np.testing.assert_allclose(served.commands[-1].target, expected, atol=1e-6)


def test_set_mode_message():
    with station() as (served, client):
        client.mav.set_mode_send(1, 1, 16)
        assert client.next("HEARTBEAT", custom_mode=16)
        client.mav.set_mode_send(1, 1, 3)
        assert "AUTO" in client.next("STATUSTEXT").text


def test_lost_pilot_disarms():
    """Its own time-out, shortened: nobody steers any more, also while the sticks were not neutral."""
    with station() as (served, client):
        client.mav.param_set_send(1, 1, b"FS_PILOT_TIMEOUT", 0.3, 9)
        assert client.command(400, 1) == 0
        client.mav.manual_control_send(1, 500, 0, 500, 0, 0)
        assert soon(lambda: bool(served.commands) and served.commands[-1].motion[0] == 0.25)
        start = time.monotonic()
        assert soon(lambda: not served.commands[-1].armed)
        assert 0.15 < time.monotonic() - start < 0.6
        assert client.next("STATUSTEXT", text="Lost manual control")


def test_others_do_not_steer():
    with station(system=42) as (served, client):
        assert client.command(400, 1) == 0
        for target in (1, 2):
            client.mav.manual_control_send(target, 1000, 0, 500, 0, 0)
        assert "SYSID_MYGCS" in client.next("STATUSTEXT", severity=4).text
        assert not any(any(command.motion) for command in served.commands)


def test_garbage_is_counted_and_dropped():
    with station(how="tcp") as (served, client):
        server_port = client.connection.port.getpeername()
        with socket.create_connection(server_port) as other:
            other.sendall(b"\xfd\xff\x00" + bytes(range(256)) * 50)
            frame = client.mav.command_long_encode(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0).pack(client.mav)
            other.sendall(frame[:-1] + bytes([frame[-1] ^ 1]))  # wrong checksum
        assert client.command(176, 1, 0) == 0
        assert not served.commands


def test_too_many_peers_are_not_served():
    with station(how="tcp") as (served, client):
        where = client.connection.port.getpeername()
        crowd = [socket.create_connection(where) for _ in range(12)]
        assert soon(lambda: sum("connected" in text for text in served.messages) >= 7)
        time.sleep(0.1)
        assert sum("connected" in text for text in served.messages) == 7  # one is the ground station that is called
        for one in crowd:
            one.close()
        assert soon(lambda: sum("disconnected" in text for text in served.messages) == 6)
        assert client.command(176, 1, 0) == 0


def test_the_longest_silent_peer_gives_its_place():
    closed = []
    peers = Peers(lambda name, write: Peer(name, write, None, None, received_at=0.0))
    for k in range(MOST):
        peers.get(k, str(k), None, 0.0).received_at = 10.0 - 0.1 * k
    peers.by_address[7].called = True  # at 9.3: the longest silent, but the vehicle's own ground station
    peers.by_address[6].close = lambda: closed.append(6)  # at 9.4, over TCP
    assert peers.get("new", "new", None, 9.4 + SILENT) is None, "all of them live"
    assert peers.get("new", "new", None, 9.41 + SILENT).name == "new" and closed == [6]
    assert set(peers.by_address) == {0, 1, 2, 3, 4, 5, 7, "new"}


def test_ending_disarms():
    with station() as (served, client):
        assert client.command(400, 1) == 0
        assert soon(lambda: bool(served.commands) and served.commands[-1].armed)
    assert not served.commands[-1].armed


def test_taken_port_says_so():
    server = endpoint()
    with serving(server):
        time.sleep(0.1)
        for clash in (
            MavlinkServer(udp_port=server.udp_port, tcp_port=None),
            endpoint(tcp_port=server.tcp_port),
        ):
            with pytest.raises(LinkError, match="cannot be bound"):
                asyncio.run(clash.run(ServedVehicle()))


def test_ground_station_elsewhere_is_exposed():
    with pytest.raises(ConfigError, match="192.168.2.1"):
        require_loopback([MavlinkServer(ground_station="192.168.2.1:14550")], exposed=False)
    for bad in ("nowhere", "host:", ":14550", "host:99999"):
        with pytest.raises(LinkError, match="ground_station"):
            MavlinkServer(ground_station=bad)
    with pytest.raises(LinkError, match="no message"):
        MavlinkServer(rates={"ATITUDE": 5})


def test_can_be_pickled():
    server = endpoint()
    assert pickle.loads(pickle.dumps(server)) == server


def test_leak_is_reported():
    with station() as (served, client):
        served.feed(1.0, [Measurement("leak", np.array([1.0]), 1.0)])
        assert client.next("STATUSTEXT", text="Leak Detected")


def test_two_servers_stop_cleanly():
    before = threading.active_count()
    with serving(endpoint()), serving(endpoint(tcp_port=None)):
        pass
    assert threading.active_count() == before
