"""A console as `rovtwin console` starts it, pages on it in Chromium, and the orders they give."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rovtwin.console.launch import end
from rovtwin.console.wire import Place

READY = 240_000  # the autopilot is compiled first, beside others on a busy machine [ms]
SERVED = 180.0  # until a page is served there [s]
SOON = 15_000


@dataclass
class Served:
    """A console that runs, and where it meets its engine."""

    port: int
    folder: Path
    arguments: Sequence[str]
    process: subprocess.Popen

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}/"

    @property
    def place(self):
        return Place.of(self.port)

    def start_again(self):
        """The same command once more."""
        self.process = start(self.port, self.folder, self.arguments)


def start(port, folder, arguments):
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    return subprocess.Popen(
        [sys.executable, "-m", "rovtwin.cli", "console", *arguments, "--no-browser", "--port", str(port)],
        cwd=folder,
        env=environment,
        stdout=(folder / "console.log").open("ab"),
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )


@contextmanager
def serving(folder: Path, *arguments: str) -> Iterator[Served]:
    """`rovtwin console ARGUMENTS` at a free port, its runs in the folder; ended in order."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    one = Served(port, folder, arguments, start(port, folder, arguments))
    try:
        yield one
    finally:
        one.process.send_signal(signal.SIGINT)
        one.process.wait(20)
        end(one.place)


def opened(browser, served, width=1366, height=768):
    """A page of the console that is ready, and what it complained of and asked for."""
    context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
    page = context.new_page()
    page.set_default_timeout(SOON)
    page.complaints, page.asked = [], set()
    page.on("console", lambda message: page.complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: page.complaints.append(error.stack or str(error)))
    page.on("request", lambda request: page.asked.add(request.url.split("/")[2].split(":")[0]))
    until = time.monotonic() + SERVED
    while True:
        try:
            page.goto(served.url, wait_until="domcontentloaded")
            break
        except Exception:
            assert time.monotonic() < until, (served.folder / "console.log").read_text()
            time.sleep(0.2)
    page.wait_for_function("() => window.rovtwin?.last?.state?.eta", timeout=READY)
    return page


def order(page, do, **what):
    """Give an order; what was answered, the text of the refusal where it was refused."""
    return page.evaluate("order => rovtwin.send(order).then(() => '', error => error.message)", {"do": do, **what})


def arm(page):
    page.click("#arm")
    page.wait_for_function("() => rovtwin.last.state.armed")


def state(page):
    return page.evaluate("rovtwin.last.state")
