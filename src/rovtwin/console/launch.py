"""Starting an engine, or finding the one that flies already."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovtwin.console.locks import is_locked
from rovtwin.console.wire import Place
from rovtwin.core.errors import ConfigError
from rovtwin.scenario.files import dump_scenario
from rovtwin.scenario.schema import Scenario

ENDING = 20.0  # an engine that was to end and closes its log still is killed; thrusters have been off since [s]


@dataclass(frozen=True)
class Running:
    """An engine that is there: its process, and what it flies."""

    pid: int
    scenario: str
    link: str


def alive(place: Place) -> bool:
    """Whether an engine is at a place, be it just beginning or ending."""
    return is_locked(place.lock)


def running(place: Place) -> Running | None:
    """The engine at a place, if one is alive: not another process that has the number of one that was killed."""
    if not alive(place):
        return None
    try:
        note: dict[str, Any] = json.loads(place.note.read_text(encoding="utf-8"))
    except (OSError, ValueError):  # it is just beginning, or ending
        return None
    return Running(note["pid"], note.get("scenario", "?"), note.get("link", "?"))


def require_free(host: str, port: int) -> None:
    """Raise ConfigError where a page cannot be served at an address, as where another console is there."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as attempt:
        attempt.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            attempt.bind((host, port))
        except OSError as error:
            raise ConfigError(
                f"{host}:{port}: cannot be served at ({error.strerror}). Is a console there already? Open its page, or "
                "choose another --port"
            ) from None


def start(place: Place, scenario: Scenario, link: str, sensors: list[str], speed: float, runs: Path) -> int:
    """Start an engine in a session of its own, so that it outlives this process and its terminal; its process number.

    Raises:
        ConfigError: It ended at once, or never began; the text is what it said.
    """
    file = place.folder / "scenario.yaml"
    file.write_text(dump_scenario(scenario), encoding="utf-8")
    output = place.folder / "engine.log"
    arguments = ["--place", place.folder, "--scenario", file, "--link", link, "--speed", str(speed)]
    arguments += ["--runs", runs.resolve()]  # passed on to web servers that may be started elsewhere
    for sensor in sensors:
        arguments += ["--sensor", sensor]
    with output.open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "rovtwin.console.engine", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    try:
        _wait_for(process, place, output)
    except BaseException:  # also Ctrl-C: nothing flies yet
        process.kill()
        raise
    return process.pid


def _wait_for(process: subprocess.Popen[bytes], place: Place, output: Path) -> None:
    """Until an engine that was started has begun; ConfigError if it does not."""
    until = time.monotonic() + 60.0
    while running(place) is None:
        if process.poll() is not None or time.monotonic() > until:
            lines = output.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            raise ConfigError(f"the autopilot's process did not begin: {lines[-1] if lines else 'it said nothing'}")
        time.sleep(0.05)


@contextmanager
def sigterm_ends() -> Iterator[None]:
    """Within, SIGTERM (systemd, docker) ends this process as Ctrl-C does: what is to be done at the end is done."""
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def end(place: Place) -> None:
    """Tell the engine to end: thrusters off, logs closed."""
    found = running(place)
    if found is None:
        return
    os.kill(found.pid, signal.SIGTERM)
    until = time.monotonic() + ENDING
    while alive(place) and time.monotonic() < until:
        time.sleep(0.05)
    if alive(place):
        os.kill(found.pid, signal.SIGKILL)
