"""Pages over HTTP that BlueOS' extensions for Water Linked's instruments ask for, with the requests they sent.

Recorded from BlueOS-Water-Linked-DVL 1.0.10 (urllib), blueos-ugps-extension and wl_ugps_external_extension (requests).
"""

import json
import re

import pytest
from tests.links.sensors import connect, free_port, reading
from tests.links.serving import serving, wait_for

from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.ugps_server import UgpsServer

BY_URLLIB = (
    b"Accept-Encoding: identity\r\nHost: 127.0.0.1:9088\r\nUser-Agent: Python-urllib/3.11\r\nConnection: close\r\n"
)
BY_REQUESTS = (
    b"Host: 127.0.0.1:9088\r\nUser-Agent: python-requests/2.34.2\r\nAccept-Encoding: gzip, deflate\r\n"
    b"Accept: */*\r\nConnection: keep-alive\r\n"
)
EPOCH = 1.7e9


def exchange(port, head, headers, body=b""):
    """Status and JSON of the answer to a request as it was recorded."""
    client = connect(port)
    extra = b"Content-Length: %d\r\nContent-Type: application/json\r\n" % len(body) if body else b""
    client.sendall(head + b" HTTP/1.1\r\n" + headers + extra + b"\r\n" + body)
    data = b""
    while b"\r\n\r\n" not in data or len(data.partition(b"\r\n\r\n")[2]) < int(
        re.findall(rb"Content-Length: (\d+)", data)[0]
    ):
        piece = client.recv(4096)
        assert piece, "hung up before the answer was whole"
        data += piece
    client.close()
    head, _, body = data.partition(b"\r\n\r\n")
    return int(head.split()[1]), json.loads(body)


@pytest.fixture
def dvl():
    server = DvlServer(port=free_port(), web_port=free_port(), epoch=EPOCH)
    with serving(server) as served:
        yield served, server


@pytest.fixture
def ugps():
    port = free_port()
    with serving(UgpsServer(port=port)) as served:
        connect(port).close()
        yield served, port


def test_extension_takes_it_for_a_dvl(dvl):
    """The extension connects to what has DVL in its product name, and reads its temperature every 30 s."""
    _, server = dvl
    status, about = exchange(server.web_port, b"GET /api/v1/about", BY_URLLIB)
    assert status == 200 and "DVL" in about["product_name"] and about["is_ready"] is True
    status, health = exchange(server.web_port, b"GET /api/v1/about/status", BY_URLLIB)
    assert status == 200 and 0.0 < float(health["temperature"]) < 45.0  # above, the extension warns


def test_pages_tell_what_the_dvl_is_now(dvl):
    """Configuration as it was set over TCP, who listens, and the clock of the reports."""
    served, server = dvl
    listener = connect(server.port)
    listener.sendall(b'{"command":"set_config","parameters":{"speed_of_sound":1500}}\r\n')
    listener.recv(4096)
    served.feed(2.5, [reading("pressure", 2.5, 1.0)])
    pages = {
        name: exchange(server.web_port, f"GET /api/v1/{name}".encode(), BY_URLLIB)[1] for name in ("config", "time")
    }
    assert pages["config"]["speed_of_sound"] == 1500.0
    assert pages["time"]["time"].startswith("2023-11-14T22:13:22.5") and pages["time"]["ntp_synchronized"] is False
    (output,) = exchange(server.web_port, b"GET /api/v1/outputs/", BY_URLLIB)[1]
    assert (output["port"], output["clients"]) == (server.port, 1)
    assert exchange(server.web_port, b"GET /api/v1/warnings/", BY_URLLIB) == (200, [])
    listener.close()


def test_what_is_not_there_is_refused_with_a_reason(dvl):
    _, server = dvl
    status, answer = exchange(server.web_port, b"GET /api/graph", BY_URLLIB)
    assert status == 404 and "/api/v1/about" in answer["error"]
    status, answer = exchange(server.web_port, b"PUT /api/v1/config", BY_REQUESTS, b'{"speed_of_sound": 1400}')
    assert status == 405 and "set_config" in answer["error"]
    assert exchange(server.web_port, b"GET /api/v1/config", BY_URLLIB)[1]["speed_of_sound"] == 1475.0


def test_port_that_is_taken_costs_the_pages_only():
    """A second twin on the machine still speaks; it says what is missing."""
    web = free_port()
    first, second = DvlServer(port=free_port(), web_port=web), DvlServer(port=free_port(), web_port=web)
    with serving(first, second) as served:
        connect(first.port).close()
        connect(second.port).close()
        assert exchange(web, b"GET /api/v1/about", BY_URLLIB)[0] == 200
        assert sum("no pages over HTTP" in text and str(web) in text for text in served.messages) == 1


ASKED = (
    (b"GET /api/v1/about/", b""),
    (b"GET /api/v1/config/generic", b""),
    (b"PUT /api/v1/external/depth", b'{"depth": 3.5, "temp": 8.12}'),
    (b"PUT /api/v1/external/orientation", b'{"orientation": 42.0}'),
    (b"GET /api/v1/position/acoustic/filtered", b""),
    (b"GET /api/v1/position/global", b""),
    (b"GET /api/v1/position/master", b""),
    (b"GET /api/v1/imu/calibrate", b""),
)


@pytest.mark.parametrize(("head", "body"), ASKED)
def test_extensions_of_the_underwater_gps_get_their_answers(ugps, head, body):
    served, port = ugps
    served.feed(1.0, [reading("position", 1.0, 5.0, 2.0)])
    assert exchange(port, head, BY_REQUESTS, body)[0] == 200


@pytest.mark.parametrize("path", [b"global", b"master"])
def test_satellites_are_counted_in_whole_numbers(ugps, path):
    """The extension prints them with Python's "02d" into an NMEA sentence, which a 12.0 makes fail."""
    served, port = ugps
    served.feed(1.0, [reading("position", 1.0, 5.0, 2.0)])
    found = {}

    def fixed() -> bool:
        """The server takes readings from a queue: a request may come first."""
        found.update(exchange(port, b"GET /api/v1/position/" + path, BY_REQUESTS)[1])
        return found["fix_quality"] > 0

    assert wait_for(fixed)
    assert f"{found['numsats']:02d}" == "12" and type(found["fix_quality"]) is int


def test_what_the_kit_does_not_do_says_why(ugps):
    _, port = ugps
    status, answer = exchange(port, b"POST /api/v1/imu/calibrate", BY_REQUESTS, b'{"action": "start"}')
    assert status == 405 and "POST" in answer["error"]
    status, answer = exchange(port, b"GET /api/v1/poi/", BY_REQUESTS)
    assert status == 404 and "/api/v1/position/global" in answer["error"]
