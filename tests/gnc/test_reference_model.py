from dataclasses import replace

import numpy as np
import pytest

from rovtwin.core.block import Start
from rovtwin.core.flow import Setpoint
from rovtwin.core.frames import (
    quaternion_exp,
    quaternion_from_euler,
    quaternion_log,
    quaternion_rate,
    rotation_error,
)
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.control.reference_model import ReferenceModel

KEY = jax.random.key(0)


def setpoint(eta, nu=np.zeros(6)):
    zero = jnp.zeros((), dtype=int)
    eta, nu = jnp.asarray(eta, dtype=float), jnp.asarray(nu, dtype=float)
    return Setpoint(
        eta[:3], quaternion_from_euler(eta[3:]), nu, jnp.zeros(3), jnp.zeros(3), jnp.asarray(False), zero, zero, zero
    )


def follow(model, start, target, dt, n):
    """References at dt, 2 dt, ... n dt."""
    memory = model.init(KEY, start)
    return jax.lax.scan(lambda m, _: model.step(m, target, dt), memory, None, length=n)[1]


def analytic(delta, w, t):
    """Unit step response of w^2 / (s^2 + 2 delta w s + w^2), by its poles."""
    if delta == 1:
        return 1 - (1 + w * t) * np.exp(-w * t)
    p, q = np.roots([1, 2 * delta * w, w * w]).astype(complex)
    return np.real(1 + (q * np.exp(p * t) - p * np.exp(q * t)) / (p - q))


@pytest.mark.parametrize("dt", [0.02, 0.5])
@pytest.mark.parametrize("delta", [0.3, 0.9, 1 - 1e-6, 1.0, 1 + 1e-6, 1.2, 3.0])
def test_step_response_is_exact(delta, dt):
    model = ReferenceModel(jnp.full(6, delta), jnp.full(6, 1.5), jnp.full(6, jnp.inf))
    n = round(6 / dt)
    turn = jnp.array([0.1, -0.2, 0.5])
    there = replace(setpoint([2.0, 0.0, 7.0, 0, 0, 0]), attitude=quaternion_exp(turn))
    path = follow(model, Start.at((1.0, 2.0, 3.0)), there, dt, n)
    expected = analytic(delta, 1.5, dt * np.arange(1, n + 1))[:, None]
    begin, end = np.array([1, 2, 3]), np.array([2, 0, 7])
    # Close to critical damping it is the oracle that loses digits: its two poles cancel.
    accuracy = 3e-9 if 0 < abs(delta - 1) < 1e-3 else 1e-11
    np.testing.assert_allclose(path.position, begin + (end - begin) * expected, atol=accuracy)
    np.testing.assert_allclose(jax.vmap(quaternion_log)(path.attitude), turn * expected, atol=accuracy)


def test_rates_are_the_derivatives_of_the_path():
    dt = 1e-3
    path = follow(ReferenceModel.thesis(), Start.at(), setpoint([1, -2, 3, 0.2, 0, 2.0]), dt, 3000)

    def differs(value, rate, atol):
        np.testing.assert_allclose(np.gradient(value, dt, axis=0)[1:-1], rate[1:-1], atol=atol)

    differs(path.position, path.velocity, 1e-5)
    differs(path.velocity, path.acceleration, 3e-5)
    differs(path.attitude, jax.vmap(quaternion_rate)(path.attitude, path.angular_velocity), 1e-5)
    differs(path.angular_velocity, path.angular_acceleration, 3e-5)


def test_an_attitude_whose_axes_have_bandwidths_of_their_own_arrives_and_its_rate_is_the_one_it_turns_at():
    dt, w = 1e-3, jnp.array([1.5, 1.5, 1.5, 0.8, 2.0, 1.2])
    model = ReferenceModel(jnp.ones(6), w, jnp.full(6, jnp.inf))
    there = setpoint([0, 0, 0, 1.0, 0.8, 2.5])
    path = follow(model, Start.at(), there, dt, 15000)
    rate = np.gradient(path.attitude, dt, axis=0)[1:-1]
    turns = jax.vmap(quaternion_rate)(path.attitude, path.angular_velocity)[1:-1]
    np.testing.assert_allclose(rate, turns, atol=2e-3)  # the tick's own length: to first order
    np.testing.assert_allclose(rotation_error(there.attitude, path.attitude[-1]), 0.0, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(path.attitude, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize(("begin", "end"), [(3.0, -3.0), (-3.0, 3.0), (0.5, -2.0), (-3.1, 0.0)])
def test_heading_goes_the_short_way_round(begin, end):
    path = follow(ReferenceModel.thesis(), Start.at(heading=begin), setpoint([0, 0, 0, 0, 0, end]), 0.02, 600)
    heading = np.asarray(path.eta[:, 5])
    assert np.all(np.abs(heading) <= np.pi)
    turned = np.unwrap(np.append(begin, heading)) - begin
    short = (end - begin + np.pi) % (2 * np.pi) - np.pi
    assert turned[-1] == pytest.approx(short, abs=1e-4)
    assert np.all(np.diff(turned) * np.sign(short) >= 0)  # monotone: critically damped
    np.testing.assert_allclose(turned[1:], short * analytic(1.0, 1.5, 0.02 * np.arange(1, 601)), atol=1e-9)


def test_begins_where_the_vehicle_is_and_as_it_moves():
    euler = jnp.array([0.1, -0.2, 2.5])
    start = Start(jnp.array([4.0, 5.0, 6.0]), quaternion_from_euler(euler), jnp.array([0.3, 0, 0, 0, 0, 0.1]))
    memory = ReferenceModel.thesis().init(KEY, start)
    np.testing.assert_allclose(memory.eta, [4, 5, 6, 0.1, -0.2, 2.5], atol=1e-12)
    assert np.hypot(*memory.velocity[:2]) == pytest.approx(0.3 * np.cos(0.2))
    at_rest = ReferenceModel.thesis().init(KEY, Start.at((4.0, 5.0, 6.0), 2.5))
    after, _ = ReferenceModel.thesis().step(at_rest, setpoint([4, 5, 6, 0, 0, 2.5]), 0.02)
    np.testing.assert_allclose(after.eta, at_rest.eta, atol=1e-12)
    np.testing.assert_allclose(memory.angular_velocity, [0.0, 0.0, 0.1])


def test_speed_of_the_way_point_is_kept_on_a_straight_path_without_overshoot():
    speed, target = 0.25, np.array([3.0, -4.0, 1.0, 0, 0, 0])
    expected = setpoint(target, [speed, 0, 0, 0, 0, 0])
    path = follow(ReferenceModel.thesis(obey_speed=True), Start.at(), expected, 0.02, 2000)
    going = np.hypot(path.velocity[:, 0], path.velocity[:, 1])
    assert going.max() == pytest.approx(speed, rel=1e-9)
    along = np.asarray(path.eta[:, :2]) @ [0.6, -0.8]
    np.testing.assert_allclose(path.eta[:, :2], along[:, None] * [0.6, -0.8], atol=1e-9)
    assert along.max() <= 5.0 and along[-1] == pytest.approx(5.0, abs=1e-3)
    assert np.all(np.diff(along) >= 0) and np.diff(along).max() <= speed * 0.02 + 1e-12
    assert 5.0 / speed < 0.02 * np.argmax(along > 4.99) < 5.0 / speed + 6

    free = follow(ReferenceModel.thesis(), Start.at(), expected, 0.02, 400)
    assert np.hypot(*np.asarray(free.velocity[:, :2]).T).max() > 2.0


def test_speed_of_the_way_point_is_kept_while_diving():
    down = setpoint([0, 0, 3.0, 0, 0, 0], [0, 0, 0.2, 0, 0, 0])
    path = follow(ReferenceModel.thesis(obey_speed=True), Start.at(), down, 0.02, 1500)
    assert path.velocity[:, 2].max() == pytest.approx(0.2, rel=1e-9)
    assert path.eta[:, 2].max() <= 3.0 and path.eta[-1, 2] == pytest.approx(3.0, abs=1e-3)


def test_speed_limit_of_an_axis():
    limit = jnp.array([jnp.inf, jnp.inf, 0.1, jnp.inf, jnp.inf, 0.2])
    model = ReferenceModel(jnp.ones(6), jnp.full(6, 1.5), limit)
    path = follow(model, Start.at(), setpoint([1, 1, 2.0, 0, 0, 3.0]), 0.02, 1500)
    rate = np.concatenate([path.velocity, path.angular_velocity], axis=1)
    assert np.all(np.abs(rate) <= limit + 1e-12)
    np.testing.assert_allclose(path.eta[-1], [1, 1, 2, 0, 0, 3], atol=1e-3)
    np.testing.assert_allclose(np.diff(path.eta[:, 2])[100:500], 0.1 * 0.02, atol=1e-12)


@pytest.mark.system
@pytest.mark.parametrize("delta", [0.7, 1.0, 1.4])
def test_gradient_by_its_parameters(delta):
    def end(delta, w):
        model = ReferenceModel(jnp.full(6, delta), jnp.full(6, w), jnp.full(6, jnp.inf))
        return follow(model, Start.at(), setpoint([1.0, 0, 0, 0, 0, 0]), 0.02, 50).eta[-1, 0]

    slope = jax.jit(jax.grad(end, argnums=(0, 1)))(delta, 1.5)
    h = 1e-4
    by_delta = (analytic(delta + h, 1.5, 1.0) - analytic(delta - h, 1.5, 1.0)) / (2 * h)
    by_w = (analytic(delta, 1.5 + h, 1.0) - analytic(delta, 1.5 - h, 1.0)) / (2 * h)
    np.testing.assert_allclose(slope, [by_delta, by_w], atol=1e-6)
