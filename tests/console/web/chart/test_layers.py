"""Tiles and tracks as a page asks for them: made once, by a process of its own, and refused in words."""

import pytest

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")
pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")

from fastapi import FastAPI
from fastapi.testclient import TestClient

from rovtwin.console.chart.maps import MapFile
from rovtwin.console.replays.shelf import Shelf
from rovtwin.console.web.chart import layers
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.scenario.files import load_scenario

MAP = MapFile("/nowhere/harbour.tif", "harbour.tif", (-9.0, 9.0), (-9.0, 9.0), 0.5, None)


class FakeHub:
    def __init__(self):
        self.kept, self.events = [], []

    def keep(self, message):
        self.kept.append(message)

    def say(self, level, text):
        self.events.append((level, text))


class FakeWorker:
    """Does at once what it is asked, or raises; `asked` are the arguments."""

    asked, answers = [], []

    def __init__(self, what, patience):
        pass

    def close(self):
        pass

    async def call(self, function, *arguments):
        FakeWorker.asked.append(arguments)
        answer = FakeWorker.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer


@pytest.fixture
def page(monkeypatch, tmp_path):
    server, hub = FastAPI(), FakeHub()
    server.on_shutdown = lambda done: None
    FakeWorker.asked, FakeWorker.answers = [], []
    monkeypatch.setattr(layers, "app", server)
    monkeypatch.setattr(layers, "Worker", FakeWorker)
    layers.add_layers(hub, load_scenario("square"), Shelf(tmp_path), [MAP])
    client = TestClient(server)
    client.hub = hub
    return client


def test_pages_learn_which_maps_there_are(page):
    (message,) = page.hub.kept
    assert message["kind"] == "layers" and message["maps"][0]["name"] == "harbour.tif"
    assert message["maps"][0]["finest"] == 1  # half a metre


def test_a_tile_is_made_once_an_empty_one_too(page):
    FakeWorker.answers = [b"png", None]
    for _ in range(2):
        assert page.get("/map/0/1/0/0.png").content == b"png"
        assert page.get("/map/0/1/7/0.png").status_code == layers.NOTHING
    assert [arguments[2:] for arguments in FakeWorker.asked] == [(1, 0, 0), (1, 7, 0)]


def test_who_asks_while_others_wait_asks_again(page):
    FakeWorker.answers = [RovtwinError("the map: 16 others wait already"), b"png"]
    assert page.get("/map/0/1/0/0.png").status_code == layers.BUSY
    assert page.get("/map/0/1/0/0.png").content == b"png"


def test_a_file_that_is_gone_is_an_event_and_not_asked_for_again(page):
    FakeWorker.answers = [ConfigError("harbour.tif: cannot be read any more")]
    for _ in range(2):
        assert page.get("/map/0/1/0/0.png").status_code == layers.NOTHING
    assert page.hub.events == [("warning", "harbour.tif: cannot be read any more")]


@pytest.mark.parametrize(
    "path",
    ["/map/1/0/0/0.png", "/map/-1/0/0/0.png", "/map/0/13/0/0.png", "/map/0/-8/0/0.png", f"/map/0/0/{10**400}/0.png"],
)
def test_what_is_no_tile_is_never_asked_for(page, path):
    assert page.get(path).status_code == 404 and not FakeWorker.asked


def test_a_run_that_is_not_there_is_refused_in_words(page):
    for run in ("nowhere", "../..", "x" * 5000, "\x00"):
        assert "found no such run" in page.get("/chart/track", params={"run": run}).json()["error"]
    assert not FakeWorker.asked


def test_so_much_is_kept_and_no_more():
    tiles = layers.Tiles()
    for i in range(40):
        tiles.put((i,), b"x" * 1_000_000)
        tiles.get((0,))
    assert tiles.size <= layers.MOST_BYTES and tiles.get((0,)) and tiles.get((5,)) is None and tiles.get((39,))
    for i in range(layers.MOST_TILES + 5):
        tiles.put((1, i), b"")
    assert tiles.get((1, 0)) is None and tiles.get((1, layers.MOST_TILES + 4)) == b""
