"""Pictures handed out to browsers: who waits for them, what is said when they end, and that nobody holds up STOP."""

import asyncio
import time

import pytest
from tests.console.loops import ran

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.console.pictures import Picture
from rovtwin.console.web import camera_stream
from rovtwin.console.web.camera_stream import Stream, feed_of
from rovtwin.core.errors import ConfigError
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle

CLOSING = 0.3  # that a process takes to end [s]


class FakeProcess:
    """Has a picture each time it is asked, until it breaks."""

    made: list["FakeProcess"] = []

    def __init__(self, feed):
        self.why, self.is_closed = feed or "", False
        FakeProcess.made.append(self)

    def newest(self):
        return None if self.why else Picture(1.0, b"jpeg", (8, 4), [{"id": 7}])

    def close(self):
        time.sleep(CLOSING)
        self.is_closed = True


@pytest.fixture
def reported(monkeypatch):
    """What pages were sent: sights as they come, and what is kept for later ones."""
    monkeypatch.setattr(camera_stream, "PictureProcess", FakeProcess)
    monkeypatch.setattr(camera_stream, "REST", 0.2)
    FakeProcess.made = []
    return {"sights": [], "kept": []}


def stream(reported, feed):
    return Stream(feed, "", reported["sights"].append, reported["kept"].append)


async def look(stream, pictures):
    """Take so many pictures, and go; how many there were."""
    taken, parts = 0, stream.parts()
    async for part in parts:
        assert b"image/jpeg" in part and part.endswith(b"jpeg\r\n")
        taken += 1
        if taken == pictures:
            break
    await parts.aclose()
    return taken


def test_looking_costs_a_process_while_somebody_does_and_its_end_holds_nobody_up(reported):
    async def work():
        one = stream(reported, "")
        assert await asyncio.gather(look(one, 3), look(one, 5)) == [3, 5]
        before, longest = time.monotonic(), 0.0
        while not FakeProcess.made[0].is_closed:
            await asyncio.sleep(0.005)
            longest, before = max(longest, time.monotonic() - before), time.monotonic()
        assert longest < 0.5 * CLOSING
        assert await look(one, 1) == 1  # another is made

    ran(work())
    assert len(FakeProcess.made) == 2
    assert reported["kept"] == [{"kind": "camera", "live": True, "why": ""}]
    assert reported["sights"][0] == {"kind": "sight", "markers": [{"id": 7}], "picture": [8, 4]}


def test_who_comes_while_a_process_ends_gets_pictures_of_the_next(reported):
    async def work():
        one = stream(reported, "")
        assert await look(one, 1) == 1
        await asyncio.sleep(0.5 * CLOSING)
        assert not FakeProcess.made[0].is_closed
        assert await look(one, 2) == 2

    ran(work())
    assert len(FakeProcess.made) == 2


@pytest.mark.system
def test_camera_that_fails_is_reported_once_and_tried_again_ever_more_seldom(reported):
    async def work():
        one = stream(reported, "no light")
        begun = time.monotonic()
        times = []
        while len(times) < 3:
            if not one.rests:
                assert await look(one, 1) == 0
                times.append(time.monotonic() - begun)
            await asyncio.sleep(0.01)
        return times

    first, second, third = ran(work())
    assert third - second > 1.5 * (second - first) > 0.2
    assert [one["why"] for one in reported["kept"]] == ["", "no light"] and reported["sights"] == []


def test_process_that_cannot_be_started_is_reported(reported, monkeypatch):
    def none_left(feed):
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(camera_stream, "PictureProcess", none_left)
    one = stream(reported, "")
    assert ran(look(one, 1)) == 0
    assert one.rests and "Resource temporarily unavailable" in reported["kept"][-1]["why"]


def test_without_a_camera_it_says_what_to_do(reported):
    scenario, vehicle = load_scenario("lawnmower_calm"), load_vehicle("double_blueye")
    with pytest.raises(ConfigError, match="--camera rtsp://"):
        feed_of(scenario, vehicle, False, "ipc://nowhere", None)
    one = Stream(None, "none", reported["sights"].append, reported["kept"].append)
    assert one.rests and reported["kept"] == [{"kind": "camera", "live": False, "why": "none"}]
