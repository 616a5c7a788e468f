"""Tables of the certificate's first sheet."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.commission.certified import first_page


def test_a_vehicle_that_is_level_reads_zero_without_a_sign(monkeypatch):
    rest = SimpleNamespace(trim=np.radians([-0.02, -0.04]), net_buoyancy=-0.0, metacentric_height=-0.0)
    monkeypatch.setattr(first_page, "floating_of", lambda assembly: rest)
    vehicle = SimpleNamespace(assembly=SimpleNamespace(solid=SimpleNamespace(mass=6.5)))
    rows = dict((name, value) for name, value, _ in first_page.balance(vehicle, []).rows)
    assert rows["Trim (pitch at rest)"] == rows["List (roll at rest)"] == "0.0 deg"
    assert rows["Net buoyancy"] == "0 N"


def test_an_axis_that_no_thruster_pushes_is_named():
    row = {"speed": 0.3, "force": 3.0, "half_width_share": 0.04, "interval_95": [2.9, 3.1], "unit": "N"}
    rows = [row | {"axis": "surge"}, row | {"axis": "sway"}, row | {"axis": "sway", "speed": -0.3}]
    assert "No thruster pushes sway: known from drift" in first_page.damping(rows, 0.05, ["surge", "yaw"]).note
    assert first_page.damping(rows, 0.05, ["surge", "sway"]).note == ""


@pytest.mark.parametrize(("ends", "text"), [([-0.004, 0.4], "0.00 to 0.40"), ([-0.4, -0.2], "-0.40 to -0.20")])
def test_an_end_that_rounds_to_zero_has_no_sign(ends, text):
    assert first_page.between(ends) == text
