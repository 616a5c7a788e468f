"""Rotations in NumPy against those of `core.frames`, one and many at once."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rovtwin.core import frames
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


def test_skew_and_wrapped_are_those_of_frames():
    np.testing.assert_array_equal(rotations.skew(MANY[0]), frames.skew(MANY[0]))
    angles = np.array([-9.0, -np.pi, 0.0, 3.0, np.pi, 100.0])
    np.testing.assert_allclose(rotations.wrapped(angles), frames.wrap(angles), **EXACT)
