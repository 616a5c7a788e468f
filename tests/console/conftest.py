"""One Chromium for all tests of the console's pages, a page with its views, and what stands in for the server.

No port is opened: what a page asks for is answered from `static/` by Playwright itself.
"""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

STATIC = Path(__file__).parents[2] / "src" / "rovtwin" / "console" / "web" / "static"
STAND_IN = Path(__file__).with_name("fake_live.js")
SITE = "http://console.test"
KINDS = {".js": "text/javascript", ".css": "text/css"}
SHEETS = "".join(f'<link rel="stylesheet" href="/static/{file.name}">' for file in sorted(STATIC.glob("*.css")))
PAGE = f"""<!doctype html><html lang="en"><head><title>views</title><link rel="icon" href="data:,">{SHEETS}
</head><body style="margin:0"></body></html>"""
LAY_OUT = """async names => {
  Object.assign(window, {sent: [], refuse: null});
  document.body.replaceChildren(...names.map(id => {
    const box = document.createElement('div');
    box.style.height = '600px';
    box.innerHTML = `<section id="${id}"></section>`;
    return box;
  }));
  await Promise.all(names.map(name => import(`/static/${name}.js`)));
}"""


# As long as Playwright runs, its event loop does in this thread, and no other test could run one of its own.
@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("needs Chromium (Debian: apt install chromium)")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright (pip install 'rovtwin[test]')")
    with playwright.sync_playwright() as started:
        # WebGL in software, as on a machine without a graphics card.
        options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        chromium = started.chromium.launch(executable_path=program, args=options)
        yield chromium
        chromium.close()


def answer(route: Any) -> None:
    path = route.request.url.removeprefix(SITE).split("?")[0]
    file = STAND_IN if path == "/static/live.js" else STATIC / path.removeprefix("/static/")
    if path == "/":
        route.fulfill(body=PAGE, content_type="text/html; charset=utf-8")
    elif file.is_file():
        route.fulfill(body=file.read_text(encoding="utf-8"), content_type=f"{KINDS[file.suffix]}; charset=utf-8")
    else:
        route.abort()


@pytest.fixture(scope="module")
def views_page(browser: Any) -> Iterator[tuple[Any, list[str]]]:
    """One page for all tests, as opening one takes longer than most of them, and the errors in its console."""
    context = browser.new_context(viewport={"width": 900, "height": 600}, has_touch=True)
    page = context.new_page()
    complaints: list[str] = []
    page.set_default_timeout(5000)
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.route("**/*", answer)
    page.goto(SITE)
    yield page, complaints
    context.close()


@pytest.fixture
def open_views(views_page: tuple[Any, list[str]]) -> Iterator[Callable[..., Any]]:
    """`open_views("chart")` builds these views anew, 900 x 600 each; the page must log no error in its console."""
    page, complaints = views_page
    complaints.clear()

    def open_views(*names: str) -> Any:
        page.evaluate(LAY_OUT, list(names))
        return page

    yield open_views
    assert not complaints


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short run that was completed: two way-points."""
    from rovtwin.runs.fly import fly
    from rovtwin.scenario.files import load_scenario

    first, second = (f"{{position: [0.6, {y}, 0.5], speed: 0.3, acceptance: 0.3}}" for y in (0, 0.5))
    changes = ["autopilot=thesis", "duration=60", "name=short", f"mission.waypoints=[{first}, {second}]"]
    scenario = load_scenario("lawnmower_calm", changes)
    folder = tmp_path_factory.mktemp("replay") / "runs" / "20261123-101500-short"
    assert fly(scenario, folder).completed
    return folder
