"""One short scenario that the tests of this folder share, so that its loop is compiled once."""

from pathlib import Path

import pytest

from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario


@pytest.fixture(scope="session")
def short() -> Scenario:
    """Twelve seconds of the lawn-mower in waves, by the autopilot that compiles fastest: dive, nothing finished."""
    return load_scenario("lawnmower_waves", ["autopilot=thesis", "duration=12", "name=short"])


NO_SWAY = """
name: no_sway
mass: 6.5
inertia: [0.06, 0.11, 0.12]
volume: 0.00655
center_of_buoyancy: [0, 0, -0.02]
shape: {box: [0.42, 0.30, 0.20]}
thrusters:
  - &t {name: port, position: [-0.15, -0.11, 0], direction: [1, 0, 0], force: {ahead: 14, astern: 11},
        curve: {power: 1.5}, dead_band: 0.05, time_constant: 0.12}
  - {<<: *t, name: starboard, position: [-0.15, 0.11, 0]}
  - {<<: *t, name: front, position: [0.14, 0, 0], direction: [0, 0, 1]}
  - {<<: *t, name: vertical_port, position: [-0.10, -0.10, 0], direction: [0, 0, 1]}
  - {<<: *t, name: vertical_starboard, position: [-0.10, 0.10, 0], direction: [0, 0, 1]}
"""


@pytest.fixture(scope="session")
def no_sway(tmp_path_factory) -> Path:
    """A light vehicle that no library has: two surge and three vertical thrusters, none sideways."""
    path = tmp_path_factory.mktemp("vehicles") / "no_sway.yaml"
    path.write_text(NO_SWAY, encoding="utf-8")
    return path
