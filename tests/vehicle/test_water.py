"""Density of water, and what it does to a vehicle."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.description.water import density, density_of


@pytest.mark.parametrize(
    ("temperature", "salinity", "expected"),
    [
        # Check values of EOS-80 (Unesco technical papers in marine science 44, 1983), which TEOS-10 meets to 0.01.
        (5, 0, 999.96675), (5, 35, 1027.67547), (25, 0, 997.04796), (25, 35, 1023.34306),
        (20, 0, 998.2063), (4, 0, 999.975), (0, 0, 999.843),
    ],
)  # fmt: skip
def test_density_of_sea_and_fresh_water(temperature, salinity, expected):
    assert density(temperature, salinity) == pytest.approx(expected, abs=0.01)


def test_cold_salty_water_is_heavier():
    temperatures = np.linspace(4, 40, 20)
    values = np.array([[density(t, s) for s in range(0, 43, 6)] for t in temperatures])
    assert (np.diff(values, axis=0) < 0).all() and (np.diff(values, axis=1) > 0).all()


@pytest.mark.parametrize(
    ("text", "expected"),
    [("fresh", 1000.0), ("Sea", 1025.0), ("1012.5", 1012.5), ("1.01 g/cm3", 1010.0), ("12C 34", 1025.816),
     ("5 °C, 35", 1027.676), ("-1.5c 34", density(-1.5, 34))],
)  # fmt: skip
def test_water_in_words(text, expected):
    assert density_of(text) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("salt", "expected fresh, sea, a density such as 1025"),
        ("12 34", "expected fresh, sea"),
        ("1.025", r"water density 1.025 kg/m3, expected 900 to 1100 .*Is it in g/cm3"),
        ("2000", "water density 2000"),
        ("-3C 34", "temperature -3 deg C: expected -1.9"),
        ("285C 34", "Is it in kelvin"),
        ("10C 60", "salinity 60: expected practical salinity from 0"),
        ("10C -1", "salinity -1"),
    ],
)
def test_no_such_water(text, expected):
    with pytest.raises(ConfigError, match=expected):
        density_of(text)


def test_a_neutral_vehicle_of_30_kg_gains_8_newtons_on_the_way_to_the_sea():
    vehicle = load_vehicle("double_blueye")
    pool, sea = vehicle.model(water_density=density_of("fresh")), vehicle.model(water_density=density(5, 35))
    assert float(pool.weight) == pytest.approx(30 * GRAVITY) and float(pool.buoyancy) == pytest.approx(30 * GRAVITY)
    assert float(sea.buoyancy - sea.weight) == pytest.approx(8.0, abs=0.2)
    assert float(sea.weight) == float(pool.weight)
    ratio = density(5, 35) / 1000.0
    for name in ("added_mass", "linear_damping_ahead", "quadratic_damping_astern", "displaced_mass", "buoyancy"):
        np.testing.assert_allclose(getattr(sea, name), ratio * getattr(pool, name), rtol=1e-12)
    for name in ("rigid_body_mass", "center_of_buoyancy", "center_of_gravity"):
        np.testing.assert_array_equal(getattr(sea, name), getattr(pool, name))


def test_a_vehicle_in_other_water_and_back():
    vehicle = load_vehicle("bluerov2")
    sea = vehicle.in_water(1025.0)
    assert sea.assembly.density == 1025.0 and sea.assembly.volume == vehicle.assembly.volume
    np.testing.assert_array_equal(sea.model().added_mass, vehicle.model(water_density=1025.0).added_mass)
    np.testing.assert_allclose(sea.in_water(vehicle.assembly.density).model().damping, vehicle.model().damping)
    assert sea.file == vehicle.file
    with pytest.raises(ConfigError, match="water density 1.02"):
        vehicle.in_water(1.02)
