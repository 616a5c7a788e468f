"""Packets of QTM's protocol and the lab's frame: what they say, and that the network's nonsense is refused, no more."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rovtwin.core.arrays.rotations import rotation_from_euler, turn_about_z
from rovtwin.core.errors import ConfigError, LinkError
from rovtwin.links.qualisys import wire
from rovtwin.links.qualisys.poses import Lab

ANGLE = st.floats(-3.1, 3.1)
ETA = st.tuples(*[st.floats(-50.0, 50.0)] * 3, ANGLE, st.floats(-1.5, 1.5), ANGLE)


def axis_rotation(axis: int, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.eye(3)
    R[i, i], R[j, j], R[i, j], R[j, i] = c, c, -s, s
    return R


def test_lab_of_the_default():
    """North is x, east is -y, down is -z; level and north is no rotation; clockwise from above is a negative yaw."""
    place, R = Lab().to_lab(np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(place, [1.0, -2.0, -3.0])
    np.testing.assert_allclose(R, np.eye(3))
    _, R = Lab().to_lab(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.3]))
    np.testing.assert_allclose(R, axis_rotation(2, -0.3), atol=1e-15)
    _, R = Lab().to_lab(np.array([0.0, 0.0, 0.0, 0.2, 0.0, 0.0]))
    np.testing.assert_allclose(R, axis_rotation(0, 0.2), atol=1e-15)


@given(ETA, ANGLE)
def test_lab_and_back(eta, yaw):
    lab = Lab(turn_about_z(yaw) @ np.diag([1.0, -1.0, -1.0]), (1.0, -2.0, 0.5), turn_about_z(0.7), (0.1, 0.0, -0.2))
    back = lab.to_eta(*lab.to_lab(np.array(eta)))
    np.testing.assert_allclose(back[:3], eta[:3], atol=1e-9)
    np.testing.assert_allclose(rotation_from_euler(back[3:]), rotation_from_euler(np.array(eta[3:])), atol=1e-9)


def test_origin_and_lever():
    lab = Lab(origin=(10.0, 20.0, 0.0), lever=(0.5, 0.0, 0.0))
    place, _ = lab.to_lab(np.array([11.0, 20.0, 2.0, 0.0, 0.0, math.pi / 2]))
    np.testing.assert_allclose(place, [1.0, -0.5, -2.0], atol=1e-12)


@pytest.mark.parametrize("R", [np.eye(2), np.eye(3) * 2, np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan)])
def test_what_is_no_rotation_is_refused(R):
    with pytest.raises(ConfigError, match="R_nq: expected a rotation matrix"):
        Lab(R_nq=R)


@given(ANGLE, st.floats(-1.5, 1.5), ANGLE)
def test_euler_angles_are_qualisys_standard(roll, pitch, yaw):
    """About x, then the new y, then the new z."""
    R = axis_rotation(0, roll) @ axis_rotation(1, pitch) @ axis_rotation(2, yaw)
    np.testing.assert_allclose(wire.qualisys_euler(R), [roll, pitch, yaw], atol=1e-9)


def test_data_packet_byte_by_byte():
    R = np.arange(9.0).reshape(3, 3)
    data = wire.data_packet(1.5, 7, ("6dres",), np.array([1.0, 2.0, 3.0]), R)
    assert struct.unpack_from("<II", data) == (len(data), 3)
    assert struct.unpack_from("<qII", data, 8) == (1_500_000, 7, 1)
    assert struct.unpack_from("<II", data, 24) == (len(data) - 24, 11)
    assert struct.unpack_from("<ihh", data, 32) == (1, 0, 0)
    body = struct.unpack_from("<13f", data, 40)
    assert body == (1000.0, 2000.0, 3000.0, *(0.0, 3.0, 6.0, 1.0, 4.0, 7.0, 2.0, 5.0, 8.0), 0.0)
    assert len(data) == 40 + 13 * 4


def test_names_of_bodies():
    xml = wire.parameters_xml("1.25", ["rov <1>", "wand"], ["6d"], 100.0).encode()
    assert wire.body_names(xml + b"\0") == ["rov <1>", "wand"]
    assert wire.body_names(wire.parameters_xml("1.25", ["rov"], ["general"], 100.0).encode()) == []


@pytest.mark.parametrize("xml", [b"", b"<a>", b"\xff", b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', b"<a/>" * 400_000])
def test_settings_that_are_none_are_refused(xml):
    with pytest.raises(LinkError):
        wire.body_names(xml)


def test_streams():
    assert wire.parse_stream(["AllFrames", "6D", "6DEulerRes", "6d"]) == wire.Stream(("6d", "6deulerres"))
    assert wire.parse_stream(["frequency:20", "3D", "Image", "6d"]) == wire.Stream(("3d", "6d"), rate=20)
    assert wire.parse_stream(["FrequencyDivisor:4", "all"]) == wire.Stream(tuple(wire.COMPONENTS), every=4)
    assert wire.parse_stream(["Stop"]) is None


@pytest.mark.parametrize(
    "words",
    [
        *([], ["allframes"], ["allframes", "7d"], ["frequency:0", "6d"], ["frequency:x", "6d"], ["frequency", "6d"]),
        *(["frequency:99999", "6d"], ["frequencydivisor:-1", "6d"], ["sometimes", "6d"], ["allframes", "udp:99", "6d"]),
    ],
)
def test_streams_that_are_none_are_refused(words):
    with pytest.raises(LinkError):
        wire.parse_stream(words)


@pytest.mark.parametrize("size", [0, 7, wire.LONGEST_PACKET + 1, 2**32 - 1])
def test_sizes_that_are_none_are_refused(size):
    with pytest.raises(LinkError, match=f"packet of {size} bytes"):
        wire.split_packets(struct.pack("<II", size, 3))


@given(st.lists(st.binary(max_size=30), max_size=5), st.integers(0, 60))
def test_packets_are_split_wherever_they_are_cut(bodies, cut):
    whole = [wire.packet(wire.XML, body) for body in bodies]
    data = b"".join(whole)
    first, rest = wire.split_packets(data[:cut])
    second, rest = wire.split_packets(rest + data[cut:])
    assert first + second == whole and rest == b""


_xml = wire.parameters_xml("1.25", ["rov", "wand"], ["all"], 100.0).encode()
_SEEDS = [
    *(_xml, b"streamframes frequency:20 6d 6dres\0", b"getparameters 6d\0", b"version 1.25"),
    wire.data_packet(1.0, 1, tuple(wire.COMPONENTS), np.ones(3), np.eye(3)),
]


@st.composite
def _bytes(draw):
    if draw(st.booleans()):
        return draw(st.binary(max_size=200))
    data = bytearray(draw(st.sampled_from(_SEEDS)))
    for at, byte in draw(st.lists(st.tuples(st.integers(0, len(data) - 1), st.integers(0, 255)), max_size=4)):
        data[at] = byte
    return bytes(data[: draw(st.integers(0, len(data)))])


def _only_link_errors(data: bytes) -> None:
    parsers = [wire.body_names, lambda d: wire.split_packets(d, wire.LONGEST_COMMAND), wire.command_words]
    parsers.append(lambda d: wire.parse_stream(wire.command_words(d)[1:]))
    parsers.append(lambda d: wire.parse_components(wire.command_words(d)[1:]))
    for parse in parsers:
        try:
            parse(data)
        except LinkError as error:
            assert len(str(error)) < 400


@settings(max_examples=400)
@given(_bytes())
def test_fuzz(data):
    _only_link_errors(data)


@pytest.mark.slow
@settings(max_examples=100_000)
@given(_bytes())
def test_fuzz_long(data):
    _only_link_errors(data)
