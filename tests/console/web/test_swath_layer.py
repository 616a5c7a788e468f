"""The layer of the floor that was seen: what pages are given, who may plan the gaps, and when it begins anew."""

import json
from dataclasses import replace

import pytest
from tests.console.loops import ran
from tests.console.swath.eyes import SOUNDER, fan, picture, states, straight

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")
pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")

from rovtwin.console.surveys import SurveyArea
from rovtwin.console.swath import gaps
from rovtwin.console.swath.painter import Depths
from rovtwin.console.web import hub as hubs
from rovtwin.console.web.swath_layer import SwathLayer
from rovtwin.console.wire import Place, encode
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.scenario.files import load_scenario

AREA = SurveyArea(((0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)), 3.4, 0.2, False)


class FakeClient:
    """An engine that obeys all."""

    def __init__(self, place, news):
        self.last, self.hung = {}, False

    async def ask(self, do, /, **what):
        encode(what)
        return {"ok": True, "checks": []}


class AtOnce:
    """A worker that works here; `refuses` is raised by its next call."""

    refuses = None

    async def call(self, function, *arguments):
        if self.refuses is not None:
            raise self.refuses
        return function(*arguments)

    def close(self):
        pass


@pytest.fixture
def desk(tmp_path, monkeypatch):
    monkeypatch.setattr(hubs, "Client", FakeClient)
    desk = hubs.Hub(Place(tmp_path), load_scenario("lawnmower_calm"))
    desk.worker = AtOnce()
    return desk


@pytest.fixture
def layer(desk):
    layer = SwathLayer(desk, load_scenario("lawnmower_calm"))
    layer.open([fan(), picture()], [], Depths([SOUNDER], None))
    return layer


def newest(desk):
    """The message as who comes late is given it."""
    page = desk.come("late")
    found = [json.loads(text) for text in page._texts]
    desk.leave(page)
    return next((one for one in found if one["kind"] == "swath"), None)


def shown(layer):
    ran(layer.judge())
    layer.send()


def flown(layer, seconds=20.0, **more):
    for state in states(*straight(seconds, **more)):
        layer.look(state)


def test_a_page_that_comes_late_is_given_all_that_was_painted(desk, layer):
    flown(layer)
    shown(layer)
    message = newest(desk)
    assert set(message) == {"kind", "flying", "area", "notes", "eyes"}
    assert message["flying"] and message["area"] is None and message["notes"] == []
    imager, camera = message["eyes"]
    assert (imager["name"], imager["kind"], imager["reach"], imager["by"]) == (
        "uhi.camera",
        "imager",
        12.0,
        "altimeter",
    )
    assert imager["height"] == pytest.approx(1.6, abs=0.03) and imager["why"] == "" and imager["began"] == 0.0
    assert imager["ended"] == pytest.approx(19.95 - 0.75, abs=0.06)
    assert imager["seen_m2"] == pytest.approx(0.3 * imager["ended"] * 1.72, rel=0.05) and imager["found"] is None
    assert {"cell", "north", "east", "rows", "columns", "data"} == set(imager["cells"])
    assert camera["seen_m2"] > imager["seen_m2"]


def test_share_and_gaps_are_of_the_area_of_the_draft_or_of_what_was_submitted(desk, layer):
    flown(layer)
    desk.draft.load([], AREA)
    shown(layer)
    message = newest(desk)
    assert message["area"] == [list(corner) for corner in AREA.corners]
    found = message["eyes"][0]["found"]
    assert found["area_m2"] == pytest.approx(24.0) and found["share"] == pytest.approx(1.72 * 5.8 / 24, rel=0.05)
    assert found["gaps_m2"] == pytest.approx((1 - found["share"]) * 24.0, rel=0.02)
    desk.draft.clear()
    shown(layer)
    assert newest(desk)["area"] is None and newest(desk)["eyes"][0]["found"] is None
    desk.draft.undo()
    ran(desk.drafting.do({"op": "add", "x": 1, "y": 1}))
    ran(desk.drafting.do({"op": "submit"}))
    desk.draft.clear()
    shown(layer)
    assert newest(desk)["eyes"][0]["found"]["share"] == found["share"]


def test_a_new_flight_begins_with_nothing_and_the_last_one_stays_until_then(desk, layer):
    flown(layer, 10.0)
    before = layer.painters[0].cells.seen_m2
    layer.look({"folder": "", "t": 10.0, "eta": [0.0] * 6})
    assert layer.painters[0].cells.seen_m2 > before  # what had waited for the end of a turn's measurement
    shown(layer)
    assert newest(desk)["eyes"][0]["cells"] is not None and not newest(desk)["flying"]
    layer.look(states([11.0], [[0, 0, 3.4, 0, 0, 0]], folder="runs/b")[0])
    assert layer.painters[0].cells.seen_m2 == 0.0
    flown(layer, 10.0, begin=12.0)
    layer.look(states([3.0], [[0, 0, 3.4, 0, 0, 0]])[0])  # the twin was started anew
    assert layer.painters[0].cells.seen_m2 == 0.0


def test_nothing_is_painted_while_no_flight_is_logged(layer):
    for state in states(*straight(5.0), folder=""):
        layer.look(state)
    assert layer.painters[0].cells.seen_m2 == 0.0


def test_an_area_that_cannot_be_judged_shows_why(desk, layer):
    flown(layer, 5.0)
    desk.draft.load([], AREA)
    desk.worker.refuses = RovtwinError("a survey needs shapely")
    shown(layer)
    assert newest(desk)["eyes"][0]["found"] == {"error": "a survey needs shapely"}


@pytest.mark.parametrize(("eye", "right"), [("camera", 0.5), ("pod.mbes", 0.5)])
def test_the_gaps_are_planned_where_the_eye_looks(desk, layer, monkeypatch, eye, right):
    """The planner is given a middle half a metre to the right, neither the camera's own nor that of an imager."""
    given = {}

    def rows_over(area, vehicle, swath=None, **asked):
        given.update(asked, vehicle=vehicle)
        return [{"x": 1.0, "y": 3.0, "depth": 3.4}]

    monkeypatch.setattr(gaps, "rows_over", rows_over)
    straight_down = picture()
    origin = straight_down.origin + [0.0, right, 0.0]
    layer.open([replace(straight_down, name=eye, origin=origin)], [], Depths([SOUNDER], None))
    flown(layer)
    desk.draft.load([], AREA)
    ran(desk.others["fill_gaps"]({"eye": eye}))
    assert given["middle"] == pytest.approx((0.0, right), abs=1e-6)


def test_the_gaps_become_a_draft_that_can_be_taken_back(desk, layer, monkeypatch):
    given = {}

    def rows_over(area, vehicle, swath=None, **asked):
        given.update(asked, area=area, swath=swath, vehicle=vehicle)
        return [{"x": 1.0, "y": 3.0, "depth": 3.4}, {"x": 5.0, "y": 3.0, "depth": 3.4}]

    monkeypatch.setattr(gaps, "rows_over", rows_over)
    flown(layer)
    desk.draft.load([{"x": 0.0, "y": 1.0, "depth": 3.4}], AREA)
    assert "2 way-points" in ran(desk.others["fill_gaps"]({"eye": "uhi.camera"}))
    assert [(row["x"], row["y"]) for row in desk.draft.rows] == [(1.0, 3.0), (5.0, 3.0)] and desk.draft.area == AREA
    assert given["mapping"].imager == "uhi" and given["floor"] == pytest.approx(5.0) and given["area"] == AREA
    missing = sum(part.area for part in given["gaps"].geoms)
    assert missing == pytest.approx(24.0 - 1.72 * 5.8, rel=0.05)
    desk.draft.undo()
    assert len(desk.draft.rows) == 1
    given.clear()
    ran(desk.others["fill_gaps"]({"eye": "camera"}))
    assert "mapping" not in given and given["swath"].width == pytest.approx(1.6 * 2 * 0.577, rel=0.02)


REFUSED = {
    "an eye that there is not": (lambda desk, layer: None, "sonar", "expected one of uhi.camera, camera"),
    "no area": (lambda desk, layer: flown(layer, 5.0), "camera", "there is no area"),
    "nothing seen": (lambda desk, layer: desk.draft.load([], AREA), "camera", "has seen nothing yet"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_the_gaps_of(desk, layer, case):
    before, eye, why = REFUSED[case]
    before(desk, layer)
    with pytest.raises(ConfigError, match=why):
        ran(desk.others["fill_gaps"]({"eye": eye}))
    assert desk.draft.rows == []


def test_only_who_is_in_control_plans_gaps(desk, layer):
    desk.come("b1")
    other = desk.come("b2")
    ran(desk.obey(other, json.dumps({"id": 1, "do": "fill_gaps", "eye": "camera"})))
    replies = [json.loads(text) for text in other._texts if '"reply"' in text]
    assert "in control" in replies[-1]["error"]


def test_a_vehicle_that_looks_ahead_has_no_layer(desk):
    layer = SwathLayer(desk, load_scenario("square", ["vehicle=bluerov2_heavy"]))
    ran(layer.run())
    assert newest(desk) is None
    with pytest.raises(ConfigError, match="no sensor whose swath is known looks down"):
        ran(layer.fill({"eye": "camera"}))
