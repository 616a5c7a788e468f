"""Stretches, at the ends and in the middle."""

import numpy as np
import pytest

from rovtwin.core.arrays.stretches import stretches


@pytest.mark.parametrize(
    ("holds", "expected"),
    [
        ([], []),
        ([0, 0], []),
        ([1, 1, 1], [(0, 3)]),
        ([1, 0, 1, 1, 0, 1], [(0, 1), (2, 4), (5, 6)]),
        ([0, 1, 0], [(1, 2)]),
    ],
)  # fmt: skip
def test_each_stretch_has_its_first_and_last(holds, expected):
    assert stretches(np.array(holds, bool)) == expected
