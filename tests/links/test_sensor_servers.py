"""What all servers of instruments share: they travel to another process, bind loopback, and live in one loop."""

import pickle
import socket
import time

import numpy as np
import pytest
from tests.links.sensors import HOST, connect, free_port, is_closed, reading
from tests.links.serving import serving

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.links.endpoint import ServeContext, Where
from rovtwin.links.qualisys.poses import Lab
from rovtwin.links.qualisys.server import QtmServer
from rovtwin.links.registry import built_in
from rovtwin.links.servers.server import require_loopback
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.ugps_server import UgpsServer
from rovtwin.vehicle import load_vehicle

KINDS = [DvlServer, UgpsServer, QtmServer]
# Every instrument of the registry that is served: a new one is tested without a line here.
SERVED = [one for one in built_in() if one.source is not None and one.server is not None]


@pytest.fixture(params=SERVED, ids=lambda one: one.scheme)
def served_at(request):
    """Makes an instrument's server as `rovtwin serve` does, from hosts and a port."""
    vehicle = load_vehicle("bluerov2")
    context = ServeContext(vehicle, ("",), {"": np.ones(6)}, (1.0,) * 6, 1025.0, Datum(), None, 20.0)
    return lambda *hosts, port=None: request.param.server(context, Where(list(hosts), port))


def test_servers_travel(served_at):
    server = served_at(port=1234)
    assert pickle.loads(pickle.dumps(server)) == server
    assert server.port == 1234


def test_the_lab_of_a_server_travels():
    turned = QtmServer(lab=Lab(origin=(1.0, 2.0, 3.0)))
    assert pickle.loads(pickle.dumps(turned)) == turned


def test_loopback_by_default(served_at):
    assert require_loopback([served_at()], exposed=False) == []
    with pytest.raises(ConfigError, match="--expose"):
        require_loopback([served_at("0.0.0.0")], exposed=False)


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


def test_end_of_a_server_frees_its_port(served_at):
    port = free_port()
    with serving(served_at(port=port)):
        client = connect(port)
    assert is_closed(client)
    with socket.socket() as again:
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        again.bind((HOST, port))
