"""The devices that ship: parts that say what they weigh, displace, measure, draw, and where that comes from."""

import numpy as np
import pytest

from rovtwin.core.user_files.config import read_yaml
from rovtwin.vehicle import list_devices, list_library, load_vehicle, render, summary, vehicle_from_dict
from rovtwin.vehicle.analysis.extent import bounding_box
from rovtwin.vehicle.analysis.summary import sources
from rovtwin.vehicle.description.files import DEVICES
from rovtwin.vehicle.description.totals.assembly import bodies

ASKED_FOR = {
    "dvl_a50": "dvl", "dvl_a125": "dvl", "ugps_u1": "position", "ping1d": "altimeter", "ping360": "sonar",
    "bar30": "pressure", "imu_tactical": "imu", "imu_consumer": "imu", "imaging_sonar": "sonar",
    "uhi_with_lamps": "imager",
}  # fmt: skip


def test_devices_are_no_vehicles():
    assert not set(list_devices()) & set(list_library())
    assert len(list_devices()) >= 12
    assert not any(load_vehicle(name).thruster_names for name in list_devices())
    assert all(load_vehicle(name).thruster_names for name in list_library())


@pytest.mark.parametrize("name", list_devices())
def test_every_device_is_described_in_full(name):
    device = load_vehicle(name)
    assert device.name == name and device.description
    total = device.assembly
    assert total.solid.mass > 0 and total.volume > 0 and np.all(np.linalg.eigvalsh(total.solid.inertia) > 0)
    assert bounding_box(device.file) is not None
    # It displaces no more than its outside holds, and no material of these is lighter than foam or heavier than lead.
    assert total.volume <= sum(np.prod(box.size) for box in total.boxes) * (1 + 1e-9)
    assert 150 < total.solid.mass / total.volume < 11400
    assert any(body.visuals for _, body in bodies(device.file, name))
    text = read_yaml(DEVICES / f"{name}.yaml")["sources"]
    assert {"mass", "parts"} & set(text) or "shape" in text or name == "uhi_with_lamps"
    assert sources(device)
    if name != "uhi":  # its draw is in what the Pioneers are estimated to need
        assert device.file.power is not None


@pytest.mark.parametrize("name, kind", ASKED_FOR.items())
def test_instruments_measure(name, kind):
    (sensor,) = load_vehicle(name).sensors
    assert sensor.item.kind == kind
    if kind == "imu":
        assert sensor.item.accelerometer.noise > 0 and sensor.item.gyro.noise > 0
    elif kind not in ("sonar", "imager"):
        assert sensor.item.rate_hz > 0 and sensor.item.noise > 0


def test_what_looks_down_looks_down():
    for name in ("ping1d", "uhi_with_lamps"):
        (sensor,) = load_vehicle(name).sensors
        np.testing.assert_allclose(sensor.rotation @ [1, 0, 0], [0, 0, 1], atol=1e-12)


def test_the_dvl_weighs_what_its_maker_says():
    total = load_vehicle("dvl_a50").assembly
    assert (total.solid.mass, total.solid.mass - 1000 * total.volume) == pytest.approx((0.170, 0.105))


@pytest.mark.parametrize("name", list_devices())
def test_every_device_can_be_bolted_on(name):
    bare = vehicle_from_dict({"name": "v", "parts": [{"name": "rov", "part": "bluerov2"}]})
    part = {"name": "new", "part": name, "pose": {"position": [0.1, 0.0, 0.3]}}
    loaded = vehicle_from_dict({"name": "v", "parts": [{"name": "rov", "part": "bluerov2"}, part]})
    device = load_vehicle(name)
    assert loaded.assembly.solid.mass == pytest.approx(bare.assembly.solid.mass + device.assembly.solid.mass)
    (before,), (after,) = bare.power_sources, loaded.power_sources
    drawn = sum(body.power or 0.0 for _, body in bodies(device.file, name))
    assert after.hotel_load == pytest.approx(before.hotel_load + drawn)
    assert after.capacity_wh == before.capacity_wh + (266 if name == "battery_pod" else 0)
    assert len(after.feeds) == 6
    assert render(summary(loaded)), "vehicle show"
