"""An inertial sensor that is mounted askew."""

import numpy as np
import pytest
from tests.identification.broken import Broken, axis_steps, record
from tests.identification.synthetic import steps_command

from rovtwin.identification.identify import default_free, identify
from rovtwin.identification.joint.build import problem_of
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.nodes import NODE
from rovtwin.identification.joint.model.parameters import MOUNTING
from rovtwin.identification.joint.solver.options import Options
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.system

VEHICLE = load_vehicle("double_blueye")
ASKEW = np.deg2rad([2.5, -1.5, 2.0])
FREE = ["restoring.*", "added_mass.roll", "added_mass.pitch", "linear_damping.roll", "linear_damping.pitch",
        "sensors.gyro.*"]  # fmt: skip


def turning(duration):
    """A log of the vehicle turning about all axes, attitude and gyro seen by a sensor that is askew."""
    t, u = steps_command(VEHICLE, 5, duration)
    return record(VEHICLE.model(), Broken(askew=tuple(ASKEW)), t, u, duration, 5, ("position", "attitude", "gyro"))


@pytest.fixture(scope="module")
def found():
    return identify(VEHICLE, [turning(40.0)], free=FREE)


def test_a_tilted_sensor_is_not_put_down_to_the_center_of_buoyancy(found):
    model = VEHICLE.model()
    lever = np.asarray(model.center_of_buoyancy) - np.asarray(model.center_of_gravity)
    for axis, true in zip("xy", lever[:2], strict=True):
        low, high = found.interval(f"restoring.center_of_buoyancy_{axis}")
        assert low < true < high
        assert high - low < 0.2 * ASKEW[0] * abs(lever[2])


def test_the_mounting_of_the_gyro_is_within_its_width_and_reported(found):
    for name, true in zip(MOUNTING, ASKEW, strict=True):
        low, high = found.interval(name, z=2.39)  # all three at once in 95 % of cases
        assert low < true < high, name
    assert any("the gyro is mounted askew by 2." in remark for remark in found.findings)


def test_derivatives_are_those_of_the_readings():
    parameters = choose(catalogue(VEHICLE), ["added_mass.yaw", "sensors.gyro.*"])
    t, u = axis_steps(VEHICLE, 0, 6.0, hold=1.5)
    log = record(VEHICLE.model(), Broken(), t, u, 6.0, signals=("position", "attitude", "gyro"))
    n = len(parameters)
    problem = problem_of(parameters, Gaussian(np.zeros(n), np.eye(n)), [log], (), Options.read({"segment": 2.0}))
    theta = np.array([0.1, 0.02, -0.01, 0.03])
    shooting, arrays, nodes = problem.shooting, problem.segments.arrays, problem.guess
    offsets, sigma = np.zeros(len(problem.groups)), np.full(len(problem.groups), 1e3)
    blocks = shooting.blocks(theta, offsets, nodes, sigma, arrays)

    def cost(theta):
        gaps, _ = shooting.residuals(theta, offsets, nodes, arrays)
        return 0.5 * float(np.sum(np.asarray(arrays["gyro"]["used"])[..., None] * np.asarray(gaps["gyro"]) ** 2))

    rows = [i for i, (name, _) in enumerate(problem.groups) if name == "gyro"]
    slope = np.asarray(blocks.slopes)[:, rows, NODE : NODE + n].sum(axis=(0, 1))
    steps = 1e-5 * np.eye(n)
    by_difference = [(cost(theta + step) - cost(theta - step)) / 2e-5 for step in steps]
    np.testing.assert_allclose(slope[1:], by_difference[1:], rtol=1e-4, atol=1e-6)


def test_it_is_a_parameter_where_a_gyro_was_logged():
    everything = catalogue(VEHICLE)
    assert not set(MOUNTING) & set(default_free(everything, []))
    log = turning(4.0)
    assert set(MOUNTING) <= set(default_free(everything, [log]))
    assert not set(MOUNTING) & set(default_free(everything, [log.without("gyro")]))
