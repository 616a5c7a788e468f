"""The contracts of Blocks, sensors, evidence, Links, Sources and views for tests of one's own; ours run the same.

    from rovtwin.testing import check_block, recorded_inputs

    def test_sliding_mode():
        check_block(SlidingMode(), recorded_inputs("controller"))

What fails raises an AssertionError that says which clause, of what, and by how much.
"""

from rovtwin.testing.block import BlockContract, check_block
from rovtwin.testing.evidence import check_evidence
from rovtwin.testing.link import LinkRig, check_link
from rovtwin.testing.recorded import recorded_inputs
from rovtwin.testing.sensor import check_sensor, sensor_inputs
from rovtwin.testing.source import SourceRig, check_source
from rovtwin.testing.view import check_view, view_states

__all__ = [
    "BlockContract",
    "LinkRig",
    "SourceRig",
    "check_block",
    "check_evidence",
    "check_link",
    "check_sensor",
    "check_source",
    "check_view",
    "recorded_inputs",
    "sensor_inputs",
    "view_states",
]
