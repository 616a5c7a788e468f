"""A thruster that is dead or reversed from some time on is named, and what else the record tells stays true."""

from dataclasses import replace

import numpy as np
import pytest
from tests.identification.synthetic import record, steps_command
from tests.monitoring.test_monitor import SEEN, rebuilt

from rovtwin.monitoring.change import changes
from rovtwin.monitoring.evidence import marginal
from rovtwin.monitoring.factors import Factors
from rovtwin.monitoring.monitor import watched
from rovtwin.monitoring.quantities import Quantities
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.system

DURATION, SINCE, HOLD = 60.0, 30.0, 2.0


def after(name, factors, thruster=None, left=1.0, seed=0):
    """The monitor after a record in which a thruster has lost its force since SINCE, and what it calls changed."""
    vehicle = load_vehicle(name)
    model = vehicle.model()
    names = Factors.of(model, vehicle.thruster_names, 0.3).names
    theta = np.array([factors.get(name, 0.0) for name in names])
    t, u = steps_command(vehicle, seed, DURATION, HOLD)
    given, pushed = 0.5 * u, 0.5 * u
    if thruster is not None:
        pushed = pushed.copy()
        pushed[t >= SINCE, vehicle.thruster_names.index(thruster)] *= left
    log = replace(record(rebuilt(model, theta), t, pushed, DURATION, seed, SEEN), command=given)
    monitor = watched(model, vehicle.thruster_names, log)
    now = Quantities(model, vehicle.thruster_names, monitor.factors).read(monitor.found())
    none = np.zeros(len(now))
    return monitor, [change.reading.quantity.name for change in changes(now, none, none)]


@pytest.mark.parametrize("left", [0.0, -1.0])
@pytest.mark.parametrize(("name", "thruster"), [("double_blueye", "port.surge"), ("blueye_x3", "port")])
def test_a_thruster_lost_half_way_is_named_with_its_time_and_nothing_else_changes(name, thruster, left):
    monitor, changed = after(name, {}, thruster, left)
    (lost,) = monitor.lost
    assert (lost.name, lost.left) == (thruster, left)
    assert lost.since == pytest.approx(SINCE, abs=HOLD + 0.1), "to the next command that asks for anything of it"
    assert ("wrong way" in str(lost)) == (left < 0.0) and f"from {lost.since:.0f} s on" in str(lost)
    assert changed == [] and monitor.doubts == []


def test_a_real_change_is_no_lost_thruster():
    """A load, more drag, a thruster that is weak: all are factors, and each is found as such."""
    factors = {"added_mass.surge": 0.4, "drag.sway": 0.4, "force.port.heave": -0.5}
    monitor, changed = after("double_blueye", factors)
    assert monitor.lost == () and monitor.doubts == []
    assert "thruster.port.heave" in changed
    found, names = monitor.found(), monitor.factors.names
    z = [(found.theta[names.index(name)] - value) / found.std[names.index(name)] for name, value in factors.items()]
    assert np.abs(z).max() < 3.0


def test_beside_a_lost_thruster_a_real_change_is_still_found():
    monitor, changed = after("double_blueye", {"drag.surge": 0.6}, "port.sway", -1.0)
    assert [lost.name for lost in monitor.lost] == ["port.sway"]
    assert set(changed) <= {"drag.surge", "top_speed.surge"} and changed


def test_a_record_without_a_lost_thruster_has_none():
    monitor, changed = after("blueye_x3", {}, seed=3)
    assert monitor.lost == () and changed == []


def test_the_likelihood_whatever_the_factors_is_that_of_a_gaussian():
    """Of y = H theta + noise, wherever it is linearised."""
    rng = np.random.default_rng(5)
    H, prior = rng.standard_normal((40, 3)), np.diag([0.3, 1.0, 2.0]) + 0.1
    y = H @ rng.multivariate_normal(np.zeros(3), prior) + rng.standard_normal(40)
    S = np.eye(40) + H @ prior @ H.T
    exact = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
    for held in (np.zeros(3), np.array([0.5, -1.0, 2.0])):
        fit = -0.5 * np.sum((y - H @ held) ** 2)
        assert marginal(fit, H.T @ H, H.T @ y, held, prior) == pytest.approx(exact)
