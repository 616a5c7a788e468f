"""A NiceGUI server with the views and a fake live module, and Debian's Chromium to look at it."""

import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

CHROMIUM = Path("/usr/bin/chromium")
STARTING = 60.0  # [s]; two on a machine that does nothing else


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def wait_for(url, process):
    until = time.monotonic() + STARTING
    while time.monotonic() < until:
        assert process.poll() is None, process.communicate()[0].decode()
        try:
            with urllib.request.urlopen(url, timeout=5.0):
                return
        except (urllib.error.URLError, OSError):
            time.sleep(0.05)
    raise AssertionError(f"{url} did not answer in {STARTING:g} s")


@pytest.fixture(scope="session")
def console_url(tmp_path_factory):
    """Of the server, with `/scene`, `/plots`, `/events`, `/all`; and its process, which may still be starting."""
    pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
    from rovtwin.console.web.mesh import vehicle_glb
    from rovtwin.vehicle import load_vehicle

    mesh = tmp_path_factory.mktemp("console") / "vehicle.glb"
    mesh.write_bytes(vehicle_glb(load_vehicle("double_blueye")))
    port = free_port()
    # NiceGUI takes another way when it believes to be tested by its own plugin.
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    command = [sys.executable, str(Path(__file__).with_name("page.py")), str(port), str(mesh)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment)
    try:
        yield f"http://127.0.0.1:{port}", process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def browser(console_url):
    """Chromium, with WebGL in software as on a machine without a graphics card."""
    playwright = pytest.importorskip("playwright.sync_api", reason="views are tested with playwright")
    if not CHROMIUM.is_file():
        pytest.skip(f"views are tested with Debian's Chromium, and there is no {CHROMIUM}: apt install chromium")
    with playwright.sync_playwright() as running:
        options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        browser = running.chromium.launch(executable_path=str(CHROMIUM), args=options)
        yield browser
        browser.close()
