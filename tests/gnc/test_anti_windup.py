"""An integral rests where it would wind up, and nowhere else."""

import numpy as np
import pytest

from rovtwin.core.numerics import jnp
from rovtwin.gnc.anti_windup import ROUNDING, integrated


@pytest.mark.parametrize(
    ("growth", "cut", "shortfall", "after"),
    [
        (0.5, 0.0, 0.0, 1.5),
        (0.5, 2.0, 0.0, 1.0),  # its own limit cuts it the way it grows
        (0.5, -2.0, 0.0, 1.5),  # it grows back from the limit
        (0.5, 0.0, 1.0, 1.0),  # the allocation gave less
        (0.5, 0.0, -1.0, 1.5),
        (-0.5, -2.0, 0.0, 1.0),
        (0.5, 0.0, 0.5 * ROUNDING, 1.5),  # of an allocation's rounding nobody takes notice
    ],
)
def test_integrates_unless_it_is_cut_that_way(growth, cut, shortfall, after):
    found = integrated(*(jnp.asarray([value]) for value in (1.0, growth, cut, shortfall)))
    np.testing.assert_array_equal(found, [after])
