"""What a replay paints of a log is what was painted in flight, by the slider's time."""

import base64
import zlib

import numpy as np
import pytest
from tests.console.swath.eyes import fan, states, straight

from rovtwin.console.replays import seen as replayed
from rovtwin.console.replays.replay import Recording
from rovtwin.console.swath.eyes import sounders_of
from rovtwin.console.swath.painter import UNJUDGED, Depths, Painter
from rovtwin.core.log import Channel, Log
from rovtwin.runs.recording.channels import ETA, ETA_UNITS
from rovtwin.scenario.files import dump_scenario, load_scenario

WORLD = ("world.floor=5", "sensors={altimeter: true}")


def recorded(folder, names=("autopilot/eta", "truth/eta"), world=WORLD, begin=0.0, silent=(8.0, 12.0), **more):
    """A log of a straight line whose truth lies 3 m aside, and what the engine would have reported of it."""
    scenario = load_scenario("lawnmower_calm", [*world, *more.get("overrides", ())])
    t, eta = straight(20.0, rate=10.0, begin=begin)
    given = states(t, eta, sounder=sounders_of(load_scenario("lawnmower_calm", list(WORLD)))[0])
    ranges = np.array([state["sensors"]["altimeter"]["value"][0] for state in given])
    values = {name: (t, eta + [0, 3.0 * (name == "truth/eta"), 0, 0, 0, 0]) for name in names}
    channels = [Channel(name, ETA, ETA_UNITS, "n") for name in names]
    channels.append(Channel("sensor/altimeter", ("range", "t_valid"), ("m", "s"), "sensor"))
    received = (t < silent[0]) | (t > silent[1])
    values["sensor/altimeter"] = (t[received], np.column_stack([ranges, t])[received])
    log = Log.from_arrays(channels, values, {"scenario": dump_scenario(scenario)})
    last = int(np.flatnonzero(received & (t < silent[0]))[-1])
    for i in np.flatnonzero(~received):
        given[i]["sensors"] = {"altimeter": {"age": t[i] - t[last], "value": [ranges[last]]}}
    return Recording(log, folder / "log.mcap"), given, scenario


@pytest.fixture
def eyes(monkeypatch):
    monkeypatch.setattr(replayed, "eyes_of", lambda scenario: ([fan()], []))


def test_the_replay_paints_the_estimate_as_the_flight_did(tmp_path, eyes):
    recording, given, scenario = recorded(tmp_path)
    message = replayed.seen(recording)
    (eye,) = message["eyes"]
    first, _ = np.frombuffer(zlib.decompress(base64.b64decode(eye["cells"]["data"])), "<u2").reshape(
        2, eye["cells"]["rows"], eye["cells"]["columns"]
    )
    at = np.where(first < 65535, eye["cells"]["begin"] + eye["cells"]["step"] * first, np.inf)
    live, depths = Painter(fan()), Depths(sounders_of(scenario), None)
    for state in given:
        live.take(depths.instant(state))
        if state["t"] == pytest.approx(6.0 + 0.7):
            assert (at <= 6.0).sum() * 0.05**2 == pytest.approx(live.cells.seen_m2, rel=0.03)
    live.finish()
    expected = np.isfinite(live.cells.first)
    rows, columns = np.nonzero(expected)
    box = expected[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert np.array_equal(np.isfinite(at), box)
    assert eye["cells"]["east"] == pytest.approx((live.cells.low[1] + columns.min()) * 0.05)
    reasons = [why for _, why in eye["course"]]
    assert "no height by altimeter" in reasons and reasons[-1] == ""
    lost = next(since for since, why in eye["course"] if why == "no height by altimeter")
    assert lost == pytest.approx(9.0, abs=0.15)  # a second after the last reading


def test_what_is_not_judged_yet_is_not_called_painted(tmp_path, eyes):
    """The log begins 5 s late: until then nobody knows, and from then on the floor is painted."""
    recording, *_ = recorded(tmp_path, begin=5.0)
    (eye,) = replayed.seen(recording)["eyes"]
    assert eye["course"][:2] == [(0.0, UNJUDGED), (5.0, "")]
    assert all(a[1] != b[1] for a, b in zip(eye["course"], eye["course"][1:], strict=False))


def test_the_course_ends_with_the_last_instant(tmp_path, eyes):
    """The altimeter falls silent so late that only what is painted at the end knows of it."""
    recording, *_ = recorded(tmp_path, silent=(18.4, 20.0))
    (eye,) = replayed.seen(recording)["eyes"]
    assert eye["course"][-1][1] == "no height by altimeter" and eye["course"][-1][0] == pytest.approx(19.4, abs=0.15)


def test_nothing_is_painted_of_a_log_without_an_estimate(tmp_path, eyes):
    recording, *_ = recorded(tmp_path, names=("truth/eta",))
    assert not replayed.has_seen(recording) and replayed.seen(recording) is None


def test_a_vehicle_that_looks_ahead_has_seen_nothing(tmp_path):
    recording, *_ = recorded(tmp_path, overrides=("vehicle=bluerov2_heavy",))
    assert not replayed.has_seen(recording)
