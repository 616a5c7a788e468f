"""What all tests share: hypothesis profiles, reference data, a short scenario, a small vehicle."""

import gc
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

# Most programs of the tests run for seconds: to optimise them takes longer. XLA reads this when JAX is imported, and
# processes that tests start inherit it.
if "optimization_level" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=0".strip()

from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario

# JAX compiles inside the first example, so a deadline per example means nothing. Every run draws the same examples;
# `HYPOTHESIS_PROFILE=explore` draws many new ones. Most examples are seeds, which have no simplest form: no shrinking.
settings.register_profile(
    "same", deadline=None, max_examples=40, derandomize=True, phases=(Phase.explicit, Phase.generate)
)
settings.register_profile(
    "explore", deadline=None, max_examples=400, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

# Modules that take long begin first, the longest before all, so that no process waits for the other at the end (make:
# --no-loadscope-reorder).
_LONG = (
    *("test_docs.py", "test_joint.py", "test_fail_safes.py", "test_navigation.py", "test_ekf.py", "test_tether.py"),
    *("test_cli.py", "test_smooth.py", "test_filming.py", "test_twin.py", "test_devices.py"),
    *("test_prioritised.py", "test_track.py", "test_autopilot.py", "test_checks.py", "test_commands.py"),
    *("test_experiment.py", "test_html.py", "test_block_contract.py", "test_free_running.py"),
    *("test_parameters.py", "test_panel.py", "test_thesis.py", "test_ekf_model.py", "test_realtime.py"),
)


# What these drive was not written here, and takes its time to start: `make test-system`.
_OUTSIDE = {"test_mavlink_mavsdk.py", "test_mavsdk_examples.py", "test_ros2_network.py"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.name in _OUTSIDE or "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.system)
    items.sort(key=lambda item: _LONG.index(item.path.name) if item.path.name in _LONG else len(_LONG))


@pytest.fixture(scope="module", autouse=True)
def settled() -> None:
    """A full collection takes seconds in the end in a process that compiles so much, and other tests count tenths."""
    gc.collect()
    gc.freeze()


SHARED = Path(__file__).parents[1] / ".." / "shared"


def shared_folder(*parts: str) -> Path:
    """A folder of logs without a licence, kept beside the repository; the test is skipped where there is none."""
    folder = SHARED.joinpath(*parts)
    if not folder.is_dir():
        pytest.skip(f"no {'/'.join(parts)} beside the repository: logs without a licence are not shipped")
    return folder.resolve()


@pytest.fixture(scope="session")
def fossen_folder() -> Path:
    """Results of Fossen's MSS toolbox, cross-checked against PythonVehicleSimulator."""
    return Path(__file__).parent / "reference" / "fossen"


@pytest.fixture(scope="session")
def short() -> Scenario:
    """Twelve seconds of the lawn-mower in waves, by the autopilot that compiles fastest: dive, nothing finished.

    Shared, so that its loop is compiled once.
    """
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
