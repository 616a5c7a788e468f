"""The page of a replay as `rovtwin console --replay` serves it, in Chromium: all views go along with the time line."""

import os
import signal
import subprocess
import sys

import pytest
from tests.console.served.conftest import free_port, wait_for

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")


@pytest.fixture(scope="module")
def url(flown):
    """Of a server that replays a run, and beside it knows one whose log was cut."""
    cut = flown.parent / "20260101-000000-cut"
    cut.mkdir()
    (cut / "log.mcap").write_bytes((flown / "log.mcap").read_bytes()[:100_000])
    port = free_port()
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    command = [sys.executable, "-m", "rovtwin.cli", "console", "--replay", str(flown), "--runs", str(flown.parent)]
    process = subprocess.Popen(
        [*command, "--port", str(port), "--no-browser"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    try:
        wait_for(f"http://127.0.0.1:{port}/replay/runs", process)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20)


@pytest.fixture(scope="module")
def page(browser, url):
    """The replay, all of it loaded; what goes wrong is on `page.wrong`."""
    context = browser.new_context(viewport={"width": 1366, "height": 768})
    page, wrong = context.new_page(), []
    page.set_default_timeout(10_000)
    page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda asked: None if asked.url.startswith((url, "blob:", "data:")) else wrong.append(asked.url))
    page.wrong = wrong
    page.goto(url)
    page.wait_for_function("() => window.rovtwin?.last?.track && rovtwin.last.state?.eta")
    yield page
    context.close()


def at(page, t):
    """Waits until the page shows a time [s]."""
    page.wait_for_function("t => Math.abs(rovtwin.last.state.t - t) < 1e-3", arg=t)


def scrub(page, t):
    page.evaluate(
        "t => { scrub.value = t; scrub.dispatchEvent(new Event('input', {bubbles: true})); }",
        t,
    )
    at(page, t)


def track_of(page):
    """Newest and number of the points that the chart's track would draw at the time shown."""
    return page.evaluate(
        """async () => {
          const {Track} = await import('/static/track.js');
          const track = new Track();
          track.know(rovtwin.last.track.map(s => ({t: s.t, x: s.eta[0], y: s.eta[1]})));
          const {t, eta} = rovtwin.last.state;
          track.add({t, x: eta[0], y: eta[1]});
          return [track.points.at(-1).t, track.points.length];
        }"""
    )


def test_slider_moves_bar_events_and_track(page):
    scrub(page, 30.0)
    assert page.locator("#fact-time").inner_text().startswith("0:30")
    assert page.locator("#fact-link").inner_text() == "short"
    shown = page.locator("#events li:not([hidden])")
    texts = shown.all_inner_texts()
    assert any("way-point 1 of 2 reached" in text for text in texts)
    assert not any("completed" in text for text in texts), "it has not happened yet"
    newest, late = track_of(page)
    scrub(page, 5.0)
    assert shown.count() < len(texts)
    assert newest == pytest.approx(30.0) and track_of(page)[1] < late


def test_plots_show_the_time_of_the_slider(page):
    page.get_by_role("tab", name="Plots").click()
    shown = []
    for t in (5.0, 30.0):
        scrub(page, t)
        speed = page.evaluate("rovtwin.last.state.nu[0]")
        page.wait_for_function(
            """speed => [...document.querySelectorAll('#plots figure')].some(figure =>
              figure.innerText.startsWith('Surge') && Math.abs(parseFloat(
                figure.querySelector('.plots-words').innerText) - speed) < 0.01)""",
            arg=speed,
        )
        shown.append(speed)
    assert abs(shown[0] - shown[1]) > 0.05, "or the test shows nothing"


def test_keys_step_and_play(page):
    scrub(page, 10.0)
    for key, t in (("ArrowRight", 11.0), ("Shift+ArrowRight", 21.0), ("ArrowLeft", 20.0), (".", 20.1), (",", 20.0)):
        page.keyboard.press(key)
        at(page, t)
    page.keyboard.press("Space")
    page.wait_for_function("() => rovtwin.last.state.running && rovtwin.last.state.t > 20.2")
    assert page.locator("#play").inner_text() == "Pause"
    page.keyboard.press("Space")
    page.wait_for_function("() => !rovtwin.last.state.running")


def test_marks_and_events_lead_to_their_time(page):
    reached = page.evaluate("rovtwin.last.marks.marks.find(m => m.mark === 'waypoint').t")
    page.locator(".mark.waypoint").click()
    at(page, reached)
    page.locator("#events li:not([hidden])").last.click()
    at(page, 0.0)
    page.get_by_role("button", name="To what happened next").click()
    page.wait_for_function("() => rovtwin.last.state.t > 0")


def test_nothing_can_be_ordered(page):
    assert page.locator("#stop").count() == 0, "nothing flies"
    assert not page.locator("#arm").is_visible()
    text = page.evaluate("rovtwin.send({do: 'arm'}).then(() => '', error => error.message)")
    assert "this is a replay" in text
    page.keyboard.press("Escape")


def test_every_control_has_a_name(page):
    nameless = page.evaluate(
        """[...document.querySelectorAll('#console :is(button, a, input, select, canvas, section)')]
          .filter(e => !e.closest('[aria-hidden=true]') && !e.getAttribute('aria-label') && !e.closest('label')
            && !(['BUTTON', 'A'].includes(e.tagName) && e.innerText.trim()) && e.checkVisibility()
            && !e.closest('[role=tabpanel]'))
          .map(e => e.outerHTML.slice(0, 80))"""
    )
    assert nameless == []


def test_runs_are_listed_and_a_cut_log_says_what_to_do(page, url):
    rows = page.get_by_role("list", name="Finished runs").get_by_role("link")
    rows.nth(1).wait_for()
    texts = rows.all_inner_texts()
    assert len(texts) == 2 and "completed" in texts[0] and "unfinished" in texts[1]
    rows.nth(1).click()
    page.get_by_role("alert", name="cannot be replayed").wait_for()
    assert "rovtwin log repair" in page.locator("#refused").inner_text()
    page.goto(f"{url}/replay?run=../../etc")
    assert "found no such run" in page.locator("#refused").inner_text()
    page.get_by_role("link").first.click()
    page.wait_for_function("() => window.rovtwin?.last?.track")
    assert page.locator("#runs a[aria-current]").count() == 1


def test_nothing_went_wrong_and_nothing_was_asked_of_others(page):
    assert page.wrong == []
