"""The rehearsal on the page: figures, rows, progress in words, the corridor on the chart, the flight beside it."""

import pytest
from tests.console import messages

AXES = [
    {"axis": "across", "unit": "m", "inside": 0.98, "least_usual": 0.9, "beyond": 0.0, "verdict": "inside"},
    {"axis": "depth", "unit": "m", "inside": 0.41, "least_usual": 0.9, "beyond": 0.21, "verdict": "outside"},
]
EFFORT = [{"axis": "surge", "ratio": 1.94, "interval_95": [0.88, 1.14], "verdict": "outside"}]


def flown(verdict="outside", **more):
    path = {"place": [[0, 0], [2, 0.2], [4, 0.4]], "depth": [2.0, 2.1, 2.2]}
    time = {"predicted": 70.0, "flown": 74.0, "inside": True}
    energy = {"predicted": 1.4, "flown": 2.9, "inside": False, "by": "the thrusters' commands"}
    beside = {"axes": AXES, "effort": EFFORT, "time_s": time, "energy_wh": energy}
    return {"verdict": verdict, "notes": [], "track": path, **beside, **more}


def rehearsal(**more):
    place = [[0, 1], [2, 1], [4, 1]]  # beside the plan, which is drawn over it
    track = {"place": place, "port": [[x, y - 0.3] for x, y in place], "starboard": [[x, y + 0.3] for x, y in place]}
    profile = {"t": [0, 30, 70], "depth": [2, 2, 2], "low": [1.9] * 3, "high": [2.1] * 3, "planned": [[0, 2], [70, 2]]}
    profile |= {"floor": [4, 4, 4], "hull": [2.4, 2.4, 2.4]}
    points = [
        {"reached": 12.4, "early": 11.0, "late": 14.0, "margin": 0.42, "least_margin": 0.31},
        {"reached": 70.0, "early": 66.0, "late": 75.0, "margin": 0.2, "least_margin": 0.04},
    ]
    model = {"vehicle": "blue", "identified": True, "drawn_from": "the covariance of 9 parameters", "draws": 39}
    figures = {"time_s": {"value": 70, "low": 66, "high": 75}, "energy_wh": {"value": 1.45, "low": 1.2, "high": 1.6}}
    figures |= {
        "charge": {"start": 1, "value": 0.8, "low": 0.7, "high": 0.85},
        "charge_by": "80 % at the start, by the gauge",
    }
    words = {"water": "no current, the twin's; no waves", "floor_by": "the scenario", "nearest_m": {"the floor": 1.6}}
    remarks = [{"level": "warning", "what": "way-point 2: a thruster has 4 % of its force left", "points": [1]}]
    fixed = {"kind": "rehearsal", "whole": True, "alike": 39, "level": 0.95, "margin": 0.04, "remarks": remarks}
    return fixed | model | figures | words | {"track": track, "profile": profile, "points": points} | more


def rehearsing(**more):
    idle = {"kind": "rehearsing", "busy": False, "doing": "", "share": None, "seconds": None, "why": "", "again": True}
    return idle | {"asked": True, "stale": False, "current": None, "waves": None, "has_waves": False} | more


FORGET = """async () => {
  const [{live}, {layer}] = await Promise.all([import('/static/live.js'), import('/static/rehearsal_layer.js')]);
  ['rehearsal', 'rehearsing'].forEach(kind => { delete live.last[kind]; });
  Object.assign(layer, {message: null, stale: false, shown: true}); }"""


@pytest.fixture
def views(open_views):
    plan = messages.plan((0, 0), (4, 0)) | {"changed": True, "length": 4.0, "seconds": 20.0}

    def opened(*names, **more):
        page = open_views(*names)
        page.evaluate(FORGET)
        for message in (messages.setup(), messages.state(), messages.rights(), plan):
            page.evaluate("message => window.emit(message)", message | more.get(message["kind"], {}))
        return page

    return opened


def emit(page, *several):
    for message in several:
        page.evaluate("message => window.emit(message)", message)


def text_of(page, place="#rehearsal"):
    return page.inner_text(place)


def test_figures_stand_with_their_intervals_and_the_level_is_named(views):
    page = views("rehearsal")
    emit(page, rehearsing(), rehearsal())
    text = text_of(page)
    for words in (
        "1:10 (1:06 to 1:15) min",
        "1.45 Wh (1.20 Wh to 1.60 Wh)",
        "80 % (70 % to 85 %)",
        "1.60 m or more",
    ):
        assert words in text
    assert "one more lies between them with 95 %" in text and "the covariance of 9 parameters" in text
    assert "as it was identified" in text
    rows = page.locator("#rehearsal tr.warning").all_inner_texts()
    assert len(rows) == 1 and rows[0].startswith("2") and "4 %" in rows[0]


def test_the_first_flight_stands_alone_until_the_others_come(views):
    page = views("rehearsal")
    first = rehearsal(whole=False, level=None, charge=None, charge_by="blue's file has no battery", remarks=[])
    for name in ("time_s", "energy_wh"):
        first[name] = {"value": first[name]["value"]}
    first["points"] = [{"reached": 12.4, "margin": 0.42}]
    emit(page, rehearsing(busy=True, doing="flying 39 drawn vehicles", share=0.31, seconds=75), first)
    assert "flying 39 drawn vehicles, 31 % · 1:15" in text_of(page)
    assert "1:10 min" in text_of(page) and "1:06" not in text_of(page) and "no battery" in text_of(page)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (rehearsing(asked=False), "Not rehearsed yet."),
        (rehearsing(why="the process that rehearses ended"), "the process that rehearses ended"),
        (rehearsing(stale=True), "rehearsed again in a moment"),
        (rehearsing(stale=True, again=False), "Rehearse again."),
    ],
)
def test_what_goes_on_is_in_words_in_both_places(views, message, words):
    page = views("plan", "rehearsal")
    emit(page, message)
    assert words in text_of(page) and words in text_of(page, "#plan .rehearsing")


def test_arrivals_stand_under_the_numbers_of_their_rows_and_go_with_a_change(views):
    page = views("plan")
    emit(page, rehearsal(), rehearsing())
    heads = page.locator("#plan tbody th")
    assert heads.all_inner_texts() == ["1\n0:12", "2\n1:10"]
    assert "1:06 to 1:15" in page.locator("#plan tbody th small").nth(1).get_attribute("title")
    emit(page, rehearsing(stale=True))
    assert heads.all_inner_texts() == ["1", "2"]


def test_who_watches_cannot_ask_and_who_is_in_control_does(views):
    page = views("plan", "rehearsal", rights={"may": False})
    assert page.locator("#rehearse").is_disabled() and page.get_by_role("button", name="Rehearse").last.is_disabled()
    emit(page, messages.rights())
    page.locator("#rehearse").click()
    page.locator("#rehearse-again").click()
    sent = page.evaluate("window.sent")
    assert sent == [{"do": "rehearse", "op": "now"}, {"do": "rehearse", "op": "again", "on": False}]


def test_a_current_is_sent_once_both_of_its_numbers_are_there(views):
    page = views("rehearsal")
    emit(page, rehearsing())
    page.locator("#rehearsal summary").click()
    page.get_by_label("Current [m/s]").fill("0.2")
    page.get_by_label("Current [m/s]").press("Tab")
    assert page.evaluate("window.sent") == []
    page.get_by_label("towards [deg]").fill("90")
    page.get_by_label("towards [deg]").press("Tab")
    assert page.evaluate("window.sent") == [
        {"do": "rehearse", "op": "water", "speed": 0.2, "toward": 90, "waves": None}
    ]


def test_the_water_that_holds_stands_in_its_fields_and_what_is_half_typed_stays(views):
    page = views("rehearsal")
    emit(page, rehearsing(current=[0.0, 0.3], waves=0.5, has_waves=True))
    assert [page.input_value(f"[name={name}]") for name in ("speed", "toward", "waves")] == ["0.3", "90", "0.5"]
    page.fill("[name=speed]", "0.4")
    emit(page, rehearsing(current=[0.0, 0.3], waves=0.5, has_waves=True, busy=True, doing="flying"))
    assert page.input_value("[name=speed]") == "0.4"


def test_a_flight_that_was_not_predicted_is_named_so(views):
    page = views("rehearsal")
    emit(page, rehearsing(), rehearsal(flown=flown()))
    text = text_of(page)
    assert "The model does not predict this flight" in text
    assert "41 % inside (drawn flights 90 % or more), up to 0.21 m beyond" in text
    assert "+94 % against the prediction (95 %: −12 % to +14 %)" in text
    assert "2.90 Wh, predicted 1.40 Wh, by the thrusters' commands" in text
    assert page.locator("#rehearsal .rehearsal-flown tr.error").count() == 2


COUNT = """shade => {
  const canvas = document.querySelector('#chart canvas');
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let i = 0; i < data.length; i += 4) count += shade.every((value, k) => data[i + k] === value);
  return count; }"""
PREDICTED = [201, 160, 255]


def painted(page):
    """Pixels of the rehearsed track on the chart, after the next frame."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return page.evaluate(COUNT, PREDICTED)


def test_the_track_is_on_the_chart_and_can_be_taken_off(views):
    page = views("chart", "rehearsal")
    assert painted(page) == 0
    emit(page, rehearsing(), rehearsal())
    assert painted(page) > 30
    page.get_by_label("Show on the chart").click()
    assert painted(page) == 0
    page.get_by_label("Show on the chart").click()
    assert painted(page) > 30
    emit(page, rehearsing(stale=True))
    assert painted(page) == 0, "fainter where the plan has changed since"
