"""Derivatives of the equations' terms, against automatic differentiation; the speed at which drag is a force."""

import numpy as np
import pytest
from tests.vehicle.random_vehicles import build

from rovtwin.core.numerics import as_array, jax
from rovtwin.vehicle.analysis.hydrostatics import floating
from rovtwin.vehicle.physics.dynamics import (
    coriolis_wrench,
    damping_force,
    damping_wrench,
    restoring_wrench,
    speed_of_drag,
)
from rovtwin.vehicle.physics.linearisation import (
    coriolis_jacobian,
    damping_jacobian,
    restoring_jacobian,
    restoring_stiffness,
)

MODELS = [build(seed) for seed in (1, 2)]
NU = as_array([0.3, -0.2, 0.1, -0.4, 0.5, 0.2])
EXACT = {"rtol": 1e-12, "atol": 1e-12}


@pytest.mark.system
@pytest.mark.parametrize("model", MODELS)
def test_jacobians_are_those_of_the_terms(model):
    drag = jax.jacfwd(lambda nu: damping_wrench(model, nu))(NU)
    np.testing.assert_allclose(damping_jacobian(model, NU), drag, **EXACT)
    np.testing.assert_allclose(damping_jacobian(model, NU, 3), drag[:3, :3], **EXACT)
    np.testing.assert_allclose(damping_force(model, NU), damping_wrench(model, NU)[:3], **EXACT)
    turning = jax.jacfwd(lambda nu: coriolis_wrench(model.inertia, nu))(NU)
    np.testing.assert_allclose(coriolis_jacobian(model.inertia, NU), turning, **EXACT)
    down = as_array([0.1, -0.3, 0.9])
    rights = jax.jacfwd(lambda d: restoring_wrench(model, d))(down)
    np.testing.assert_allclose(restoring_jacobian(model), rights, **EXACT)


def test_jacobian_of_damping_at_rest_is_the_mean_of_both_sides():
    model = MODELS[0].replace(linear_damping_astern=3.0 * MODELS[0].linear_damping_ahead)
    np.testing.assert_allclose(damping_jacobian(model, 0.0 * NU), 2.0 * model.linear_damping_ahead, **EXACT)


@pytest.mark.parametrize("model", MODELS)
def test_stiffness_is_the_slope_of_the_restoring_moment_and_what_hydrostatics_states(model):
    # Level, down_b is [0, 0, 1]; rolled by a small angle it is [0, angle, 1], pitched [-angle, 0, 1].
    rates = np.zeros((3, 2))
    rates[1, 0], rates[0, 1] = 1.0, -1.0
    found = np.asarray(restoring_stiffness(model))
    np.testing.assert_allclose(found[3:5], np.diagonal(np.asarray(restoring_jacobian(model) @ rates)[3:5]), **EXACT)
    parts = model.weight, model.buoyancy, model.center_of_gravity, model.center_of_buoyancy
    np.testing.assert_allclose(found[3:5], floating(*(np.asarray(part) for part in parts)).stiffness, **EXACT)
    np.testing.assert_array_equal(found[[0, 1, 2, 5]], 0.0)
    np.testing.assert_allclose(jax.jit(restoring_stiffness)(model), found, **EXACT)


@pytest.mark.parametrize(("linear", "quadratic"), [(20.0, 0.0), (0.0, 30.0), (20.0, 30.0)])
def test_speed_of_drag_is_that_at_which_drag_is_the_force(linear, quadratic):
    force = np.array([1e-6, 0.3, 40.0])
    speed = speed_of_drag(linear, quadratic, force)
    np.testing.assert_allclose(linear * speed + quadratic * speed**2, force, rtol=1e-12)
