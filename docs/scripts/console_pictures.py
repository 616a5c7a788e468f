"""Pictures of the console for docs/console.md: `python -m docs.scripts.console_pictures` (needs Chromium)."""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from rovtwin.console.launch import end
from rovtwin.console.wire import Place

FIGURES = Path(__file__).parents[1] / "figures"
PORT = 8790
SMALL, LARGE = {"width": 1366, "height": 768}, {"width": 1920, "height": 1080}
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


def take(page: Page, name: str, *tabs: str, size: dict | None = None, wait: float = 3.0) -> None:
    """A picture with these tabs in front."""
    for tab in tabs:
        page.get_by_role("tab", name=tab, exact=True).click()
    if size:
        page.set_viewport_size(size)
    time.sleep(wait)
    page.screenshot(path=FIGURES / f"console_{name}.png")


def main() -> None:
    """Take them all."""
    place = Place.of(PORT)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "rovtwin.cli", *CONSOLE, "--no-browser", "--port", str(PORT), "--runs", folder]
        console = subprocess.Popen(command)
        try:
            with sync_playwright() as playwright:
                program = shutil.which("chromium")
                chromium = playwright.chromium.launch(
                    executable_path=program, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
                )
                page = chromium.new_page(viewport=SMALL)
                for _ in range(100):
                    try:
                        page.goto(f"http://127.0.0.1:{PORT}/", wait_until="domcontentloaded")
                        break
                    except Exception:
                        time.sleep(0.5)
                fly(page)
                take(page, "chart")
                take(page, "scene", "3-D", "Plots", size=LARGE, wait=6.0)
                page.get_by_label("Dark or daylight colours").click()
                take(page, "daylight", "Chart", "World", size=SMALL)
                page.get_by_label("Dark or daylight colours").click()
                take(page, "pilot", "Pilot", "Camera", size=SMALL)
                take(page, "phone", size={"width": 390, "height": 844})
                chromium.close()
        finally:
            console.send_signal(2)
            console.wait(20)
            end(place)


if __name__ == "__main__":
    main()
