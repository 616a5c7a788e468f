"""Bench and dip beside a twin that is not quite what the file says; mistakes are planted, named, and stop the stage."""

from dataclasses import replace

import numpy as np
import pytest
from tests.commission.waterside import Corrupted, CountingClock, Yes, twin

from rovtwin.commission import bench
from rovtwin.commission import work as working
from rovtwin.commission.dip import stage as dip
from rovtwin.commission.dossier import Dossier
from rovtwin.commission.drill import stage as drill
from rovtwin.commission.request import Request
from rovtwin.commission.work import Work
from rovtwin.core.flow import Measurement
from rovtwin.core.link import COMMAND_LIFE
from rovtwin.links.twin import TwinLink

DEEPEST = 1.5


def begun(
    tmp_path, monkeypatch, vehicle="double_blueye", read=lambda r: r, send=lambda u: u, person=None, truth=None,
    link=Corrupted,
):  # fmt: skip
    """Work beside a twin in which readings and commands are changed on the way; the link is kept in `made`."""
    made = []

    def connect(url, scenario, clock, observe=False):
        made.append(link(twin(None if truth is None else str(truth), clock, scenario), read, send))
        return made[-1]

    monkeypatch.setattr(working, "connect", connect)
    monkeypatch.setattr(working, "Clock", CountingClock)
    dossier = Dossier.begin(tmp_path / "c", Request(vehicle, "twin://", tank=f"6x4x{DEEPEST}"))
    folder = tmp_path / "c" / "stage"
    folder.mkdir()
    return Work(dossier, folder, person or Yes()), made


def changed(sensor, how):
    """Readings of one sensor changed."""

    def read(reading):
        if reading.sensor != sensor:
            return reading
        value = how(np.asarray(reading.value))
        return None if value is None else Measurement(reading.sensor, value, reading.t_valid)

    return read


def late(sensor, seconds):
    return lambda r: Measurement(r.sensor, r.value, r.t_valid - seconds) if r.sensor == sensor else r


def stops(outcome):
    return {check.what: f"{check.text} {check.fix}" for check in outcome.checks if check.verdict == "stop"}


@pytest.mark.system
def test_a_sound_vehicle_passes_bench_and_dip(tmp_path, monkeypatch):
    work, made = begun(tmp_path, monkeypatch)
    found = bench.run(work)
    assert found.go, found.reasons
    assert not made[0].commands  # at rest nothing is sent
    by_name = {one["name"]: one for one in found.measured["sensors"]}
    assert by_name["gyro"]["rate_hz"] == pytest.approx(100.0, rel=0.05)
    np.testing.assert_allclose(by_name["accelerometer"]["noise"], 0.0308, rtol=0.15)
    (work.folder / "again").mkdir()
    monkeypatch.setattr(Corrupted, "limits", ("the gain is 0.5",))
    found = dip.run(replace(work, folder=work.folder / "again"))
    assert found.go, found.reasons
    assert [c.text for c in found.checks if c.what == "commands"] == ["the gain is 0.5."]
    assert [one["what"] for one in found.measured["thrusters"]] == ["ok"] * 6
    assert found.seconds < 120.0 and np.abs(made[1].commands[-1]).max() == 0.0  # thrusters off at the end
    (work.folder / "half").mkdir()
    monkeypatch.setattr(Corrupted, "reach", 0.5)
    found = dip.run(replace(work, folder=work.folder / "half"))
    assert stops(found).keys() == {"reach"} and "50% of full command" in stops(found)["reach"]


@pytest.mark.system
def test_without_a_yes_nothing_is_sent(tmp_path, monkeypatch):
    work, made = begun(tmp_path, monkeypatch, person=Yes(answer=False))
    found = dip.run(work)
    assert not found.go and "not confirmed" in found.reasons[0]
    assert not made[0].commands


READINGS = {
    "depth in feet": (changed("pressure", lambda v: v * 3.281), "pressure"),
    "no gyro": (changed("gyro", lambda v: None), "gyro"),
    "compass hangs": (changed("attitude", lambda v: np.zeros(3)), "attitude"),
    "accelerometer upside down": (changed("accelerometer", lambda v: -v), "vertical"),
    "accelerometer in g": (changed("accelerometer", lambda v: v / 9.81), "accelerometer"),
    "clock late": (late("gyro", 0.8), "gyro clock"),
    "clock ahead": (late("pressure", -0.5), "pressure clock"),
}


@pytest.mark.slow
@pytest.mark.parametrize("mistake", READINGS)
def test_the_bench_names_what_sensors_have_wrong(tmp_path, monkeypatch, mistake):
    read, what = READINGS[mistake]
    found = stops(bench.run(begun(tmp_path, monkeypatch, read=read)[0]))
    assert what in found, found


def scaled(**by):
    def send(u):
        return u * np.array([by.get(f"t{i}", 1.0) for i in range(len(u))])

    return send


def swapped(i, k):
    def send(u):
        order = np.arange(len(u))
        order[[i, k]] = k, i
        return u[order]

    return send


PUSHES = {
    "reversed": ({"send": scaled(t5=-1.0)}, "starboard.heave", "other way"),
    "dead": ({"send": scaled(t1=0.0)}, "port.sway", "does not push"),
    "weak": ({"send": scaled(t2=0.6)}, "port.heave", "% of the force"),
    "swapped": ({"send": swapped(0, 2)}, "port.surge", "port.heave"),
    "gyro x and y": ({"read": changed("gyro", lambda v: v[[1, 0, 2]])}, "gyro", "y, x, z"),
    "gyro z": ({"read": changed("gyro", lambda v: v * [1, 1, -1])}, "gyro", "z has the wrong sign"),
    "accelerometer x": ({"read": changed("accelerometer", lambda v: v * [-1, 1, 1])}, "accelerometer", "x has"),
    "feet": ({"read": changed("pressure", lambda v: (v - 0.75) * 3.281 + 0.75)}, "pressure", "feet"),
}


@pytest.mark.slow
@pytest.mark.parametrize("mistake", PUSHES)
def test_the_dip_names_what_is_mounted_wrong(tmp_path, monkeypatch, mistake):
    planted, what, words = PUSHES[mistake]
    found = stops(dip.run(begun(tmp_path, monkeypatch, **planted)[0]))
    assert words in found.get(what, ""), found
    assert set(found) <= {what, "port.heave" if mistake == "swapped" else what}


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["bluerov2", "gladius_mini", "bluerov2_heavy"])
def test_other_vehicles_pass_the_dip_too(tmp_path, monkeypatch, vehicle):
    found = dip.run(begun(tmp_path, monkeypatch, vehicle)[0])
    assert {one["what"] for one in found.measured["thrusters"]} <= {"ok", "unseen"}, found.measured


@pytest.mark.slow
def test_the_drill_times_a_stop_and_a_silence(tmp_path, monkeypatch):
    found = drill.run(begun(tmp_path, monkeypatch)[0])
    assert found.go, found.reasons
    stop, silent = found.measured["thrusters_off"]
    assert stop["interval_95"][0] <= 0.04 and stop["seconds"] < 0.1
    assert silent["seconds"] == pytest.approx(COMMAND_LIFE, abs=0.06)


@pytest.mark.slow
def test_the_drill_names_a_stop_that_stops_nothing(tmp_path, monkeypatch):
    """A link that goes on by itself with the last command."""
    work, made = begun(tmp_path, monkeypatch)
    monkeypatch.setattr(Corrupted, "stop", lambda self: None)
    monkeypatch.setattr(TwinLink, "command", property(lambda self: self._u))
    found = stops(drill.run(work))
    assert list(found) == ["stop"] and "still on after" in found["stop"]
