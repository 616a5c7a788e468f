"""Too many clients of an instrument: who makes no use of a place gives way to those that come.

Over HTTP that is who asks nothing; where a stream is sent, who does not take it.
"""

import asyncio
import socket
import time

import pytest
from tests.links.sensors import connect, free_port, is_closed, wait_until
from tests.links.serving import serving

from rovtwin.links.qualisys import wire
from rovtwin.links.qualisys.server import QtmServer
from rovtwin.links.servers import tcp_server as open_tcp_server
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.ugps_server import UgpsServer

SILENT = 40
ASKED = {  # of a server: what a client says, and how the answer begins
    DvlServer: (b'{"command":"get_config"}\n', b'{"'),
    UgpsServer: (b"GET /api/v1/about HTTP/1.1\r\nHost: here\r\n\r\n", b"HTTP/1.1 200"),
    QtmServer: (wire.text_packet(1, "QTMVersion"), None),
}
PAGES, STREAMS = [UgpsServer], [DvlServer, QtmServer]


@pytest.fixture(params=PAGES, ids=lambda server: server.__name__)
def served(request, monkeypatch):
    """A server with room for four, its port, and how to ask something there."""
    monkeypatch.setattr(open_tcp_server, "IDLE", 0.3)
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
    time.sleep(2 * open_tcp_server.IDLE)
    newcomers = [connect(port) for _ in range(3)]
    assert all(ask(client) for client in newcomers)
    assert sum(is_closed(client, 0.1) for client in silent) >= SILENT - 1
    for client in (*silent, *newcomers):
        client.close()


@pytest.mark.system
def test_who_says_something_stays_and_the_oldest_of_the_silent_goes(served):
    port, ask = served
    time.sleep(2 * open_tcp_server.IDLE)  # those that asked whether it is there have left, or are silent
    talker = connect(port)
    assert ask(talker)
    first = connect(port)
    time.sleep(0.05)
    others = [connect(port) for _ in range(2)]
    until = time.monotonic() + 2 * open_tcp_server.IDLE
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
    monkeypatch.setattr(open_tcp_server, "IDLE", 60.0)
    others = [connect(port) for _ in range(8)]
    assert sum(is_closed(other, 0.3) for other in others) >= 4
    for other in others:
        other.close()


@pytest.mark.system
@pytest.mark.parametrize("served", STREAMS, indirect=True, ids=lambda server: server.__name__)
def test_who_only_reads_a_stream_stays_however_silent(served):
    port, ask = served
    readers = [connect(port) for _ in range(8)]
    refused = {client for client in readers if is_closed(client, 0.3)}
    readers = [client for client in readers if client not in refused]
    assert 3 <= len(readers) <= 4
    time.sleep(2 * open_tcp_server.IDLE)
    newcomer = connect(port)
    assert is_closed(newcomer, 1.0)
    assert not any(is_closed(reader, 0.1) for reader in readers)
    for client in (newcomer, *readers):
        client.close()


def test_who_does_not_take_a_stream_gives_way_to_a_new_one(monkeypatch):
    monkeypatch.setattr(open_tcp_server, "IDLE", 0.3)

    async def sends(client):
        while client.stuck < 0.1 and not client.gone:
            client.send(bytes(1024))
            await asyncio.sleep(0.001)
        await client.reader.read()  # until it is dropped

    async def read(port):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        while await reader.read(1 << 16):
            pass
        writer.close()

    async def run():
        port, lines = free_port(), []
        async with open_tcp_server.open_tcp_server("it", "127.0.0.1", port, sends, lines.append, 100, most=3) as people:
            readers = [asyncio.create_task(read(port)) for _ in range(2)]
            with socket.socket() as deaf:
                deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                deaf.connect(("127.0.0.1", port))
                await _until(lambda: len(people.clients) == 3 and max(one.stuck for one in people.clients) > 0.4)
                newcomer = asyncio.create_task(read(port))
                await _until(lambda: any("gave way" in text for text in lines))
                await asyncio.sleep(0.1)
                assert not any(task.done() for task in (*readers, newcomer)) and people.refused == 0
                assert f"it: 127.0.0.1:{deaf.getsockname()[1]} gave way to another" in lines
            for task in (*readers, newcomer):
                task.cancel()

    asyncio.run(asyncio.wait_for(run(), 20.0))


async def _until(done):
    while not done():
        await asyncio.sleep(0.01)
