"""A lawn-mower flown by the autopilot through the Blueye protocol: the twin in one process, the autopilot in another.

The whole lawn-mower in real time is `docs/scripts/lawnmower_over_blueye.py`, and the slow test at the end.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.links.twins import free_port

from rovtwin.core.log import Log
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.live.connect import connect, source
from rovtwin.scenario.live.flight import fly_live
from rovtwin.scenario.pace import Clock
from rovtwin.scenario.score import distance_to_leg

HOSTS, HTTP = ("127.0.0.22", "127.0.0.23"), 8795
REPOSITORY = Path(__file__).parents[2]
# Small, but with as many way-points as the lawn-mower: programs of one shape are compiled once.
LINES = [(2, 0), (2, 1), (0, 1), (0, 2), (2, 2), (2, 3), (0, 3)]


class Serving:
    """`rovtwin serve` in a process of its own."""

    def __init__(self, log: Path, ugps: int, speed: float):
        words = ["--address", f"ugps=127.0.0.1:{ugps}", "--speed", str(speed), "--log", str(log)]
        for host in HOSTS:
            words += ["--address", f"blueye={host}:{HTTP}"]
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "rovtwin.cli",
                "serve",
                "double_blueye",
                "--protocol",
                "blueye",
                "--protocol",
                "ugps",
                *words,
            ],
            env=os.environ | {"PYTHONPATH": str(REPOSITORY / "src")},
            stdout=subprocess.PIPE,
            text=True,
        )
        self.said: list[str] = []
        for line in self.process.stdout:
            self.said.append(line)
            if line.startswith("blueye:"):
                return
        raise AssertionError(f"it does not serve: {self.said}")

    def end(self) -> str:
        """Ctrl-C; what it then said."""
        self.process.send_signal(signal.SIGINT)
        rest, _ = self.process.communicate(timeout=30)
        assert self.process.returncode == 0
        return rest


def small(**overrides):
    points = ",".join(f"{{position: [{x}, {y}, 2.0], speed: 0.25, acceptance: 0.4}}" for x, y in LINES)
    given = [f"mission={{name: small, waypoints: [{points}]}}", "autopilot=model_based", "duration=150"]
    given += ["autopilot.supervisor.deadline_missed.action=ignore"]  # the machine of a test is busy, time runs fast
    return load_scenario("lawnmower_calm", [*given, *(f"{k}={v}" for k, v in overrides.items())], 4)


def flights(folder, wanted, speed):
    """Flights one after the other with one served twin, by name; its truth; what it said at the end."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("http_proxy", f"http://{HOSTS[0]}:{HTTP}")
        patch.setenv("no_proxy", "127.0.0.1")
        ugps = free_port()
        serving = Serving(folder / "truth.mcap", ugps, speed)
        found = {}
        try:
            for name, (scenario, how) in wanted.items():
                clock = Clock(speed)
                with source(f"ugps://127.0.0.1:{ugps}", clock) as positions:
                    link = connect(f"blueye://{','.join(HOSTS)}", scenario, clock)
                    run = folder / name
                    found[name] = fly_live(scenario, link, [positions], clock, run, arm=lambda readiness: True, **how)
        finally:
            said = serving.end()
    return found, Log.read(folder / "truth.mcap"), said


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Five seconds without thrust, then the small lawn-mower."""
    wanted = {"idle": (small(duration=5), {"thrust": False}), "mission": (small(), {})}
    return flights(tmp_path_factory.mktemp("flown"), wanted, 4.0)


def test_a_small_lawnmower_over_the_protocol(flown):
    found, truth, said = flown
    flight = found["mission"]
    assert flight.completed, flight.summary["reason"]
    eta, leg, mode = truth["truth/eta"], flight.log["autopilot/leg"], flight.log["autopilot/mode"]
    # Depth tells how the two clocks lie: 1 mm of noise against 1.5 m of dive.
    believed = flight.log["autopilot/eta"]

    def at(offset):
        return np.stack([np.interp(believed.t + offset, eta.t, eta.values[:, i]) for i in range(3)], axis=1)

    offsets = np.arange(0.0, eta.t[-1] - believed.t[-1], 0.05)
    true = at(min(offsets, key=lambda o: np.mean((at(o)[:, 2] - believed.values[:, 2]) ** 2)))
    on = mode.values[:, 3] > 0.5
    cross = np.sqrt(np.mean(distance_to_leg(true[on], leg.values[on]) ** 2))
    # The best filter on fixes of 0.5 m once a second knows the place to 0.16 m an axis; twice that for one short run.
    assert cross < 0.33
    assert np.sqrt(np.mean((true[:, 2] - believed.values[:, 2]) ** 2)) < 0.02
    assert not truth["truth/command"].values[-1].any()  # nothing turns after the end
    assert "served" in said
    assert not any(name.startswith("truth/") for name in flight.log.channels)


def test_without_thrust_everything_is_computed_and_nothing_moves(flown):
    found, truth, _ = flown
    assert np.abs(found["idle"].log["autopilot/command"].values).max() > 0.1
    assert not found["idle"].log["host/timing"].values[:, 2].any()
    began = np.flatnonzero(truth["truth/command"].values.any(axis=1))[0]
    assert truth["truth/command"].t[began] > 5.0  # the first that moved the twin was the mission


@pytest.mark.slow
def test_the_whole_lawnmower_in_real_time(tmp_path):
    scenario = load_scenario("lawnmower_calm", ["autopilot=model_based"], 1)
    found, _, _ = flights(tmp_path, {"whole": (scenario, {})}, 1.0)
    flight = found["whole"]
    assert flight.completed
    assert flight.summary["late_ms_p99"] < 5.0
