"""What the console shows of a finished run: states, marks, history, and which runs there are."""

import asyncio
import json
import os
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.console.loops import ran
from tests.console.messages import state as state_of_a_flight

from rovtwin.console.engine.reporting.state import Consistency, SensorStatus, band
from rovtwin.console.replays.history import history
from rovtwin.console.replays.marks import marks_of
from rovtwin.console.replays.replay import Recording
from rovtwin.console.replays.shelf import Shelf
from rovtwin.console.wire import encode
from rovtwin.core.errors import ConfigError, LogError, RovtwinError
from rovtwin.core.flow import PHASES
from rovtwin.core.log import Channel, Log, LogWriter
from rovtwin.core.log.pictures import Album, PictureWriter

pytestmark = pytest.mark.system

ETA = ("x", "y", "z", "phi", "theta", "psi")


@pytest.fixture(scope="module")
def recording(flown):
    return Recording.open(flown)


def short_log(tmp_path, *names, summary=None):
    """A log of one second with these channels: sample k of field i is 10 k + i."""
    fields = {"sensor/position": ("north", "east", "t_valid"), "sensor/pressure": ("depth", "t_valid")}
    channels = [Channel(name, fields.get(name, ETA), "1", "") for name in names]
    t = np.array([0.0, 0.5, 1.0])
    data = {c.name: (t, 10.0 * np.arange(3)[:, None] + np.arange(len(c.fields))) for c in channels}
    return Recording(Log.from_arrays(channels, data, summary or {}), tmp_path / "log.mcap")


# States.


def test_state_is_what_the_log_says(recording):
    log, t = recording.log, 12.34  # samples are at 12.3 and 12.4
    row = int(np.searchsorted(log["autopilot/eta"].t, t)) - 1
    assert log["autopilot/eta"].t[row] == pytest.approx(12.3)
    state = recording.state(t)
    for key, channel in (("eta", "autopilot/eta"), ("truth", "truth/eta"), ("u", "autopilot/command")):
        np.testing.assert_array_equal(state[key], log[channel].values[row])
    np.testing.assert_allclose(state["sd"], log["autopilot/std"].values[row, :6])
    np.testing.assert_allclose(np.diag(state["ellipse"]), log["autopilot/std"].values[row, :2] ** 2)
    phase, _, waypoint, on_leg = log["autopilot/mode"].values[row]
    assert (state["phase"], state["waypoint"], state["on_leg"]) == (PHASES[int(phase)], waypoint, bool(on_leg))
    assert state["count"] == 2 and state["replay"] and state["stage"] == "replay"


def test_state_has_all_that_views_know_of_a_flight(recording):
    missing = state_of_a_flight().keys() - recording.state(3.0).keys() - {"markers"}  # which live.js adds
    assert not missing
    encode(recording.state(3.0))


def test_reference_rate_is_the_slope_of_the_reference(recording):
    before, after = (recording.state(t)["reference"] for t in (5.05, 5.15))
    np.testing.assert_allclose(recording.state(5.05)["reference_rate"], (after - before) / 0.1, atol=1e-9)


def test_what_sensors_read_has_its_unit(recording):
    """The depth that a pressure sensor tells is in metres; the console called it Pa."""
    reported = recording.setup()["readings"]
    assert reported["pressure"] == {"fields": ["depth"], "units": ["m"]}
    assert reported["position"] == {"fields": ["north", "east"], "units": ["m", "m"]}
    assert reported["attitude"]["units"] == ["rad"] * 3
    assert reported.keys() == set(recording.setup()["sensors"])


def test_sensors_are_as_old_as_they_were(recording):
    series = recording.log["sensor/position"]
    t = float(series.t[4]) + 0.3
    reported = recording.state(t)["sensors"]["position"]
    assert reported["age"] == pytest.approx(0.3)
    np.testing.assert_array_equal(reported["value"], series.values[4, :-1])
    assert (
        recording.state(0.0)["sensors"].keys() == SensorStatus(list(recording.readings)).report(0.0)["sensors"].keys()
    )


def test_consistency_is_that_of_a_flight(recording):
    """The engine's own window over the same ticks, judged at the same full second."""

    def reported_by_the_filter(nis: Any, dof: Any) -> Any:
        return SimpleNamespace(estimate=SimpleNamespace(nis=nis, nis_dof=dof))

    nis, dof = recording.log["autopilot/nis"], recording.log["autopilot/nis_dof"]
    engine = Consistency(list(nis.channel.fields))
    for t, n, d in zip(nis.t, nis.values, dof.values, strict=True):
        if t <= 25.0:
            engine.take(t, reported_by_the_filter(n, d))
    expected, found = engine.report(25.0), recording.state(25.7)["nis"]
    assert found.keys() == expected.keys() and found
    for name in found:
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-9)


def test_band_is_that_of_chi_square_tables():
    np.testing.assert_allclose(band(10.0), (0.3247, 2.0483), atol=5e-5)


def test_progress_grows_to_the_end(recording):
    states = [recording.state(t) for t in np.linspace(recording.start, recording.end, 30)]
    assert states[0]["progress"] < 0.1 and states[-1]["progress"] == 1.0
    assert all(state["waypoint"] / 2 <= state["progress"] <= 1.0 for state in states)


def test_real_flight_has_no_truth(tmp_path):
    recording = short_log(tmp_path, "autopilot/eta")
    state = recording.state(0.7)
    np.testing.assert_array_equal(state["eta"], [10, 11, 12, 13, 14, 15])
    assert [state[key] for key in ("truth", "current", "sd", "ellipse", "u", "phase", "to_go")] == [None] * 7
    assert not recording.setup()["twin"]
    encode(state)


def test_log_without_estimate_shows_truth_or_else_what_was_measured(tmp_path):
    np.testing.assert_array_equal(short_log(tmp_path, "truth/eta").state(1.0)["eta"], [20, 21, 22, 23, 24, 25])
    measured = short_log(tmp_path, "sensor/position", "sensor/pressure")
    np.testing.assert_array_equal(measured.state(0.6)["eta"], [10, 11, 10, 0, 0, 0])
    assert short_log(tmp_path, "sensor/pressure").state(0.6)["eta"] is None, "views wait for one"


def test_plan_and_setup_are_those_of_the_scenario(recording):
    rows = [(row["x"], row["y"], row["depth"], row["speed"]) for row in recording.plan(0)["flown"]]
    assert rows == [(0.6, 0.0, 0.5, 0.3), (0.6, 0.5, 0.5, 0.3)]
    setup = recording.setup()
    assert setup["vehicle"] == "double_blueye" and len(setup["thrusters"]) == 6 and setup["twin"]


# What happened.


def test_marks_say_what_happened_when(recording):
    marks = marks_of(recording)
    assert [mark["t"] for mark in marks] == sorted(mark["t"] for mark in marks)
    reached = [mark for mark in marks if mark["mark"] == "waypoint"]
    assert [mark["text"] for mark in reached] == ["way-point 1 of 2 reached"]
    before, after = (recording.state(reached[0]["t"] + dt)["waypoint"] for dt in (-0.01, 0.01))
    assert (before, after) == (0, 1)
    assert marks[0]["mark"] == "start" and (marks[-1]["mark"], marks[-1]["text"]) == ("end", "completed")


def test_decisions_of_the_supervisor_are_marked(tmp_path):
    mode = np.array([[3, 0, 0, 1], [5, 2, 0, 0], [3, 0, 0, 1], [8, 17, 1, 0]], float)
    channel = Channel("autopilot/mode", ("phase", "reason", "waypoint", "on_leg"), "1", "")
    metadata = {"faults": json.dumps([{"what": "sway dead", "start": 2.5, "end": None, "thrusters": []}])}
    log = Log.from_arrays([channel], {"autopilot/mode": (np.arange(4.0), mode)}, metadata)
    found = [(m["t"], m["mark"], m["text"]) for m in marks_of(Recording(log, tmp_path / "log.mcap"))]
    assert (1.0, "decision", "paused: operator") in found
    assert (2.0, "decision", "goes on (go): operator") in found
    assert (2.5, "fault", "fault: sway dead") in found
    assert (3.0, "decision", "held: time out") in found


# History.


def test_history_is_the_states_thinned(recording):
    block = history(recording)
    length = int.from_bytes(block[:4], "little")
    header = json.loads(block[4 : 4 + length])
    rows = np.frombuffer(block, "<f4", offset=4 + length).reshape(header["count"], -1)
    edges = np.cumsum([0, *(max(width, 1) for _, width in header["columns"])])
    assert rows.shape[1] == edges[-1]
    k = header["count"] // 2
    state = recording.state(header["start"] + k * header["step"])
    for (path, _), a, b in zip(header["columns"], edges, edges[1:], strict=False):
        value = state
        for step in path.split("."):
            value = value[step]
        np.testing.assert_allclose(rows[k, a:b], value, rtol=1e-5, atol=1e-4, err_msg=path)


# Pictures.


def test_album_gives_the_picture_that_was_there(tmp_path):
    with PictureWriter(tmp_path / "port.mcap", "port") as writer:
        for k in range(5):
            writer.write(0.1 * k, 0.1 * k + 0.03, bytes([k]) * 1000)
    album = Album(tmp_path / "port.mcap")
    assert [album.number_at(t) for t in (0.0, 0.03, 0.2, 0.23, 9.0)] == [None, 0, 1, 2, 4]
    assert album.picture(3) == bytes([3]) * 1000
    with pytest.raises(LogError, match="found 5 pictures, asked for number 5"):
        album.picture(5)


# Logs that cannot be shown.


def test_unfinished_log_says_how_to_repair_it(flown, tmp_path):
    (tmp_path / "log.mcap").write_bytes((flown / "log.mcap").read_bytes()[:200_000])
    with pytest.raises(LogError, match="rovtwin log repair"):
        Recording.open(tmp_path)


def test_damaged_log_says_how_to_repair_it(flown, tmp_path):
    data = bytearray((flown / "log.mcap").read_bytes())
    data[100_000:100_010] = bytes(10)
    (tmp_path / "log.mcap").write_bytes(data)
    with pytest.raises(LogError, match="rovtwin log repair"):
        Recording.open(tmp_path)


def test_what_is_no_run_is_refused(tmp_path):
    with pytest.raises(LogError, match="found no log.mcap in it"):
        Recording.open(tmp_path)
    with LogWriter(tmp_path / "log.mcap", [Channel("truth/eta", ETA, "m", "n")], {}):
        pass
    with pytest.raises(LogError, match="found no samples"):
        Recording.open(tmp_path)
    (tmp_path / "text.mcap").write_text("no log at all")
    with pytest.raises(LogError, match="not an MCAP file"):
        Recording.open(tmp_path / "text.mcap")


# The shelf.


def made(folder, summary=None):
    folder.mkdir(parents=True)
    (folder / "log.mcap").write_bytes(b"")
    if summary is not None:
        (folder / "summary.json").write_text(json.dumps(summary))


def test_runs_are_listed_newest_first(tmp_path):
    made(tmp_path / "20260101-120000-old", {"completed": True, "reason": "", "duration_s": 61.5})
    made(tmp_path / "20260301-120000-demo" / "calm", {"completed": False, "reason": "geofence", "duration_s": 3.0})
    made(tmp_path / "20260201-120000-killed")
    made(tmp_path / "mine", {"completed": True})
    os.utime(tmp_path / "mine" / "log.mcap", (0, 0))
    (tmp_path / "empty").mkdir()
    found = [(one["name"], one["verdict"], one["completed"], one["duration"]) for one in Shelf(tmp_path).runs()]
    assert found == [
        ("calm", "geofence", False, 3.0),
        ("killed", "unfinished", None, None),
        ("old", "completed", True, 61.5),
        ("mine", "completed", True, None),
    ]
    assert Shelf(tmp_path).runs()[0]["run"] == "20260301-120000-demo/calm"
    assert Shelf(tmp_path).runs()[2]["date"] == "2026-01-01 12:00"
    assert Shelf(tmp_path / "nowhere").runs() == []


@pytest.mark.parametrize(
    "run",
    ["../outside", "inside/../../outside", "..", ".", "", "{outside}", "link", "inside/\0", "x" * 5000, "nothing"],
)
def test_only_runs_in_the_folder_are_found(tmp_path, run):
    runs, outside = tmp_path / "runs", tmp_path / "outside"
    made(runs / "inside")
    made(outside)
    (runs / "link").symlink_to(outside)
    shelf = Shelf(runs)
    assert shelf.find("inside") == (runs / "inside").resolve()
    with pytest.raises(ConfigError, match="found no such run"):
        shelf.find(run.format(outside=outside))


# Browsers.


@pytest.fixture(scope="module")
def replaying(recording):
    pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
    from rovtwin.console.web.replays.replaying import Replaying

    return Replaying(recording, "short")


async def waiting_messages(seat):
    """All that waits for a browser, by kind."""
    found = {}
    while True:
        try:
            message = json.loads(await asyncio.wait_for(seat.next(), 0.001))
        except TimeoutError:
            return found
        found[message["kind"]] = message


async def answers_to(replaying, seat, **order):
    await replaying.obey(seat, json.dumps({"id": 1} | order))
    return await waiting_messages(seat)


def test_each_browser_is_where_it_wants_to_be(replaying):
    async def look():
        one, other = replaying.come("a"), replaying.come("b")
        first = await waiting_messages(one)
        assert {"setup", "plan", "marks", "history", "state"} <= first.keys()
        moved = await answers_to(replaying, one, do="seek", t=20.0)
        assert moved["state"]["t"] == 20.0 and moved["reply"]["ok"]
        assert (await waiting_messages(other))["state"]["t"] == 0.0
        assert (await answers_to(replaying, one, do="seek", t=1e9))["state"]["t"] == replaying.recording.end
        replaying.leave(one)
        replaying.leave(other)

    ran(look())
    assert replaying.seats == []


def test_steps_go_from_sample_to_sample(replaying):
    async def look():
        seat = replaying.come("a")
        steps = [
            (10.04, 1, 10.1),
            (None, 1, 10.2),
            (None, -1, 10.1),
            (10.04, -1, 10.0),
            (None, 2, 10.2),
            (0.0, -1, 0.0),
        ]
        for start, by, expected in steps:
            if start is not None:
                await answers_to(replaying, seat, do="seek", t=start)
            assert (await answers_to(replaying, seat, do="step", by=by))["state"]["t"] == pytest.approx(expected)

    ran(look())


def test_it_plays_at_its_pace_and_ends_at_the_end(replaying):
    async def look():
        seat = replaying.come("a")
        await answers_to(replaying, seat, do="seek", t=replaying.recording.end - 2.0)
        await answers_to(replaying, seat, do="play", running=True, speed=20)
        await asyncio.sleep(0.3)
        state = (await waiting_messages(seat))["state"]
        assert state["t"] == pytest.approx(replaying.recording.end) and not state["running"]
        again = await answers_to(replaying, seat, do="play", running=True, speed=1)
        assert again["state"]["t"] == replaying.recording.start, "from the end it begins again"
        replaying.leave(seat)
        assert not seat.running

    ran(look())


@pytest.mark.parametrize(
    "order", [{"do": "arm"}, {"do": "goto", "x": 1, "y": 2}, {"do": "seek", "t": "now"}, {"do": "seek"}]
)
def test_nothing_else_can_be_ordered(replaying, order):
    async def look():
        reply = (await answers_to(replaying, replaying.come("a"), **order))["reply"]
        assert not reply["ok"] and reply["error"]

    ran(look())


def test_stop_reaches_what_flies_beside(recording, replaying):
    from rovtwin.console.web.replays.replaying import Replaying

    async def look(one):
        return (await answers_to(one, one.come("a"), do="stop"))["reply"]

    async def stop():
        pressed.append(1)
        return True

    pressed = []
    assert ran(look(Replaying(recording, "", stop)))["message"] == "thrusters off"
    assert pressed == [1]
    assert "nothing flies" in ran(look(replaying))["error"]


def test_library_opens_a_run_once_and_lets_go_of_old_ones(tmp_path):
    from rovtwin.console.web.replays.replaying import OPEN, Library

    log = tmp_path / "mine" / "log.mcap"
    log.parent.mkdir()
    short_log(tmp_path, "truth/eta").log.write(log)

    async def read(path):
        return Log.read(path)

    async def look():
        library = Library(Shelf(tmp_path), read)
        one = await library.open("mine")
        assert await library.open("mine") is one
        for k in range(OPEN + 3):  # as if it had been written again
            os.utime(log, (k, k))
            newest = await library.open("mine")
        assert newest is not one and len(library._open) == OPEN
        with pytest.raises(RovtwinError, match="no such run"):
            await library.open("../x")

    ran(look())
