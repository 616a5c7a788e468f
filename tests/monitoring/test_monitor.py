"""The monitor on runs of the plant: what has changed is found, and what has not is not."""

from dataclasses import replace

import numpy as np
import pytest
from tests.identification.synthetic import record, steps_command

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import jnp
from rovtwin.monitoring.change import causes, changes
from rovtwin.monitoring.factors import Factors, changed
from rovtwin.monitoring.monitor import watched
from rovtwin.monitoring.quantities import Quantities
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.system

DURATION = 80.0
SEEN = ("depth", "attitude", "gyro", "velocity")


def rebuilt(model, theta):
    """A whole model with these factors: its derived arrays made anew."""
    other = changed(model, jnp.asarray(theta))
    ahead, astern, quadratic, quadratic_astern = (other.damping[:, i : i + 6] for i in range(0, 24, 6))
    damping = {"linear_damping_ahead": ahead, "linear_damping_astern": -astern}
    damping |= {"quadratic_damping_ahead": quadratic, "quadratic_damping_astern": -quadratic_astern}
    return other.replace(**damping)


def run(name, factors, seed=0, signals=SEEN, world=lambda model: model, duration=DURATION):
    """Vehicle, theta of a plant with these factors by name, and the monitor after a run of it."""
    vehicle = load_vehicle(name)
    model = vehicle.model()
    names = Factors.of(model, vehicle.thruster_names, 0.3).names
    theta = np.array([factors.get(name, 0.0) for name in names])
    t, u = steps_command(vehicle, seed, duration)
    given = record(world(rebuilt(model, theta)), t, 0.7 * u, duration, seed, signals)
    return vehicle, theta, watched(model, vehicle.thruster_names, given)


def readings(vehicle, monitor):
    found = Quantities(vehicle.model(), vehicle.thruster_names, monitor.factors).read(monitor.found())
    return {reading.quantity.name: reading for reading in found}


CASES = {
    "double_blueye": {"drag.surge": 0.2, "force.port.sway": -0.3, "added_mass.heave": 0.15},
    "bluerov2_heavy": {"drag.yaw": -0.25, "force.front_port": -0.4, "restoring.net_buoyancy": 1.5},
    "torpedo": {"drag.yaw": 0.3},
}


@pytest.mark.parametrize("name", CASES)
def test_it_finds_what_has_changed_and_its_intervals_hold(name):
    vehicle, truth, monitor = run(name, CASES[name])
    found = monitor.found()
    z = (found.theta - truth) / found.std
    assert np.mean(np.abs(z) < 1.96) > 0.9 and np.abs(z).max() < 3.5
    names, prior = monitor.factors.names, np.sqrt(np.diag(monitor.factors.covariance))
    for changed_one in CASES[name]:
        i = names.index(changed_one)
        assert found.std[i] < 0.5 * prior[i], f"{changed_one} is learnt"


def test_what_has_changed_is_reported_in_words_and_nothing_else():
    vehicle, _, monitor = run("bluerov2_heavy", {"force.front_port": -0.4})
    now = list(readings(vehicle, monitor).values())
    none = np.zeros(len(now))
    reported = changes(now, none, none)
    assert [change.reading.quantity.name for change in reported][:1] == ["thruster.front_port"]
    assert "front_port against others -3" in str(reported[0].difference)
    assert any("look at front_port" in line for line in causes(reported))
    vehicle, _, monitor = run("bluerov2_heavy", {}, seed=1)
    assert changes(list(readings(vehicle, monitor).values()), none, none) == []


@pytest.mark.parametrize("log_factor", [-1.2, -6.0])
def test_a_thruster_that_hardly_pushes_is_named_and_nothing_else(log_factor):
    vehicle, _, monitor = run("bluerov2_heavy", {"force.front_port": log_factor}, seed=4, duration=50.0)
    now = list(readings(vehicle, monitor).values())
    none = np.zeros(len(now))
    reports = [change for change in changes(now, none, none) if change.reading.quantity.group]
    if monitor.lost:  # dead: then all else is as it was
        assert [(one.name, one.since, one.left) for one in monitor.lost] == [("front_port", None, 0.0)]
        assert log_factor < -3.0 and reports == []
        return
    assert [change.reading.quantity.name for change in reports] == ["thruster.front_port"]
    assert reports[0].reading.value < -0.9


def test_top_speed_is_known_better_than_drag_or_force():
    vehicle, _, monitor = run("double_blueye", {})
    now = readings(vehicle, monitor)
    assert now["top_speed.surge"].std < 0.5 * min(now["drag.surge"].std, now["force.surge"].std)


def test_a_model_that_is_not_exact_widens_what_it_says():
    """Thrusters whose curve bends otherwise: what is said of drag and added mass must not be sure of a wrong value."""

    def bent(model):
        return model.replace(thrusters=replace(model.thrusters, exponent=model.thrusters.exponent * 1.4))

    _, _, exact = run("double_blueye", {}, seed=2)
    _, _, broken = run("double_blueye", {}, seed=2, world=bent)
    assert np.median(broken.found().std / exact.found().std) > 1.1
    rows = [i for i, name in enumerate(exact.factors.names) if name.startswith(("drag", "added_mass"))]
    z = (broken.found().theta / broken.found().std)[rows]
    assert np.mean(np.abs(z) < 2.6) > 0.85


def test_without_a_velocity_it_says_less_and_still_holds():
    _, truth, monitor = run("double_blueye", {"drag.surge": 0.2}, signals=("horizontal", "depth", "attitude", "gyro"))
    found = monitor.found()
    assert np.abs((found.theta - truth) / found.std).max() < 3.5


def test_what_it_cannot_use_is_reported():
    vehicle = load_vehicle("double_blueye")
    t, u = steps_command(vehicle, 0, 30.0)
    given = record(vehicle.model(), t, u, 30.0)
    with pytest.raises(IdentificationError, match=r"found attitude, depth, horizontal, expected attitude and gyro"):
        watched(vehicle.model(), vehicle.thruster_names, given.without("gyro"))
    with pytest.raises(IdentificationError, match=r"10 s with readings, expected 20 s"):
        watched(vehicle.model(), vehicle.thruster_names, given.cut(0.0, 10.0))
    assert watched(vehicle.model(), vehicle.thruster_names, given).far < 1e-3
    gyro = given.signals["gyro"]
    turned = replace(given, signals=given.signals | {"gyro": replace(gyro, value=-gyro.value)})
    assert watched(vehicle.model(), vehicle.thruster_names, turned).far > 0.05
