"""The mixing of ArduSub's axes, from a vehicle's own thrusters."""

import pickle

import numpy as np
import pytest

from rovtwin.links.ardusub_json.motors import BLUEROV2_HEAVY
from rovtwin.links.mavlink.mixing import mixer, shares
from rovtwin.vehicle import load_vehicle

# ArduPilot, AP_Motors6DOF.cpp, SUB_FRAME_VECTORED_6DOF: roll, pitch, yaw, throttle (up), forward, lateral; motors 1-8.
ARDUSUB = np.array(
    [
        [0, 0, 1, 0, -1, 1],
        [0, 0, -1, 0, -1, -1],
        [0, 0, -1, 0, 1, 1],
        [0, 0, 1, 0, 1, -1],
        [1, -1, 0, -1, 0, 0],
        [-1, -1, 0, -1, 0, 0],
        [1, 1, 0, -1, 0, 0],
        [-1, 1, 0, -1, 0, 0],
    ]
)


@pytest.fixture(scope="module")
def heavy():
    vehicle = load_vehicle("bluerov2_heavy")
    return vehicle.thruster_names, vehicle.model().thrusters


@pytest.fixture(scope="module")
def mixing(heavy):
    return mixer(heavy[1])


def test_factors_are_ardusubs(heavy, mixing):
    """Our T and ArduSub's table say the same of each motor, given the order and signs that lockstep uses."""
    names, _ = heavy
    roll, pitch, yaw, up, forward, lateral = ARDUSUB.T
    table = np.stack([forward, lateral, -up, roll, pitch, yaw], axis=1)
    for motor, (name, sign) in enumerate(zip(BLUEROV2_HEAVY.names, BLUEROV2_HEAVY.signs, strict=True)):
        np.testing.assert_array_equal(mixing.factors[names.index(name)], sign * table[motor], err_msg=name)


def test_axes_of_what_axes_can_say(mixing):
    axes = np.array([0.3, -0.2, 0.25, 0.1, -0.15, 0.4])
    np.testing.assert_allclose(mixing.axes(mixing.commands(axes)), axes, atol=1e-12)


def test_u_of_one_direction_arrives_whole(heavy, mixing):
    """What a symmetric allocation wants along one axis is in reach of the axes: nothing of the force is lost."""
    for axis in range(6):
        expected = np.zeros(6)
        expected[axis] = 0.4
        u = mixing.command_of_motion(expected)
        np.testing.assert_allclose(mixing.commands(mixing.axes(u)), u, atol=1e-6)


def test_motion_is_undone(mixing):
    """A share of the largest force, as the physics take it, gives back the thrusters' commands."""
    axes = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    u = mixing.commands(axes)
    np.testing.assert_allclose(mixing.command_of_motion(mixing.motion(axes)), u, atol=0.01)
    # Half the command is less than half the force: the curve of the thrusters bends.
    assert 0.4 < mixing.motion(axes)[0] < 0.6 and mixing.motion(axes)[0] != pytest.approx(0.5, abs=0.02)


def test_full_axes_are_full_shares(mixing):
    for axis in np.vstack([np.eye(6), -np.eye(6)]):
        np.testing.assert_allclose(mixing.motion(axis), axis, atol=1e-9)


def test_more_than_all_is_scaled_by_group(mixing):
    u = mixing.commands(np.array([1.0, 0.0, 0.2, 0.0, 0.0, 1.0]))
    assert np.abs(u).max() == 1.0
    vertical = np.any(mixing.factors[:, 2:5] != 0, axis=1)
    np.testing.assert_allclose(np.abs(u[vertical]), 0.2)


def test_axes_never_beyond_full(mixing):
    rng = np.random.default_rng(1)
    for u in rng.uniform(-1, 1, (50, 8)):
        assert np.abs(mixing.axes(u)).max() <= 1.0


def test_can_be_pickled(heavy, mixing):
    again = pickle.loads(pickle.dumps(shares(heavy[1])))
    u = np.linspace(-0.5, 0.5, 8)
    np.testing.assert_array_equal(again(u), mixing.axes(u))
