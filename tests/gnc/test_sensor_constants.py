"""Key frames hang together as a batch estimate says, and constants of sensors are found where positions know them."""

import numpy as np
import pytest

from rovtwin.core.arrays.key_frames import KeyFrames, joint_covariance
from rovtwin.core.block import Start
from rovtwin.core.errors import LogError
from rovtwin.core.flow import Slot
from rovtwin.core.frames import euler_from_quaternion
from rovtwin.core.numerics import jnp
from rovtwin.gnc.navigation.constants import (
    SensorConstant,
    estimate_constants,
    started_without,
    usual_constants,
    without,
)
from rovtwin.gnc.navigation.tuning import Mount, Tuning
from rovtwin.vehicle import load_vehicle


def chain(links=7, n=3, seed=2):
    """A random linear system, smoothed by recursion and at once by least squares over all of it."""
    rng = np.random.default_rng(seed)
    F = [np.eye(n) + 0.3 * rng.normal(size=(n, n)) for _ in range(links - 1)]
    Q, H, R, P0 = 0.2 * np.eye(n), rng.normal(size=(1, n)), np.array([[0.3]]), np.eye(n)
    information = np.zeros((links * n, links * n))
    information[:n, :n] += np.linalg.inv(P0)
    for k in range(links):
        at = slice(k * n, (k + 1) * n)
        information[at, at] += H.T @ np.linalg.inv(R) @ H
        if k < links - 1:
            both = slice(k * n, (k + 2) * n)
            step = np.hstack([-F[k], np.eye(n)])
            information[both, both] += step.T @ np.linalg.inv(Q) @ step
    filtered, predicted, P = [], [], P0
    for k in range(links):
        P = P - P @ H.T @ np.linalg.inv(H @ P @ H.T + R) @ H @ P
        filtered.append(P)
        if k < links - 1:
            P = F[k] @ P @ F[k].T + Q
            predicted.append(P)
    gains = [filtered[k] @ F[k].T @ np.linalg.inv(predicted[k]) for k in range(links - 1)]
    smoothed = [filtered[-1]]
    for k in range(links - 2, -1, -1):
        smoothed.insert(0, filtered[k] + gains[k] @ (smoothed[0] - predicted[k]) @ gains[k].T)
    return np.array(gains), np.array(smoothed), np.linalg.inv(information).reshape(links, n, links, n)


def test_covariances_between_key_frames_are_those_of_least_squares_over_all():
    gains, smoothed, whole = chain()
    T = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.0]])
    for chosen in (np.arange(7), np.array([0, 2, 6])):
        expected = np.einsum("ai,kilj,bj->kalb", T, whole[chosen][:, :, chosen], T)
        found = joint_covariance(gains, smoothed, T, chosen)
        np.testing.assert_allclose(found, expected.reshape(found.shape), atol=1e-12)


def test_gains_cut_to_the_pose_would_not_do():
    """Why products are of the whole error: what velocity carries is lost otherwise."""
    gains, smoothed, whole = chain()
    T = np.eye(3)[:1]
    cut = T @ gains[0] @ T.T @ (T @ gains[1] @ T.T) @ (T @ smoothed[2] @ T.T)
    assert abs(cut.item() - whole[0, 0, 2, 0]) > 0.01


def key_frames():
    gains, smoothed, _ = chain(n=6)
    k, c = len(smoothed), 1
    rng = np.random.default_rng(0)
    constants = np.array([0.02]), np.array([0.01]), np.array([[1e-4]]), np.array([1e-3])
    V = rng.normal(size=(k, 6, c))
    links = np.arange(float(k)), np.zeros((k, 3)), np.tile([1.0, 0, 0, 0], (k, 1)), gains, smoothed, np.eye(6)
    return KeyFrames(*links, ("attitude.heading",), V, *constants)


def test_the_file_gives_back_what_it_was_given(tmp_path):
    keys = key_frames()
    keys.save(tmp_path / "keys.nc")
    again = KeyFrames.load(tmp_path / "keys.nc")
    assert again.constants == keys.constants
    np.testing.assert_array_equal(again.joint(), keys.joint())
    with pytest.raises(LogError, match="keys.nc"):
        keys.save(tmp_path / "keys.nc")
    (tmp_path / "no.nc").write_bytes(b"nothing")
    with pytest.raises(LogError, match="no file of key frames"):
        KeyFrames.load(tmp_path / "no.nc")


def test_constants_come_on_top_of_the_poses():
    keys = key_frames()
    joint, m = keys.joint(), 6 * len(keys.t)
    V = keys.response.reshape(m, 1)
    poses = joint_covariance(keys.gains, keys.covariance, keys.pose, np.arange(len(keys.t)))
    np.testing.assert_allclose(joint[:m, :m], poses + 1e-4 * V @ V.T)
    np.testing.assert_allclose(joint[:m, m:], 1e-4 * V)
    assert np.linalg.eigvalsh(joint).min() > -1e-12


@pytest.mark.parametrize("std", [0.5, 5.0])
def test_planted_constants_are_found_with_their_deviation(std):
    rng = np.random.default_rng(1)
    J, true, steps = rng.normal(size=(2, 400)), np.array([0.3, -0.2]), np.array([0.1, 0.1])
    pulls = []
    for _ in range(300):
        z = rng.normal(size=400) - true @ J
        z[::7] = np.nan  # not used
        value, S = estimate_constants(z, z + steps[:, None] * J, z - steps[:, None] * J, steps, np.full(2, std))
        pulls.append(np.linalg.solve(np.linalg.cholesky(S), value - true))
    assert np.mean(np.square(pulls)) == pytest.approx(1.0, abs=0.12)


def slots():
    value = jnp.array([[[0.4, 0.1, 0.0]], [[0.5, 0.0, 0.1]]])
    return {name: Slot(value, jnp.ones((2, 1), bool), jnp.zeros((2, 1))) for name in ("dvl", "attitude")}


def test_constants_are_taken_out_of_the_readings():
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # the log points to the right
    tuning = Tuning.of(load_vehicle("double_blueye").model(), {"dvl": Mount(0.005, rotation=turned)})
    given, velocity = slots(), np.array([[0.4, 0.1, 0.0], [0.5, 0.0, 0.1]])
    heading = without(given, SensorConstant("heading", "attitude", 0.02), 0.02, tuning, velocity)
    np.testing.assert_allclose(heading["attitude"].value - given["attitude"].value, [[[0, 0, -0.02]]] * 2)
    # A log that is clockwise by an angle sees the velocity turned the other way; one too quick sees it longer.
    c, s = np.cos(0.1), np.sin(0.1)
    anew = turned.T @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    read = {"dvl": Slot(jnp.asarray(velocity @ anew.T)[:, None], given["dvl"].valid, given["dvl"].t_valid)}
    yaw = without(read, SensorConstant("dvl_yaw", "dvl", 0.1), 0.1, tuning, velocity)
    np.testing.assert_allclose(yaw["dvl"].value[:, 0], velocity @ turned, atol=1e-12)
    read = {"dvl": Slot(jnp.asarray(1.03 * velocity @ turned)[:, None], given["dvl"].valid, given["dvl"].t_valid)}
    scale = without(read, SensorConstant("dvl_scale", "dvl", 0.03), 0.03, tuning, velocity)
    np.testing.assert_allclose(scale["dvl"].value[:, 0], velocity @ turned, atol=1e-12)


def test_a_heading_at_the_start_comes_from_the_compass():
    start = Start(jnp.zeros(3), jnp.array([1.0, 0, 0, 0]), jnp.zeros(6))
    moved = started_without(start, SensorConstant("heading", "attitude", 0.02), 0.02)
    np.testing.assert_allclose(euler_from_quaternion(moved.attitude), [0, 0, -0.02], atol=1e-12)
    assert started_without(start, SensorConstant("dvl_yaw", "dvl", 0.02), 0.02) is start


def test_only_sensors_that_spoke_have_constants():
    tuning = Tuning.of(load_vehicle("double_blueye").model())
    assert [one.name for one in usual_constants(tuning, ["attitude", "gyro"])] == ["attitude.heading"]
    assert len(usual_constants(tuning, ["attitude", "dvl"])) == 3
    assert not usual_constants(tuning, ["attitude", "dvl"], {"heading": 0.0, "dvl_yaw": 0.0, "dvl_scale": 0.0})
