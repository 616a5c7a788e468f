"""The whole closed loop (plant, sensors, filter, guidance, control): control ticks per second against plain NumPy."""

from typing import Any

import equinox as eqx
import numpy as np

from benchmarks.numpy_loop import NumpyLoop
from benchmarks.timing import in_turns, rates, ratio
from rovtwin.core.numerics import jax, jnp
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.loop import HostLoop, advance, advance_batch, stack, start_batch, start_loop
from rovtwin.scenario import load_scenario
from rovtwin.simulation.sensors.sensor import Sensor

SCENARIO = "lawnmower_calm"


def simulation(overrides: tuple[str, ...] = ("autopilot=thesis",), seed: int = 1):
    return compose(load_scenario(SCENARIO, overrides, seed=seed))


def single(quick: bool) -> dict[str, Any]:
    """One vehicle, one simulated second a call as runs do; simulated seconds per second, and the ratio to NumPy."""
    calls, few, rounds = (2, 5, 3) if quick else (60, 25, 11)
    run = simulation()
    dt, substeps = run.scenario.control_dt, run.scenario.substeps
    ticks = round(1.0 / dt)
    host = HostLoop(run.loop, run.key, run.start, dt, ticks, short=0)
    plain = NumpyLoop(run)

    def compiled():
        for _ in range(calls):
            host.advance()

    def numpy():
        for _ in range(few):
            plain.tick()

    times = in_turns({"compiled": compiled, "numpy": numpy}, rounds)
    return {
        "compiled_ticks_per_s": rates(times["compiled"], calls * ticks),
        "physics_steps_per_s": rates(times["compiled"], calls * ticks * substeps),
        "numpy_ticks_per_s": rates(times["numpy"], few),
        "times_real_time": rates(times["compiled"], calls * ticks * dt)["median"],
        "ratio": ratio(times["compiled"], times["numpy"], calls * ticks, few),
    }


def batch(quick: bool) -> dict[str, Any]:
    """Several seeds side by side under vmap: control ticks of all vehicles per second."""
    sizes, calls, rounds = ((4,), 1, 2) if quick else ((1, 10, 32), 10, 5)
    results = {}
    for n in sizes:
        runs = [simulation(seed=seed + 1) for seed in range(n)]
        dt = runs[0].scenario.control_dt
        ticks = round(1.0 / dt)
        loops = stack([run.loop for run in runs])
        begin = start_batch(loops, stack([run.key for run in runs]), stack([run.start for run in runs]), dt)

        def action(loops=loops, begin=begin, dt=dt, ticks=ticks):
            memory = jax.tree.map(jnp.copy, begin)
            for call in range(calls):
                memory, _ = advance_batch(loops, memory, jnp.asarray(call * ticks), ticks, dt)
            jax.block_until_ready(memory)

        results[f"vehicles_{n}"] = rates(in_turns({"batch": action}, rounds)["batch"], n * calls * ticks)
    return results


def same_flight(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Paths of the compiled and of the NumPy loop with sensors that do not err, shapes (n, 6): the two do the same."""
    # Nearly deep enough and pointing elsewhere: it dives, turns, goes and reaches a way-point in little time.
    run = simulation(
        ("start={position: [4.5, 0.3, 2.85], heading_deg: 40}", "autopilot.controller.gains=pole_placement")
    )
    quiet = {
        name: Sensor(name, sensor.rate / 1000, physics_rate_hz=sensor.physics_rate / 1000)
        for name, sensor in run.loop.twin.sensors.items()
    }
    loop = eqx.tree_at(lambda loop: loop.twin.sensors, run.loop, quiet)
    dt = run.scenario.control_dt
    ticks = round(1.0 / dt)
    memory = start_loop(loop, run.key, run.start, dt)
    plain, path, plain_path = NumpyLoop(run, noise=0.0), [], []
    for call in range(round(seconds)):
        memory, record = advance(loop, memory, jnp.asarray(call * ticks), ticks, dt)
        path.append(np.concatenate([record.state.position, record.autopilot.estimate.position], axis=1))
        for _ in range(ticks):
            truth = plain.x[:3].copy()
            plain.tick()
            plain_path.append(np.concatenate([truth, plain.estimate[:3]]))
    return np.concatenate(path), np.array(plain_path)
