"""Do 95 % intervals hold the truth in 95 % of all cases? 200 campaigns, see `calibration`."""

import pytest
from tests.identification.calibration import run


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    found = run(200, jobs=2)
    assert 0.94 <= found["pooled"] <= 0.96
    for name, share in found["parameters"].items():
        assert 0.90 <= share <= 0.99, name
    assert found["minutes"] < 45.0
