"""One short scenario that the tests of this folder share, so that its loop is compiled once."""

import pytest

from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario


@pytest.fixture(scope="session")
def short() -> Scenario:
    """Twelve seconds of the lawn-mower in waves: dive, nothing finished."""
    return load_scenario("lawnmower_waves", ["duration=12", "name=short"])
