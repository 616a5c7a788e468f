"""Compile times: in a fresh process with an empty cache, and in the next one, which finds what the first compiled."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]

# Wall-clock time of each stage of a run, as a user waits for it.
CHILD = """
import json, time
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
run = compose(load_scenario("lawnmower_calm", ["autopilot=thesis"]))
found["compose_s"] = lap()
loop = HostLoop(run.loop, run.key, run.start, run.scenario.control_dt, 50)
found["first_start_s"] = lap()
loop.advance()
found["first_second_s"] = lap()
found["whole_s"] = t[-1] - t[0]
found["processor_s"] = time.process_time()
print(json.dumps(found))
"""


def cold_and_cached(quick: bool) -> dict[str, Any]:
    """Seconds from the start of Python to the end of the first simulated second, stage by stage."""
    del quick  # there is nothing to shorten
    with tempfile.TemporaryDirectory(prefix="rovtwin-bench-") as cache:
        environment = os.environ | {"ROVTWIN_CACHE": cache}
        found = {name: _child(environment) for name in ("cold", "cached")}
        size = sum(file.stat().st_size for file in Path(cache).rglob("*") if file.is_file())
    return found | {"cache_mb": size / 1e6}


def _child(environment: dict[str, str]) -> dict[str, float]:
    command = [sys.executable, "-c", CHILD]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"the benchmark's child process failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])
