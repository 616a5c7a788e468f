"""Views of one's own on the page: what they give is shown as it is and runs nothing; what fails is named."""

import pytest

BUILT = """() => {
  document.body.innerHTML = `<button role="tab" id="tab-right-3" aria-controls="panel-right-3">Trim</button>
    <div class="panel" id="panel-right-3" aria-labelledby="tab-right-3">
    <section id="own-view-0" class="own-view"></section></div>`;
  return import('/static/own_views.js');
}"""
SIZE = 'width="40" height="20"'
SVG = f'<svg xmlns="http://www.w3.org/2000/svg" {SIZE}><script>window.ran = 1</script><rect {SIZE}/></svg>'


STOPPED = """async () => {
  const t = performance.now();
  await rovtwin.send({do: 'stop'});
  return performance.now() - t;
}"""


@pytest.fixture
def view(views_page):
    page, complaints = views_page
    complaints.clear()
    page.evaluate(BUILT)
    page.wait_for_selector("#own-view-0 > *")

    def given(**message):
        page.evaluate("m => window.emit(m)", {"kind": "view-0", "title": "Trim", "error": "", **message})
        return page

    yield given
    assert not complaints


def test_rows_and_text_are_shown_as_they_are(view):
    page = view(rows=[["depth <b>", "1.235", "m"], ["armed"]])
    assert page.locator("#own-view-0 tr").all_inner_texts() == ["depth <b>\t1.235 m", "armed\t"]
    assert view(text="<i>no markup</i>").inner_text("#own-view-0") == "<i>no markup</i>"


def test_a_picture_is_an_image_that_runs_nothing(view):
    page = view(svg=SVG)
    page.wait_for_function("() => document.querySelector('#own-view-0 img')?.naturalWidth === 40")
    assert page.evaluate("window.ran") is None and page.get_attribute("#own-view-0 img", "alt") == "Trim"


def test_one_that_fails_is_named_on_its_page_and_tab(view):
    page = view(error="Trim.show failed: KeyError: 'eta' (trim.py, line 9)", title="Trim angle")
    shown = page.get_by_role("alert").inner_text()
    assert shown == "Trim angle: Trim.show failed: KeyError: 'eta' (trim.py, line 9)"
    assert page.inner_text("#tab-right-3") == "Trim angle" and page.get_attribute("#tab-right-3", "data-failed") == ""
    view(text="well again")
    assert page.get_attribute("#tab-right-3", "data-failed") is None and not page.get_by_role("alert").count()


@pytest.mark.slow
@pytest.mark.system
def test_the_console_has_them_as_tabs_and_stops_beside_one_that_hangs(browser, tmp_path):
    from tests.console.whole import SOON, arm, opened, order, serving

    pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
    (tmp_path / "mine.py").write_text(
        "from rovtwin.console.view import View\n"
        "class Depth(View):\n    title = 'My depth'\n"
        "    def show(self, state): return [('depth', state['eta'][2], 'm')]\n"
        "class Hangs(View):\n    def show(self, state):\n        while True: pass\n"
    )
    with serving(tmp_path, "lawnmower_calm", "--view", "mine:Depth", "--view", "mine:Hangs") as served:
        page = opened(browser, served)
        page.wait_for_function("() => document.querySelector('#own-view-0 td')", timeout=8 * SOON)
        page.click("text=My depth")
        assert page.inner_text("#own-view-0 th") == "depth" and page.inner_text("#own-view-0 td").endswith(" m")
        page.wait_for_function("() => document.querySelector('#own-view-1 .own-view-error')", timeout=8 * SOON)
        page.click("text=Hangs")
        assert "found no end within 5 s" in page.inner_text("#own-view-1")
        if not page.evaluate("rovtwin.last.rights.may"):
            order(page, "take")
        arm(page)
        took = page.evaluate(STOPPED)
        page.wait_for_function("() => !rovtwin.last.state.armed")
        assert took < 500.0, f"STOP took {took:.0f} ms"
        page.screenshot(path=tmp_path / "console.png")
        assert page.complaints == []
        page.context.close()
