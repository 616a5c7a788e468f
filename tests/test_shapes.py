"""Shapes in types hold, see `tests/shapes.py`; and nobody but a test pays for looking."""

import subprocess
import sys
from pathlib import Path

import pytest
from tests.shapes import accepted, wrong_calls

ROOT = Path(__file__).parents[1]


def traced(what: str) -> str:
    done = subprocess.run([sys.executable, "-m", "tests.shapes", what], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.system
def test_every_block_and_vehicle_has_the_shapes_of_its_types_and_wrong_ones_are_refused():
    assert "traced" in traced("loop")


@pytest.mark.slow
def test_the_estimate_has_the_shapes_of_its_types():
    assert "traced" in traced("estimate")


def test_the_package_itself_checks_no_types():
    assert len(accepted()) == len(wrong_calls())
