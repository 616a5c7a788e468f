"""The view Commission in Chromium: what to do next, cards that only a click made after they appeared answers, pages."""

import json

import pytest

QUESTION = {"id": 3, "kind": "confirm", "text": "Thrusters turn for 38 s. Are all hands away", "unit": ""}
NOW = {"name": "dip", "title": "Dip", "moves": True, "folder": "c", "attempts": 1, "phase": "asking"}
CHECKS = [
    {"verdict": "ok", "what": "gyro", "text": "as expected", "fix": ""},
    {"verdict": "warning", "what": "clock", "text": "it is late.", "fix": "Look for a slow link."},
    {"verdict": "stop", "what": "port", "text": "pushes the other way.", "fix": "Turn its sign."},
]
FILES = [
    {"path": "3-dip/2/log.mcap", "picture": False, "bytes": 1_500_000},
    {"path": "3-dip/2/pull.png", "picture": True, "bytes": 900},
    {"path": "3-dip/2/certificate.html", "picture": False, "bytes": 9000},
    {"path": "3-dip/2/bundle.zip", "picture": False, "bytes": 9000},
]


def attempt(number, state, checks, files=()):
    fixed = {"began": "2026-11-26T12:00:00Z", "seconds": 38.0, "skipped": "no scale", "folder": f"3-dip/{number}"}
    return fixed | {"number": number, "state": state, "checks": checks, "files": list(files)}


def stage(number, name, state, attempts=()):
    words = {"purpose": f"what {name} finds out", "next": f"What comes after {name}."}
    flags = {"moves": name == "dip", "connects": True}
    return {"number": number, "name": name, "title": name.title(), "state": state, "attempts": list(attempts)} | (
        words | flags
    )


TRIED = [attempt(1, "cut off", []), attempt(2, "no-go", CHECKS, FILES)]
STAGES = [stage(1, "paper", "passed", [attempt(1, "go", CHECKS[:1])]), stage(2, "dip", "no-go", TRIED)]
REQUEST = {
    "vehicle": "double_blueye",
    "link": "twin://",
    "tank": "6x3x1.5",
    "sensors": [],
    "minutes": 15,
    "prior": None,
}
CHECKLIST = {
    "name": "c",
    "folder": "/runs/c",
    "request": REQUEST,
    "due": "dip",
    "next": "No-go, port: Turn its sign. Then start Dip again.",
    "stages": [*STAGES, stage(3, "drill", "to do")],
}
NEXT = CHECKLIST["next"]
FOUND = {"name": "c", "vehicle": "double_blueye", "link": "twin://", "last": "dip", "date": "2026-11-26 12:00"}
LIST = {"folder": "runs", "found": [FOUND], "defaults": {"vehicle": "my/rov.yaml", "link": "twin://", "sides": [6, 3]}}


@pytest.fixture
def opened(open_views, views_page):
    """`opened("?name=c")` builds the view with a checklist; this page is in control."""
    shared, _ = views_page
    found = {"checklist": CHECKLIST, "list": LIST}

    def answer(route):
        kind = route.request.url.split("/commission/")[1].split("?")[0]
        route.fulfill(body=json.dumps(found[kind]), content_type="application/json")

    shared.route("**/commission/*", answer)
    shared.route("**/commission/file*", lambda route: route.fulfill(body="<svg/>", content_type="image/svg+xml"))

    def opened(query, may=True):
        shared.evaluate("query => history.replaceState(null, '', '/' + query)", query)
        page = open_views("commission")
        page.evaluate("may => window.emit({kind: 'rights', may, in_control: may ? 'b1' : 'b2'})", may)
        reported(page, revision=0)  # the stand-in remembers what other tests told it
        return page

    yield opened
    forget = "import('/static/live.js').then(({live}) => { clearInterval(window.beat); delete live.last.pulse; })"
    shared.evaluate(forget)
    shared.evaluate("history.replaceState(null, '', '/')")
    shared.unroute("**/commission/*")
    shared.unroute("**/commission/file*")


def reported(page, **changes):
    """What the server tells of the stage that is being done."""
    progress = {"what": "", "share": None, "since": 0, "began": 0}
    fixed = {"kind": "commission", "now": None, "question": None, "progress": progress}
    page.evaluate("m => window.emit(m)", fixed | {"lines": [], "ended": None, "held": False, "revision": 1} | changes)


def answers(page):
    return page.evaluate("window.sent.filter(one => one.op === 'answer').map(one => [one.question, one.value])")


def able(page):
    page.wait_for_function(
        "() => [...document.querySelectorAll('.commission-question button')].every(b => !b.disabled)"
    )


def test_only_a_click_made_after_the_question_appeared_answers_it(opened):
    page = opened("?name=c")
    page.get_by_role("button", name="Start Dip").wait_for()
    reported(page, now=NOW, question=QUESTION)
    card = page.get_by_role("alertdialog", name="Dip asks")
    yes, no = card.get_by_role("button", name="Yes"), card.get_by_role("button", name="No")
    assert yes.is_disabled() and no.is_disabled(), "a click that was meant for something else"
    page.keyboard.press("Enter")
    page.keyboard.press("Space")
    assert page.evaluate("document.activeElement.getAttribute('role')") == "alertdialog"
    assert "Thrusters may turn after a yes" in card.inner_text()
    assert answers(page) == []
    able(page)
    page.keyboard.press("Enter")
    assert answers(page) == [], "no button has the focus by itself"
    assert "read it, look at the vehicle, then answer" in page.inner_text("#commission-next")
    yes.click()
    assert answers(page) == [[3, True]] and yes.is_disabled() and no.is_disabled()
    reported(page, now=NOW | {"phase": "resting"}, question=QUESTION | {"id": 4})
    able(page)
    assert "Thrusters may turn" not in card.inner_text(), "this one moves nothing"
    no.click()
    assert answers(page) == [[3, True], [4, False]]
    reported(page, now=NOW)
    assert page.locator(".commission-question").count() == 0


def test_a_figure_has_its_unit_and_may_be_not_to_be_had(opened):
    page = opened("?name=c")
    reported(page, now=NOW, question=QUESTION | {"id": 5, "kind": "number", "text": "What did it read", "unit": "N"})
    able(page)
    assert "asks for a figure" in page.inner_text("#commission-next")
    assert "says what is lost" in page.inner_text(".commission-question")
    field = page.get_by_label("What did it read [N]")
    page.get_by_role("button", name="Send").click()
    assert answers(page) == [], "nothing was typed"
    field.fill("12.5")
    field.press("Enter")
    assert answers(page) == [[5, 12.5]]
    reported(page, now=NOW, question=QUESTION | {"id": 6, "kind": "number", "text": "And now", "unit": "N"})
    able(page)
    page.get_by_role("button", name="Not to be had").click()
    assert answers(page)[1:] == [[6, None]]


def test_who_only_watches_answers_and_starts_nothing(opened):
    page = opened("?name=c", may=False)
    assert page.get_by_role("button", name="Start Dip").is_disabled()
    reported(page, now=NOW, question=QUESTION)
    page.wait_for_timeout(1000)
    assert (
        page.get_by_role("button", name="Yes").is_disabled()
        and page.get_by_role("button", name="End Dip").is_disabled()
    )
    assert "b2 is in control" in page.inner_text(".commission-question")
    assert "whoever is in control answers" in page.inner_text("#commission-next")


def test_one_sentence_says_what_to_do_next(opened):
    page = opened("?name=c")
    page.wait_for_function(
        "text => document.querySelector('#commission-next').innerText === text", arg=CHECKLIST["next"]
    )
    page.get_by_role("button", name="Start Dip").click()
    assert page.evaluate("window.sent.at(-1)") == {"do": "commission", "op": "start", "folder": "c", "stage": "dip"}
    doing = {"what": "planning", "share": 0.25, "since": 1060, "began": 1000}
    lines = ["2. Dip: what dip finds out", "hands off"]
    reported(page, now=NOW | {"phase": "resting"}, held=True, revision=2, progress=doing, lines=lines)
    assert "thrusters stay off until it has asked" in page.inner_text("#commission-next")
    assert page.locator("#commission progress").get_attribute("value") == "0.25"
    page.evaluate("window.beat = setInterval(() => window.emit({kind: 'pulse', at: 1125}), 200)")
    page.wait_for_function("document.querySelector('.commission-time').innerText === '1:05 (2:05 in all)'")
    assert page.locator(".commission-lines li").all_inner_texts() == ["hands off"], "its title stands on its page"
    reported(page, now=NOW | {"phase": "turning"}, held=True, revision=2, lines=lines)
    assert "Watch the vehicle; STOP or Esc" in page.inner_text("#commission-next")
    news = {"kind": "commission_progress", "what": "pushing astern", "share": 0.5, "since": 1122, "began": 1122}
    page.evaluate("m => window.emit(m)", news)
    assert "pushing astern" in page.inner_text("#commission-now") and "hands off" in page.inner_text("#commission-now")
    page.wait_for_function("document.querySelector('.commission-time').innerText === '0:03'")
    page.get_by_role("button", name="End Dip").click()
    assert page.evaluate("window.sent.at(-1).op") == "end"
    assert page.locator("#stage-dip .commission-chip").inner_text() == "now"
    assert page.locator("#commission-attempt").count() == 0, "the attempt that is being made has no page yet"
    before = page.locator("#commission-before")
    assert before.get_attribute("open") is None and "The attempt before: cut off" in before.inner_text()
    reported(page, now=NOW | {"ending": True}, held=True, revision=2)
    assert "is being ended" in page.inner_text("#commission-next") and page.locator("#commission-end").is_disabled()
    reported(page, now=NOW | {"folder": "other"}, revision=3)
    assert "Dip of other" in page.inner_text("#commission-next"), "another commissioning goes on"
    reported(page, now=NOW | {"name": "paper", "title": "Paper", "moves": False}, revision=3)
    assert "thrusters stay off" in page.inner_text("#commission-next")
    ended = {"stage": "dip", "folder": "c", "how": "no-go", "level": "danger", "text": "Dip: no-go. Its page says why."}
    reported(page, ended=ended, held=True, revision=4)
    assert "Its page says why" in page.inner_text("#commission-now")
    page.get_by_role("button", name="Give the vehicle back").click()
    assert page.evaluate("window.sent.at(-1).op") == "give_back"


def test_a_page_has_lines_with_their_fixes_pictures_and_links(opened):
    page = opened("?name=c")
    page.get_by_role("heading", name="2 Dip").wait_for()
    page.wait_for_function("getComputedStyle(document.querySelector('.commission-checks li')).display !== 'list-item'")
    lines = page.locator(".commission-checks li").all_inner_texts()
    verdicts = page.locator(".commission-checks li > b").all_inner_texts()
    assert verdicts == ["NO-GO", "warning", "ok"], "what stops it stands first"
    box = page.locator(".commission-checks li").first.bounding_box()
    assert box["width"] > 300, "a no-go line has room for its words"
    assert "Turn its sign." in lines[0] and "Without it: no scale" in page.inner_text(".commission-page")
    links = page.eval_on_selector_all(
        ".commission-page a", "all => all.map(a => [a.innerText, a.getAttribute('href')])"
    )
    named = dict(links)
    assert named["Certificate"] == "/commission/file?name=c&path=3-dip%2F2%2Fcertificate.html"
    assert "Bundle of the evidence" in named and page.locator(".commission-pictures img").count() == 1
    page.get_by_label("Attempt").select_option(label="1 (cut off)")
    assert "ended before it had a page" in page.inner_text(".commission-page")
    page.locator("#stage-paper").click()
    page.get_by_role("heading", name="1 Paper").wait_for()
    page.get_by_role("button", name="Do Paper again").click()
    assert page.evaluate("window.sent.at(-1).stage") == "paper"


def test_one_is_begun_or_opened_and_asked_for_anew(opened):
    page = opened("")
    assert "Begin a commissioning, or open one" in page.inner_text("#commission-next")
    page.get_by_role("link", name="c double_blueye over twin://").wait_for()
    assert page.get_by_label("Folder").input_value() == "commissioned-rov"
    for side, value in (("length", "6"), ("width", "3"), ("depth", "1.5")):
        page.get_by_label(f"{side} of the tank").fill(value)
    page.evaluate("window.refuse = 'folder: runs/c is there already'")
    page.get_by_role("button", name="Begin").click()
    page.get_by_text("runs/c is there already").wait_for()
    given = page.evaluate("window.sent.at(-1)")
    assert given["op"] == "begin" and given["folder"] == "commissioned-rov"
    asked = {"vehicle": "my/rov.yaml", "tank": "6x3x1.5", "interval": 0.05, "currents": [0, 0.1, 0.2], "prior": None}
    assert {key: given["request"][key] for key in asked} == asked
    page = opened("?name=c")
    page.get_by_text("What is asked for").click()
    page.get_by_label("Most minutes").fill("25")
    page.get_by_role("button", name="Ask for this from now on").click()
    given = page.evaluate("window.sent.at(-1)")
    assert (given["op"], given["folder"], given["request"]["minutes"]) == ("change", "c", 25)


SMALL = """() => [...document.querySelectorAll('#commission button, #commission a.action')]
  .filter(one => one.offsetParent && one.offsetHeight < (innerWidth <= 900 ? 44 : 30)).map(one => one.outerHTML)"""


@pytest.mark.parametrize("width, height", [(1440, 900), (1024, 768), (390, 844)])
def test_nobody_is_kept_out_and_nothing_runs_over_the_edge(opened, width, height):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="needs axe-playwright-python")
    page = opened("?name=c")
    page.set_viewport_size({"width": width, "height": height})
    try:
        page.get_by_role("heading", name="2 Dip").wait_for()
        page.get_by_text("What is asked for").click()
        sheet = page.add_style_tag(content="button { box-sizing: content-box; }")  # as NiceGUI's has it
        shown = [
            {},
            {"now": NOW, "progress": {"what": "estimating, " * 12, "share": 0.2, "since": 70, "began": 0}},
            {"now": NOW, "question": QUESTION},
            {"now": NOW, "question": QUESTION | {"kind": "number", "id": 9}},
        ]
        for changes in shown:
            reported(page, **changes)
            page.wait_for_timeout(900 if "question" in changes else 0)
            found = axe.Axe().run(page, context="#commission").response["violations"]
            grave = [(one["id"], one["nodes"][0]["html"][:120]) for one in found if one["impact"] != "minor"]
            assert grave == []
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
            bar = page.locator(".commission-progress progress")
            assert not bar.count() or bar.bounding_box()["width"] > 150, "however much is said of what goes on"
            small = page.evaluate(SMALL)
            assert small == []
        sheet.evaluate("one => one.remove()")
    finally:
        page.set_viewport_size({"width": 900, "height": 600})


def test_a_picture_that_a_stage_names_is_shown(opened):
    page = opened("?name=c")
    page.get_by_role("button", name="Start Dip").wait_for()
    lines = ["Picture: /runs/c/3-dip/3/pull.png", "Picture: /etc/c/pull.png"]
    reported(page, now=NOW, lines=lines)
    shown = page.locator(".commission-lines img")
    assert shown.count() == 1 and shown.get_attribute("src") == "/commission/file?name=c&path=3-dip%2F3%2Fpull.png"


def test_nothing_is_started_from_a_checklist_of_before(opened, views_page):
    shared, _ = views_page
    page = opened("?name=c")
    page.get_by_role("button", name="Start Dip").wait_for()
    waiting = []
    shared.route("**/commission/checklist*", lambda route: waiting.append(route))
    try:
        ended = {"stage": "dip", "folder": "c", "how": "go", "level": "ok", "text": "Dip: go."}
        reported(page, ended=ended, held=True, revision=8)
        page.wait_for_function("document.querySelector('#commission-next').innerText.startsWith('Reading what came')")
        assert page.locator("#commission-start").count() == 0, "it would be done again"
        done = CHECKLIST | {"due": "drill", "next": "Keep hands away. Start Drill."}
        waiting[0].fulfill(body=json.dumps(done), content_type="application/json")
        page.get_by_role("button", name="Start Drill").wait_for()
    finally:
        shared.unroute("**/commission/checklist*")
    page.evaluate("window.late = 4000")
    page.get_by_role("button", name="Start Drill").click()
    page.locator(".commission-progress progress").wait_for()  # an order that takes a while shows that it does
    page.evaluate("window.late = 0")


def test_what_came_of_a_stage_is_not_scrolled_away(opened):
    page = opened("?name=c")
    page.set_viewport_size({"width": 1024, "height": 400})
    try:
        page.get_by_role("heading", name="2 Dip").wait_for()
        page.evaluate("document.querySelector('#commission').style.height = '400px'")  # as in the console's grid
        page.get_by_text("What is asked for").click()
        page.locator("#commission-send").scroll_into_view_if_needed()
        place = "document.querySelector('.commission-main').scrollTop"
        before = page.evaluate(place)
        page.locator("#stage-paper").click()
        assert before > 0 and page.evaluate(place) == 0
    finally:
        page.set_viewport_size({"width": 900, "height": 600})


def test_all_stages_stand_on_a_small_laptop(opened, views_page):
    shared, _ = views_page
    many = [
        stage(k, f"stage{k}", "to do") | {"purpose": "what it finds out, in so many words that it takes " * 2}
        for k in range(1, 11)
    ]
    shared.route(
        "**/commission/checklist*",
        lambda route: route.fulfill(body=json.dumps(CHECKLIST | {"stages": many, "due": "stage1"})),
    )
    page = opened("?name=c")
    page.set_viewport_size({"width": 1024, "height": 700})
    try:
        page.locator("#stage-stage10").wait_for()
        heights = page.eval_on_selector_all(".commission-stage", "all => all.map(one => one.offsetHeight)")
        assert sum(heights) < 700 - 200, "bar, alerts and the sentence on top take 200"
        assert page.locator("#stage-stage1 .muted").first.is_visible(), "the chosen one says what it is for"
    finally:
        shared.unroute("**/commission/checklist*")
        page.set_viewport_size({"width": 900, "height": 600})


def test_a_console_that_is_silent_is_named(opened):
    page = opened("?name=c")
    page.get_by_role("button", name="Start Dip").wait_for()
    page.evaluate("window.emit({kind: 'pulse', at: 10})")
    page.wait_for_function("document.querySelector('#commission-next').innerText.startsWith('No news')")
    page.evaluate("window.emit({kind: 'pulse', at: 14})")
    page.wait_for_function("next => document.querySelector('#commission-next').innerText === next", arg=NEXT)
