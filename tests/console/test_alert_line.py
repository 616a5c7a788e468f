"""The line below the bar: of one height, whatever it says; what is made ready, and how long nobody is in control."""

import pytest
from tests.console import messages

ALERT = {"level": "danger", "what": "LEAK", "cause": "water comes in", "remedy": "recover the vehicle now"}
MAKING = {"what": "compiling the autopilot", "step": 2, "of": 5, "seconds": 83.2, "whole": 90.0}
ALONE = {"operator_silent": {"limit": 60.0, "action": "hold"}}


@pytest.fixture
def line(open_views):
    """The line in a page's grid, with a state and a set-up that differ so from the usual ones."""

    def opened(state, setup=None):
        page = open_views("alerts")
        page.set_viewport_size({"width": 1200, "height": 600})
        pages.append(page)
        page.evaluate("""() => { const [strip] = document.querySelectorAll('#alerts');
          document.body.className = 'console'; document.body.replaceChildren(strip); }""")
        for message in (messages.setup(**(setup or {})), messages.state(**state), messages.rights(False)):
            page.evaluate("message => window.emit(message)", message)
        page.evaluate("alerts => import('/static/alerts.js').then(m => m.showAlerts(alerts))", state.get("alerts", []))
        return page

    pages = []
    yield opened
    for page in pages:
        page.set_viewport_size({"width": 900, "height": 600})


def test_its_height_is_the_same_with_any_number_of_alerts(line):
    heights = {line({"alerts": [ALERT] * n}).locator("#alerts").bounding_box()["height"] for n in (0, 1, 5)}
    assert len(heights) == 1


def test_the_gravest_stands_there_and_the_others_when_asked_for(line):
    page = line({"alerts": [ALERT, ALERT | {"level": "warning", "what": "no position for 1:05 min"}]})
    assert "LEAK" in page.get_by_role("alert").inner_text()
    assert not page.get_by_text("no position").is_visible()
    page.get_by_role("button", name="1 more").click()
    assert page.get_by_text("no position").is_visible()


def test_what_is_compiled_is_reported_with_its_number_and_seconds(line):
    """First starts took minutes behind one word."""
    page = line({"stage": "connecting", "eta": None, "making": MAKING, "armed": False})
    text = page.locator("#alerts").inner_text()
    assert "2 of 5: compiling the autopilot · 1:23 (1:30 in all)" in text and "The first start" in text
    bar = page.get_by_role("progressbar")
    assert (bar.get_attribute("value"), bar.get_attribute("max")) == ("1", "5")


def test_pages_count_down_while_nobody_is_in_control(line):
    page = line({"operator_age": 12.3, "alerts": [ALERT]}, ALONE)
    assert page.get_by_role("timer").inner_text() == "Nobody is in control: it stays where it is in 0:48."
    assert "LEAK" in page.get_by_role("alert").inner_text()  # which goes on standing there
    page.get_by_role("button", name="Take control").click()
    assert page.evaluate("window.sent") == [{"do": "take"}]


@pytest.mark.parametrize("state", [{"operator_age": 0.3}, {"operator_age": 9.0, "armed": False},
                                   {"operator_age": 9.0, "phase": "idle"}, {"operator_age": None, "replay": True},
                                   {"operator_age": 70.0}])  # fmt: skip
def test_nothing_is_counted_where_nothing_will_happen(line, state):
    assert not line(state, ALONE).get_by_role("timer").is_visible()


def test_without_a_rule_it_is_reported_that_it_goes_on(line):
    rule = {"operator_silent": {"limit": 60.0, "action": "ignore"}}
    assert line({"operator_age": 9.0}, rule).get_by_role("timer").inner_text() == "Nobody is in control: it goes on."
