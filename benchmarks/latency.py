"""One real-time tick of the autopilot from Python: readings in, command out, as `fly --realtime` does it."""

import time
from typing import Any

import numpy as np

from benchmarks.closed_loop import composed
from rovtwin.core.flow import NO_REQUEST, AutopilotInput, Measurement, pack
from rovtwin.core.numerics import jax, jnp
from rovtwin.scenario.loop import start_loop


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
    """Median and 99th percentile of a tick [s], and medians of its parts."""
    ticks = 200 if quick else 5_000
    run = composed()
    dt = run.scenario.control_dt
    memory = start_loop(run.loop, run.key, run.start, dt)
    thinking, empty = memory.autopilot, jax.device_get(memory.measurements)
    request = jnp.asarray(NO_REQUEST)
    think = jax.jit(lambda m, measured: run.loop.autopilot.step(m, AutopilotInput(measured, request), dt))
    rng = np.random.default_rng(0)
    jax.block_until_ready(think(thinking, pack([], empty)))
    times = np.zeros((ticks, 3))
    for k in range(ticks):
        delivered = readings(rng, k, dt)
        t0 = time.perf_counter()
        slots = pack(delivered, empty)
        t1 = time.perf_counter()
        thinking, decided = think(thinking, slots)
        t2 = time.perf_counter()
        u = np.asarray(decided.command.u)
        t3 = time.perf_counter()
        times[k] = t1 - t0, t2 - t1, t3 - t2
    assert np.isfinite(u).all()
    whole = times.sum(axis=1)
    return {
        "median_s": float(np.median(whole)),
        "p99_s": float(np.percentile(whole, 99)),
        "most_s": float(whole.max()),
        "pack_median_s": float(np.median(times[:, 0])),
        "step_median_s": float(np.median(times[:, 1])),
        "period_s": dt,
    }
