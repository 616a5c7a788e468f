"""Too many clients of an instrument: those that say nothing give way to those that come."""

import time

import pytest
from tests.links.sensors import connect, free_port, is_closed, wait_until
from tests.links.serving import serving

from rovtwin.links import crowd
from rovtwin.links.qualisys import wire
from rovtwin.links.qualisys.server import QtmServer
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.ugps_server import UgpsServer

SILENT = 40
ASKED = {  # of a server: what a client says, and how the answer begins
    DvlServer: (b'{"command":"get_config"}\n', b'{"'),
    UgpsServer: (b"GET /api/v1/about HTTP/1.1\r\nHost: here\r\n\r\n", b"HTTP/1.1 200"),
    QtmServer: (wire.text_packet(1, "QTMVersion"), None),
}


@pytest.fixture(params=ASKED, ids=lambda server: server.__name__)
def served(request, monkeypatch):
    """A server with room for four, its port, and how to ask something there."""
    monkeypatch.setattr(crowd, "IDLE", 0.3)
    port = free_port()
    question, answer = ASKED[request.param]

    def ask(client):
        try:
            client.sendall(question)
            return client.recv(1000).startswith(answer or b"")
        except OSError:
            return False

    with serving(request.param(port=port, most_clients=4)):
        wait_until(lambda: ask(connect(port)))
        yield port, ask


def test_forty_silent_connections_keep_nobody_out(served):
    port, ask = served
    silent = [connect(port) for _ in range(SILENT)]
    time.sleep(2 * crowd.IDLE)
    newcomers = [connect(port) for _ in range(3)]
    assert all(ask(client) for client in newcomers)
    assert sum(is_closed(client, 0.1) for client in silent) >= SILENT - 1
    for client in (*silent, *newcomers):
        client.close()


def test_who_says_something_stays_and_the_oldest_of_the_silent_goes(served):
    port, ask = served
    time.sleep(2 * crowd.IDLE)  # those that asked whether it is there have left, or are silent
    talker = connect(port)
    assert ask(talker)
    first = connect(port)
    time.sleep(0.05)
    others = [connect(port) for _ in range(2)]
    until = time.monotonic() + 2 * crowd.IDLE
    while time.monotonic() < until:
        assert ask(talker)
        time.sleep(0.05)
    newcomer = connect(port)
    assert ask(newcomer) and ask(talker)
    assert is_closed(first, 1.0) and not any(is_closed(other, 0.1) for other in others)
    for client in (talker, first, newcomer, *others):
        client.close()


def test_where_nobody_is_silent_the_new_one_is_turned_away(served, monkeypatch):
    port, ask = served
    monkeypatch.setattr(crowd, "IDLE", 60.0)
    others = [connect(port) for _ in range(8)]
    assert sum(is_closed(other, 0.3) for other in others) >= 4
    for other in others:
        other.close()
