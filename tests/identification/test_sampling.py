"""NUTS against the Gaussian of the estimate: on a good test they agree."""

import numpy as np
import pytest
from tests.identification.synthetic import record, steps_command

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.identify import identify
from rovtwin.identification.joint.result import sampling
from rovtwin.vehicle import load_vehicle

DURATION = 30.0


@pytest.fixture(scope="module")
def found():
    vehicle = load_vehicle("double_blueye")
    model = vehicle.model()
    t, u = steps_command(vehicle, 0, DURATION)
    full = 2 * float(model.thrusters.force_ahead[0])
    anchor = {"bollard": {"direction": "surge", "force": full, "sd": 0.02 * full}}
    return identify(vehicle, [record(model, t, u, DURATION)], anchors=[anchor])


@pytest.mark.slow
def test_widths_of_what_was_learnt_are_those_of_the_posterior(found):
    drawn = sampling.sample(found.problem, found.solution, count=100, warm_up=60)
    learnt = np.array([v == "learnt" for v in found.verdicts])
    # 100 draws tell a standard deviation to 7 %; the sampler bounces off the edges of dead bands, hence divergences.
    assert drawn.divergences < 40
    reported = learnt & (drawn.effective > 50)
    assert reported.sum() > 20
    assert np.median(drawn.ratio[reported]) == pytest.approx(1.0, abs=0.25)
    assert drawn.ratio[reported].min() > 0.7 and drawn.ratio[reported].max() < 1.45
    assert np.abs(drawn.shift[reported]).max() < 0.4


@pytest.mark.slow
def test_tests_that_are_too_long_are_refused(found, monkeypatch):
    monkeypatch.setattr(sampling, "_LARGEST", 100)
    with pytest.raises(IdentificationError, match="give a shorter test"):
        sampling.sample(found.problem, found.solution)
