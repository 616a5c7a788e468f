"""A perturbed plant: each coefficient its own draw, masses and thrust by their factors, everything else as it was."""

import numpy as np
import pytest
from tests.simulation.helper import vehicle

from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.mismatch import DAMPING, drawn, lifted, perturbed
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.thrusters import static_force

MODEL = vehicle()
KEY = jax.random.key(4)


def ratios(plant):
    diagonals = [np.diag(getattr(plant, name)) / np.diag(getattr(MODEL, name)) for name in DAMPING]
    return np.concatenate(diagonals)


def test_every_damping_coefficient_has_its_own_draw():
    lopsided = MODEL.replace(
        linear_damping_astern=2.0 * MODEL.linear_damping_ahead,
        quadratic_damping_astern=2.0 * MODEL.quadratic_damping_ahead,
    )
    both = perturbed(lopsided, KEY)
    assert len(np.unique([np.diag(getattr(both, n)) / np.diag(getattr(lopsided, n)) for n in DAMPING])) == 24
    plant = perturbed(MODEL, KEY)
    factors = ratios(plant)
    assert len(np.unique(factors)) == 12, "what is one coefficient ahead and astern has one draw"
    np.testing.assert_array_equal(plant.quadratic_damping_astern, plant.quadratic_damping_ahead)
    assert factors.min() >= 0.75 and factors.max() <= 1.25
    assert not np.asarray(plant.linear_damping_ahead)[~np.eye(6, dtype=bool)].any()
    many = np.stack([ratios(perturbed(MODEL, key)) for key in jax.random.split(KEY, 30)])
    assert many.min() < 0.76 and many.max() > 1.24
    assert abs(many.mean() - 1.0) < 4 * 0.5 / np.sqrt(12 * many.size / 2)
    np.testing.assert_array_equal(ratios(perturbed(MODEL, KEY)), factors)


def test_masses_and_thrust_by_their_factors():
    plant = perturbed(MODEL, KEY)
    for name in ("rigid_body_mass", "added_mass", "inertia", "weight", "buoyancy", "displaced_mass"):
        np.testing.assert_allclose(getattr(plant, name), 1.1 * getattr(MODEL, name), rtol=1e-14)
    np.testing.assert_allclose(plant.inertia_inverse @ plant.inertia, np.eye(6), atol=1e-12)
    u = jnp.array([1.0, -1.0, 0.5, -0.5, 0.1, 0.0])
    np.testing.assert_allclose(static_force(plant.thrusters, u), 0.9 * static_force(MODEL.thrusters, u), rtol=1e-14)
    for name in ("center_of_gravity", "center_of_buoyancy"):
        np.testing.assert_array_equal(getattr(plant, name), getattr(MODEL, name))


def test_what_was_drawn_gives_the_plant_back_from_the_model():
    lopsided = MODEL.replace(
        quadratic_damping_astern=2.0 * MODEL.quadratic_damping_ahead,
        linear_damping_ahead=MODEL.linear_damping_ahead.at[5, 1].set(0.3),
    )
    plant = perturbed(lopsided, KEY, 0.25, 1.2, 0.8)
    factors = drawn(lifted(plant, 3.0), lopsided)
    assert factors["mass"] == pytest.approx(1.2) and factors["thrust"] == pytest.approx(0.8)
    for i, axis in enumerate(AXES):
        ahead, astern = factors[f"quadratic_damping.{axis}"], factors[f"quadratic_damping_astern.{axis}"]
        assert ahead != astern
        own = lopsided.quadratic_damping_astern[i, i]
        np.testing.assert_allclose(astern * own, plant.quadratic_damping_astern[i, i], rtol=1e-12)
    moment = factors["linear_damping.sway_yaw"] * 0.3
    np.testing.assert_allclose(moment, plant.linear_damping_ahead[5, 1], rtol=1e-12)


def test_factors_of_one_change_nothing():
    plant = perturbed(MODEL, KEY, damping=0.0, mass=1.0, thrust=1.0)
    for a, b in zip(jax.tree.leaves(plant), jax.tree.leaves(MODEL), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)


def test_lifted_has_so_much_more_buoyancy():
    plant = lifted(MODEL, 2.0)
    assert float(plant.buoyancy - MODEL.buoyancy) == 2.0
    np.testing.assert_allclose(plant.displaced_mass, plant.buoyancy / 9.81)
    np.testing.assert_array_equal(plant.weight, MODEL.weight)
