"""The served QTM against the vendor's unmodified client, and against clients that misbehave."""

import asyncio
import math
import struct
import threading
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.links.sensors import HOST, connect, free_port, is_closed, reading, wait_until
from tests.links.serving import serving

from rovtwin.core.arrays.rotations import rotation_from_euler, turn_about_z
from rovtwin.links.qualisys import wire
from rovtwin.links.qualisys.poses import Lab
from rovtwin.links.qualisys.server import QtmServer

qtm_rt = pytest.importorskip("qtm_rt", reason="pip install 'rovtwin[qualisys]'")
ETA = np.array([1.5, -2.0, 3.0, 0.1, -0.2, 2.5])


def pose(t, eta=ETA):
    return reading("mocap", t, *eta)


def with_client(port, what):
    """Run a coroutine with a client of the vendor's, in a loop of its own."""

    async def run():
        connect(port).close()
        connection = await qtm_rt.connect(HOST, port, timeout=5)
        assert connection is not None
        try:
            return await asyncio.wait_for(what(connection), 10)
        finally:
            connection.disconnect()

    return asyncio.run(run())


@pytest.fixture
def rig():
    port = free_port()
    with serving(QtmServer(port=port, body="rov", most_clients=4)) as served:
        yield served, port


class Feeding:
    """Poses at 100 Hz of simulated time, as fast as they go, until the block is left."""

    def __init__(self, served, eta=lambda t: ETA, pause=0.002):
        self.served, self.eta, self.pause = served, eta, pause
        self.t, self.done = 0.0, threading.Event()
        self.thread = threading.Thread(target=self.run)

    def run(self):
        while not self.done.wait(self.pause):
            self.served.feed(self.t, [pose(self.t, self.eta(self.t))])
            self.t += 0.01

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.done.set()
        self.thread.join()


async def stream(connection, count, frames="allframes", components=("6d",)):
    packets, enough = [], asyncio.Event()

    def take(packet):
        packets.append(packet)
        if len(packets) >= count:
            enough.set()

    assert await connection.stream_frames(frames, list(components), on_packet=take) == b"Ok"
    await enough.wait()
    await connection.stream_frames_stop()
    return packets[:count]


def test_commands(rig):
    served, port = rig
    served.feed(0.0, [pose(0.0)])

    async def talk(connection):
        version = await connection.qtm_version()
        order = await connection.byte_order()
        settings = await connection.get_parameters(["6d", "general"])
        state = await connection.get_state()
        return version, order, settings, state

    version, order, settings, state = with_client(port, talk)
    assert version.startswith(b"QTM Version is") and order == b"Byte order is little endian"
    assert wire.body_names(settings) == ["rov"] and b"<Frequency>100</Frequency>" in settings
    assert state == qtm_rt.QRTEvent.EventRTfromFileStarted


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda c: c.take_control("secret"), "Wrong or missing password"),
        (lambda c: c.start(), "must be master"),
        (lambda c: c.load("file"), "must be master"),
        (lambda c: c.send_xml("<QTM_Settings/>"), "must be master"),
        (lambda c: c.get_parameters(["image"]), "not available: the twin has general, 3d, 6d"),
        (lambda c: c._protocol.send_command("dance"), "Parse error"),
        (lambda c: c._protocol.send_command("streamframes often 6d"), "Parse error"),
        (lambda c: c._protocol.set_version("1.99"), "NOT supported"),
    ],
)
def test_refusals(rig, ask, message):
    """Errors as QTM's; the connection stays."""
    _, port = rig

    async def talk(connection):
        with pytest.raises(qtm_rt.QRTCommandException, match=message):
            await ask(connection)
        assert (await connection.qtm_version()).startswith(b"QTM")

    with_client(port, talk)


def test_six_degrees_of_freedom(rig):
    """Every component holds the pose that was fed, in the lab's frame."""
    served, port = rig
    with Feeding(served):
        components = ("6d", "6dres", "6deuler", "6deulerres")
        (packet,) = with_client(port, lambda c: stream(c, 1, components=components))
    assert abs(packet.timestamp / 1e4 - round(packet.timestamp / 1e4)) < 1e-9 and packet.framenumber > 0
    R_ned = rotation_from_euler(ETA[3:])
    flip = np.diag([1.0, -1.0, -1.0])
    R_lab = flip @ R_ned @ flip
    for get in (packet.get_6d, packet.get_6d_residual):
        header, bodies = get()
        assert header.body_count == 1 and len(bodies) == 1
        np.testing.assert_allclose(bodies[0][0], [1500.0, 2000.0, -3000.0], rtol=1e-6)
        matrix = np.array(bodies[0][1].matrix).reshape(3, 3).T
        np.testing.assert_allclose(matrix, R_lab, atol=1e-6)
    assert packet.get_6d_residual()[1][0][2].residual == 0.0
    for get in (packet.get_6d_euler, packet.get_6d_euler_residual):
        _, bodies = get()
        np.testing.assert_allclose(bodies[0][0], [1500.0, 2000.0, -3000.0], rtol=1e-6)
        np.testing.assert_allclose(np.radians(bodies[0][1]), wire.qualisys_euler(R_lab), atol=1e-6)


def test_markers(rig):
    """Markers of the body where its settings say that they are on it, with and without labels."""
    served, port = rig

    async def look(connection):
        settings = ElementTree.fromstring(await connection.get_parameters(["3d", "6d"]))
        return settings, await stream(connection, 1, components=("3d", "3dres", "3dnolabels", "3dnolabelsres", "6d"))

    with Feeding(served):
        settings, (packet,) = with_client(port, look)
    assert [label.text for label in settings.findall("*/Label/Name")] == ["rov-1", "rov-2", "rov-3", "rov-4"]
    assert [enabled.text for enabled in settings.findall("*/Body/Enabled")] == ["true"]
    points = np.array([[float(p.get(axis)) for axis in "XYZ"] for p in settings.findall("*/Body/Points/Point")])
    position, matrix = packet.get_6d()[1][0]
    expected = np.array(position) + points @ np.array(matrix.matrix).reshape(3, 3)
    for get in (packet.get_3d_markers, packet.get_3d_markers_residual, packet.get_3d_markers_no_label_residual):
        header, markers = get()
        assert header.marker_count == 4
        np.testing.assert_allclose([marker[:3] for marker in markers], expected, atol=1e-3)
    assert [marker.id for marker in packet.get_3d_markers_no_label()[1]] == [1, 2, 3, 4]


def test_cameras_there_are_none(rig):
    """2D is of cameras: a component without any, as the vendor's advanced example reads it."""
    served, port = rig
    with Feeding(served):
        (packet,) = with_client(port, lambda c: stream(c, 1, components=("2d",)))
    header, cameras = packet.get_2d_markers()
    assert header.camera_count == 0 and cameras == []


def test_markers_of_a_lost_body(rig):
    served, port = rig

    async def look(connection):
        served.feed(0.0, [pose(0.0)])
        coming = asyncio.ensure_future(connection.get_current_frame(["3d", "3dnolabels"]))
        await asyncio.sleep(0.1)
        for k in range(1, 4):
            served.feed(0.2 * k, [reading("pressure", 0.2 * k, 1.0)])
        return await coming

    packet = with_client(port, look)
    assert np.isnan(packet.get_3d_markers()[1]).all() and packet.get_3d_markers_no_label()[0].marker_count == 0


def test_measurement_under_control(rig):
    """What the vendor's control example asks for, with the events that it waits for."""
    served, port = rig
    event = qtm_rt.QRTEvent

    async def drive(connection):
        async with qtm_rt.TakeControl(connection, "password"):
            assert await connection.get_state() == event.EventRTfromFileStarted
            await connection.new()
            await connection.await_event(event.EventConnected, timeout=5)
            await connection.start()
            await connection.await_event(event.EventCaptureStarted, timeout=5)
            assert len(await stream(connection, 2)) == 2
            await connection.stop()
            await connection.await_event(event.EventCaptureStopped, timeout=5)
            with pytest.raises(qtm_rt.QRTCommandException, match="writes no QTM files"):
                await connection.save("Demo.qtm")
            with pytest.raises(qtm_rt.QRTCommandException, match="cameras are calibrated"):
                await connection.calibrate()
            with pytest.raises(qtm_rt.QRTCommandException, match="Failed to start"):
                await connection.start()
            with pytest.raises(qtm_rt.QRTCommandException, match="twin's are fixed"):
                await connection.send_xml("<QTM_Settings/>")
        with pytest.raises(qtm_rt.QRTCommandException, match="must be master"):
            await connection.new()

    with Feeding(served):
        with_client(port, drive)


@pytest.mark.parametrize("leaves", [lambda c: c.disconnect(), lambda c: c.release_control()])
def test_one_client_in_control_and_frames_when_it_leaves(rig, leaves):
    """Another is informed who rules; a measurement that was closed goes on when the one who closed it rules no more."""
    served, port = rig

    async def watch(other):
        with_control = await qtm_rt.connect(HOST, port, timeout=5)
        await with_control.take_control("password")
        with pytest.raises(qtm_rt.QRTCommandException, match="current master is 127.0.0.1"):
            await other.take_control("password")
        await with_control.close()
        assert await other.get_state() == qtm_rt.QRTEvent.EventConnectionClosed
        frames = []
        assert await other.stream_frames("allframes", ["6d"], on_packet=frames.append) == b"Ok"
        await asyncio.sleep(0.1)
        assert not frames, "frames of a measurement that is closed"
        leaving = leaves(with_control)
        if leaving is not None:
            await leaving
        while not frames:
            await asyncio.sleep(0.01)

    with Feeding(served):
        with_client(port, watch)
    assert [text for text in served.messages if "no frames" in text] and [
        t for t in served.messages if "frames again" in t
    ]


def test_control_can_be_disabled():
    port = free_port()
    with serving(QtmServer(port=port, password=None)):

        async def ask(connection):
            with pytest.raises(qtm_rt.QRTCommandException, match="Client control disabled"):
                await connection.take_control("password")

        with_client(port, ask)


def test_lab_that_is_turned():
    """The lab's x to the east and its origin elsewhere."""
    port = free_port()
    lab = Lab(R_nq=turn_about_z(math.pi / 2) @ np.diag([1.0, -1.0, -1.0]), origin=(1.0, 1.0, 0.0))
    with serving(QtmServer(port=port, lab=lab)) as served, Feeding(served):
        (packet,) = with_client(port, lambda c: stream(c, 1))
    (position, _) = packet.get_6d()[1][0]
    np.testing.assert_allclose(position, [-3000.0, 500.0, -3000.0], rtol=1e-6)


@pytest.mark.parametrize(("frames", "step"), [("allframes", 1), ("frequencydivisor:5", 5), ("frequency:20", 5)])
def test_rates(rig, frames, step):
    served, port = rig
    with Feeding(served):
        packets = with_client(port, lambda c: stream(c, 12, frames))
    assert set(np.diff([packet.framenumber for packet in packets])) == {step}
    assert set(np.diff([packet.timestamp for packet in packets])) == {10_000 * step}


def test_current_frame(rig):
    served, port = rig
    with Feeding(served):
        wait_until(lambda: served.station.now > 0.0)
        packet = with_client(port, lambda c: c.get_current_frame(["6deuler"]))
    assert packet.get_6d_euler()[0].body_count == 1


def test_lost_body_is_not_a_number(rig):
    """The vehicle goes on, its pose does not: frames go on with NaN, and the pose comes back."""
    served, port = rig

    async def watch(connection):
        packets = []
        starting = asyncio.ensure_future(connection.stream_frames("allframes", ["6dres"], on_packet=packets.append))
        await asyncio.sleep(0.1)
        steps = [[pose(0.0)], *[[reading("pressure", 0.1 * k, 1.0)] for k in range(1, 11)], [pose(1.1)]]
        for k, batch in enumerate(steps):
            served.feed(0.1 * k, batch)
            await asyncio.sleep(0.01)
        assert await starting == b"Ok"
        while packets[-1].timestamp != 1_100_000:
            await asyncio.sleep(0.01)
        return packets

    packets = with_client(port, watch)
    x = np.array([packet.get_6d_residual()[1][0][0].x for packet in packets])
    assert x[0] == x[-1] == 1500.0 and np.isnan(x[1:-1]).all() and 6 <= x.size - 2 <= 9
    lost = packets[1].get_6d_residual()[1][0]
    assert np.isnan([*lost[0], *lost[1].matrix, lost[2].residual]).all()


def test_nothing_to_see_yet(rig):
    """Without a pose there is no measurement: QTM says so, and streams when there is."""
    served, port = rig

    async def watch(connection):
        packets = []
        assert await connection.stream_frames("allframes", ["6d"], on_packet=packets.append) == b"Ok"
        served.feed(0.0, [pose(0.0)])
        while not packets:
            await asyncio.sleep(0.01)
        return packets[0]

    assert with_client(port, watch).framenumber == 1


@pytest.mark.parametrize(
    "junk", [b"\0" * 8, struct.pack("<II", 2**32 - 1, 1), b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 5000]
)
def test_garbage_ends_only_its_connection(rig, junk):
    served, port = rig
    raw = connect(port)
    raw.sendall(junk)
    assert is_closed(raw)
    with Feeding(served):
        assert len(with_client(port, lambda c: stream(c, 2))) == 2


def test_half_a_packet_waits_for_nobody(rig):
    served, port = rig
    raw = connect(port)
    raw.sendall(struct.pack("<II", 20, 1) + b"vers")
    with Feeding(served):
        assert len(with_client(port, lambda c: stream(c, 2))) == 2
    raw.close()


def test_packets_that_are_no_commands_are_answered(rig):
    _, port = rig
    raw = connect(port)
    for kind in (0, 3, 9, 77):
        raw.sendall(wire.packet(kind, b"abc"))
    raw.sendall(wire.packet(1, b"") + wire.packet(1, b"\xff\xfe\0") + wire.text_packet(1, "qtmversion"))
    data = b""
    while b"QTM Version" not in data:
        data += raw.recv(4096)
    packets, _ = wire.split_packets(data)
    assert [wire.parse_header(p[:8], 4096)[1] for p in packets] == [1, 0, 0, 0, 0, 0, 0, 1]
    raw.close()


def test_slow_client_is_dropped_and_holds_up_nobody(rig):
    served, port = rig
    slow = connect(port, receive_buffer=4096)
    slow.sendall(wire.text_packet(1, "streamframes allframes 6d 6dres 6deuler 6deulerres"))
    for k in range(6000):
        served.feed(0.01 * k, [pose(0.01 * k)])
        if any("did not read" in text for text in served.messages):
            break
    assert any("did not read" in text for text in served.messages), "the slow client was not dropped"
    with Feeding(served):
        assert len(with_client(port, lambda c: stream(c, 2))) == 2
    slow.close()


def test_one_too_many_is_turned_away(rig):
    served, port = rig
    others = [connect(port) for _ in range(4)]
    wait_until(lambda: sum("connected" in text for text in served.messages) == 4)
    assert is_closed(connect(port))
    for other in others:
        other.close()
