"""What all servers of instruments share: they travel to another process, bind loopback, and live in one loop."""

import pickle
import socket
import time

import numpy as np
import pytest
from tests.links.sensors import HOST, connect, free_port, is_closed, reading
from tests.links.serving import serving

from rovtwin.core.errors import ConfigError
from rovtwin.links.qualisys.poses import Lab
from rovtwin.links.qualisys.server import QtmServer
from rovtwin.links.servers.server import require_loopback
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.ugps_server import UgpsServer

KINDS = [DvlServer, UgpsServer, QtmServer]


@pytest.mark.parametrize("kind", KINDS)
def test_servers_travel(kind):
    server = kind(port=1234)
    assert pickle.loads(pickle.dumps(server)) == server
    turned = QtmServer(lab=Lab(origin=(1.0, 2.0, 3.0)))
    assert pickle.loads(pickle.dumps(turned)) == turned


@pytest.mark.parametrize("kind", KINDS)
def test_loopback_by_default(kind):
    assert require_loopback([kind()], exposed=False) == []
    with pytest.raises(ConfigError, match="--expose"):
        require_loopback([kind(host="0.0.0.0")], exposed=False)


def test_one_loop_is_never_blocked():
    """All three in one loop, with clients and garbage at ten times the usual rate: nothing waits long for it."""
    servers = [kind(port=free_port()) for kind in KINDS]
    late = []
    with serving(*servers) as served:
        clients = [connect(server.port) for server in servers for _ in range(4)]
        for client in clients[8:]:
            client.sendall(b"\x36\0\0\0\1\0\0\0streamframes allframes 6d 6dres 6deuler 6deulerres\0")
        for k in range(200):
            t = 0.005 * k
            batch = [
                reading("dvl", t, 0.5, 0.0, 0.0),
                reading("mocap", t, *np.ones(6)),
                reading("position", t, 1.0, 2.0),
            ]
            start = time.monotonic()
            served.feed(t, [*batch, reading("attitude", t, 0.0, 0.0, 0.1)])
            late.append(time.monotonic() - start)
            clients[k % 4].sendall(b"{nonsense}\n" * 10)
            with connect(servers[1].port) as request:
                request.sendall(b"GET /api/v1/position/global HTTP/1.0\r\n\r\n")
                assert request.recv(100).startswith(b"HTTP/1.1 200")
        for client in clients:
            client.close()
    assert np.median(late) < 0.02 and np.percentile(late, 90) < 0.2  # busy machines have longer tails


@pytest.mark.parametrize("kind", KINDS)
def test_end_of_a_server_frees_its_port(kind):
    port = free_port()
    with serving(kind(port=port)):
        client = connect(port)
    assert is_closed(client)
    with socket.socket() as again:
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        again.bind((HOST, port))
