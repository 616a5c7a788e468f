"""Messages of the DVL: what they say, and that nothing from the network does more than be refused."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rovtwin.core.errors import LinkError
from rovtwin.links.waterlinked import dvl_wire as wire
from rovtwin.links.waterlinked.dvl_wire import PositionReport, Response, VelocityReport

VELOCITY = VelocityReport(
    velocity=(0.5, -0.1, 0.02),
    valid=True,
    altitude=2.5,
    fom=0.004,
    covariance=((1e-5, 0.0, 0.0), (0.0, 2e-5, 0.0), (0.0, 0.0, 3e-6)),
    transducers=wire.beams((0.5, -0.1, 0.02), 2.5, True),
    since_last=106.25,
    time_of_validity=1638191471563017,
    time_of_transmission=1638191471752336,
)
POSITION = PositionReport(ts=49056.8, x=12.5, y=-64.5, z=1.75, std=0.002, roll=0.5, pitch=-0.25, yaw=170.0)
RESPONSE = Response("get_config", True, "", dict(wire.CONFIG))


@pytest.mark.parametrize("report", [VELOCITY, POSITION, RESPONSE])
def test_reports_come_back(report):
    line = wire.report_line(report)
    assert line.endswith(b"\r\n") and line.count(b"\n") == 1
    assert wire.parse_report(line) == report


def test_figure_of_merit_is_the_vendors():
    """Covariance and figure of merit of the report that Water Linked prints in its description of the protocol."""
    covariance = [
        [2.4471841442164077e-08, -3.3937477272871774e-09, -1.6659699175747278e-09],
        [-3.3937477272871774e-09, 1.4654466085062268e-08, 4.0409570134514183e-10],
        [-1.6659699175747278e-09, 4.0409570134514183e-10, 1.5971971523143225e-09],
    ]
    assert wire.figure_of_merit(covariance) == pytest.approx(0.00016016385053352144, rel=1e-6)


def test_beams_hold_the_velocity():
    """A least-squares fit through the four beams gives it back; slant ranges give the altitude back."""
    velocity = np.array([0.7, -0.3, 0.1])
    beams = wire.beams(velocity.tolist(), 4.0, True)
    found, *_ = np.linalg.lstsq(wire.beam_directions(), [beam.velocity for beam in beams], rcond=None)
    np.testing.assert_allclose(found, velocity, atol=1e-12)
    np.testing.assert_allclose([b.distance * math.cos(math.radians(22.5)) for b in beams], 4.0)
    np.testing.assert_allclose(wire.beam_directions()[:, 2], math.cos(math.radians(22.5)))


def test_old_firmware_has_no_stamps():
    found = {"time": 100.0, "vx": 0.1, "vy": 0.0, "vz": 0.0, "fom": 0.01, "altitude": 1.0, "velocity_valid": True}
    found |= {"status": 0, "format": "json_v2", "type": "velocity"}
    report = wire.parse_report(json.dumps(found).encode())
    assert isinstance(report, VelocityReport)
    assert report.time_of_validity is None and report.covariance is None and report.transducers == ()


@pytest.mark.parametrize("change", [{"type": "velocity_water"}, {"tracking_mode": "water"}])
def test_water_tracking_is_not_over_ground(change):
    found = json.loads(wire.report_line(VELOCITY)) | change
    report = wire.parse_report(json.dumps(found).encode())
    assert isinstance(report, VelocityReport) and not report.bottom


def test_unknown_types_are_passed_over():
    assert wire.parse_report(b'{"type": "something_new"}') is None


@pytest.mark.parametrize(
    "change",
    [
        *({"vx": "0.1"}, {"vx": None}, {"vx": True}, {"vx": 10**400}, {"velocity_valid": 1}, {"altitude": [1.0]}),
        *({"covariance": [[1.0]]}, {"covariance": {}}, {"transducers": [1]}, {"transducers": [{}] * 99}),
        *({"time_of_validity": "now"}, {"type": 5}, {"time_of_validity": None}),
    ],
)
def test_wrong_fields_are_refused(change):
    found = json.loads(wire.report_line(VELOCITY)) | change
    with pytest.raises(LinkError):
        wire.parse_report(json.dumps(found).encode())


@pytest.mark.parametrize(
    "line",
    [
        *(b"", b"[]", b"null", b"{", b"\xff\xfe", b"[" * 60000, b'{"type": "velocity", "vx": NaN}', b"1" * 70000),
        *(b'{"type":"velocity","vx":1e999}', b'{"type": "velocity", "vx": Infinity}', b'{"a":' * 9000, b"9" * 5000),
    ],
)
def test_nonsense_is_refused(line):
    with pytest.raises(LinkError):
        wire.parse_report(line)


@pytest.mark.parametrize(
    "changes",
    [
        *({"speed_of_sound": 999}, {"speed_of_sound": "fast"}, {"acoustic_enabled": 1}, {"range_mode": "=7"}),
        *({"mounting_rotation_offset": -1}, {"range_mode": 3}, {"nonsense": 1}, {"range_mode": "1<=2<=3"}),
    ],
)
def test_wrong_settings_are_refused(changes):
    with pytest.raises(LinkError):
        wire.checked_config(wire.CONFIG, changes)


def test_right_settings_are_taken():
    changes = {"speed_of_sound": 1500, "range_mode": "2<=4", "dark_mode_enabled": True, "mounting_rotation_offset": 90}
    assert wire.checked_config(wire.CONFIG, changes) == wire.CONFIG | changes


_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just(10**400),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=8,
)
_known = ["type", "vx", "vy", "vz", "fom", "covariance", "altitude", "transducers", "velocity_valid", "status", "time"]
_known += ["time_of_validity", "time_of_transmission", "ts", "x", "roll", "response_to", "success", "command"]
_known += ["parameters", "tracking_mode"]


@st.composite
def _lines(draw):
    """Bytes of three kinds: any, a good message with bits of it exchanged, and JSON with good names and any values."""
    kind = draw(st.integers(0, 2))
    if kind == 0:
        return draw(st.binary(max_size=200))
    if kind == 1:
        line = bytearray(wire.report_line(draw(st.sampled_from([VELOCITY, POSITION, RESPONSE]))))
        for at, byte in draw(st.lists(st.tuples(st.integers(0, len(line) - 1), st.integers(0, 255)), max_size=4)):
            line[at] = byte
        return bytes(line[: draw(st.integers(0, len(line)))])
    base = json.loads(wire.report_line(draw(st.sampled_from([VELOCITY, POSITION, RESPONSE]))))
    base |= draw(st.dictionaries(st.sampled_from(_known), _values, max_size=4))
    return json.dumps(base).encode()  # may hold NaN and Infinity, as careless senders write them


def _only_link_errors(line: bytes) -> None:
    for parse in (wire.parse_report, wire.parse_order):
        try:
            found = parse(line)
        except LinkError as error:
            assert len(str(error)) < 400
            continue
        if isinstance(found, VelocityReport):
            assert all(map(math.isfinite, (*found.velocity, found.altitude, found.fom)))
        if isinstance(found, wire.Order):
            try:
                wire.checked_config(wire.CONFIG, found.parameters)
            except LinkError as error:
                assert len(str(error)) < 400


@settings(max_examples=400)
@given(_lines())
def test_fuzz(line):
    _only_link_errors(line)


@pytest.mark.slow
@settings(max_examples=100_000)
@given(_lines())
def test_fuzz_long(line):
    _only_link_errors(line)
