"""Dives against a certificate, as `rovtwin watch --certificate` compares them."""

import json
from functools import partial

import numpy as np
import pytest
from tests.identification.commands import run

from rovtwin.commission.after import watching
from rovtwin.commission.after.envelope import as_found
from rovtwin.commission.after.issued import Issued, Proven, issued
from rovtwin.commission.request import Request
from rovtwin.core.errors import ConfigError
from rovtwin.identification.identify import identify
from rovtwin.identification.joint.result.overlay import to_yaml
from rovtwin.monitoring.factors import AXES
from rovtwin.monitoring.lost import Lost
from rovtwin.planning.tank import MOTION_CAPTURE
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle

watch = partial(run, command="watch")


def certificate(folder, flight):
    """One of a Double Blueye that was proven in calm water, two missions in each current."""
    folder.mkdir()
    (folder / "identified.yaml").write_text(to_yaml(identify(load_vehicle("double_blueye")).file(), "a test"))
    rows = [{"sea_m": 0.0, "current_m_s": speed} for speed in (0.0, 0.1)]
    prove = {"envelope": rows, "largest_currents": [{"sea_m": 0.0, "current_m_s": 0.1}]}
    request = Request(str(folder / "identified.yaml"), "twin://", samples=2)
    proven = Proven.model_validate({"seed": 1, "samples": 2} | prove)
    return Issued(
        folder, "double_blueye", "2026-11-20T10:00:00Z", "0" * 64, request, None, proven, MOTION_CAPTURE, flight
    )


def test_a_thruster_that_is_lost_has_no_force_in_the_missions_that_are_flown_again():
    vehicle = load_vehicle("double_blueye")
    model, names = vehicle.model(), vehicle.thruster_names
    theta = np.zeros(16 + len(names))
    theta[0] = np.log(1.3)
    found = as_found(model, theta, [Lost(2, names[2], None, 0.0)], names)
    assert not np.asarray(found.thrusters.configuration)[:, 2].any()
    np.testing.assert_allclose(found.thrusters.configuration[:, 0], model.thrusters.configuration[:, 0])
    surge = AXES.index("surge")
    np.testing.assert_allclose(found.damping[surge, surge], 1.3 * model.damping[surge, surge])
    np.testing.assert_allclose(found.inertia_inverse @ found.inertia, np.eye(6), atol=1e-9)


def test_a_folder_that_is_no_certificate_is_refused_in_words(monkeypatch, capsys, tmp_path):
    code, _, err = watch(monkeypatch, capsys, tmp_path, "--certificate", tmp_path)
    assert code == 2 and "MANIFEST.json" in err and "expected" in err
    code, _, err = watch(monkeypatch, capsys, tmp_path, "--certificate", tmp_path, "--vehicle", "double_blueye")
    assert code == 2 and "--vehicle double_blueye: found --certificate beside it" in err
    with pytest.raises(ConfigError, match="no such folder"), issued(tmp_path / "none"):
        pass


@pytest.mark.slow
def test_a_dive_with_a_weak_thruster_is_not_as_certified(tmp_path, monkeypatch):
    for name, seed, health in (("certified", 1, 1.0), ("same", 2, 1.0), ("weak", 3, 0.3)):
        given = ["duration=75", f"world.thruster_health={{port.surge: {health}}}"]
        fly(load_scenario("square", given, seed), tmp_path / name)
    made = certificate(tmp_path / "bundle", tmp_path / "certified" / "log.mcap")
    found = watching.watch_certified([tmp_path / "same"], made)
    assert found.good and found.envelope is None, json.dumps([str(a) for a in found.alarms])
    found = watching.watch_certified([tmp_path / "same", tmp_path / "weak"], made)
    assert found.changed and not found.good and not found.watch.changes[0]
    assert any("port.surge" in text for text, changed in found.watch.words() if changed)
    assert found.envelope is not None and sum(cell.missions for cell in found.envelope.cells) == 4
    assert found.envelope.lines()
