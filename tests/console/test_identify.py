"""The panel of an identification test, and the process that looks at its log while it is flown."""

import numpy as np
import pytest

from rovtwin.console.assess import Assessor, AssessProcess, Subject
from rovtwin.core.log import Channel, LogWriter
from rovtwin.vehicle import load_vehicle

VEHICLE = "double_blueye"
EXPERIMENT = {
    "manoeuvre": 1,
    "of": 2,
    "what": "hand",
    "remaining": 2.4,
    "cue": "TILT IT, thrusters are off",
    "hand": True,
}
EXPERIMENT |= {"t": 12.0, "duration": 20.0, "running": True, "ended": ""}
TEST = {"name": "mixed", "description": "Two things.", "duration": 20.0, "by_hand": ["BY HAND: 30 deg"]}
TEST["manoeuvres"] = [
    {"what": "steps surge", "start": 0.0, "end": 10.0, "pieces": []},
    {"what": "release", "start": 10.0, "end": 20.0, "pieces": []},
]
ROW = {"unit": "kg", "value": 30.0, "low": 20.0, "high": 40.0, "prior": 25.0, "prior_low": 5.0, "prior_high": 85.0}
ROWS = [
    ROW | {"name": "added_mass.surge", "ratio": 0.4, "coupling": False},
    ROW | {"name": "added_mass.sway", "ratio": 0.98, "coupling": False},
    ROW | {"name": "added_mass.surge_pitch", "ratio": 0.4, "coupling": True},
]
QUALITY = {"signals": [{"name": "depth", "rate": 42.0, "longest": 3.0}], "judged": True, "verdict": "error"}
QUALITY |= {"not_pushed": ["heave"], "findings": [{"severity": "error", "where": "depth", "message": "m", "fix": "f"}]}
NEWS = {"kind": "identify", "folder": "runs/a", "command": "rovtwin identify v log", "seconds": 15.0, "busy": False}


def send(page, **message):
    page.evaluate("message => window.emit(message)", message)


@pytest.fixture
def panel(open_views):
    page = open_views("identify")
    send(page, kind="setup", test=TEST)
    send(page, kind="rights", may=True)
    send(page, kind="state", armed=True, experiment=EXPERIMENT)
    return page


def test_operator_sees_what_to_do_and_how_far_the_test_is(panel):
    assert panel.inner_text("#cue") == EXPERIMENT["cue"] and panel.locator("#cue.hand").count() == 1
    assert panel.inner_text("#cue-left") == "hand: 2 s left, 8 s of the test"
    assert panel.locator("li[aria-current=step]").inner_text().startswith("2. release")
    assert panel.locator("progress").evaluate_all("all => all.map(one => one.value / one.max)") == [1.0, 0.2]


def test_start_and_abort_are_offered_when_they_can_be_obeyed(panel):
    assert panel.is_disabled("#start") and panel.is_enabled("#abort")
    panel.click("#abort")
    send(panel, kind="state", armed=True, experiment=EXPERIMENT | {"running": False})
    assert panel.is_enabled("#start") and panel.is_disabled("#abort")
    panel.click("#start")
    assert panel.evaluate("sent") == [{"do": "abort"}, {"do": "start"}]
    send(panel, kind="rights", may=False)
    assert panel.is_disabled("#start")


def test_quality_and_estimate_are_shown_and_labelled_quick(panel):
    send(panel, **NEWS, final=False, quality=QUALITY)
    reported = panel.inner_text("#quality")
    assert (
        "do not use it so" in reported
        and "depth 42 Hz (gap of 3.0 s)" in reported
        and "Not pushed so far: heave." in reported
    )
    assert panel.is_hidden("#command")
    send(panel, **NEWS, final=True, estimate={"rows": ROWS, "informed": 2, "took": 3.0, "changes": 300})
    assert "2 of 3 parameters" in panel.inner_text("#estimated")
    assert panel.locator("tbody th[scope=row]").all_inner_texts() == ["surge\nkg"]
    panel.check("#uninformed")
    panel.check("#couplings")
    assert panel.locator("tbody th[scope=row]").count() == 3
    now, before = (panel.locator(f".identify-bar .{kind}").first.bounding_box()["width"] for kind in ("now", "before"))
    assert now / before == pytest.approx(20.0 / 80.0, abs=0.03)
    assert panel.inner_text("#command") == NEWS["command"]
    assert panel.locator(".identify-note").inner_text().startswith("Quick estimate")


@pytest.fixture
def growing(tmp_path):
    """A log that is still written: four seconds of commands and of two sensors."""
    names = load_vehicle(VEHICLE).thruster_names
    folder = tmp_path / "run"
    folder.mkdir()
    fields = tuple(name.replace(".", "_") for name in names)
    channels = [
        Channel("autopilot/command", fields, ("1",) * len(fields), ""),
        Channel("sensor/pressure", ("depth", "t_valid"), ("m", "s"), "n"),
        Channel("sensor/gyro", ("p", "q", "r", "t_valid"), ("rad/s", "rad/s", "rad/s", "s"), "b"),
    ]
    t = np.arange(0.0, 4.0, 0.02)
    with LogWriter(folder / "log.mcap", channels) as log:
        log.write_many("autopilot/command", t, np.zeros((len(t), len(fields))))
        log.write_many("sensor/pressure", t, np.stack([np.full(len(t), 3.0), t], axis=1))
        log.write_many("sensor/gyro", t, np.column_stack([np.zeros((len(t), 3)), t]))
        log.flush()
        yield folder / "log.mcap"


def test_log_that_grows_is_read_and_judged_only_once_it_is_long_enough(growing):
    assessor = Assessor(Subject(load_vehicle(VEHICLE), 84.0, 2))
    records = assessor.records(growing, final=False)
    assert [record.duration for record in records] == [pytest.approx(3.98, abs=0.02)]
    found = assessor.quality(records, final=False)
    assert found["verdict"] == "early" and found["findings"] == []
    assert [(one["name"], round(one["rate"])) for one in found["signals"]] == [("depth", 50), ("gyro", 50)]
    assert assessor.quality(records, final=True)["verdict"] == "early"  # an abort


def test_error_counts_once_two_looks_found_it(growing, monkeypatch):
    from rovtwin.console import assess
    from rovtwin.identification.checks.findings import Finding

    alarm = Finding("error", "clock", "commands", "late.", "Write it.")
    monkeypatch.setattr(assess, "check_record", lambda record, model, thrusters: [alarm])
    monkeypatch.setattr(assess, "JUDGED", 1.0)
    assessor = Assessor(Subject(load_vehicle(VEHICLE), 84.0, 2))
    records = assessor.records(growing, final=False)
    assert [assessor.quality(records, final=False)["verdict"] for _ in range(2)] == ["warning", "error"]
    assert Assessor(Subject(load_vehicle(VEHICLE), 84.0, 2)).quality(records, final=True)["verdict"] == "error"


@pytest.mark.slow
def test_process_looks_tells_and_ends(growing, tmp_path):
    process = AssessProcess(Subject(load_vehicle(VEHICLE), 84.0, 2))
    try:
        for log, expected in ((tmp_path / "none" / "log.mcap", ["error"]), (growing, ["quality", "estimate"])):
            process.ask(log, log != growing)  # of a log that grows it is no error that there is nothing yet
            reports = []
            while answer := process.answer(200.0):
                reports += [key for key in answer if key != "seconds"]
            assert reports == expected and answer == {}
    finally:
        process.close()
    assert not process._process.is_alive()
