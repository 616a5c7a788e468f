"""Rotations in NumPy against those of `core.frames`, one and many at once."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rovtwin.core import flow, frames
from rovtwin.core.arrays import rotations

MANY = np.array([[0.1, -0.7, 2.0], [-3.0, 1.2, -1.0], [0.4, 0.0, 3.1]])
EXACT = {"rtol": 0.0, "atol": 1e-14}


@given(st.tuples(*[st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)]))
def test_rotation_of_euler_angles_and_back(angles):
    R = rotations.rotation_from_euler(np.array(angles))
    np.testing.assert_allclose(R, frames.rotation_from_euler(np.array(angles)), **EXACT)
    np.testing.assert_allclose(rotations.euler_from_rotation(R), angles, atol=1e-7)


def test_many_are_one_by_one():
    R, q = rotations.rotation_from_euler(MANY), rotations.quaternion_from_euler(MANY)
    for i, euler in enumerate(MANY):
        np.testing.assert_allclose(R[i], frames.rotation_from_euler(euler), **EXACT)
        np.testing.assert_allclose(q[i], frames.quaternion_from_euler(euler), **EXACT)
    np.testing.assert_allclose(rotations.euler_from_rotation(R), MANY, atol=1e-12)
    np.testing.assert_array_equal(rotations.rotation_from_euler(MANY[None]), R[None])
    np.testing.assert_array_equal(rotations.quaternion_from_euler(MANY[0]), q[0])


def test_a_heading_turns_ahead_and_starboard_clockwise_seen_from_above():
    np.testing.assert_allclose(rotations.turn_about_z(math.pi / 2) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], **EXACT)
    headings = MANY[:, 2]
    np.testing.assert_allclose(rotations.heading_rotation(headings)[2], frames.heading_rotation(headings[2]), **EXACT)
    np.testing.assert_allclose(rotations.turn_about_z(0.3), frames.yaw_rotation(0.3), **EXACT)


def test_heading_and_tilt_are_those_of_frames():
    q = rotations.quaternion_from_euler([*MANY, [0.0, 0.0, 1.0], [0.0, np.radians(89.9), 0.5]])
    np.testing.assert_allclose(rotations.heading_of(q), frames.heading_of(q), **EXACT)
    np.testing.assert_allclose(rotations.tilt_of(q), [frames.tilt_of(one) for one in q], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(rotations.tilt_of([math.cos(0.9), 0.0, math.sin(0.9), 0.0]), [0.0, 1.8], **EXACT)


def test_skew_and_wrapped_are_those_of_frames():
    np.testing.assert_array_equal(rotations.skew(MANY[0]), frames.skew(MANY[0]))
    angles = np.array([-9.0, -np.pi, 0.0, 3.0, np.pi, 100.0])
    np.testing.assert_allclose(rotations.wrapped(angles), frames.wrap(angles), **EXACT)


def test_poses_with_euler_angles_are_those_of_the_flow():
    q, omega = rotations.quaternion_from_euler(MANY), np.array([0.3, -0.2, 0.5])
    place, velocity = np.arange(9.0).reshape(3, 3), np.full(3, 0.1)
    np.testing.assert_allclose(rotations.pose(place, q), np.concatenate([place, MANY], axis=1), atol=1e-13)
    for one, eta in zip(q, rotations.pose(place, q), strict=True):
        reference = flow.Reference(eta[:3], one, velocity, omega, velocity, omega)
        np.testing.assert_allclose(rotations.pose(eta[:3], one), reference.eta, **EXACT)
        np.testing.assert_allclose(rotations.pose_rate(velocity, omega, one), reference.eta_dot, atol=1e-12)


@pytest.mark.system
def test_the_covariance_of_a_pose_is_that_of_its_euler_angles():
    factor, six = np.random.default_rng(1).normal(size=(3, 12, 12)), np.zeros(6)
    expected = factor @ np.swapaxes(factor, 1, 2)
    made = [
        flow.Estimate.from_euler(np.append(six[:3], e), six, six, C, six, six)
        for e, C in zip(MANY, expected, strict=True)
    ]
    covariance, attitude = (np.stack([getattr(one, name) for one in made]) for name in ("covariance", "attitude"))
    assert not np.allclose(covariance, expected)
    np.testing.assert_allclose(rotations.pose_covariance(covariance, attitude), expected, rtol=1e-9, atol=1e-9)
    sampled = np.random.default_rng(2).multivariate_normal(np.zeros(12), 1e-8 * covariance[0], 20_000)[:, 3:6]
    turned = [frames.quaternion_exp(v) for v in sampled[:2000]]
    angles = rotations.euler_from_quaternion([frames.quaternion_multiply(attitude[0], q) for q in turned])
    np.testing.assert_allclose(np.cov(angles.T), 1e-8 * expected[0][3:6, 3:6], rtol=0.3, atol=3e-9)


def test_skew_of_many_and_back():
    S = rotations.skew(MANY)
    for one, a in zip(S, MANY, strict=True):
        np.testing.assert_array_equal(one, rotations.skew(a))
        np.testing.assert_allclose(one @ [0.3, -0.2, 0.5], np.cross(a, [0.3, -0.2, 0.5]), **EXACT)
    np.testing.assert_allclose(rotations.vector_of_skew(S + np.eye(3)), MANY, **EXACT)


def test_angle_between_attitudes_is_the_length_of_their_logarithm():
    R = rotations.rotation_from_euler(MANY)
    turn = R[0] @ np.asarray(frames.rotation_from_vector(np.array([0.2, -0.1, 0.4])))
    assert rotations.angle_between(R[0], turn) == pytest.approx(np.sqrt(0.21), abs=1e-12)
    np.testing.assert_allclose(rotations.angle_between(R, R), 0.0, atol=3e-8)
