"""Faults on the wire while thrusters turn: nothing crashes, and no thrust outlasts its watchdog (docs/link_faults.md).

Real processes on fixed addresses of their own: all tests that bind them are in this module.
"""

import pytest
from tests.links.faults.bench import bench
from tests.links.faults.cases import perform
from tests.links.faults.list import CASES, QUICK

pytest.importorskip("blueye.sdk", reason="blueye.sdk is not installed: pip install 'rovtwin[blueye]'")
pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")


@pytest.fixture(scope="module")
def benches(tmp_path_factory):
    with (
        bench("blueye", tmp_path_factory.mktemp("blueye")) as blueye,
        bench("mavlink", tmp_path_factory.mktemp("mavlink")) as mavlink,
    ):
        yield {"blueye": blueye, "mavlink": mavlink}


@pytest.mark.system
@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.id)
def test_thrusters_rest_in_time(benches, case):
    perform(benches[case.bench], case, patient=True, again=False)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_whole_table(benches, case):
    perform(benches[case.bench], case, patient=True)
