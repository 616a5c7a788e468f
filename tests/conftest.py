"""What all tests share: hypothesis profiles, reference data, a short scenario, a small vehicle."""

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

# Most programs of the tests run for seconds: to optimise them takes longer. JAX and XLA read this when JAX is imported,
# and processes that tests start inherit it. Fusions by way of MLIR take half of the time of such a compilation in
# jax 0.10; without them loops are LLVM at once. Level 1 is that of `_RUN_LONG` below.
if "optimization_level" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "1"
    _quick = ["--xla_backend_optimization_level=1"]
    if sys.version_info < (3, 12):
        _quick.append("--xla_cpu_use_fusion_emitters=false")
    os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *_quick]).strip()

if os.environ.get("ROVTWIN_SHAPES"):
    from tests.shapes import checked

    checked()

from rovtwin.core.numerics import jax
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario

# Traces make many objects that live: looking through all of them as often as Python does takes a tenth of a trace.
gc.set_threshold(50_000, 20, 50)

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
    *("test_joint.py", "test_block_contract.py", "test_live.py", "test_own_blocks.py", "test_cli.py"),
    *("test_inflow.py", "test_navigation.py", "test_lost.py", "test_push.py", "test_monitor.py"),
    *("test_mounting.py", "test_checks.py", "test_ekf.py", "test_served.py", "test_remote_link.py"),
    *("test_tether.py", "test_payload.py", "test_fail_safes.py", "test_run.py", "test_discrepancy.py"),
    *("test_link.py", "test_experiment.py", "test_levers.py", "test_watch.py", "test_api.py"),
    *("test_link_contract.py", "test_filming.py", "test_smooth.py", "test_camera_images.py", "test_figures.py"),
    *("test_supervisor.py", "test_loads.py", "test_twin.py", "test_tune.py", "test_sea.py", "test_commands.py"),
    *("test_free_running.py", "test_result.py", "test_diagnostics.py", "test_sensors.py"),
    *("test_vehicle_figures.py", "test_hub.py", "test_detection.py", "test_serving.py", "test_html.py"),
    "test_devices.py",
)

# Programs of these modules run longer than it takes to optimise them. None of them is also compiled in a process that a
# test compares bit for bit with this one.
_RUN_LONG = (
    *("gnc/test_ekf.py", "gnc/test_levers.py", "identification/test_joint.py"),
    *("monitoring/test_lost.py", "monitoring/test_monitor.py"),
)

# What these drive was not written here, and takes its time to start: they are `system` as a whole.
_OUTSIDE = ("links/mavlink/test_mavsdk.py", "links/mavlink/test_mavsdk_examples.py", "links/ros2/test_network.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.as_posix().endswith(_OUTSIDE) or "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.system)
    items.sort(key=lambda item: _LONG.index(item.path.name) if item.path.name in _LONG else len(_LONG))


@pytest.fixture(scope="module", autouse=True)
def optimised(request: pytest.FixtureRequest) -> Iterator[None]:
    """Programs that are first compiled in a module of `_RUN_LONG` are optimised."""
    quickly = os.environ.get("JAX_DISABLE_MOST_OPTIMIZATIONS") == "1"  # as set above, or by the process that began this
    if not (quickly and request.path.as_posix().endswith(_RUN_LONG)):
        yield
        return
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", True)


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
