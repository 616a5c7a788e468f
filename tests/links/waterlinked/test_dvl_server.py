"""The served DVL against a client written from the vendor's field list alone, and against clients that misbehave."""

import json
import math
import socket
import time

import numpy as np
import pytest
from tests.links.sensors import HOST, connect, free_port, is_closed, reading, wait_until
from tests.links.serving import serving

from rovtwin.core.errors import LinkError
from rovtwin.links.waterlinked.dvl_server import DvlServer

EPOCH = 1.7e9
VELOCITY = {
    **dict.fromkeys(("time", "vx", "vy", "vz", "fom", "altitude"), float),
    **{"covariance": list, "transducers": list, "velocity_valid": bool, "status": int, "format": str, "type": str},
    **{"time_of_validity": int, "time_of_transmission": int},
}
TRANSDUCER = {"id": int, **dict.fromkeys(("velocity", "distance", "rssi", "nsd"), float), "beam_valid": bool}
POSITION = {
    **dict.fromkeys(("ts", "x", "y", "z", "std", "roll", "pitch", "yaw"), float),
    **{"type": str, "status": int, "format": str},
}
RESPONSE = {"response_to": str, "success": bool, "error_message": str, "result": object, "format": str, "type": str}


def check(found, fields):
    """Exactly these fields, each of exactly this type."""
    assert set(found) == set(fields)
    for key, kind in fields.items():
        assert kind is object or type(found[key]) is kind, f"{key} is {found[key]!r}"


def strict(line: bytes):
    """As the vendor's own reader and libwaterlinked read it."""
    assert line.endswith(b"\r\n")
    found = json.loads(line, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    fields = {"velocity": VELOCITY, "position_local": POSITION, "response": RESPONSE}[found["type"]]
    check(found, fields)
    assert found["format"] == "json_v3.1"
    if found["type"] == "velocity":
        assert [len(row) for row in found["covariance"]] == [3, 3, 3]
        assert all(type(x) is float for row in found["covariance"] for x in row)
        assert [beam["id"] for beam in found["transducers"]] == [0, 1, 2, 3]
        for beam in found["transducers"]:
            check(beam, TRANSDUCER)
    return found


class Client:
    def __init__(self, port):
        self.socket = connect(port)
        self.lines = self.socket.makefile("rb")
        self.passed = []  # messages of types that nobody asked for yet

    def next(self, kind, count=1):
        """The next messages of a type; others are kept."""
        found = [message for message in self.passed if message["type"] == kind][:count]
        self.passed = [message for message in self.passed if not any(message is one for one in found)]
        while len(found) < count:
            line = self.lines.readline()
            assert line, "the server hung up"
            message = strict(line)
            (found if message["type"] == kind else self.passed).append(message)
        return found[0] if count == 1 else found

    def ask(self, command, parameters=None):
        message = {"command": command} | ({"parameters": parameters} if parameters is not None else {})
        self.socket.sendall(json.dumps(message).encode() + b"\n")
        return self.next("response")

    def close(self):
        self.lines.close()
        self.socket.close()


@pytest.fixture
def rig():
    port = free_port()
    with serving(DvlServer(port=port, epoch=EPOCH, most_clients=4)) as served:
        client = Client(port)
        client.ask("get_config")
        yield served, client, port
        client.close()


def test_velocity(rig):
    served, client, _ = rig
    served.feed(0.10, [reading("altimeter", 0.10, 2.5), reading("dvl", 0.08, 0.0, 0.0, 0.0)])
    served.feed(0.25, [reading("dvl", 0.20, 0.5, -0.1, 0.02)])
    first, second = client.next("velocity", 2)
    assert (second["vx"], second["vy"], second["vz"]) == (0.5, -0.1, 0.02)
    assert second["velocity_valid"] is True and second["altitude"] == 2.5 and second["status"] == 0
    assert second["time"] == pytest.approx(120.0)
    assert second["time_of_validity"] == round((EPOCH + 0.20) * 1e6)
    assert second["time_of_transmission"] == round((EPOCH + 0.25) * 1e6)
    assert first["time_of_validity"] == round((EPOCH + 0.08) * 1e6)
    assert np.diag(second["covariance"]) == pytest.approx(np.square(DvlServer().noise))
    assert second["fom"] == pytest.approx(0.005)
    beam = second["transducers"][0]
    tilt = math.radians(22.5)
    across = math.sin(tilt) * math.sqrt(0.5)
    assert beam["velocity"] == pytest.approx(across * 0.5 + across * -0.1 + math.cos(tilt) * 0.02)
    assert beam["distance"] == pytest.approx(2.5 / math.cos(tilt)) and beam["beam_valid"] is True


def test_bottom_lock_is_lost_without_readings(rig):
    served, client, _ = rig
    served.feed(0.0, [reading("dvl", 0.0, 0.5, 0.0, 0.0)])
    assert client.next("velocity")["velocity_valid"] is True
    for k in range(1, 31):  # the vehicle goes on, its DVL does not
        served.feed(0.1 * k, [reading("pressure", 0.1 * k, 2.0)])
    lost = client.next("velocity", 5)
    assert not any(report["velocity_valid"] for report in lost)
    assert all(report["altitude"] == -1.0 and report["vx"] == 0.0 for report in lost)
    assert not any(beam["beam_valid"] for beam in lost[0]["transducers"])
    served.feed(3.1, [reading("dvl", 3.1, 0.25, 0.0, 0.0)])
    while not (report := client.next("velocity"))["velocity_valid"]:
        pass
    assert report["vx"] == 0.25


@pytest.mark.system
def test_bottom_lock_is_lost_when_the_vehicle_dies(rig):
    """Nothing is fed any more: half a second of real time later clients know."""
    served, client, _ = rig
    served.feed(0.0, [reading("dvl", 0.0, 0.5, 0.0, 0.0)])
    assert client.next("velocity")["velocity_valid"] is True
    start = time.monotonic()
    assert client.next("velocity")["velocity_valid"] is False
    assert time.monotonic() - start < 2.0


@pytest.mark.parametrize(
    ("server", "others", "expected"),
    [
        (DvlServer(), [("altimeter", 3.0)], 3.0),
        (DvlServer(), [("altimeter", math.inf)], -1.0),
        (DvlServer(floor=10.0), [("pressure", 4.0)], 6.0),
        (DvlServer(floor=10.0), [("pressure", 4.0), ("altimeter", 5.5)], 5.5),
        (DvlServer(), [("pressure", 4.0)], -1.0),
    ],
)
def test_altitude(server, others, expected):
    server.port = free_port()
    with serving(server) as served:
        client = Client(server.port)
        client.ask("get_config")
        batch = [reading(name, 0.0, value) for name, value in others]
        served.feed(0.0, [*batch, reading("dvl", 0.0, 0.1, 0.0, 0.0)])
        report = client.next("velocity")
        assert report["altitude"] == expected and report["velocity_valid"] is True
        assert all((beam["distance"] > 0) == (expected > 0) for beam in report["transducers"])
        unknown = server.floor is None and others[0][0] == "pressure"
        assert any("altitude is reported as -1" in text for text in served.messages) == unknown
        client.close()


def sail(served, velocity, psi, start, stop, dt=0.05):
    for k in range(round(start / dt), round(stop / dt)):
        t = k * dt
        served.feed(t, [reading("attitude", t, 0.0, 0.0, psi), reading("dvl", t, *velocity)])


def test_dead_reckoning(rig):
    """Heading east at the start: x is ahead as at the reset, whatever the compass says."""
    served, client, _ = rig
    east = math.pi / 2
    sail(served, (1.0, 0.0, 0.1), east, 0.0, 2.0)
    sail(served, (1.0, 0.0, 0.0), east + math.pi / 2, 2.0, 4.05)
    reports = client.next("position_local", 21)
    np.testing.assert_allclose(np.diff([report["ts"] for report in reports]), 0.2, atol=1e-5)
    last = reports[-1]
    assert last["ts"] == pytest.approx(EPOCH + 4.0, abs=1e-5)
    np.testing.assert_allclose([last["x"], last["y"], last["z"]], [1.95, 2.05, 0.195], atol=0.06)
    assert last["yaw"] == pytest.approx(90.0) and last["roll"] == pytest.approx(0.0, abs=1e-9)
    assert last["std"] == pytest.approx(0.005 * 4.0)


def test_reset_dead_reckoning(rig):
    served, client, _ = rig
    sail(served, (1.0, 0.0, 0.0), 0.5, 0.0, 1.0)
    assert client.ask("reset_dead_reckoning")["success"] is True
    before = client.next("position_local", 5)[-1]
    assert before["x"] > 0.7 and before["std"] > 0.0
    served.feed(2.0, [reading("pressure", 2.0, 1.0)])
    report = client.next("position_local")
    assert (report["x"], report["y"], report["std"]) == (0.0, 0.0, 0.0)
    assert report["yaw"] == pytest.approx(0.0, abs=1e-9)


def test_commands(rig):
    _, client, _ = rig
    config = client.ask("get_config")
    assert config["response_to"] == "get_config" and config["success"] is True and config["error_message"] == ""
    kinds = {"speed_of_sound": float, "mounting_rotation_offset": float, "range_mode": str}
    check(
        config["result"],
        kinds | dict.fromkeys(("acoustic_enabled", "dark_mode_enabled", "periodic_cycling_enabled"), bool),
    )
    assert client.ask("set_config", {"speed_of_sound": 1500.0, "range_mode": "=2"})["success"] is True
    assert client.ask("get_config")["result"] == config["result"] | {"speed_of_sound": 1500.0, "range_mode": "=2"}
    for command in ("calibrate_gyro", "trigger_ping", "reset_dead_reckoning"):
        answer = client.ask(command)
        assert answer["response_to"] == command and answer["success"] is True and answer["result"] is None


@pytest.mark.parametrize(
    ("command", "parameters", "message"),
    [
        ("fly_away", None, "no such command"),
        ("set_config", {"speed_of_sound": 1}, "speed_of_sound"),
        ("set_config", {"colour": "red"}, "no such parameter"),
        ("set_config", {"acoustic_enabled": "yes"}, "acoustic_enabled"),
    ],
)
def test_wrong_commands(rig, command, parameters, message):
    _, client, _ = rig
    before = client.ask("get_config")["result"]
    answer = client.ask(command, parameters)
    assert answer["success"] is False and message in answer["error_message"] and answer["response_to"] == command
    assert client.ask("get_config")["result"] == before


def test_settings_do_what_they_say(rig):
    """A mounting offset turns velocities, a wrong speed of sound scales them, silence is silence until a ping."""
    served, client, _ = rig
    client.ask("set_config", {"mounting_rotation_offset": 90, "speed_of_sound": 1475 * 1.02})
    served.feed(0.0, [reading("dvl", 0.0, 1.0, 0.0, 0.0)])
    report = client.next("velocity")
    # The DVL's ahead is the vehicle's starboard.
    np.testing.assert_allclose([report["vx"], report["vy"]], [0.0, 1.02], atol=1e-12)
    client.ask("set_config", {"acoustic_enabled": False, "mounting_rotation_offset": 0})
    assert [client.ask("trigger_ping")["success"] for _ in range(17)] == [True] * 15 + [False] * 2
    for k in range(1, 21):
        served.feed(0.1 * k, [reading("dvl", 0.1 * k, 0.01 * k, 0.0, 0.0)])
    client.ask("set_config", {"acoustic_enabled": True, "speed_of_sound": 1475})
    served.feed(2.1, [reading("dvl", 2.1, 9.0, 0.0, 0.0)])
    speeds = [report["vx"] for report in client.next("velocity", 16)]
    np.testing.assert_allclose(speeds, [*(0.0102 * k for k in range(1, 16)), 9.0])


@pytest.mark.parametrize(
    "line", [b"hello", b"{", b"[1]", b'{"command": 5}', b"\xff\x00\xfe", b'{"command":"get_config"']
)
def test_garbage_is_answered_and_forgotten(rig, line):
    _, client, _ = rig
    client.socket.sendall(line + b"\r\n")
    answer = client.next("response")
    assert answer["success"] is False and answer["error_message"]
    assert client.ask("get_config")["success"] is True


@pytest.mark.parametrize(
    ("sent", "answers"),
    [
        (b'{"command":"get_config"}', ["get_config"]),  # libwaterlinked, dvl-a50: no end of line
        (b'{"command":"get_config"}{"command":"trigger_ping"}', ["get_config", "trigger_ping"]),
        (b'{"command":"get_config"}\n\n{"command":"trigger_ping"}\r\n', ["get_config", "trigger_ping"]),
        (b'["command","get_config"]{"command":"get_config"}', ["", "get_config"]),  # dvl-a50's own mistake
        (b'hello {"command":1}\n{"command":"get_config"}', ["", "get_config"]),
    ],
)
@pytest.mark.parametrize("pieces", [1, 7])
def test_commands_with_and_without_an_end_of_line(rig, sent, answers, pieces):
    """As C++ drivers send them, whole or torn to pieces."""
    _, client, _ = rig
    client.ask("get_config")
    size = -(-len(sent) // pieces)
    for at in range(0, len(sent), size):
        client.socket.sendall(sent[at : at + size])
        time.sleep(0.005)
    found = [client.next("response") for _ in answers]
    assert [answer["response_to"] for answer in found] == answers
    assert client.ask("get_config")["success"] is True


def test_endless_line_ends_the_connection(rig):
    _, client, port = rig
    other = connect(port)
    other.sendall(b"x" * 20000)
    assert is_closed(other)
    assert client.ask("get_config")["success"] is True


def test_one_too_many_is_turned_away(rig):
    served, client, port = rig
    others = [connect(port) for _ in range(3)]
    wait_until(lambda: sum("connected" in text for text in served.messages) == 4)
    assert is_closed(connect(port))
    for other in others:
        other.close()
    wait_until(lambda: sum("left" in text for text in served.messages) == 3)
    late = Client(port)
    assert late.ask("get_config")["success"] is True
    assert client.ask("get_config")["success"] is True
    late.close()


def test_slow_client_is_dropped_and_holds_up_nobody(rig):
    served, client, port = rig
    slow = connect(port, receive_buffer=4096)
    wait_until(lambda: sum("connected" in text for text in served.messages) == 2)
    client.socket.settimeout(0.5)
    got = 0
    for k in range(6000):
        served.feed(0.01 * k, [reading("dvl", 0.01 * k, 0.5, 0.0, 0.0)])
        if k % 20 == 19:
            got += len(client.next("velocity", 20))
        if any("did not read" in text for text in served.messages):
            break
    assert any("did not read" in text for text in served.messages), "the slow client was not dropped"
    assert got >= k - 20  # who reads loses nothing
    slow.close()


def test_client_that_vanishes(rig):
    """A reset in the middle of a line."""
    served, client, port = rig
    rude = connect(port)
    rude.sendall(b'{"command": "get_')
    rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    rude.close()
    for k in range(5):
        served.feed(0.1 * k, [reading("dvl", 0.1 * k, 0.5, 0.0, 0.0)])
    assert len(client.next("velocity", 5)) == 5


def test_address_taken():
    port = free_port()
    with serving(DvlServer(port=port)):
        connect(port).close()
        with pytest.raises(LinkError, match=f"dvl at {HOST}:{port}: cannot be bound"), serving(DvlServer(port=port)):
            time.sleep(0.2)
