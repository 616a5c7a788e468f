"""Mistakes that people make, planted in a twin beside which bench and dip are done: each is named and stops the stage.

More stand in `test_at_the_water` (sensors, thrusters) and in `test_scale`.
"""

import numpy as np
import pytest
from tests.commission.test_at_the_water import begun, changed, stops
from tests.commission.waterside import Corrupted, Yes, edited

from rovtwin.commission import bench
from rovtwin.commission.dip import stage as dip
from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement

pytestmark = pytest.mark.slow


def reporting(sensor, value):
    """A sensor that the vehicle tells of besides, in each reading of the depth."""

    class Telling(Corrupted):
        def read(self):
            found = super().read()
            depths = [r for r in found if r.sensor == "pressure"]
            return found + [Measurement(sensor, np.array(value), r.t_valid) for r in depths]

    return Telling


AT_REST = {
    "battery empty": (reporting("battery", [0.2, 30.0]), "battery", "charged to 20 %"),
    "leak": (reporting("leak", [1.0]), "leak", "water"),
}


@pytest.mark.parametrize("mistake", AT_REST)
def test_the_bench_names_what_is_wrong_with_the_vehicle(tmp_path, monkeypatch, mistake):
    link, what, words = AT_REST[mistake]
    found = stops(bench.run(begun(tmp_path, monkeypatch, link=link)[0]))
    assert words in found.get(what, ""), found


MISREAD = {
    "depth without its zero": (changed("pressure", lambda v: v + 3.0), "pressure"),
    "attitude with z up": (changed("attitude", lambda v: v + [np.pi, 0, 0]), "vertical"),
    "accelerometer x and y swapped": (changed("accelerometer", lambda v: v[[0, 2, 1]]), "vertical"),
}


@pytest.mark.parametrize("mistake", MISREAD)
def test_the_bench_names_frames_and_units(tmp_path, monkeypatch, mistake):
    read, what = MISREAD[mistake]
    found = stops(bench.run(begun(tmp_path, monkeypatch, read=read)[0]))
    assert what in found, found


def other(change, vehicle="double_blueye"):
    """A truth that is not as the file has it."""
    return lambda path: edited(vehicle, path / "truth.yaml", change)


def buoyant(newtons):
    def change(data):
        data["restoring"] = dict(data["restoring"]) | {"buoyancy": newtons}

    return change


def turned(data):
    """The port drone is bolted on with its lateral thruster 60 deg off."""
    thruster = next(t for t in data["parts"][0]["thrusters"] if t["name"].endswith("sway"))
    thruster["direction"] = [0.866, 0.5, 0.0]


TRUTHS = {
    "ballast forgotten": (other(buoyant(30.0 * 9.81 + 5.0)), "buoyancy", "net buoyancy about"),
    "salt instead of fresh": (other(buoyant(30.0 * 9.81 * 1.025)), "buoyancy", "net buoyancy about"),
    "payload not in the file": (other(buoyant(30.0 * 9.81 - 8.0)), "buoyancy", "net buoyancy about"),
    "thruster turned": (other(turned), "port.sway", "not as the file says"),
}


@pytest.mark.parametrize("mistake", TRUTHS)
def test_the_dip_names_a_vehicle_that_is_another(tmp_path, monkeypatch, mistake):
    truth, what, words = TRUTHS[mistake]
    found = stops(dip.run(begun(tmp_path, monkeypatch, truth=truth(tmp_path))[0]))
    assert words in found.get(what, ""), found


def test_an_attitude_in_degrees_is_named(tmp_path, monkeypatch):
    found = stops(dip.run(begun(tmp_path, monkeypatch, read=changed("attitude", np.degrees))[0]))
    assert found and any("attitude" in f"{what} {text}" for what, text in found.items()), found


def test_a_compass_that_is_a_quarter_turn_off_is_noticed_by_the_person(tmp_path, monkeypatch):
    class Sees(Yes):
        def confirm(self, question):
            return "bow" not in question

    found = stops(dip.run(begun(tmp_path, monkeypatch, person=Sees())[0]))
    assert "did not point there" in found["compass"]


def test_a_dvl_that_is_turned_by_45_degrees_is_named(tmp_path, monkeypatch):
    c = np.sqrt(0.5)
    read = changed("dvl", lambda v: np.array([[c, -c, 0], [c, c, 0], [0, 0, 1]]) @ v)
    found = stops(dip.run(begun(tmp_path, monkeypatch, vehicle="orca", read=read)[0]))
    assert "turned by" in found.get("dvl", ""), found


def test_water_that_comes_in_while_it_pushes_ends_the_pushes(tmp_path, monkeypatch):
    class Leaking(Corrupted):
        def read(self):
            found = super().read()
            wet = len(self.commands) > 300
            return found + [Measurement("leak", np.ones(1), r.t_valid) for r in found[:1] if wet]

    work, made = begun(tmp_path, monkeypatch, link=Leaking)
    found = stops(dip.run(work))
    assert "water" in found["pushes"] and np.abs(made[0].commands[-1]).max() == 0.0


def test_another_client_in_control_is_no_vehicle_of_ours(tmp_path, monkeypatch):
    class Taken(Corrupted):
        def arm(self):
            raise LinkError("port: another client is in control")

    work, made = begun(tmp_path, monkeypatch, link=Taken)
    with pytest.raises(LinkError, match="another client"):
        dip.run(work)
    assert not made[0].commands
