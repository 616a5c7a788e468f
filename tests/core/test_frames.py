"""Rotations: the axioms of the group, every way round between the three forms, and the thesis's printed mistake."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rovtwin.core import frames
from rovtwin.core.numerics import jax, jnp

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
EULER = np.array([0.3, 0.4, 0.5])


def random_quaternions(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def random_euler(count: int, seed: int = 0, pitch: float = np.pi / 2 - 0.05) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * np.array([np.pi, pitch, np.pi])


def batched(function, shape: tuple[int, ...]):
    """The function of single items over a batch of this shape."""
    for _ in shape:
        function = jax.vmap(function)
    return jax.jit(function)


def same_rotation(a, b, atol=1e-14):
    """q and -q are one rotation."""
    np.testing.assert_allclose(np.abs(np.sum(np.asarray(a) * np.asarray(b), axis=-1)), 1.0, atol=atol)


# -- the group


@pytest.mark.parametrize("shape", [(), (1,), (7,), (3, 2)])
def test_quaternions_are_a_group(shape):
    a, b, c = (random_quaternions(shape, seed) for seed in range(3))
    multiply, conjugate = batched(frames.quaternion_multiply, shape), batched(frames.quaternion_conjugate, shape)
    one = np.broadcast_to(IDENTITY, (*shape, 4))
    np.testing.assert_allclose(np.linalg.norm(multiply(a, b), axis=-1), 1.0, atol=1e-14)  # closed
    np.testing.assert_allclose(multiply(multiply(a, b), c), multiply(a, multiply(b, c)), atol=1e-14)
    np.testing.assert_allclose(multiply(a, one), a, atol=1e-15)
    np.testing.assert_allclose(multiply(one, a), a, atol=1e-15)
    np.testing.assert_allclose(multiply(a, conjugate(a)), one, atol=1e-14)
    np.testing.assert_allclose(multiply(conjugate(a), a), one, atol=1e-14)


@pytest.mark.parametrize("shape", [(), (7,), (3, 2)])
def test_matrices_follow_quaternions(shape):
    """R is a homomorphism into SO(3): orthogonal, right-handed, R(ab) = R(a) R(b), R(-q) = R(q)."""
    a, b = random_quaternions(shape, 1), random_quaternions(shape, 2)
    matrix, multiply = batched(frames.rotation_from_quaternion, shape), batched(frames.quaternion_multiply, shape)
    A, B = np.asarray(matrix(a)), np.asarray(matrix(b))
    np.testing.assert_allclose(A @ np.swapaxes(A, -1, -2), np.broadcast_to(np.eye(3), A.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(A), 1.0, atol=1e-14)
    np.testing.assert_allclose(matrix(multiply(a, b)), A @ B, atol=1e-14)
    np.testing.assert_allclose(matrix(-a), A, atol=1e-15)


def test_normalise():
    q = random_quaternions((), 3)
    np.testing.assert_allclose(frames.quaternion_normalise(jnp.asarray(3.7 * q)), q, atol=1e-15)


def test_quaternion_turns_as_stated():
    """Hamilton, b to n: heading east (psi = 90 degrees), forward is east and starboard is south."""
    q = jnp.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    R_nb = np.asarray(frames.rotation_from_quaternion(q))
    np.testing.assert_allclose(R_nb @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(R_nb @ [0, 1, 0], [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(frames.rotate_to_body(q, jnp.array([0.0, 1.0, 0.0])), [1, 0, 0], atol=1e-15)


def test_euler_angles_have_the_usual_signs():
    """Nose up is positive pitch, starboard down positive roll, towards east positive yaw."""
    forward, starboard = np.array([1, 0, 0]), np.array([0, 1, 0])
    roll, pitch, yaw = (np.asarray(frames.rotation_from_euler(0.1 * jnp.eye(3)[i])) for i in range(3))
    assert (roll @ starboard)[2] > 0 and (pitch @ forward)[2] < 0 and (yaw @ forward)[1] > 0


# -- round trips


@pytest.mark.system
def test_euler_quaternion_matrix_and_back():
    euler = random_euler(200)
    q = np.asarray(jax.vmap(frames.quaternion_from_euler)(euler))
    R = np.asarray(jax.vmap(frames.rotation_from_euler)(euler))
    np.testing.assert_allclose(jax.vmap(frames.rotation_from_quaternion)(q), R, atol=1e-14)
    same_rotation(jax.vmap(frames.quaternion_from_rotation)(R), q)
    np.testing.assert_allclose(jax.vmap(frames.euler_from_quaternion)(q), euler, atol=1e-12)
    np.testing.assert_allclose(jax.vmap(frames.euler_from_quaternion)(-q), euler, atol=1e-12)


def test_matrix_to_quaternion_near_every_half_turn():
    """Where the trace is -1 the naive formula divides by zero; the sign of the answer is fixed by w >= 0."""
    rng = np.random.default_rng(5)
    axes = np.concatenate([np.eye(3), rng.normal(size=(20, 3))])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for angle in (np.pi, np.pi - 1e-9, np.pi - 1e-4, 0.0, 1e-9):
        q = np.concatenate([np.full((len(axes), 1), np.cos(angle / 2)), np.sin(angle / 2) * axes], axis=1)
        back = np.asarray(jax.vmap(frames.quaternion_from_rotation)(jax.vmap(frames.rotation_from_quaternion)(q)))
        same_rotation(back, q)
        assert (back[:, 0] >= 0).all()


def test_pitch_near_ninety_degrees():
    """Angles lose their meaning one by one there, the rotation does not; at the pole itself nothing is NaN."""
    for distance in (1e-3, 1e-5, 1e-7, 0.0):
        for sign in (1, -1):
            euler = jnp.array([0.3, sign * (np.pi / 2 - distance), -1.1])
            q = frames.quaternion_from_euler(euler)
            angles = frames.euler_from_quaternion(q)
            assert np.isfinite(angles).all()
            # arcsin near 1 resolves half the digits.
            np.testing.assert_allclose(angles[1], euler[1], atol=5e-8)
            if distance > 1e-6:
                again = frames.rotation_from_euler(angles)
                np.testing.assert_allclose(again, frames.rotation_from_quaternion(q), atol=1e-7)


def test_thesis_matrix_is_no_rotation():
    """Errata 1: (2.4) as printed has theta and phi swapped in four places; determinant 0.955. Ours is a rotation."""
    (cf, ct, cp), (sf, st_, sp) = np.cos(EULER), np.sin(EULER)
    ours = np.asarray(frames.rotation_from_euler(jnp.asarray(EULER)))
    mended = [
        [cp * ct, -sp * cf + cp * st_ * sf, sp * sf + cp * cf * st_],
        [sp * ct, cp * cf + sf * st_ * sp, -cp * sf + st_ * sp * cf],
        [-st_, ct * sf, ct * cf],
    ]
    np.testing.assert_allclose(ours, mended, atol=1e-15)
    np.testing.assert_allclose(ours @ ours.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(ours) == pytest.approx(1.0, abs=1e-15)
    # The same angles about single axes, multiplied: R = R_z(psi) R_y(theta) R_x(phi).
    R_x = np.array([[1, 0, 0], [0, cf, -sf], [0, sf, cf]])
    R_y = np.array([[ct, 0, st_], [0, 1, 0], [-st_, 0, ct]])
    R_z = np.array([[cp, -sp, 0], [sp, cp, 0], [0, 0, 1]])
    np.testing.assert_allclose(ours, R_z @ R_y @ R_x, atol=1e-15)
    printed = np.array(
        [
            [cp * ct, -sp * ct + cp * st_ * sf, sp * st_ + cp * ct * sf],
            [sp * ct, cp * ct + sp * st_ * sf, -cp * st_ + sp * st_ * cf],
            [-st_, ct * sf, ct * cf],
        ]
    )
    assert np.linalg.det(printed) == pytest.approx(0.955, abs=1e-3)
    assert np.linalg.norm(printed @ printed.T - np.eye(3)) > 0.1


def test_pitch_from_a_quaternion_rounded_up():
    """A length of 1 + 1e-15 makes a sine above one."""
    angles = frames.euler_from_quaternion(jnp.sqrt(0.5) * jnp.array([1.0, 0.0, 1.0, 0.0]) * (1 + 1e-15))
    np.testing.assert_allclose(angles[1], np.pi / 2, atol=1e-7)


# -- rates


def test_rates_are_those_of_the_angles():
    """Theta_dot = T(Theta) omega and q_dot against a small turn R exp(S(omega) h)."""
    h = 1e-6
    for euler, omega in zip(random_euler(50, 1, 1.2), np.random.default_rng(2).normal(size=(50, 3)), strict=True):
        q = frames.quaternion_from_euler(jnp.asarray(euler))

        def turned(sign, q=q, omega=omega):
            size = np.linalg.norm(omega) * h
            axis = sign * omega / np.linalg.norm(omega)
            small = jnp.asarray(np.concatenate([[np.cos(size / 2)], np.sin(size / 2) * axis]))
            return frames.quaternion_multiply(q, small)

        rate = (frames.euler_from_quaternion(turned(1)) - frames.euler_from_quaternion(turned(-1))) / (2 * h)
        np.testing.assert_allclose(frames.euler_rate_matrix(jnp.asarray(euler)) @ omega, rate, rtol=1e-6, atol=1e-6)
        q_rate = (turned(1) - turned(-1)) / (2 * h)
        np.testing.assert_allclose(frames.quaternion_rate(q, jnp.asarray(omega)), q_rate, atol=1e-8)


@pytest.mark.system
def test_gradients_are_finite():
    """Also at level, at the half turn of yaw and with the arcsin near its end."""
    for euler in ([0.0, 0, 0], [0, 0, np.pi], [0.2, 1.57, 0.1], [np.pi, 0, 0]):
        slope = jax.jacobian(lambda e: frames.euler_from_quaternion(frames.quaternion_from_euler(e)))(jnp.array(euler))
        np.testing.assert_allclose(slope, np.eye(3), atol=1e-6)


# -- small things


@given(st.lists(st.floats(-10, 10), min_size=6, max_size=6))
def test_skew_and_cross_are_the_cross_product(numbers):
    a, b = np.array(numbers[:3]), np.array(numbers[3:])
    np.testing.assert_allclose(frames.cross(jnp.asarray(a), jnp.asarray(b)), np.cross(a, b), atol=1e-12)
    S = np.asarray(frames.skew(jnp.asarray(a)))
    np.testing.assert_array_equal(S, -S.T)
    np.testing.assert_allclose(S @ b, np.cross(a, b), atol=1e-12)


@given(st.floats(-50, 50))
def test_wrap(angle):
    wrapped = float(frames.wrap(jnp.asarray(angle)))
    assert -np.pi <= wrapped < np.pi
    turns = (angle - wrapped) / (2 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_wrap_at_the_seam():
    np.testing.assert_allclose(frames.wrap(jnp.array([np.pi, -np.pi, 3 * np.pi])), -np.pi)
    np.testing.assert_allclose(
        frames.wrap(jnp.deg2rad(jnp.array([[190.0, -190.0], [359.0, 720.0]]))),
        np.deg2rad([[-170.0, 170.0], [-1.0, 0.0]]),
        atol=1e-14,
    )
    assert float(jax.grad(frames.wrap)(2.0)) == 1.0


# -- other people's frames


def test_ned_enu_and_frd_flu_are_involutions():
    a = jnp.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(frames.ned_to_enu(a), [2, 1, -3])
    np.testing.assert_array_equal(frames.frd_to_flu(a), [1, -2, -3])
    np.testing.assert_array_equal(frames.enu_to_ned(frames.ned_to_enu(a)), a)
    np.testing.assert_array_equal(frames.ned_to_enu(frames.ned_to_enu(a)), a)
    np.testing.assert_array_equal(frames.flu_to_frd(frames.frd_to_flu(a)), a)


def test_attitude_in_enu_flu():
    """A vector may go body -> world by either road; facing north is yaw 90 degrees in ENU; and back again."""
    for q in random_quaternions((30,), 8):
        q = jnp.asarray(q)
        other = frames.attitude_ned_frd_to_enu_flu(q)
        v = jnp.array([0.3, -0.5, 0.8])  # in FRD
        by_ned = frames.ned_to_enu(frames.rotation_from_quaternion(q) @ v)
        by_enu = frames.rotation_from_quaternion(other) @ frames.frd_to_flu(v)
        np.testing.assert_allclose(by_enu, by_ned, atol=1e-14)
        same_rotation(frames.attitude_enu_flu_to_ned_frd(other), q)
    north = frames.euler_from_quaternion(frames.attitude_ned_frd_to_enu_flu(jnp.asarray(IDENTITY)))
    np.testing.assert_allclose(north, [0, 0, np.pi / 2], atol=1e-12)


def test_rotation_by_a_heading_is_that_of_a_level_attitude():
    R = frames.rotation_from_euler(jnp.array([0.0, 0.0, 2.1]))
    np.testing.assert_allclose(frames.yaw_rotation(jnp.asarray(2.1)), R, atol=1e-16)
    np.testing.assert_allclose(frames.heading_rotation(jnp.asarray(2.1)), R[:2, :2], atol=1e-16)


def test_small_rotations_take_one_attitude_to_another_and_back():
    q = frames.quaternion_from_euler(jnp.array([0.3, -0.4, 2.5]))
    for size in (0.0, 1e-3, 1e-2):
        angle = size * jnp.array([1.0, -0.6, 0.4])
        after = frames.quaternion_turned(q, 0.5 * angle)
        np.testing.assert_allclose(frames.rotation_between(after, q), angle, atol=size**3)
        np.testing.assert_allclose(frames.rotation_between(-after, q), angle, atol=size**3)  # the same attitude
        R = Rotation.from_quat(np.array(q), scalar_first=True) * Rotation.from_rotvec(np.array(angle))
        np.testing.assert_allclose(frames.rotation_from_quaternion(after), R.as_matrix(), atol=size**3 + 1e-15)


# -- rotation vectors, heading and tilt


def test_exponential_and_logarithm_are_those_of_scipy_at_every_size():
    axes = np.random.default_rng(3).normal(size=(9, 3))
    sizes = np.array([0.0, 1e-9, 9.9e-4, 1.01e-3, 0.1, 1.0, 2.0, 3.0, np.pi - 1e-9])
    vectors = axes / np.linalg.norm(axes, axis=1, keepdims=True) * sizes[:, None]
    q = jax.vmap(frames.quaternion_exp)(vectors)
    np.testing.assert_allclose(q, Rotation.from_rotvec(vectors).as_quat(scalar_first=True), atol=1e-15)
    for one in (q, -q):  # the same attitude
        np.testing.assert_allclose(jax.vmap(frames.quaternion_log)(one), vectors, atol=1e-13)
    R = jax.vmap(frames.rotation_from_vector)(vectors)
    np.testing.assert_allclose(R, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-15)


def test_the_logarithm_goes_the_short_way_round():
    past = frames.quaternion_exp(jnp.array([0.0, 0.0, np.pi + 0.1]))
    np.testing.assert_allclose(frames.quaternion_log(past), [0.0, 0.0, 0.1 - np.pi], atol=1e-14)


@pytest.mark.system
def test_rotation_vectors_have_a_gradient_at_zero():
    np.testing.assert_allclose(jax.jacobian(frames.quaternion_exp)(jnp.zeros(3))[1:], 0.5 * np.eye(3))
    there_and_back = jax.jacobian(lambda v: frames.quaternion_log(frames.quaternion_exp(v)))
    for size in (0.0, 5e-4, 0.7):
        np.testing.assert_allclose(there_and_back(size * jnp.array([0.6, 0.0, -0.8])), np.eye(3), atol=1e-12)


def test_the_error_of_an_attitude_turns_it_into_the_desired_one():
    q, desired = random_quaternions((2,), seed=4)
    turn = frames.quaternion_exp(frames.rotation_error(desired, jnp.asarray(q)))
    same_rotation(frames.quaternion_multiply(jnp.asarray(q), turn), desired)


def test_heading_is_the_turn_about_the_vertical_nearest_to_an_attitude():
    for q in random_quaternions((5,), seed=5):
        R, near = frames.rotation_from_quaternion(jnp.asarray(q)), np.linspace(-np.pi, np.pi, 20001)
        alike = np.cos(near) * (R[0, 0] + R[1, 1]) + np.sin(near) * (R[1, 0] - R[0, 1])  # trace of both
        away = float(frames.heading_of(jnp.asarray(q))) - near[np.argmax(alike)]
        assert abs((away + np.pi) % (2 * np.pi) - np.pi) < 4e-4


def test_heading_and_tilt_of_a_vehicle_that_rolls_or_pitches_only_are_its_angles():
    for euler, tilt in (([0.7, 0, -2.0], [0.7, 0]), ([0, -1.2, 3.0], [0, -1.2]), ([0, 0, 1.0], [0, 0])):
        q = frames.quaternion_from_euler(jnp.array(euler, dtype=float))
        np.testing.assert_allclose(frames.heading_of(q), euler[2], atol=1e-14)
        np.testing.assert_allclose(frames.heading_of(-q), euler[2], atol=1e-14)
        np.testing.assert_allclose(frames.tilt_of(q), tilt, atol=1e-14)


def test_an_attitude_is_its_heading_and_then_its_tilt():
    for q in random_quaternions((5,), seed=6):
        tilt = frames.quaternion_exp(jnp.append(frames.tilt_of(jnp.asarray(q)), 0.0))
        level = frames.level_attitude(frames.heading_of(jnp.asarray(q)))
        same_rotation(frames.quaternion_multiply(level, tilt), q)


def test_heading_and_tilt_go_on_through_a_pitch_of_ninety_degrees():
    pitch = np.radians(np.linspace(80, 100, 21))
    q = jnp.stack([frames.quaternion_multiply(frames.level_attitude(0.9), turned) for turned in _about_y(pitch)])
    np.testing.assert_allclose(frames.heading_of(q), 0.9, atol=1e-14)
    tilt = jax.vmap(frames.tilt_of)(q)
    np.testing.assert_allclose(tilt[:, 1], pitch, atol=1e-14)
    np.testing.assert_allclose(tilt[:, 0], 0.0, atol=1e-14)
    assert np.ptp(frames.euler_from_quaternion(q)[:, 2]) > 3.0, "psi turns round"


def _about_y(angles):
    return [frames.quaternion_exp(jnp.array([0.0, angle, 0.0])) for angle in angles]
