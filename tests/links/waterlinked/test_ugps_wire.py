"""Messages of the Underwater GPS, and HTTP: what they say, and that the network's nonsense is refused, no more."""

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rovtwin.core.errors import LinkError
from rovtwin.links import http_wire
from rovtwin.links.waterlinked import ugps_wire as wire
from rovtwin.links.waterlinked.ugps_wire import AcousticPosition, MapPosition

FIX = AcousticPosition(3.5, -1.25, 10.0, 0.5, True, (1.0, 2.0), (-60.0, -61.0), (-90.0, -91.0), (1.0, 0.0))
PLACE = MapPosition(63.45, 10.36, 42.0, 10.0, 0.5, 1.9, 11.0, 1.0)


def body(message, **changes):
    return json.dumps(wire.body_of(message) | changes).encode()


def test_messages_come_back():
    assert wire.parse_acoustic(body(FIX)) == FIX
    assert wire.parse_map(body(PLACE)) == PLACE


def test_receivers_may_be_missing_or_true():
    """The description says numbers, firmware sends true and false; an antenna may have no receivers to tell of."""
    assert wire.parse_acoustic(body(FIX, receiver_valid=[True, False])) == FIX
    bare = {key: wire.body_of(FIX)[key] for key in ("x", "y", "z", "std", "position_valid")}
    assert wire.parse_acoustic(json.dumps(bare).encode()).x == 3.5


@pytest.mark.parametrize(
    "change", [{"x": "1"}, {"x": None}, {"y": 10**400}, {"position_valid": 1}, {"receiver_distance": [0.0] * 99}]
)
def test_wrong_fixes_are_refused(change):
    with pytest.raises(LinkError):
        wire.parse_acoustic(body(FIX, **change))


@pytest.mark.parametrize("change", [{"lat": 91.0}, {"lon": -181.0}, {"lat": math.nan}, {"orientation": "north"}])
def test_wrong_places_are_refused(change):
    with pytest.raises(LinkError):
        wire.parse_map(body(PLACE, **change))


@pytest.mark.parametrize(
    ("path", "reported"),
    [
        *((wire.DEPTH, {}), (wire.DEPTH, {"depth": 1e9}), (wire.DEPTH, {"depth": math.nan})),
        *((wire.ORIENTATION, {"orientation": 361.0}), (wire.EXTERNAL_MASTER, {"lat": 63.0, "lon": 10.0})),
        *((wire.IMU, {"roll": 0.0}), (wire.DEPTH, {"depth": 1.0, "temp": "cold"})),
    ],
)
def test_wrong_puts_are_refused(path, reported):
    with pytest.raises(LinkError):
        wire.parse_put(path, json.dumps(reported).encode())


def test_topside_frame():
    """Forward to the east: what lies north of the unit is on its left."""
    x, y = wire.to_topside((10.0, 0.0), math.pi / 2)
    assert (x, y) == (pytest.approx(0.0, abs=1e-12), pytest.approx(-10.0))
    assert wire.from_topside((x, y), math.pi / 2) == pytest.approx((10.0, 0.0))


def test_requests_come_back():
    sent = http_wire.request_bytes("PUT", "kit", wire.DEPTH, {"depth": 1.0})
    head, _, content = sent.partition(b"\r\n\r\n")
    request = http_wire.parse_request(head + b"\r\n\r\n")
    assert (request.method, request.path, request.keep) == ("PUT", wire.DEPTH, False)
    assert request.length == len(content) and json.loads(content) == {"depth": 1.0}


def test_absolute_addresses_and_queries():
    request = http_wire.parse_request(b"GET http://kit:80/api/v1/about?x=1 HTTP/1.1\r\nHost: kit\r\n\r\n")
    assert request.path == "/api/v1/about" and request.keep


def test_responses_come_back_whole():
    sent = http_wire.response_bytes(200, {"x": 1.0}, True)
    for cut in range(len(sent)):
        assert http_wire.parse_response(sent[:cut], ended=False) is None
    response = http_wire.parse_response(sent, ended=False)
    assert response is not None and response.status == 200 and json.loads(response.body) == {"x": 1.0}
    unstated = b"HTTP/1.0 200 OK\r\n\r\n{}"
    assert http_wire.parse_response(unstated, ended=False) is None
    assert http_wire.parse_response(unstated, ended=True) == http_wire.Response(200, b"{}")


@pytest.mark.parametrize(
    "head",
    [
        *(b"\r\n\r\n", b"GET /\r\n\r\n", b"GET / FTP/1.0\r\n\r\n", b"GET / HTTP/1.1\r\nno colon\r\n\r\n"),
        *(b"PUT / HTTP/1.1\r\nContent-Length: -5\r\n\r\n", b"PUT / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n"),
        *(b"PUT / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n", b"GET http://[ HTTP/1.1\r\n\r\n"),
        b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 100 + b"\r\n",
    ],
)
def test_wrong_requests_are_refused(head):
    with pytest.raises(LinkError):
        http_wire.parse_request(head)


@pytest.mark.parametrize(
    "data",
    [
        *(b"HTTP/1.1 abc\r\n\r\n", b"SSH-2.0-x\r\n\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nabc"),
        *(b"x" * 20000, b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n0\r\n\r\n", b""),
        b"HTTP/1.1 200 OK\r\n\r\n" + b"x" * 70000,
    ],
)
def test_wrong_responses_are_refused(data):
    with pytest.raises(LinkError):
        http_wire.parse_response(data, ended=True)


_SEEDS = [
    body(FIX),
    body(PLACE),
    b'{"depth": 1.0, "temp": 10.0}',
    http_wire.response_bytes(200, wire.body_of(FIX), True),
    http_wire.request_bytes("PUT", "kit", wire.DEPTH, {"depth": 1.0}),
]
_values = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6) | st.lists(st.floats(), max_size=5)
)
_keys = st.sampled_from([*wire.body_of(FIX), *wire.body_of(PLACE), "depth", "temp", "roll", "pitch", "yaw"])


@st.composite
def _bytes(draw):
    kind = draw(st.integers(0, 2))
    if kind == 0:
        return draw(st.binary(max_size=200))
    if kind == 1:
        data = bytearray(draw(st.sampled_from(_SEEDS)))
        for at, byte in draw(st.lists(st.tuples(st.integers(0, len(data) - 1), st.integers(0, 255)), max_size=4)):
            data[at] = byte
        return bytes(data[: draw(st.integers(0, len(data)))])
    base = draw(st.sampled_from([wire.body_of(FIX), wire.body_of(PLACE)]))
    return json.dumps(base | draw(st.dictionaries(_keys, _values, max_size=4))).encode()


def _only_link_errors(data: bytes) -> None:
    parsers = [wire.parse_acoustic, wire.parse_map, http_wire.parse_request]
    parsers += [lambda d, path=path: wire.parse_put(path, d) for path in wire.PUTS]
    parsers += [lambda d, end=end: http_wire.parse_response(d, end) for end in (False, True)]
    for parse in parsers:
        try:
            found = parse(data)
        except LinkError as error:
            assert len(str(error)) < 400
            continue
        if isinstance(found, AcousticPosition):
            assert all(map(math.isfinite, (found.x, found.y, found.z, found.std, *found.receiver_distance)))
        if isinstance(found, MapPosition):
            assert abs(found.lat) <= 90.0 and abs(found.lon) <= 180.0
        if isinstance(found, dict):
            assert all(map(math.isfinite, found.values()))


@settings(max_examples=400)
@given(_bytes())
def test_fuzz(data):
    _only_link_errors(data)


@pytest.mark.slow
@settings(max_examples=100_000)
@given(_bytes())
def test_fuzz_long(data):
    _only_link_errors(data)
