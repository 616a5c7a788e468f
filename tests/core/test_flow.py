"""What flows: slots and how a link's readings get into them."""

import numpy as np

from rovtwin.core import flow
from rovtwin.core.flow import Environment, Measurement, Slot, pack
from rovtwin.core.frames import heading_rotation, quaternion_rate, rotation_from_euler
from rovtwin.core.numerics import jax, jnp

EMPTY = {"gyro": Slot.empty(3, 3), "pressure": Slot.empty(1, 1)}


def reading(sensor: str, k: int, size: int = 3) -> Measurement:
    return Measurement(sensor, np.full(size, float(k)), 0.01 * k)


def test_pack_keeps_order_time_and_structure():
    packed = pack([reading("gyro", 1), reading("pressure", 7, 1), reading("gyro", 2)], EMPTY)
    assert jax.tree.structure(packed) == jax.tree.structure(EMPTY)
    for a, b in zip(jax.tree.leaves(packed), jax.tree.leaves(EMPTY), strict=True):
        assert a.shape == b.shape and a.dtype == b.dtype
    np.testing.assert_array_equal(packed["gyro"].valid, [True, True, False])
    np.testing.assert_array_equal(packed["gyro"].value[:2], [[1, 1, 1], [2, 2, 2]])
    np.testing.assert_allclose(packed["gyro"].t_valid[:2], [0.01, 0.02])
    np.testing.assert_array_equal(packed["pressure"].value, [[7]])


def test_pack_absent_is_not_valid_and_finite():
    for slot in pack([], EMPTY).values():
        assert not slot.valid.any()
        assert np.isfinite(slot.value).all() and np.isfinite(slot.t_valid).all()


def test_pack_keeps_the_newest_of_too_many():
    packed = pack([reading("gyro", k) for k in range(5)], EMPTY)
    np.testing.assert_array_equal(packed["gyro"].value[:, 0], [2, 3, 4])
    assert packed["gyro"].valid.all()


def test_pack_leaves_out_sensors_it_does_not_know():
    assert set(pack([reading("sonar", 1)], EMPTY)) == set(EMPTY)


def test_empty_slot():
    slot = Slot.empty(2, 4)
    assert slot.value.shape == (2, 4) and slot.value.dtype == float
    assert slot.valid.shape == (2,) and slot.valid.dtype == bool and slot.t_valid.shape == (2,)


def test_calm_water_stands_still():
    for leaf, shape in zip(jax.tree.leaves(Environment.calm()), ((3,), (3,), (6,), (3,)), strict=True):
        assert leaf.shape == shape and not leaf.any()


def test_names_and_numbers_agree():
    """Phases and reasons are numbers in the loop and names in logs."""
    for name in flow.PHASES:
        assert flow.PHASES[getattr(flow, name.upper())] == name
    for name in flow.REASONS[1:]:
        assert flow.REASONS[getattr(flow, name.upper().replace(" ", "_"))] == name
    assert flow.REASONS[flow.NO_REASON] == ""


def test_all_are_pytrees_of_arrays():
    command = flow.Command(jnp.zeros(3))
    doubled = jax.jit(lambda c: jax.tree.map(lambda x: 2 * x + 1, c))(command)
    assert isinstance(doubled, flow.Command)
    np.testing.assert_array_equal(doubled.u, np.ones(3))


def test_newest_reading_of_a_slot_is_the_last_valid_one():
    slot = Slot(jnp.arange(6.0).reshape(3, 2), jnp.array([True, True, False]), jnp.zeros(3))
    before = jnp.array([-1.0, -2.0])
    np.testing.assert_array_equal(slot.newest(before), [2.0, 3.0])
    np.testing.assert_array_equal(Slot.empty(3, 2).newest(before), before)


def test_slow_motion_is_what_the_waves_leave():
    eta, nu, wave = jnp.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.9]), jnp.arange(6.0) / 10, jnp.arange(6.0) / 7
    six = jnp.zeros(6)
    estimate = flow.Estimate.from_euler(eta, nu, six, jnp.zeros((12, 12)), six, six, wave)
    R_nb, level = rotation_from_euler(eta[3:]), heading_rotation(eta[5])
    np.testing.assert_allclose(estimate.slow_position + wave[:3], eta[:3], rtol=1e-15)
    slow = estimate.slow_velocity(R_nb.T)
    np.testing.assert_allclose(R_nb @ slow + wave[3:], R_nb @ nu[:3], rtol=1e-14)
    np.testing.assert_allclose(estimate.slow_velocity_n(R_nb), R_nb @ slow, atol=1e-15)
    np.testing.assert_allclose(level @ estimate.slow_velocity(level.T), estimate.slow_velocity_n(level), atol=1e-15)


def test_a_reference_from_euler_angles_turns_as_they_do():
    eta, rate, change = np.array([1, 2, 3, 0.3, -0.5, 2.0]), np.array([0.1] * 3 + [0.2, -0.1, 0.3]), np.arange(6) / 10

    def at(t):
        return flow.Reference.from_euler(
            *(jnp.asarray(v) for v in (eta + t * rate + 0.5 * t**2 * change, rate + t * change, change))
        )

    now, h = at(0.0), 1e-5
    np.testing.assert_allclose(now.eta, eta, atol=1e-14)
    np.testing.assert_allclose(now.eta_dot, rate, atol=1e-14)
    np.testing.assert_allclose(
        quaternion_rate(now.attitude, now.angular_velocity), (at(h).attitude - at(-h).attitude) / (2 * h), atol=1e-9
    )
    np.testing.assert_allclose(
        now.angular_acceleration, (at(h).angular_velocity - at(-h).angular_velocity) / (2 * h), atol=1e-9
    )


def test_a_level_set_point_has_its_heading():
    zero, no = jnp.zeros((), int), jnp.asarray(False)
    leg = jnp.zeros(6), jnp.zeros(3), jnp.zeros(3), no, zero, zero, zero
    asked = flow.Setpoint.level(jnp.array([1.0, 2.0, 3.0]), jnp.asarray(-3.0), *leg)
    np.testing.assert_allclose(asked.heading, -3.0, atol=1e-15)
    np.testing.assert_allclose(asked.eta, [1.0, 2.0, 3.0, 0.0, 0.0, -3.0], atol=1e-15)
