"""What a log does not say of its start and of its clocks: thrusters that were off, sensors that are late."""

from dataclasses import replace

import numpy as np
import pytest
from tests.identification.synthetic import record, steps_command

from rovtwin.identification.identify import default_free, identify
from rovtwin.identification.joint.build import problem_of
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.nodes import NODE
from rovtwin.identification.joint.solver.options import Options
from rovtwin.vehicle import load_vehicle

VEHICLE = load_vehicle("double_blueye")
FREE = ["added_mass.surge", "added_mass.yaw", "quadratic_damping.surge", "quadratic_damping.yaw",
        "thrusters.surge.time_constant", "commands.delay"]  # fmt: skip
LATE = {"horizontal": 0.012, "attitude": -0.006, "depth": 0.03}


def flown(seconds, seed=3):
    """A log of the vehicle under random commands; thrusters at rest before the first."""
    t, u = steps_command(VEHICLE, seed, seconds)
    return record(VEHICLE.model(), t, u, seconds, seed)


def begun_with_thrust(seconds):
    """The same, but the first command is a hard one, and thrusters were off before it."""
    t, u = steps_command(VEHICLE, 3, seconds + 2.0)
    u[1] = 0.9 * np.sign(u[1])
    whole = record(VEHICLE.model(), t, u, seconds + 2.0, 3)
    return whole.cut(2.0, seconds + 2.0)


def late(log):
    """The same log with clocks of its sensors that are off."""
    signals = {name: replace(s, t=s.t + LATE.get(name, 0.0)) for name, s in log.signals.items()}
    return replace(log, signals=signals)


@pytest.mark.system
def test_thrusters_that_were_off_before_a_log_widen_nothing():
    """Taken as settled at the first command they left an error that passed for a disturbance, as large all along."""
    alike, begun = (identify(VEHICLE, [log], free=FREE) for log in (flown(40.0), begun_with_thrust(40.0)))
    for name in FREE:
        low, high = begun.interval(name)
        known = alike.interval(name)
        assert high - low < 1.6 * (known[1] - known[0]), name
    truth = catalogue(VEHICLE)
    for p in truth.free:
        if p.name in FREE:
            low, high = begun.interval(p.name, z=3.0)
            assert low < p.base < high, p.name


@pytest.mark.system
def test_sensors_that_are_late_are_found_and_named():
    found = identify(VEHICLE, [late(flown(40.0))], free=[*FREE, "sensors.*.delay"])
    for name, true in LATE.items():
        low, high = found.interval(f"sensors.{name}.delay", z=2.39)  # all three at once in 95 % of cases
        assert low < true < high, name
        assert high - low < (0.01 if name != "horizontal" else 0.07)  # 3 cm of noise on positions tell little
    assert any("depth by 30 +- " in remark for remark in found.findings)


@pytest.mark.system
def test_derivatives_by_delays_are_those_of_the_readings():
    names = [f"sensors.{name}.delay" for name in LATE]
    parameters = choose(catalogue(VEHICLE), ["added_mass.yaw", *names])
    n = len(parameters)
    log = flown(6.0)
    problem = problem_of(parameters, Gaussian(np.zeros(n), np.eye(n)), [log], (), Options.read({"segment": 2.0}))
    theta = np.array([0.1, *(0.013 + 0.001 * np.arange(3))])
    shooting, arrays, nodes = problem.shooting, problem.segments.arrays, problem.guess
    offsets, sigma = np.zeros(len(problem.groups)), np.full(len(problem.groups), 1e3)
    blocks = shooting.blocks(theta, offsets, nodes, sigma, arrays)

    def cost(theta):
        gaps, _ = shooting.residuals(theta, offsets, nodes, arrays)
        return sum(
            0.5 * float(np.sum(np.asarray(arrays[name]["used"])[..., None] * np.asarray(gap) ** 2))
            for name, gap in gaps.items()
        )

    slope = np.asarray(blocks.slopes)[:, :, NODE : NODE + n].sum(axis=(0, 1))
    by_difference = [(cost(theta + step) - cost(theta - step)) / 2e-5 for step in 1e-5 * np.eye(n)]
    np.testing.assert_allclose(slope[1:], by_difference[1:], rtol=1e-3, atol=1e-6)


def test_the_gyro_is_the_clock_and_sensors_that_were_not_logged_have_no_delay():
    everything, log = catalogue(VEHICLE), flown(2.0)

    def delays(log):
        return {name.split(".")[1] for name in default_free(everything, log) if name.startswith("sensors.")
                and name.endswith(".delay")}  # fmt: skip

    assert delays([log]) == {"horizontal", "depth", "attitude"}
    assert delays([log.without("gyro")]) == {"horizontal", "depth"}
    assert delays([]) == set()
    assert not [p.name for p in choose(everything, ["*"]).free if p.name.startswith("sensors.")]
