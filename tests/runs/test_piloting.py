"""A vehicle flown by hand; a short flight is among the fail-safes', whose program it shares."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario

STICKS = "operator=[{at: 0, ask: pilot}, {at: 0.5, ask: pilot, velocity: [0.2, 0, 0], turn_rate_deg: 6}]"


def test_what_a_pilot_cannot_ask_is_refused():
    with pytest.raises(ConfigError, match="with ask: pilot only"):
        load_scenario("square", ["operator=[{at: 0, ask: pause, velocity: [0.2, 0, 0]}]"])
    with pytest.raises(ConfigError, match="a test flies its own time-line"):
        compose(load_scenario("test_decay", [STICKS]))


@pytest.mark.slow
def test_what_is_not_asked_for_is_held():
    run = fly(load_scenario("examples/piloting.yaml"))
    eta, nu = run.log["truth/eta"], run.log["truth/nu"]
    ahead, aside = (nu.t > 30) & (nu.t < 41), (nu.t > 67) & (nu.t < 74)
    assert np.abs(nu["u"][ahead] - 0.25).max() < 0.02 and np.abs(nu["v"][aside] - 0.15).max() < 0.02
    assert np.ptp(eta["z"][ahead | aside]) < 0.03 and np.ptp(eta["psi"][aside]) < 0.05
    last = eta.values[eta.t > 83][:, :3]
    assert np.ptp(last, axis=0).max() < 0.1
