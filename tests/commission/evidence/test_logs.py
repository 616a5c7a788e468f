"""Logs of parts: which count, what becomes of those that were cut off or cannot be read."""

from dataclasses import replace

import numpy as np
import pytest

from rovtwin.commission.dossier import Dossier
from rovtwin.commission.evidence import logs
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Stage
from rovtwin.core.log import Channel, LogWriter
from rovtwin.identification.checks.findings import Finding
from rovtwin.vehicle import load_vehicle

STAGE = Stage("excite", "", "", "", True, lambda work: None)


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("double_blueye")


@pytest.fixture
def unchecked(monkeypatch):
    monkeypatch.setattr(logs, "check_record", lambda record, model, thrusters: [])


def write(path, vehicle, seconds=20.0, whole=True):
    """A log of a test: commands, depth, positions."""
    path.parent.mkdir(parents=True, exist_ok=True)
    names = tuple(name.replace(".", "_") for name in vehicle.thruster_names)
    channels = [
        Channel("autopilot/command", names, ("1",) * len(names), ""),
        Channel("sensor/position", ("north", "east", "t_valid"), ("m", "m", "s"), "n"),
    ]
    log = LogWriter(path, channels, {})
    t = np.arange(0.0, seconds, 0.1)
    if seconds:
        log.write_many("autopilot/command", t, np.sin(t)[:, None] * np.ones(len(names)))
        log.write_many("sensor/position", t, np.stack([0.1 * t, 0.0 * t, t], axis=1))
    log.close()
    if not whole:
        content = path.read_bytes()
        path.write_bytes(content[: int(0.6 * len(content))])
    return path


def test_logs_of_another_description_are_not_used(tmp_path):
    dossier = Dossier.begin(tmp_path / "commissioned", Request("double_blueye", "twin://"))
    old = dossier.next_attempt(1, STAGE)
    killed = dossier.next_attempt(1, STAGE)
    dossier._attempts[0] = replace(old, fingerprint="of something else")
    for attempt in (old, killed):
        (attempt.folder / "part-1").mkdir()
        (attempt.folder / "part-1" / "log.mcap").touch()
    assert logs.logs_of(dossier) == [killed.folder / "part-1" / "log.mcap"]


def test_a_whole_log_a_torn_one_and_one_that_is_none(tmp_path, vehicle, unchecked):
    whole = write(tmp_path / "1" / "part-1" / "log.mcap", vehicle)
    torn = write(tmp_path / "1" / "part-2" / "log.mcap", vehicle, 4000.0, whole=False)
    empty = write(tmp_path / "1" / "part-3" / "log.mcap", vehicle, 0.0)
    none = tmp_path / "1" / "part-4" / "log.mcap"
    none.parent.mkdir()
    none.write_bytes(b"no log")
    found = logs.read_logs(vehicle, [whole, torn, empty, none], tmp_path)
    assert found.logs == (whole, tmp_path / "1-part-2.repaired.mcap")
    assert found.records[0].duration == pytest.approx(20.0, abs=0.2) and found.records[1].duration > 100.0
    assert found.minutes == pytest.approx(sum(record.duration for record in found.records) / 60.0)
    by_name = {check.what: check for check in found.checks}
    assert by_name["1/part-2"].verdict == "note" and "cut off" in by_name["1/part-2"].text
    assert by_name["1/part-4"].verdict == "warning" and "left out" in by_name["1/part-4"].text
    assert "1/part-3" not in by_name, "nothing was armed: nothing is missing"


def test_a_test_that_ended_as_it_began_is_left_out_and_harms_nothing(tmp_path, vehicle):
    log = write(tmp_path / "1" / "part-1" / "log.mcap", vehicle, 1.5)
    found = logs.read_logs(vehicle, [log], tmp_path)
    assert not found.records and not found.logs
    (check,) = found.checks
    assert check.verdict == "note" and "left out" in check.text


def test_what_cannot_be_right_stops_and_what_is_odd_warns(tmp_path, vehicle, monkeypatch):
    found = [
        Finding("error", "swapped", "gyro", "p and q are swapped.", "Mend the mounting."),
        Finding("warning", "gap", "position", "2 s without a reading.", "See why."),
        Finding("note", "rare", "depth", "is rare.", ""),
    ]
    monkeypatch.setattr(logs, "check_record", lambda record, model, thrusters: found)
    log = write(tmp_path / "1" / "part-1" / "log.mcap", vehicle)
    checks = logs.read_logs(vehicle, [log], tmp_path).checks
    assert [check.verdict for check in checks] == ["stop", "warning"]
    assert "swapped" in checks[0].text and "move the log out" in checks[0].fix and "part-1" in checks[0].what
