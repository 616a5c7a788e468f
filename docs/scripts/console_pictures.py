"""Pictures of the console for docs/console.md: `python -m docs.scripts.console_pictures` (needs Chromium)."""

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Page, sync_playwright
from tests.console.known import identified

from rovtwin.console.launch import end
from rovtwin.console.wire import Place

FIGURES = Path(__file__).parents[1] / "figures"
PORT = 8790
SMALL, LARGE = {"width": 1366, "height": 768}, {"width": 1920, "height": 1080}
CHANGED = ["world.thruster_health={port.surge: 0.6}", "world.net_buoyancy=-2.0"]
WORLD = ["world.floor=4.5", "sensors.altimeter=true", "autopilot=model_based"]
AREA = [[1.0, 0.5], [7.0, 0.5], [7.0, 6.0], [1.0, 6.0]]
CONSOLE = ["console", "lawnmower_calm", "--set", "cameras=[{scene: pool}]"]


def fly(page: Page) -> None:
    """Fly the scenario's mission to its third leg."""
    page.wait_for_function("() => window.rovtwin?.last?.state?.eta", timeout=120_000)
    page.evaluate("rovtwin.send({do: 'pace', speed: 5})")
    page.click("#arm")
    page.wait_for_function("() => rovtwin.last.state.armed")
    page.click("#submit")
    page.wait_for_function("() => rovtwin.last.plan.submitted")
    page.click("#start")
    page.wait_for_function("() => rovtwin.last.state.waypoint >= 3", timeout=120_000)


def survey(page: Page) -> None:
    """Fly lines that are too far apart over an area, until half of it was seen."""
    page.wait_for_function("() => window.rovtwin?.last?.state?.eta && rovtwin.last.swath", timeout=240_000)
    page.evaluate("rovtwin.send({do: 'pace', speed: 5})")
    template = "{do: 'plan', op: 'template', name: 'lawnmower', spacing: 1.4, depth: 3.0, speed: 0.2"
    page.evaluate(f"area => rovtwin.send({template}, area}})", AREA)
    page.click("#arm")
    page.wait_for_function("() => rovtwin.last.state.armed")
    page.click("#submit")
    page.wait_for_function("() => rovtwin.last.plan.submitted && !rovtwin.last.plan.changed")
    page.click("#start")
    page.wait_for_function("() => rovtwin.last.swath.eyes[0].found?.share > 0.5", timeout=600_000)


def take(page: Page, name: str, *tabs: str, size: dict | None = None, wait: float = 3.0) -> None:
    """A picture with these tabs in front."""
    for tab in tabs:
        page.get_by_role("tab", name=tab, exact=True).click()
    if size:
        page.set_viewport_size(size)
    time.sleep(wait)
    page.screenshot(path=FIGURES / f"console_{name}.png")


@contextmanager
def console(folder: str, *arguments: str) -> Iterator[Page]:
    """A page on `rovtwin ARGUMENTS`, 1366 by 768; runs lie in the folder."""
    place = Place.of(PORT)
    command = [sys.executable, "-m", "rovtwin.cli", *arguments, "--no-browser", "--port", str(PORT), "--runs", folder]
    started = subprocess.Popen(command)
    try:
        with sync_playwright() as playwright:
            chromium = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox", "--enable-unsafe-swiftshader"]
            )
            page = chromium.new_page(viewport=SMALL)
            for _ in range(100):
                try:
                    page.goto(f"http://127.0.0.1:{PORT}/", wait_until="domcontentloaded")
                    break
                except Exception:
                    time.sleep(0.5)
            yield page
            chromium.close()
    finally:
        started.send_signal(2)
        started.wait(20)
        end(place)


def main() -> None:
    """Take them all."""
    with tempfile.TemporaryDirectory() as folder:
        with console(folder, *CONSOLE) as page:
            fly(page)
            take(page, "chart")
            take(page, "scene", "3-D", "Plots", size=LARGE, wait=6.0)
            page.get_by_label("Dark or daylight colours").click()
            take(page, "daylight", "Chart", "World", size=SMALL)
            page.get_by_label("Dark or daylight colours").click()
            take(page, "pilot", "Pilot", "Camera", size=SMALL)
            take(page, "phone", size={"width": 390, "height": 844})
        changes = [f"vehicle={identified(Path(folder) / 'known.yaml')}", *CHANGED]
        settings = [part for change in changes for part in ("--set", change)]
        with console(folder, "console", "lawnmower_calm", *settings) as page:
            fly(page)
            page.wait_for_function("() => rovtwin.last.state.changed.length > 1", timeout=120_000)
            take(page, "changes", "Changes")
        settings = [part for change in WORLD for part in ("--set", change)]
        with console(folder, "console", "lawnmower_calm", *settings) as page:
            survey(page)
            take(page, "swath")


if __name__ == "__main__":
    main()
