"""The thrusters' bars: values, limits, what is lost."""

from importlib.util import find_spec
from pathlib import Path

import pytest
from tests.console import messages

# As in NiceGUI's own page, where its sheet is a layer.
POPUP = """sheet => {
  const style = document.createElement('style');
  style.textContent = `@layer nicegui { ${sheet} }`;
  const box = document.createElement('div');
  Object.assign(box, {id: 'popup', className: 'nicegui-error-popup', ariaHidden: 'false', textContent: 'Lost.'});
  document.body.append(style, box);
}"""


@pytest.fixture
def rows(open_views):
    """Class and words of each row after these messages: [(classes, name, value, word), ...]."""

    def shown(*sent):
        page = open_views("thrusters")
        for message in sent:
            page.evaluate("message => window.emit(message)", message)
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        script = """rows => rows.map(r => [r.className.replace('thruster', '').trim(),
          ...[...r.querySelectorAll('span')].map(s => s.textContent)])"""
        return page, page.locator(".thruster").evaluate_all(script)

    return shown


def test_full_weak_and_lost_thrusters_are_distinguished(rows):
    page, found = rows(messages.setup(), messages.state())
    assert found == [
        ["", "port surge", "+0.50", ""],
        ["is-full", "starboard surge", "+1.00", "at limit"],
        ["is-weak", "sway", "\u22120.20", "60 % left"],
        ["is-lost", "heave", "+0.10", "lost"],
    ]
    meter = page.get_by_role("meter", name="starboard surge")
    assert meter.get_attribute("aria-valuenow") == "1.00" and meter.get_attribute("aria-valuetext") == "+1.00, at limit"
    bar = page.locator(".thruster-bar").first.bounding_box()
    fill = page.locator(".thruster-fill").first.bounding_box()
    assert fill["width"] == pytest.approx(bar["width"] / 4, abs=1.5)  # +0.5 of a half


def test_without_names_thrusters_are_numbered(rows):
    _, found = rows(messages.setup(thrusters=None), messages.state(u=[0.0, -1.0], health=[1, 1]))
    assert [row[1:3] for row in found] == [["thruster 1", "0.00"], ["thruster 2", "\u22121.00"]]


def test_no_box_of_nicegui_covers_them_when_the_connection_is_lost(rows):
    nicegui = find_spec("nicegui")
    if nicegui is None or nicegui.origin is None:
        pytest.skip("needs NiceGUI (pip install 'rovtwin[console]')")
    sheet = Path(nicegui.origin).with_name("static") / "nicegui.css"
    page, _ = rows(messages.setup(), messages.state())
    page.evaluate(POPUP, sheet.read_text(encoding="utf-8"))
    assert page.locator(".nicegui-error-popup").count() == 1
    assert not page.locator(".nicegui-error-popup").is_visible()
