"""The served Underwater GPS against a client written from the vendor's field list, and against those that misbehave."""

import http.client
import json
import math

import numpy as np
import pytest
from tests.links.sensors import HOST, connect, free_port, is_closed, reading, wait_until
from tests.links.serving import serving

from rovtwin.core.datum import Datum
from rovtwin.links.waterlinked.ugps_server import UgpsServer

NUMBER = (int, float)
ACOUSTIC = {
    **dict.fromkeys(("x", "y", "z", "std"), NUMBER),
    **{"position_valid": bool},
    **dict.fromkeys(("receiver_distance", "receiver_rssi", "receiver_nsd", "receiver_valid"), list),
}
MAP = dict.fromkeys(("lat", "lon", "orientation", "cog", "sog", "hdop", "numsats", "fix_quality"), NUMBER)
ABOUT = {"version": str, "version_short": str, "chipid": str, "product_name": str, "variant": str}
ABOUT |= {"hardware_revision": int, "product_id": int}
DATUM = Datum(63.4, 10.4)
TOPSIDE = (5.0, -2.0, 30.0)


def check(found, fields):
    assert set(found) == set(fields)
    for key, kind in fields.items():
        assert isinstance(found[key], kind) and (kind is bool or not isinstance(found[key], bool)), key
        if kind is list:
            assert len(found[key]) == 4 and all(type(item) is float for item in found[key])


class Client:
    def __init__(self, port):
        connect(port).close()
        self.connection = http.client.HTTPConnection(HOST, port, timeout=5.0)

    def ask(self, method, path, body=None):
        content = None if body is None else json.dumps(body)
        self.connection.request(method, f"/api/v1{path}", content, {"Content-Type": "application/json"})
        response = self.connection.getresponse()
        data = response.read()
        assert response.headers["Content-Type"] == "application/json"
        return response.status, json.loads(data, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))

    def get(self, path):
        status, found = self.ask("GET", path)
        assert status == 200
        return found


@pytest.fixture
def rig():
    port = free_port()
    with serving(UgpsServer(port=port, topside=TOPSIDE, datum=DATUM)) as served:
        client = Client(port)
        yield served, client, port
        client.connection.close()


def fix(served, t, north, east, depth=4.0):
    served.feed(t, [reading("pressure", t, depth), reading("position", t, north, east)])


def test_acoustic_position(rig):
    """10 m ahead of the topside unit and 3 m to its right."""
    served, client, _ = rig
    c, s = math.cos(math.radians(30.0)), math.sin(math.radians(30.0))
    fix(served, 1.0, 5.0 + 10.0 * c - 3.0 * s, -2.0 + 10.0 * s + 3.0 * c)
    for path in ("/position/acoustic/filtered", "/position/acoustic/raw"):
        found = client.get(path)
        check(found, ACOUSTIC)
        np.testing.assert_allclose([found["x"], found["y"], found["z"]], [10.0, 3.0, 4.0], atol=1e-9)
        assert found["position_valid"] is True and found["std"] == 0.5
        assert found["receiver_valid"] == [1.0] * 4
        assert found["receiver_distance"][0] == pytest.approx(math.dist((10.0, 3.0, 4.0), (0.2, 0.2, 1.0)))


def test_global_position(rig):
    served, client, _ = rig
    fix(served, 1.0, 40.0, -30.0)
    found = client.get("/position/global")
    check(found, MAP)
    place = DATUM.position(found["lat"], found["lon"], 0.0)
    np.testing.assert_allclose(place[:2], [40.0, -30.0], atol=1e-3)
    master = client.get("/position/master")
    check(master, MAP)
    np.testing.assert_allclose(DATUM.position(master["lat"], master["lon"], 0.0)[:2], TOPSIDE[:2], atol=1e-6)
    assert master["orientation"] == 30.0


def test_before_the_first_fix(rig):
    _, client, _ = rig
    found = client.get("/position/acoustic/filtered")
    check(found, ACOUSTIC)
    assert found["position_valid"] is False
    check(client.get("/position/global"), MAP)


def test_old_positions_are_not_valid(rig):
    served, client, _ = rig
    fix(served, 1.0, 6.0, 0.0)
    assert client.get("/position/acoustic/filtered")["position_valid"] is True
    served.feed(3.5, [reading("pressure", 3.5, 4.0)])
    found = client.get("/position/acoustic/filtered")
    assert found["position_valid"] is False and found["receiver_valid"] == [0.0] * 4
    fix(served, 3.6, 6.0, 0.0)
    assert client.get("/position/acoustic/filtered")["position_valid"] is True


def test_renewed_four_times_a_second(rig):
    """Positions at 20 Hz: 5 fixes in the first second."""
    served, client, _ = rig
    seen = set()
    for k in range(21):
        fix(served, 0.05 * k, 10.0 + k, 0.0)
        seen.add(client.get("/position/acoustic/filtered")["x"])
    assert len(seen) == 5


def test_fixes_at_rest_differ(rig):
    """As on the real one, where every signal strength is measured."""
    served, client, _ = rig
    fix(served, 1.0, 6.0, 0.0)
    first = client.get("/position/acoustic/filtered")
    assert client.get("/position/acoustic/filtered") == first
    fix(served, 2.0, 6.0, 0.0)
    assert client.get("/position/acoustic/filtered") != first


def test_external_depth_and_orientation(rig):
    served, client, _ = rig
    assert client.ask("PUT", "/external/depth", {"depth": 7.5, "temp": 8.0}) == (200, {"success": True, "error": ""})
    fix(served, 1.0, 6.0, 0.0, depth=4.0)
    assert client.get("/position/acoustic/raw")["z"] == 7.5
    assert client.get("/external/orientation") == {"orientation": -1.0}
    assert client.ask("PUT", "/external/orientation", {"orientation": 42.0})[0] == 200
    assert client.get("/external/orientation") == {"orientation": 42.0}
    assert client.get("/position/global")["orientation"] == 42.0
    imu = {"roll": 1.0, "pitch": 2.0, "yaw": 3.0, "x": 0.0, "y": 0.0, "z": -9.8}
    assert client.ask("PUT", "/external/imu", imu)[0] == 200
    assert client.get("/external/imu") == imu


def test_external_master(rig):
    """A client that says where the topside unit is moves the place on the map, not the acoustic one."""
    served, client, _ = rig
    fix(served, 1.0, 6.0, 0.0)
    acoustic = client.get("/position/acoustic/filtered")
    assert client.ask("PUT", "/external/master", {"lat": 60.0, "lon": 5.0, "orientation": 0.0})[0] == 200
    master = client.get("/position/master")
    check(master, MAP)
    assert (master["lat"], master["lon"], master["orientation"]) == (60.0, 5.0, 0.0)
    found = client.get("/position/global")
    place = Datum(60.0, 5.0).position(found["lat"], found["lon"], 0.0)
    np.testing.assert_allclose(place[:2], [acoustic["x"], acoustic["y"]], atol=1e-3)
    assert client.get("/config/generic")["gps"] == "external"


def test_locator_that_needs_the_depth():
    port = free_port()
    with serving(UgpsServer(port=port, needs_depth=True)) as served:
        client = Client(port)
        fix(served, 1.0, 6.0, 0.0)
        assert client.get("/position/acoustic/filtered")["position_valid"] is False
        client.ask("PUT", "/external/depth", {"depth": 4.0, "temp": 10.0})
        assert client.get("/position/acoustic/filtered")["position_valid"] is True
        client.connection.close()


def test_about_and_settings(rig):
    _, client, _ = rig
    check(client.get("/about"), ABOUT)
    assert {"channel", "locator_type", "gps", "compass", "static_lat", "static_lon"} <= set(
        client.get("/config/generic")
    )
    assert set(client.get("/about/status")) == {"imu", "gps", "battery"}
    assert set(client.get("/config/antenna")) == {"x", "y", "depth", "antenna_rotation"}


@pytest.mark.parametrize(
    ("method", "path", "body", "status"),
    [
        *(("GET", "/nonsense", None, 404), ("POST", "/about", {}, 405), ("PUT", "/position/global", {}, 405)),
        *(("PUT", "/external/depth", {"depth": "deep"}, 400), ("PUT", "/external/depth", {}, 400)),
        *(
            ("PUT", "/external/depth", [1], 400),
            ("PUT", "/external/master", {"lat": 99, "lon": 0, "orientation": 0}, 400),
        ),
    ],
)
def test_wrong_requests(rig, method, path, body, status):
    _, client, _ = rig
    found = client.ask(method, path, body)
    assert found[0] == status and found[1]["success"] is False and found[1]["error"]
    check(client.get("/about"), ABOUT)


@pytest.mark.parametrize(
    "content", [b'{"depth": NaN}', b'{"depth": Infinity}', b'{"depth": 1e999}', b"{" * 5000, b"\xff"]
)
def test_wrong_bodies_change_nothing(rig, content):
    served, client, port = rig
    raw = connect(port)
    raw.sendall(b"PUT /api/v1/external/depth HTTP/1.1\r\nContent-Length: %d\r\n\r\n" % len(content) + content)
    assert raw.recv(4096).startswith(b"HTTP/1.1 400 ")
    raw.close()
    fix(served, 1.0, 6.0, 0.0)
    assert client.get("/position/acoustic/raw")["z"] == 4.0


@pytest.mark.parametrize(
    "data",
    [
        *(b"\x00\xff\x00\xff\r\n\r\n", b"GET\r\n\r\n", b"x" * 100_000, b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 5000),
        *(b"PUT /api/v1/external/depth HTTP/1.1\r\nContent-Length: 999999\r\n\r\n",),
    ],
)
def test_garbage_ends_only_its_connection(rig, data):
    _, client, port = rig
    raw = connect(port)
    raw.sendall(data)
    assert is_closed(raw)
    check(client.get("/about"), ABOUT)


def test_half_a_request_waits_for_nobody(rig, monkeypatch):
    monkeypatch.setattr("rovtwin.links.waterlinked.web.PATIENCE", 0.2)
    _, client, port = rig
    slow = connect(port)
    slow.sendall(b"GET /api/v1/about HT")
    check(client.get("/about"), ABOUT)
    assert is_closed(slow)


@pytest.mark.system
def test_many_connections(rig):
    """More than are served: those that idle take the places, until they are asked to leave."""
    served, client, port = rig
    check(client.get("/about"), ABOUT)
    others = [connect(port) for _ in range(60)]
    check(client.get("/about"), ABOUT)  # who is in stays in
    assert sum(is_closed(other, 0.05) for other in others) >= 60 - 32
    for other in others:
        other.close()
    wait_until(lambda: _answers(port))


def _answers(port):
    late = connect(port)
    try:
        late.sendall(b"GET /api/v1/about HTTP/1.0\r\n\r\n")
        return late.recv(100).startswith(b"HTTP/1.1 200")
    except OSError:
        return False
    finally:
        late.close()
