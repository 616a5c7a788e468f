"""Four browsers on one console: age of what they show, camera's rate, memory and lateness over time.

`python -m tests.console.soak --minutes 10` prints a line a minute and one JSON object at the end. One browser shows
every view, three show no 3-D; WebGL is drawn in software. The mission is flown again and again, in real time.
"""

import argparse
import json
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

import numpy as np
import zmq
from playwright.sync_api import Page, sync_playwright

from rovtwin.console.launch import end, running
from rovtwin.console.wire import Place

SCENARIO = ["lawnmower_calm", "--set", "cameras=[{scene: pool}]"]
OVERRUN = 20.0  # a whole control period [ms]
LISTEN = """offset => {
  window.ages = []; window.pictures = 0; let seen = null;
  const frame = () => {
    const state = rovtwin.last.state;
    if (state !== seen) { seen = state; ages.push(performance.now() / 1000 + offset - state.sent); }
    requestAnimationFrame(frame);
  };
  frame();
  rovtwin.on('sight', () => { pictures += 1; });
}"""
TAKE = "() => { const told = [ages, pictures]; ages = []; pictures = 0; return told; }"


def resident(pid: int) -> float:
    """Memory of a process [MB]."""
    with open(f"/proc/{pid}/status") as stream:
        return next(int(line.split()[1]) for line in stream if line.startswith("VmRSS")) / 1e3


def children(pid: int) -> list[int]:
    found = subprocess.run(["pgrep", "-P", str(pid)], capture_output=True, text=True).stdout
    return [int(one) for one in found.split()]


def offset(page: Page) -> float:
    """What to add to the page's clock to have ours [s], from the quickest of many questions."""
    best = (np.inf, 0.0)
    for _ in range(40):
        before = time.monotonic()
        there = page.evaluate("performance.now()") / 1000
        after = time.monotonic()
        best = min(best, (after - before, (before + after) / 2 - there))
    return best[1]


def opened(chromium, port: int, three: bool) -> Page:
    page = chromium.new_page(viewport={"width": 1366, "height": 768})
    for _ in range(200):
        try:
            page.goto(f"http://127.0.0.1:{port}/", wait_until="domcontentloaded")
            break
        except Exception:
            time.sleep(0.3)
    page.wait_for_function("() => window.rovtwin?.last?.state?.eta", timeout=240_000)
    if three:
        page.get_by_role("tab", name="3-D").click()
    page.evaluate(LISTEN, offset(page))
    return page


def percentiles(values: list[float]) -> dict[str, float]:
    return {f"p{p}": round(1e3 * float(np.percentile(values, p)), 1) for p in (50, 99, 100)}


def soak(minutes: float) -> dict:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    place, rows, late, ages = Place.of(port), [], [], {"every view": [], "without 3-D": []}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "rovtwin.cli", "console", *SCENARIO, "--no-browser", "--port", str(port)]
        console = subprocess.Popen([*command, "--runs", folder])
        try:
            with sync_playwright() as playwright:
                options = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-backgrounding-occluded-windows"]
                chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=options)
                pages = [opened(chromium, port, i == 0) for i in range(4)]
                ear = zmq.Context.instance().socket(zmq.SUB)
                ear.setsockopt(zmq.SUBSCRIBE, b'{"kind":"state"')
                ear.connect(place.news)
                pages[0].evaluate("rovtwin.send({do: 'arm'})")
                pages[0].wait_for_function("() => rovtwin.last.state.armed")
                pages[0].evaluate("rovtwin.send({do: 'plan', op: 'submit'})")
                engine = running(place).pid
                processes = {"web": console.pid, "engine": engine, "host": max(children(engine), key=resident)}
                began, pictures = time.monotonic(), 0
                while (passed := time.monotonic() - began) < 60 * minutes:
                    until = time.monotonic() + min(60.0, 60 * minutes - passed)
                    while time.monotonic() < until:
                        if ear.poll(200):
                            state = json.loads(ear.recv())
                            late.append(state.get("late_ms", 0.0))
                            if late[-1] > OVERRUN:
                                print(f"t = {state['t']:.1f} s, {state['phase']}: {late[-1]:.0f} ms late", flush=True)
                    if pages[0].evaluate("!['go', 'dive', 'turn', 'hold'].includes(rovtwin.last.state.phase)"):
                        pages[0].evaluate("rovtwin.send({do: 'start'})")
                    for i, page in enumerate(pages):
                        reported = page.evaluate(TAKE)
                        ages["every view" if i == 0 else "without 3-D"] += reported[0]
                        pictures += reported[1] if i == 0 else 0
                    row = {"minute": round((time.monotonic() - began) / 60, 1)}
                    row |= {name: round(resident(pid), 1) for name, pid in processes.items()}
                    row |= {"heap": [round(p.evaluate("performance.memory.usedJSHeapSize") / 1e6, 1) for p in pages]}
                    rows.append(row)
                    print(row, flush=True)
                seconds = time.monotonic() - began
                chromium.close()
        finally:
            console.send_signal(signal.SIGINT)
            console.wait(30)
            end(place)
    return {
        "minutes": minutes,
        "age_ms": {name: percentiles(values) for name, values in ages.items()},
        "states_per_s": {name: len(v) / seconds / (1 if name == "every view" else 3) for name, v in ages.items()},
        "camera_per_s": pictures / seconds,
        "late_ms": {f"p{p}": round(float(np.percentile(late, p)), 2) for p in (50, 99, 100)},
        "overruns": sum(value > OVERRUN for value in late),
        "memory": rows,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    print(json.dumps(soak(parser.parse_args().minutes)))
