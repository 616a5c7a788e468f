"""One real-time tick of the autopilot from Python: readings in, command out, as `fly --realtime` does it."""

import gc
import time
from typing import Any

import numpy as np

from benchmarks.closed_loop import simulation
from rovtwin.core.flow import Measurement
from rovtwin.runs.loop import start_loop
from rovtwin.runs.realtime import HostAutopilot


def readings(rng: np.random.Generator, tick: int, dt: float) -> list[Measurement]:
    """What a link delivers in one 50 Hz tick: two of each fast sensor, depth nearly always, a position every second."""
    t = tick * dt
    fast = [(name, t - age) for age in (dt / 2, 0.0) for name in ("accelerometer", "attitude", "gyro")]
    found = [Measurement(name, 1e-3 * rng.normal(size=3), when) for name, when in fast]
    found.append(Measurement("pressure", 0.5 + 1e-3 * rng.normal(size=1), t))
    if tick % round(1.0 / dt) == 0:
        found.append(Measurement("position", 0.5 * rng.normal(size=2), t))
    return found


def tick(quick: bool) -> dict[str, Any]:
    """Median and 99th percentile of a tick [s]; a tick that only hands over the vectors, for comparison."""
    ticks = 200 if quick else 5_000
    run = simulation()
    dt = run.scenario.control_dt
    memory = start_loop(run.loop, run.key, run.start, dt)
    autopilot = HostAutopilot(run.loop.autopilot, memory.autopilot, memory.measurements, dt)
    rng = np.random.default_rng(0)
    delivered = [readings(rng, k, dt) for k in range(ticks)]
    times = np.zeros(ticks)
    gc.collect()
    for k in range(ticks):
        begin = time.perf_counter()
        command = autopilot.step(delivered[k])
        times[k] = time.perf_counter() - begin
    assert np.isfinite(command.u).all()
    return {
        "median_s": float(np.median(times)),
        "p99_s": float(np.percentile(times, 99)),
        "most_s": float(times.max()),
        "period_s": dt,
    }
