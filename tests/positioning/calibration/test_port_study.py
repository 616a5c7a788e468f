"""What ignoring a port costs: the sizes that optics says."""

import numpy as np
import pytest

from rovtwin.positioning.calibration.port_study import AIR, PORT, calibrated_in_water, port_cost
from rovtwin.report.cameras.lens import port_figure

pytest.importorskip("cv2")


def test_a_lens_calibrated_in_water_has_the_focal_length_of_the_water_and_a_pincushion():
    lens, rms = calibrated_in_water(AIR, PORT)
    assert 1.333 * 768 == pytest.approx(float(lens.focal[0]), rel=0.02)
    assert float(lens.distortion[0]) > 0.2
    assert rms < 0.3


@pytest.mark.slow
def test_ignored_a_port_makes_everything_seem_nearer_by_a_quarter_and_modelled_it_costs_nothing(tmp_path):
    cost = port_cost(distances=[1.0, 4.0])
    ignored, in_water, modelled = cost.error.values()
    assert np.allclose(ignored / cost.distance, 0.26, atol=0.03)
    assert (in_water < 0.1 * ignored).all() and in_water[1] > in_water[0]
    assert modelled.max() < 1e-5
    port_figure(cost.distance, cost.error).savefig(tmp_path / "port.png")
