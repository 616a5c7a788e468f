"""When telemetry goes out, and what a vehicle's sensors become in it."""

import numpy as np
import pytest

from rovtwin.core.datum import Datum
from rovtwin.core.flow import Measurement
from rovtwin.links.blueye import readings
from rovtwin.links.blueye.drone.drone import About, Drone
from rovtwin.links.blueye.drone.telemetry import SENSED, Telemetry


def a_drone(name: str = "", datum: Datum | None = None) -> Telemetry:
    telemetry = Telemetry(Drone(name, About(), 2.0), datum)
    for message in SENSED:
        telemetry.set_rate(message, 100.0)
    return telemetry


def sent(telemetry: Telemetry, now: float, *batch: Measurement) -> list[tuple[str, bytes]]:
    return [pair for pair in telemetry.take(now, list(batch)) if pair[0] in SENSED]


def depth(t: float, name: str = "pressure", value: float = 1.0) -> Measurement:
    return Measurement(name, np.array([value]), t)


def read(pairs: list[tuple[str, bytes]], sensor: str) -> list[np.ndarray]:
    return [v for name, payload in pairs for s, v in readings.parse_telemetry(name, payload) if s == sensor]


@pytest.mark.system
@pytest.mark.parametrize("drift", [-1e-3, -1e-5, 0.0, 1e-5, 1e-3])
def test_no_reading_is_lost_at_the_sensors_own_rate(drift):
    """Its clock may be fast or slow."""
    telemetry = a_drone()
    telemetry.set_rate("DepthTel", 50.0)
    count = sum(len(sent(telemetry, 0.02 * k, depth(0.02 * k * (1 + drift)))) for k in range(1, 20_000))
    assert count == 19_999


@pytest.mark.parametrize("rate", [1.0, 3.0, 5.0, 20.0, 30.0])
def test_rate_is_kept_over_a_faster_sensor(rate):
    telemetry = a_drone()
    telemetry.set_rate("DepthTel", rate)
    count = sum(len(sent(telemetry, 0.01 * k, depth(0.01 * k))) for k in range(1, 10_001))
    assert count == pytest.approx(100 * rate, rel=0.02)


def test_nothing_new_is_nothing_sent():
    telemetry = a_drone()
    assert len(sent(telemetry, 1.0, depth(1.0))) == 1
    assert sent(telemetry, 2.0) == []


def test_several_readings_at_once_are_sent_in_order_and_paired_by_time():
    telemetry = a_drone()
    times = (0.01, 0.02, 0.03)
    gyro = [Measurement("gyro", np.full(3, t), t) for t in times]
    force = [Measurement("accelerometer", np.full(3, -t), t) for t in times]
    pairs = [p for p in sent(telemetry, 0.03, *force, *gyro) if p[0] == "CalibratedImuTel"]
    assert [v[0] for v in read(pairs, "gyro")] == pytest.approx(times)
    assert [-v[0] for v in read(pairs, "accelerometer")] == pytest.approx(times)


def test_an_instrument_that_has_gone_silent_is_left_out():
    telemetry = a_drone()
    sent(telemetry, 0.0, Measurement("accelerometer", np.ones(3), 0.0), Measurement("gyro", np.ones(3), 0.0))
    pairs = sent(telemetry, 0.2, Measurement("gyro", np.ones(3), 0.2))
    assert len(read(pairs, "gyro")) == 1 and not read(pairs, "accelerometer")


def test_drones_own_reading_before_the_vehicles():
    telemetry = a_drone("port")
    assert read(sent(telemetry, 0.0, depth(0.0, "pressure", 5.0)), "pressure") == [pytest.approx([5.0])]
    both = sent(telemetry, 0.1, depth(0.1, "port/pressure", 3.0), depth(0.1, "pressure", 5.0))
    assert read(both, "pressure") == [pytest.approx([3.0])]
    assert sent(telemetry, 0.2, depth(0.2, "pressure", 5.0)) == []
    assert sent(telemetry, 0.3, depth(0.3, "starboard/pressure", 5.0)) == []


def test_position_is_the_vehicles_estimate_where_there_is_one():
    telemetry = a_drone(datum=Datum(63.0, 10.0))
    measured = Measurement("position", np.array([5.0, 6.0]), 0.0)
    attitude = Measurement("attitude", np.array([0.0, 0.0, 0.5]), 0.0)
    assert read(sent(telemetry, 0.0, measured, attitude), "position") == [pytest.approx([5.0, 6.0])]
    assert telemetry.contents.message("PositionEstimateTel").position_estimate.heading == pytest.approx(0.5)
    estimated = Measurement("estimate", np.arange(1.0, 13.0), 1.0)
    assert read(sent(telemetry, 1.0, estimated), "position") == [pytest.approx([1.0, 2.0])]
    reported = telemetry.contents.message("PositionEstimateTel").position_estimate
    assert (reported.heading, reported.surge_rate, reported.yaw_rate) == pytest.approx((6.0, 7.0, 12.0))
    later = Measurement("position", np.array([50.0, 60.0]), 2.0)
    assert read(sent(telemetry, 2.0, later), "position") == [], "a measurement is no estimate"


def test_position_has_its_place_on_the_map():
    """What the SDK's NMEA example sends: 0, 0 would be a place in the Atlantic."""
    telemetry = a_drone(datum=Datum(63.0, 10.0))
    sent(telemetry, 0.0, Measurement("estimate", np.array([111.4, -50.0, *np.zeros(10)]), 0.0))
    estimate = telemetry.contents.message("PositionEstimateTel").position_estimate
    latitude, longitude, _ = Datum(63.0, 10.0).geodetic([111.4, -50.0, 0.0])
    assert estimate.is_valid and estimate.global_position.latitude == pytest.approx(float(latitude), abs=1e-9)
    assert estimate.global_position.longitude == pytest.approx(float(longitude), abs=1e-9)
    assert latitude > 63.0009 and longitude < 9.9991


def test_position_without_a_place_on_the_map_is_not_valid():
    telemetry = a_drone()
    sent(telemetry, 0.0, Measurement("estimate", np.arange(12.0), 0.0))
    estimate = telemetry.contents.message("PositionEstimateTel").position_estimate
    assert not estimate.is_valid and not estimate.HasField("global_position") and estimate.easting == 1.0


def test_odometer_counts_the_level_way():
    """0.3 m/s ahead and 0.4 to starboard for ten seconds, at any depth rate."""
    telemetry = a_drone(datum=Datum())
    for k in range(101):
        value = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.3, 0.4, 0.9, 0.0, 0.0, 0.0])
        sent(telemetry, 0.1 * k, Measurement("estimate", value, 0.1 * k))
    estimate = telemetry.contents.message("PositionEstimateTel").position_estimate
    assert estimate.odometer == pytest.approx(5.0, abs=0.06)
    assert estimate.course_over_ground == pytest.approx(np.degrees(1.0 + np.arctan2(0.4, 0.3)), abs=1e-4)


def test_clock_that_is_set_back_does_not_silence_the_drone():
    telemetry = a_drone()
    telemetry.set_rate("DepthTel", 10.0)
    for k in range(100):
        sent(telemetry, 0.1 * k, depth(0.1 * k))
    assert len(sent(telemetry, 0.0, depth(0.0))) == 1
    assert sum(len(sent(telemetry, 0.1 * k, depth(0.1 * k))) for k in range(1, 50)) == 49


def test_magnetic_field_is_seen_from_the_drone():
    """Heading east, north is to the left; nose down, the steep field is ahead."""
    telemetry = a_drone()
    for euler, expected in (
        ([0, 0, 0], [13.7, 0, 50.1]),
        ([0, 0, np.pi / 2], [0, -13.7, 50.1]),
        ([0, -np.pi / 2, 0], [50.1, 0, -13.7]),
        ([np.pi / 2, 0, 0], [13.7, 50.1, 0]),
    ):
        telemetry.contents.latest.clear()
        sent(
            telemetry,
            0.0,
            Measurement("attitude", np.array(euler, dtype=float), 0.0),
            Measurement("gyro", np.zeros(3), 0.0),
        )
        field = telemetry.contents.message("CalibratedImuTel").imu.magnetometer
        np.testing.assert_allclose([field.x, field.y, field.z], expected, atol=1e-9)
