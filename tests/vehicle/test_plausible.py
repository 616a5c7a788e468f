"""Thrust, speed and noise that hardly any vehicle has: named with number, range and unit, and never of a real one."""

import pytest

from rovtwin.vehicle import check, load_vehicle
from rovtwin.vehicle.analysis.plausible import implausible
from rovtwin.vehicle.description import files
from rovtwin.vehicle.description.vehicle import vehicle_from_dict

BOX = {"box": [0.4, 0.3, 0.2]}


def small(force=50.0, drag=None, **sensor):
    """A vehicle of 10 kg with two thrusters ahead."""
    places = [[0, 0.1, 0], [0, -0.1, 0]]
    thrusters = [{"name": f"t{i}", "direction": [1, 0, 0], "position": p, "force": force} for i, p in enumerate(places)]
    data = {"name": "small", "mass": 10.0, "volume": 0.01, "shape": BOX, "thrusters": thrusters}
    if drag is not None:
        data["hydrodynamics"] = {"quadratic_damping": [drag, 100, 100, 1, 1, 1]}
    if sensor:
        data["sensors"] = [{"name": "s", **sensor}]
    return vehicle_from_dict(data, "small")


def lines(vehicle):
    return [slip.line for slip in implausible(vehicle, vehicle.model())]


@pytest.mark.parametrize("name", files.list_library())
def test_no_vehicle_of_the_library_is_doubted(name):
    vehicle = load_vehicle(name)
    assert lines(vehicle) == []


@pytest.mark.parametrize(
    "device", ["imu_consumer", "imu_tactical", "dvl_a50", "dvl_a125", "bar30", "ping1d", "ugps_a1"]
)
def test_no_device_of_the_library_is_doubted(device):
    assert lines(load_vehicle(device)) == []


def test_a_usual_small_vehicle_passes():
    assert lines(small()) == [] and lines(small(kind="imu", gyro={"noise": 0.002})) == []


def test_a_force_in_grams_is_named_with_the_weight_and_the_speed_it_implies():
    (line,) = lines(small(force=3500.0))
    assert line.startswith(
        "thruster 't0' and 1 more push up to 3500 N, 36 times the vehicle's weight, expected 0.03 to 3"
    )
    assert "it implies 1" in line and "As grams it would be 34.3 N" in line


def test_a_force_in_kilonewtons_is_named():
    (line,) = lines(small(force=0.05))
    assert line.startswith("all thrusters together push 0.1 N, 0.1 % of the vehicle's weight, expected 3 %")


def test_a_top_speed_far_beyond_its_size_is_named():
    (line,) = lines(small(force=90.0, drag=0.5))
    assert line.startswith("top speed in surge comes to 18 m/s, expected less than 5.8 for a vehicle of some 0.22 m")
    assert lines(small(force=90.0, drag=20.0)) == []


@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        ({"kind": "imu", "gyro": {"noise": 0.2}}, "sensor s.gyro: found noise 0.2 rad/s, expected up to 0.02"),
        ({"kind": "imu", "accelerometer": {"noise": [12, 0.01, 0.01]}}, "found noise 12 m/s2, expected up to 0.5"),
        ({"kind": "imu", "accelerometer": {"bias": [0, -5, 0]}}, "found bias 5 m/s2, expected up to 2: is it in mg?"),
        ({"kind": "attitude", "noise": 0.5}, "expected up to 0.1 (0.001 to 0.02 in AHRS units): is it in degrees?"),
        ({"kind": "dvl", "noise": 5.0}, "expected up to 0.3 (0.005 in a small Doppler log): is it in mm/s or cm/s?"),
    ],
)
def test_noise_that_no_sensor_of_the_kind_has_is_named_with_the_likely_unit(sensor, expected):
    (line,) = lines(small(**sensor))
    assert expected in line


def test_check_says_so_and_refuses_nothing(tmp_path):
    path = tmp_path / "odd.yaml"
    path.write_text(
        "{name: odd, mass: 10, volume: 0.01, shape: {box: [0.4, 0.3, 0.2]}, sensors: [{name: i, kind: imu, "
        "gyro: {noise: 0.2}}], thrusters: [{name: t, direction: [1, 0, 0], force: 3500}]}"
    )
    found = check(path)
    assert "units look wrong (thruster 't', noise of i.gyro)" in found.reservations
    assert any("3500 N" in line for line in found.findings) and any("0.2 rad/s" in line for line in found.findings)
