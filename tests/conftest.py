"""What all tests share: hypothesis profiles and the reference data beside the repository."""

import gc
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

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
    *("test_cli.py", "test_smoothing.py", "test_observer.py", "test_filming.py", "test_twin.py", "test_devices.py"),
    *("test_priority_allocation.py", "test_track.py", "test_autopilot.py", "test_checks.py", "test_commands.py"),
    *("test_trial.py", "test_html.py", "test_block_contract.py", "test_free_running.py"),
    *("test_parameters.py", "test_panel.py", "test_thesis.py", "test_observer_model.py", "test_realtime.py"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: _LONG.index(item.path.name) if item.path.name in _LONG else len(_LONG))


@pytest.fixture(scope="module", autouse=True)
def settled() -> None:
    """A full collection takes seconds in the end in a process that compiles so much, and other tests count tenths."""
    gc.collect()
    gc.freeze()


SHARED = Path(__file__).parents[1] / ".." / "shared"


def shared_folder(*parts: str) -> Path:
    """A folder of the reference material kept beside the repository; the test is skipped where there is none."""
    folder = SHARED.joinpath(*parts)
    if not folder.is_dir():
        pytest.skip(f"no {'/'.join(parts)} beside the repository: reference material is not shipped")
    return folder.resolve()


@pytest.fixture(scope="session")
def fossen_folder() -> Path:
    """Results of Fossen's MSS toolbox, cross-checked against PythonVehicleSimulator."""
    return shared_folder("reference", "fossen")
