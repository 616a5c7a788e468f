"""External physics for ArduSub: the wire, the motors, and lock-step under a synthetic firmware.

No firmware can be had here: `Firmware` writes the packets and reads the answers as the documented format and the
parser of ArduPilot's SIM_JSON.cpp do. Each test is a synthetic exchange, not a recorded one.
"""

import json
import re
import socket
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rovtwin.core.errors import LinkError
from rovtwin.links.ardusub_json import lockstep
from rovtwin.links.ardusub_json.lockstep import Lockstep
from rovtwin.links.ardusub_json.motors import BLUEROV2_HEAVY, command
from rovtwin.links.ardusub_json.wire import Servos, State, decode_servos, encode_servos, encode_state

NEUTRAL = (1500,) * 8 + (0,) * 8
RATE = 1200


def state(t: float, depth: float = 0.0) -> State:
    return State(
        t,
        np.zeros(3),
        np.array([0.0, 0.0, -9.81]),
        np.array([0.0, 0.0, depth]),
        np.zeros(3),
        np.array([1.0, 0.0, 0.0, 0.0]),
    )


class Physics:
    """A body that sinks by the sum of its vertical outputs, and remembers what it was sent."""

    def __init__(self):
        self.t, self.depth, self.seen, self.resets = 0.0, 0.0, [], 0

    def advance(self, pwm, dt):
        self.seen.append((pwm, dt))
        self.t += dt
        self.depth += dt * sum(command(p) for p in pwm[4:8])
        return state(self.t, self.depth)

    def reset(self):
        self.resets += 1
        self.t = self.depth = 0.0


class Firmware:
    """The firmware's side of the wire."""

    def __init__(self, port):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(1.0)

    def send(self, count, pwm=NEUTRAL, rate=RATE):
        self.socket.send(encode_servos(Servos(rate, count, pwm)))

    def exchange(self, count, pwm=NEUTRAL, rate=RATE):
        self.send(count, pwm, rate)
        return self.answer()

    def answer(self):
        return parsed(self.socket.recv(4096))

    def quiet(self):
        self.socket.settimeout(0.15)
        try:
            self.socket.recv(4096)
            return False
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(1.0)


def parsed(data: bytes) -> dict:
    """What SIM_JSON.cpp makes of an answer: the last line between newlines, a value after each key.

    Its parser looks for the bare key, skips `":`, and reads a list as `[%f, %f, %f]` or a number as atof does.
    """
    assert data.startswith(b"\n") and data.endswith(b"\n")
    text = data.decode().split("\n")[-2]
    found = {}
    for section, key in [("", "timestamp"), ("imu", "gyro"), ("imu", "accel_body"), *[("", k) for k in KEYS]]:
        at = text.index(section) + len(section) + 1 if section else 0
        value = text[text.index(key, at) + len(key) + 2 :]
        numbers = re.match(r"\[?(-?[\d.e+-]+(?:,\s*-?[\d.e+-]+)*)\]?", value)
        assert numbers, f"{key}: {value[:40]!r} is nothing that scanf reads"
        found[key] = [float(number) for number in numbers.group(1).split(",")]
    assert json.loads(text)
    return found


KEYS = ("position", "velocity", "quaternion")


@pytest.fixture
def running():
    physics = Physics()
    server = Lockstep(physics.advance, physics.reset, port=0)
    thread = threading.Thread(target=server.run)
    thread.start()
    yield server, physics, Firmware(server.port)
    start = time.monotonic()
    server.stop()
    assert time.monotonic() - start < 0.05, "stop returns at once"
    thread.join(1.0)
    assert not thread.is_alive()
    server.close()
    server.close()


def test_exchange_by_the_documented_format(running):
    """Bytes as they are on the wire, written out: 40 of them in, a line of JSON back."""
    server, physics, firmware = running
    packet = bytes.fromhex("1a48" + "b004" + "00000000" + "dc05" * 4 + "6c07" * 4 + "0000" * 8)
    assert len(packet) == 40
    firmware.socket.send(packet)
    data = firmware.socket.recv(4096)
    assert physics.seen == [((1500,) * 4 + (1900,) * 4 + (0,) * 8, 1 / 1200)]
    assert re.fullmatch(
        rb'\n\{"timestamp":[\d.e-]+,"imu":\{"gyro":\[0\.0,0\.0,0\.0\],"accel_body":\[0\.0,0\.0,-9\.81\]\},'
        rb'"position":\[0\.0,0\.0,[\d.]+\],"velocity":\[0\.0,0\.0,0\.0\],"quaternion":\[1\.0,0\.0,0\.0,0\.0\]\}\n',
        data,
    )
    got = parsed(data)
    assert got["timestamp"] == [1 / 1200] and got["position"][2] == pytest.approx(4 / 1200)


def test_lockstep_counts_time_by_frames(running):
    server, physics, firmware = running
    for count in range(600):
        got = firmware.exchange(count)
    assert got["timestamp"][0] == pytest.approx(0.5) and server.counts.steps == 600
    assert server.counts.lost == server.counts.repeats == server.counts.resets == 0


def test_32_channels(running):
    _, physics, firmware = running
    firmware.exchange(0, (1600,) * 32)
    assert len(physics.seen[0][0]) == 32


def test_repeated_packet_gets_the_same_answer(running):
    server, physics, firmware = running
    first = firmware.exchange(0)
    assert firmware.exchange(0, (1900,) * 16) == first and len(physics.seen) == 1
    assert firmware.exchange(1)["timestamp"][0] > first["timestamp"][0] and server.counts.repeats == 1


def test_late_packet_is_dropped(running):
    server, physics, firmware = running
    for count in range(5):
        firmware.exchange(count)
    firmware.send(3)
    assert firmware.quiet() and server.counts.late == 1 and physics.resets == 0


def test_gap_is_one_step(running):
    server, physics, firmware = running
    firmware.exchange(0)
    assert firmware.exchange(10)["timestamp"][0] == pytest.approx(2 / RATE) and server.counts.lost == 9


@pytest.mark.parametrize("back_to", [0, 3])
def test_counter_that_jumps_back_is_a_reset(running, back_to):
    server, physics, firmware = running
    for count in range(20):
        firmware.exchange(count)
    assert firmware.exchange(back_to)["timestamp"][0] == pytest.approx(1 / RATE)
    assert physics.resets == 1 and server.counts.resets == 1


def test_a_firmware_that_flew_before_gets_no_answer_until_it_is_started_anew():
    """As after kill -9 of these physics, which would go on from their own beginning under an armed firmware."""
    physics, text = Physics(), []
    server = Lockstep(physics.advance, physics.reset, port=0, say=text.append)
    firmware = Firmware(server.port)
    try:
        for _ in range(3):
            firmware.send(83_211, (1900,) * 16)
            assert not server.serve_one()
        assert firmware.quiet() and physics.seen == [] and server.counts.under_way == 3
        assert len(text) == 1 and "at its frame 83211, expected 0" in text[0] and "start it anew" in text[0]
        firmware.send(0)
        assert server.serve_one() and firmware.answer()["timestamp"][0] == pytest.approx(1 / RATE)
    finally:
        server.close()


def test_stranger_does_not_steer(running, monkeypatch):
    server, physics, firmware = running
    firmware.exchange(0)
    stranger = Firmware(server.port)
    stranger.send(1, (1900,) * 16)
    assert stranger.quiet() and len(physics.seen) == 1 and server.counts.strangers == 1
    monkeypatch.setattr(lockstep, "CHANGE", 0.0)  # the firmware was silent for long
    assert stranger.exchange(1)["timestamp"][0] == pytest.approx(1 / RATE) and physics.resets == 1


def test_garbage_is_counted(running):
    server, physics, firmware = running
    for data in (b"", b"\x1a", b"hello", encode_servos(Servos(RATE, 0, NEUTRAL))[:-1], bytes(2000)):
        firmware.socket.send(data)
    firmware.send(0, rate=0)
    firmware.send(0, rate=1)
    assert firmware.exchange(0)["timestamp"][0] == pytest.approx(1 / RATE) and server.counts.garbage == 7


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_physics_that_went_wrong_are_not_sent(bad):
    with pytest.raises(LinkError, match="position"):
        encode_state(state(1.0, depth=bad))
    server = Lockstep(lambda pwm, dt: state(1.0, depth=bad), port=0)
    Firmware(server.port).send(0)
    with pytest.raises(LinkError, match="position"):
        server.run()
    server.close()


def test_taken_port():
    first = Lockstep(Physics().advance, port=0)
    with pytest.raises(LinkError, match="cannot be bound"):
        Lockstep(Physics().advance, port=first.port)
    first.close()


def test_pulses():
    assert [command(p) for p in (1100, 1300, 1500, 1900)] == [-1.0, -0.5, 0.0, 1.0]
    assert [command(p) for p in (0, 1, 1099, 1901, 65535)] == [0.0] * 5


def test_motors_by_name():
    """Output 1 of ArduSub pushes the front starboard corner back: our thruster of that name turns astern."""
    names = ["vertical_rear_port", "front_starboard"]
    np.testing.assert_array_equal(BLUEROV2_HEAVY.commands((1900, *[1500] * 6, 1300), names), [0.5, -1.0])
    with pytest.raises(LinkError, match="no motor"):
        BLUEROV2_HEAVY.commands(NEUTRAL, ["bow"])
    with pytest.raises(LinkError, match="outputs"):
        BLUEROV2_HEAVY.commands((1500,) * 6, names)


def check_decoding(data: bytes) -> None:
    """Whatever comes, it is a packet of 16 or 32 pulses or a LinkError."""
    try:
        servos = decode_servos(data)
    except LinkError:
        return
    assert len(servos.pwm) in (16, 32) and encode_servos(servos) == data
    assert all(-1.0 <= command(pulse) <= 1.0 for pulse in servos.pwm)


def packets() -> st.SearchStrategy[bytes]:
    heads = st.sampled_from([b"\x1a\x48", b"\x81\x73", b""])
    sizes = st.sampled_from([38, 39, 70, 71, 0, 5])
    return st.one_of(
        st.binary(max_size=100),
        st.builds(lambda head, body: head + body, heads, sizes.flatmap(lambda n: st.binary(min_size=n, max_size=n))),
    )


@pytest.mark.parametrize("examples", [300, pytest.param(100_000, marks=pytest.mark.slow)])
def test_any_bytes(examples):
    settings(max_examples=examples, deadline=None, database=None)(given(packets())(check_decoding))()
