"""Blueye's wire format: units and frames both ways, and bytes that anybody may have written."""

import math

import blueye.protocol as bp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rovtwin.core.errors import LinkError
from rovtwin.links.blueye import readings, wire
from rovtwin.links.blueye.drone.drone import About, Drone
from rovtwin.links.blueye.drone.telemetry import Telemetry
from rovtwin.links.blueye.protobuf import PACKAGE, message, names
from rovtwin.links.blueye.services.answers import answer
from rovtwin.links.blueye.services.http import HttpRequest, encode, parse_http, respond
from rovtwin.links.blueye.wire import parse_control, parse_request


def frames(sent) -> list[bytes]:
    """As the SDK sends a message."""
    kind = type(sent)
    return [sent._pb.DESCRIPTOR.full_name.encode(), kind.serialize(sent)]


def a_drone() -> tuple[Drone, Telemetry]:
    drone = Drone("", About(), 2.0)
    return drone, Telemetry(drone)


def reply_to(request, drone: Drone, telemetry: Telemetry, now: float = 0.0, address: str = "127.0.0.1"):
    head, payload = answer(frames(request), drone, telemetry, address, now)
    return getattr(bp, head.decode().removeprefix(PACKAGE)).deserialize(payload)


# What clients send


def test_motion():
    sent = bp.MotionInputCtrl(motion_input={"surge": 0.5, "sway": -0.25, "heave": 1.0, "roll": 0.125, "yaw": -1.0})
    assert parse_control(frames(sent)) == wire.Motion((0.5, -0.25, 1.0, 0.125, 0.0, -1.0))


def test_motion_beyond_its_range_is_clipped():
    sent = bp.MotionInputCtrl(motion_input={"surge": 7.0, "yaw": -3.0})
    assert parse_control(frames(sent)) == wire.Motion((1.0, 0.0, 0.0, 0.0, 0.0, -1.0))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_motion_that_is_no_number_is_none(bad):
    sent = bp.MotionInputCtrl(motion_input={"surge": 0.5, "heave": bad})
    assert parse_control(frames(sent)) == wire.Motion(wire.STILL)


@pytest.mark.parametrize("field", ["type_", "version", "name"])
def test_what_a_client_calls_itself_cannot_command_a_terminal(field):
    sent = bp.ConnectClientReq(client_info={field: "\x1b]0;mine\x07\x9b2J\r\nblue\u00e9\u202eeye\x7f"})
    name = parse_request(frames(sent)).client.name
    assert name.isascii() and name.isprintable() and "blue" in name and "\\x1b]0;mine" in name


@pytest.mark.parametrize("name", sorted(wire.MODES))
@pytest.mark.parametrize("on", [True, False])
def test_modes(name, on):
    sent = getattr(bp, name)(state={"enabled": on})
    assert parse_control(frames(sent)) == wire.Mode(wire.MODES[name], on)


def test_lights_density_watchdog_and_the_rest():
    assert parse_control(frames(bp.LightsCtrl(lights={"value": 0.5}))) == wire.Lights(0.5)
    assert parse_control(frames(bp.WaterDensityCtrl(density={"value": 997.0}))) == wire.WaterDensity(997.0)
    assert parse_control(frames(bp.WatchdogCtrl(connection_duration={"value": 3}, client_id=9))) == wire.Watchdog(9)
    assert parse_control(frames(bp.TiltVelocityCtrl(velocity={"value": 1}))) == wire.Ignored("TiltVelocityCtrl")


def test_every_control_message_is_understood_or_ignored():
    for name in names("Ctrl"):
        parse_control([f"{PACKAGE}{name}".encode(), b""] if name != "WaterDensityCtrl" else frames(_salty()))


def _salty():
    return bp.WaterDensityCtrl(density={"value": 1025.0})


@pytest.mark.parametrize(
    ("sent", "message"),
    [
        ([], "0 frames"),
        ([b"blueye.protocol.MotionInputCtrl"], "1 frames"),
        ([b"a", b"b", b"c"], "3 frames"),
        ([b"blueye.protocol.PingReq", b""], "ends in Ctrl"),
        ([b"os.system", b""], "ends in Ctrl"),
        ([b"\xff\xfe", b""], "no text"),
        ([b"x" * 1000, b""], "1000 bytes"),
        ([b"blueye.protocol.MotionInputCtrl", b"\x0a\xff"], "no such message"),
        ([b"blueye.protocol.MotionInputCtrl", b"x" * 70000], "70000 bytes"),
        ([b"blueye.protocol.LightsCtrl", b"\x0a\x05\x0d\x00\x00\xc0\x7f"], "lights nan"),
    ],
)
def test_control_that_is_none_says_what_was_found(sent, message):
    with pytest.raises(LinkError, match=message):
        parse_control(sent)


# Requests


def test_every_request_gets_its_reply():
    requests = names("Req")
    assert {"PingReq", "ConnectClientReq", "SetMissionReq", "GetCvModelsReq"} <= requests
    for name in requests:
        drone, telemetry = a_drone()
        reply = reply_to(getattr(bp, name)(), drone, telemetry)
        assert type(reply).__name__ == name.removesuffix("Req") + "Rep"


def test_reply_to_what_is_no_request_is_one_that_parses_as_any():
    for sent in ([], [b"x"], [b"\xff", b"y"], [b"blueye.protocol.PingReq", b"\xff\xff"], [b"a"] * 5):
        drone, telemetry = a_drone()
        head, payload = answer(sent, drone, telemetry, "", 0.0)
        assert (head, payload) == (b"blueye.protocol.PingRep", b"") and drone.dropped == 1


def test_malformed_request_gets_the_reply_of_its_kind():
    drone, telemetry = a_drone()
    head, payload = answer([b"blueye.protocol.SetPubFrequencyReq", b"\x0a\xff"], drone, telemetry, "", 0.0)
    assert head == b"blueye.protocol.SetPubFrequencyRep"
    assert not bp.SetPubFrequencyRep.deserialize(payload).success


@pytest.mark.parametrize(
    ("name", "rate", "accepted"),
    [
        ("DepthTel", 100.0, True),
        ("DepthTel", 0.0, True),
        ("blueye.protocol.DepthTel", 5.0, True),
        ("DepthTel", 100.5, False),
        ("DepthTel", -1.0, False),
        ("DepthTel", math.nan, False),
        ("MultibeamPingTel", 1.0, False),
        ("_imu", 1.0, False),
        ("", 1.0, False),
    ],
)
def test_rates(name, rate, accepted):
    drone, telemetry = a_drone()
    reply = reply_to(bp.SetPubFrequencyReq(message_type=name, frequency=rate), drone, telemetry)
    assert reply.success == accepted
    assert telemetry.rates["DepthTel"] == (rate if accepted else 10.0)


def test_clock_is_set_to_a_time_of_this_century_only():
    drone, telemetry = a_drone()
    assert reply_to(bp.SyncTimeReq(time={"unix_timestamp": {"seconds": 1_900_000_000}}), drone, telemetry).success
    assert drone.clock() == pytest.approx(1_900_000_000, abs=5)
    assert not reply_to(bp.SyncTimeReq(time={"unix_timestamp": {"seconds": 5}}), drone, telemetry).success
    assert drone.clock() == pytest.approx(1_900_000_000, abs=5)


def test_what_a_client_says_of_itself_is_cut():
    request = parse_request(frames(bp.ConnectClientReq(client_info={"type_": "x" * 5000, "is_observer": True})))
    assert request.client.text["type_"] == "x" * 100 and request.client.observer


# Telemetry


def sent_and_read(built) -> dict[str, np.ndarray]:
    return dict(readings.parse_telemetry(built.DESCRIPTOR.name, built.SerializeToString()))


def test_units_of_telemetry_are_the_protocols():
    depth = readings.depth_telemetry(12.5)
    assert depth.depth.value == 12.5
    attitude = readings.attitude_telemetry(np.radians([10.0, -20.0, 170.0])).attitude
    np.testing.assert_allclose([attitude.roll, attitude.pitch, attitude.yaw], [10, -20, 170], rtol=1e-6)
    imu = readings.imu_telemetry(
        "CalibratedImuTel", np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, -9.80665]), np.array([13.7, 0.0, 50.1]), 8.0
    ).imu
    assert (imu.gyroscope.x, imu.accelerometer.z, imu.magnetometer.z) == (0.1, -1.0, 50.1)
    dvl = readings.dvl_telemetry(np.array([0.5, 0.25, -0.125]), 0.2, 3.0).dvl_velocity
    assert (dvl.velocity.x, dvl.velocity.y, dvl.velocity.z, dvl.delta_time) == (0.5, -0.25, -0.125, pytest.approx(200))


@given(st.lists(st.floats(-3.14, 3.14), min_size=3, max_size=3), st.floats(-5, 5), st.floats(0, 100))
@settings(max_examples=100, deadline=None)
def test_telemetry_comes_back_as_it_went(euler, speed, depth):
    vector = np.array([speed, -speed, 0.5 * speed])
    assert sent_and_read(readings.depth_telemetry(depth))["pressure"] == pytest.approx([depth], abs=1e-5)
    np.testing.assert_allclose(
        sent_and_read(readings.attitude_telemetry(np.array(euler)))["attitude"], euler, atol=1e-6
    )
    imu = sent_and_read(readings.imu_telemetry("CalibratedImuTel", vector, 2 * vector, None, 8.0))
    np.testing.assert_allclose(imu["gyro"], vector, atol=1e-12)
    np.testing.assert_allclose(imu["accelerometer"], 2 * vector, atol=1e-12)
    np.testing.assert_allclose(sent_and_read(readings.dvl_telemetry(vector, 0.1, None))["dvl"], vector, atol=1e-12)
    assert sent_and_read(readings.altitude_telemetry(depth))["altimeter"] == pytest.approx([depth], abs=1e-5)


def test_what_is_not_valid_is_not_read():
    Altitude, Position, Dvl = message("AltitudeTel"), message("PositionEstimateTel"), message("DvlVelocityTel")
    assert sent_and_read(Altitude(altitude={"value": 3.0, "is_valid": False})) == {}
    assert sent_and_read(Position(position_estimate={"northing": 3.0})) == {}
    velocity = {"velocity": {"x": 1.0}}
    assert sent_and_read(Dvl(dvl_velocity={**velocity, "is_water_tracking": True})) == {}
    beams = [{"id": i, "beam_valid": i < 2} for i in range(4)]
    assert sent_and_read(Dvl(dvl_velocity={**velocity, "transducers": beams})) == {}
    assert sent_and_read(Dvl(dvl_velocity=velocity)).keys() == {"dvl"}
    assert sent_and_read(message("CalibratedImuTel")(imu={"gyroscope": {"x": 1.0}})).keys() == {"gyro"}


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_telemetry_that_is_no_number_is_no_reading(bad):
    for built in (
        message("DepthTel")(depth={"value": bad}),
        message("AttitudeTel")(attitude={"yaw": bad}),
        message("CalibratedImuTel")(imu={"gyroscope": {"y": bad}}),
        message("PositionEstimateTel")(position_estimate={"northing": bad, "is_valid": True}),
    ):
        with pytest.raises(LinkError, match="NaN or infinity"):
            sent_and_read(built)
    with pytest.raises(LinkError, match="NaN or infinity"):
        readings.parse_power(
            message("BatteryBQ40Z50Tel")(battery={"current": bad, "voltage": {"total": 12}}).SerializeToString()
        )


def test_a_drone_that_reads_gravity_downward():
    built = message("CalibratedImuTel")(imu={"accelerometer": {"z": 1.0}})
    ((_, force),) = readings.parse_telemetry("CalibratedImuTel", built.SerializeToString(), -1.0)
    np.testing.assert_allclose(force, [0, 0, -9.80665])


# HTTP


@pytest.mark.parametrize(
    ("head", "request_"),
    [
        (b"GET /diagnostics/drone_info HTTP/1.1\r\nHost: 127.0.0.3\r\n\r\n", ("127.0.0.3", "/diagnostics/drone_info")),
        (b"GET http://127.0.0.3/logs?x=1 HTTP/1.1\r\nHost: 127.0.0.9\r\n\r\n", ("127.0.0.3", "/logs")),
        (b"GET / HTTP/1.0\r\n\r\n", ("", "/")),
        (b"get http://A:80 HTTP/1.1\r\nhost: b:81\r\n\r\n", ("a", "/")),
    ],
)
def test_http(head, request_):
    assert parse_http(head) == HttpRequest("GET", *request_)


@pytest.mark.parametrize(
    "head", [b"", b"\r\n\r\n", b"GET /", b"GET  / HTTP/1.1", b"GET http://[::1 HTTP/1.1\r\n", b"x" * 9000]
)
def test_http_that_is_none(head):
    with pytest.raises(LinkError):
        parse_http(head)


def test_http_answers():
    info = {"sw_version": "3.4.0"}
    assert respond(HttpRequest("GET", "", "/diagnostics/drone_info"), info) == (200, info)
    assert respond(HttpRequest("GET", "", "/logs"), info) == (200, [])
    assert respond(HttpRequest("GET", "", "/etc/passwd"), info)[0] == 404
    assert respond(HttpRequest("POST", "", "/logs"), info)[0] == 405
    head, body = encode(404, {"error": "x"}).split(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 404 Not Found") and body == b'{"error": "x"}'


# Fuzz: the same properties with few examples here and with 10^5 in the slow run

FUZZ = [200, pytest.param(100_000, marks=pytest.mark.slow)]
HEADS = st.one_of(
    st.binary(max_size=100),
    st.sampled_from([f"{PACKAGE}{name}".encode() for name in sorted(names())]),
    st.sampled_from([name.encode() for name in sorted(names())]),
)
VALID = [
    frames(bp.MotionInputCtrl(motion_input={"surge": 0.5, "yaw": 1.0}))[1],
    frames(bp.ConnectClientReq(client_info={"type_": "SDK", "name": "me"}))[1],
    frames(bp.SetPubFrequencyReq(message_type="DepthTel", frequency=5))[1],
    readings.imu_telemetry("CalibratedImuTel", np.ones(3), np.ones(3), np.ones(3), 8.0).SerializeToString(),
    readings.dvl_telemetry(np.ones(3), 0.1, 2.0).SerializeToString(),
]


@st.composite
def garbled(draw) -> bytes:
    """A message with some bytes changed, or cut short, or something else altogether."""
    content = bytearray(draw(st.sampled_from(VALID)))
    for place, value in draw(st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), max_size=4)):
        content[place % len(content)] = value
    return bytes(content[: draw(st.integers(0, len(content)))])


PAYLOADS = st.one_of(st.binary(max_size=300), garbled())
SENT = st.one_of(st.lists(st.binary(max_size=50), max_size=4), st.tuples(HEADS, PAYLOADS).map(list))


def fuzz(examples: int, strategy, check) -> None:
    """`check` raises nothing but LinkError for anything of the strategy."""

    @given(strategy)
    @settings(max_examples=examples, deadline=None, database=None)
    def run(sent) -> None:
        try:
            check(sent)
        except LinkError:
            pass

    run()


@pytest.mark.parametrize("examples", FUZZ)
def test_fuzz_control(examples):
    drone, _ = a_drone()
    drone.connect(wire.Client(), "", 0.0)
    drone.armed = True

    def check(sent):
        drone.obey(parse_control(sent), "", 0.0)
        command = drone.command()
        assert all(-1 <= m <= 1 for m in command.motion) and 0 <= command.lights <= 1

    fuzz(examples, SENT, check)


@pytest.mark.parametrize("examples", FUZZ)
def test_fuzz_requests(examples):
    drone, telemetry = a_drone()

    def check(sent):
        try:
            head, payload = answer(sent, drone, telemetry, "10.0.0.1", 0.0)
        except LinkError as error:
            raise AssertionError("a request without an answer") from error
        message(head.decode().removeprefix(PACKAGE)).FromString(payload)
        assert len(drone.clients.all) <= 16

    fuzz(examples, SENT, check)


@pytest.mark.parametrize("examples", FUZZ)
def test_fuzz_telemetry(examples):
    kinds = st.one_of(st.sampled_from(sorted(readings.SENSORS)), st.sampled_from(sorted(names())), st.text(max_size=20))

    def check(sent):
        name, payload = sent
        for _, value in readings.parse_telemetry(name, payload):
            assert np.isfinite(value).all()
        assert math.isfinite(readings.parse_power(payload))

    fuzz(examples, st.tuples(kinds, PAYLOADS), check)


@pytest.mark.parametrize("examples", FUZZ)
def test_fuzz_http(examples):
    lines = st.lists(st.text(max_size=40), max_size=5).map("\r\n".join)
    head = st.one_of(
        st.binary(max_size=200),
        lines.map(lambda text: text.encode("utf-8", "replace")),
        st.builds(
            lambda m, t, h: f"{m} {t} HTTP/1.1\r\nHost: {h}\r\n\r\n".encode("utf-8", "replace"),
            st.sampled_from(["GET", "POST", "get", ""]),
            st.one_of(st.text(max_size=40), st.sampled_from(["/", "http://[", "http://a:x/", "//", "/%zz"])),
            st.text(max_size=20),
        ),
    )

    def check(sent):
        encode(*respond(parse_http(sent), {}))

    fuzz(examples, head, check)
