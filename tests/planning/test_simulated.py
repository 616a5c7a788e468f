"""The plan against the thesis's steady steps by simulation: both flown by the twin, both identified."""

from dataclasses import replace

import numpy as np
import pytest

from rovtwin.identification.experiment.choice import variance_ratio
from rovtwin.identification.identify import identify
from rovtwin.planning.experiments import SIGNALS, plan_tests
from rovtwin.planning.records import experiment_records
from rovtwin.planning.tank import Tank
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle

# Sensors as noisy as the plan takes readings to miss a model by: what is simulated is then what was promised.
NOISE = {"gyro": 0.005, "attitude": 0.005, "pressure": 0.005}
PULLS = [
    {"bollard": {"direction": axis, "command": 1.0, "force": force, "sd": 0.02 * force}}
    for axis, force in (("surge", 20.0), ("sway", 10.0), ("heave", 22.0))
]


def identified(scenario):
    sensors = scenario.sensors.model_copy(
        update={name: getattr(scenario.sensors, name).model_copy(update={"noise": s}) for name, s in NOISE.items()}
    )
    quick = scenario.rates.model_copy(update={"physics": 100})
    (records,) = experiment_records(scenario.model_copy(update={"sensors": sensors, "rates": quick}), seeds=[1])
    seen = [replace(r, signals={name: r.signals[name] for name in SIGNALS}) for r in records]
    return identify(load_vehicle("double_blueye"), seen, anchors=PULLS)


@pytest.mark.slow  # two joint estimates of a quarter of an hour each: minutes
def test_the_plan_halves_the_variances_of_the_steady_steps_in_the_same_time():
    vehicle = load_vehicle("double_blueye")
    steady = load_scenario("test_steps_thesis")
    plan = plan_tests(vehicle, "double_blueye", minutes=13.5, tank=Tank(6.0, 3.0, 1.5))  # as long as the steady steps
    ours, theirs = identified(plan.scenario), identified(steady)
    assert ours.parameters.names == theirs.parameters.names
    prior = np.sqrt(np.diag(ours.prior.covariance))
    assert variance_ratio(ours.std, theirs.std, prior) < 0.5
    for found in (ours, theirs):  # the truth is theta = 0
        learnt = found.std < 0.5 * prior
        assert np.sqrt(np.mean((found.theta / found.std)[learnt] ** 2)) < 2.0
