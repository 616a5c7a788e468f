"""What comes before a flight: with an empty cache, and in the next process, which finds what was kept."""

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
ROUNDS = 3  # processes that find what was kept; the median counts

# Each stage of a run: wall-clock time, as a user waits for it, and processor time.
CHILD = """
import json, sys, time
t = [time.perf_counter()]
def lap():
    t.append(time.perf_counter())
    return t[-1] - t[-2]
from rovtwin.core.numerics import jax, jnp
found = {"import_jax_s": lap()}
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario import load_scenario
from rovtwin.runs.loop import HostLoop
found["import_rovtwin_s"] = lap()
run = compose(load_scenario("lawnmower_calm", [f"autopilot={sys.argv[1]}"]))
found["compose_s"] = lap()
loop = HostLoop(run.loop, run.key, run.start, run.scenario.control_dt, 50)
found["first_start_s"] = lap()
loop.advance()
found["first_second_s"] = lap()
found["whole_s"] = t[-1] - t[0]
found["processor_s"] = time.process_time()
print(json.dumps(found))
"""

# What `rovtwin fly` is asked for, whole processes: scenario, autopilot, vehicle.
FLIGHTS = {
    "model_based": ["autopilot=model_based"],
    "thesis": ["autopilot=thesis"],
    "bluerov2_heavy": ["autopilot=model_based", "vehicle=bluerov2_heavy"],
}


def cold_and_cached(quick: bool) -> dict[str, Any]:
    """Stages from the start of Python to the end of the first simulated second, and processor time of `rovtwin fly`."""
    found: dict[str, Any] = {}
    for autopilot in ["thesis"] if quick else ["thesis", "model_based"]:
        with tempfile.TemporaryDirectory(prefix="rovtwin-bench-") as cache:
            environment = os.environ | {"ROVTWIN_CACHE": cache}
            stages = {name: _child(environment, autopilot) for name in ("cold", "cached")}
            size = sum(file.stat().st_size for file in Path(cache).rglob("*") if file.is_file())
        found |= (
            stages | {"cache_mb": size / 1e6}
            if autopilot == "thesis"
            else {f"{k}_{autopilot}": stages[k] for k in stages}
        )
    flights = {"thesis": FLIGHTS["thesis"]} if quick else FLIGHTS
    return found | {"fly_processor_s": {name: _fly(overrides) for name, overrides in flights.items()}}


def _child(environment: Mapping[str, str], autopilot: str) -> dict[str, float]:
    return json.loads(_done([sys.executable, "-c", CHILD, autopilot], environment).splitlines()[-1])


def _fly(overrides: list[str]) -> dict[str, float]:
    """Processor time [s] of a whole `rovtwin fly` of one simulated second without a report: cold, and cached."""
    with tempfile.TemporaryDirectory(prefix="rovtwin-bench-") as folder:
        environment = os.environ | {"ROVTWIN_CACHE": f"{folder}/cache"}
        changes = [word for one in [*overrides, "duration=1"] for word in ("--set", one)]

        def once(number: int) -> float:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            out = ["--no-report", "--out", f"{folder}/run{number}"]
            # 1: not completed, for the mission takes longer
            _done([sys.executable, "-m", "rovtwin.cli", "fly", "lawnmower_calm", *changes, *out], environment, (0, 1))
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

        cold = once(0)
        return {"cold": cold, "cached": statistics.median(once(1 + k) for k in range(ROUNDS))}


def _done(command: list[str], environment: Mapping[str, str], fine: tuple[int, ...] = (0,)) -> str:
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode not in fine:
        raise RuntimeError(f"the benchmark's child process failed:\n{done.stderr}")
    return done.stdout
