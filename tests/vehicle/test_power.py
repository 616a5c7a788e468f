"""Batteries in vehicle files, and the law of what thrusters draw."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.power import T200_POWER


def thruster(name, **more):
    return {"name": name, "direction": [1, 0, 0], "force": {"ahead": 16.0, "astern": 9.0}} | more


def vehicle(**more):
    unit = {"mass": 10.0, "volume": 0.01, "inertia": [1, 1, 1]}
    inner = unit | {"name": "pod", "thrusters": [thruster("x")]}
    port = unit | {"name": "port", "thrusters": [thruster("surge", power=128.0)], "parts": [inner]}
    portside = unit | {"name": "portside", "thrusters": [thruster("surge")]}
    return unit | {"name": "two", "parts": [port, portside]} | more


def test_thrusters_hang_on_the_nearest_battery_around_them():
    data = vehicle(thrusters=[thruster("main")], battery={"capacity_wh": 100, "hotel_load": 5})
    data["parts"][0]["battery"] = {"capacity_wh": 30}
    found = vehicle_from_dict(data)
    names = found.thruster_names
    fed = {s.name: {names[i] for i in s.feeds} for s in found.power_sources}
    assert fed == {"vehicle": {"main", "portside.surge"}, "port": {"port.surge", "port.pod.x"}}
    assert [(s.capacity_wh, s.hotel_load) for s in found.power_sources] == [(100, 5), (30, 0)]


def test_a_thruster_without_a_battery_around_it_hangs_on_the_largest():
    data = vehicle(thrusters=[thruster("main")])
    data["parts"] += [
        {"name": n, "mass": 1.0, "battery": {"capacity_wh": wh}} for n, wh in (("tube", 300), ("spare", 20))
    ]
    found = vehicle_from_dict(data)
    fed = {s.name: len(s.feeds) for s in found.power_sources}
    assert fed == {"tube": len(found.thruster_names), "spare": 0}, "no thruster runs for free"


def test_a_device_draws_from_the_battery_around_it_or_the_largest():
    data = vehicle(battery={"capacity_wh": 100, "hotel_load": 5}, power=2.0)
    data["parts"][0]["battery"] = {"capacity_wh": 30}
    data["parts"][0]["parts"][0]["power"] = 7.0  # the pod's
    loads = {s.name: s.hotel_load for s in vehicle_from_dict(data).power_sources}
    assert loads == {"vehicle": 5 + 2, "port": 7}
    pair = {"parts": [{"name": n, "mass": 1, "battery": {"capacity_wh": wh}} for n, wh in (("a", 20), ("b", 30))]}
    camera = {"name": "camera", "mass": 0.1, "power": 3.0}
    bolted = {"name": "v", "parts": [*pair["parts"], camera]}
    assert [s.hotel_load for s in vehicle_from_dict(bolted).power_sources] == [0, 3]


def test_a_battery_in_parallel_adds_its_capacity():
    data = vehicle(battery={"capacity_wh": 100, "hotel_load": 5})
    data["parts"].append({"name": "spare", "mass": 1, "battery": {"capacity_wh": 40, "parallel": True}})
    (source,) = vehicle_from_dict(data).power_sources
    assert (source.name, source.capacity_wh, source.hotel_load, len(source.feeds)) == ("vehicle", 140, 5, 3)
    alone = vehicle(parts=data["parts"][-1:], battery=None)
    assert [s.capacity_wh for s in vehicle_from_dict(alone).power_sources] == [40]


def test_power_is_that_of_the_file_or_of_a_t200():
    c = vehicle_from_dict(vehicle()).specific_power()
    np.testing.assert_allclose(c, [[2.0, 2.0], T200_POWER, T200_POWER])  # 128 W at 16 N: 128 / 16^1.5


def test_the_double_blueye_has_one_in_each_unit():
    sources = load_vehicle("double_blueye").power_sources
    assert {s.name: len(s.feeds) for s in sources} == {"port": 3, "starboard": 3}


@pytest.mark.parametrize(
    "battery, message", [({"capacity_wh": 0}, "greater than 0"), ({}, "missing"), ({"capacity": 3}, "capacity_wh")]
)
def test_a_battery_that_cannot_be_is_refused(battery, message):
    with pytest.raises(ConfigError, match=message):
        vehicle_from_dict(vehicle(battery=battery))


# Blue Robotics, T200 bollard test at 16 V (2019), every 40 us of pulse width: force [kgf], electrical power [W].
ASTERN = [(-4.07, 388.8), (-3.66, 309.1), (-2.99, 224.6), (-2.45, 164.3), (-1.94, 110.2), (-1.44, 70.4), (-1.02, 38.4),
          (-0.65, 19.2), (-0.32, 6.4), (-0.07, 0.8)]  # fmt: skip
AHEAD = [(0.08, 0.8), (0.40, 6.4), (0.82, 19.2), (1.28, 41.6), (1.82, 73.3), (2.43, 112.0), (3.11, 166.4),
         (3.82, 223.8), (4.65, 306.1), (5.25, 381.3)]  # fmt: skip


@pytest.mark.parametrize("points, c", [(AHEAD, T200_POWER[0]), (ASTERN, T200_POWER[1])], ids=["ahead", "astern"])
def test_a_t200_draws_what_momentum_theory_says(points, c):
    """Exponent near 3/2, coefficient as in the code, rms within a few per cent of full power."""
    force, power = np.array(points).T
    F = 9.80665 * np.abs(force)
    exponent = np.polyfit(np.log(F), np.log(power), 1)[0]
    fitted = power @ F**1.5 / (F**3).sum()
    rms = np.sqrt(np.mean((c * F**1.5 - power) ** 2)) / power.max()
    print(f"exponent {exponent:.2f}, c {fitted:.3f} W/N^1.5, rms {100 * rms:.1f} % of {power.max():.0f} W")
    assert fitted == pytest.approx(c, rel=0.02) and rms < 0.025 and 1.4 < exponent < 1.65
