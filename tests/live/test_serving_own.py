"""Code of one's own where a vehicle is served: what runs is noted, what would not run is refused."""

import json
import sys

import numpy as np
import pytest
from tests.packages import install

from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.core.trust import VARIABLE
from rovtwin.links.ardusub_json.endpoint import ARDUSUB_JSON
from rovtwin.live.serving.host import ServedVehicle
from rovtwin.live.serving.lockstep import FirmwarePhysics
from rovtwin.live.serving.protocols import world_for
from rovtwin.live.serving.truth_log import truth_log

SOURCE = """
import jax.numpy as jnp
import rovtwin
class Push(rovtwin.Block):
    def init(self, key, start): return None
    def step(self, memory, input, dt): return memory, jnp.array([50.0, 0, 0, 0, 0, 0])
"""
WITH_FORCE = ["world.forces=[{block: 'pushing:Push'}]"]


@pytest.fixture(autouse=True)
def installed(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")
    monkeypatch.syspath_prepend(
        install(tmp_path / "site", "pushing", SOURCE, {"rovtwin.blocks": {"push": "pushing:Push"}})
    )
    yield
    sys.modules.pop("pushing", None)


@pytest.mark.parametrize("named", ["pushing:Push", "push"])
def test_an_autopilot_of_ones_own_is_refused_with_the_fix(named):
    scenario = world_for("square", [f"autopilot.controller={named}"], None)
    why = f"autopilot.controller: found {named}, .*would not run.*Serve it with --set autopilot=model_based"
    with pytest.raises(ConfigError, match=why):
        ServedVehicle(scenario)
    with pytest.raises(ConfigError, match=why):
        FirmwarePhysics(scenario, ARDUSUB_JSON.firmware(), "ardusub-json")
    assert "pushing" not in sys.modules, "it was run for nothing"


@pytest.mark.system
def test_a_force_of_ones_own_acts_and_the_log_says_which_code_it_was(tmp_path):
    vehicle = ServedVehicle(world_for("gladius_mini", WITH_FORCE, None))
    path = tmp_path / "truth.mcap"
    with truth_log(path, vehicle) as log:
        for _ in range(50):
            vehicle.advance({})
            log.take(vehicle)
    found = Log.read(path)
    assert found["truth/nu"]["u"][-1] > 0.5 and np.isfinite(found["truth/eta"].values).all()
    (code,) = json.loads(found.metadata["own_code"]).items()
    assert code[0] == "pushing:Push" and code[1]["module"] == "pushing" and len(code[1]["sha256"]) == 64


@pytest.mark.system
def test_without_code_of_ones_own_the_log_says_nothing_of_it(tmp_path):
    vehicle = ServedVehicle(world_for("gladius_mini", [], None))
    with truth_log(tmp_path / "truth.mcap", vehicle) as log:
        vehicle.advance({})
        log.take(vehicle)
    assert "own_code" not in Log.read(tmp_path / "truth.mcap").metadata
