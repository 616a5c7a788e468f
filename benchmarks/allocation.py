"""The allocator with priorities: time per tick inside a scan, one core, and Newton steps per solve."""

from typing import Any

import numpy as np

from benchmarks.timing import in_turns
from rovtwin.core.block import Start
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.gnc.allocation.box_least_squares import MOST_STEPS, unbounded
from rovtwin.gnc.allocation.prioritised import DAMPING, AllocationMemory, PriorityAllocation
from rovtwin.gnc.interfaces import Allocated, AllocationInput
from rovtwin.vehicle import load_vehicle

VEHICLES = ("double_blueye", "bluerov2_heavy")


@jax.jit
def scanned(block: PriorityAllocation, taus: Array, health: Array) -> Array:
    memory = block.init(jax.random.key(0), Start.at())

    def step(memory: AllocationMemory, tau: Array) -> tuple[AllocationMemory, Allocated]:
        return block.step(memory, AllocationInput(tau, health), 0.02)

    return jax.lax.scan(step, memory, taus)[1].made


@jax.jit
def steps_taken(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    return jax.lax.map(lambda one: unbounded(*one, jnp.zeros(A.shape[2]), DAMPING)[1], (A, b, lower, upper))


def priorities(quick: bool) -> dict[str, Any]:
    """Wrenches of 0.3 (mostly reachable) and of twice the largest of each axis; steps on random vehicles."""
    ticks, rounds = (200, 3) if quick else (5000, 11)
    rng, actions = np.random.default_rng(0), {}
    for name in VEHICLES:
        block = PriorityAllocation.of(load_vehicle(name).model())
        for size in (0.3, 2.0):
            taus = jnp.asarray(rng.normal(size=(ticks, 6)) * size * np.asarray(block.greatest_wrench))
            arguments = block, taus, jnp.ones(block.thrusters.count)
            actions[f"{name}, {size:g}"] = lambda arguments=arguments: scanned(*arguments).block_until_ready()
    times = in_turns(actions, rounds)
    steps = _steps(rng, 200 if quick else 50_000)
    return {
        "us_per_tick": {name: 1e6 * float(np.median(found)) / ticks for name, found in times.items()},
        "steps": {"median": int(np.median(steps)), "most": int(steps.max()), "bound": MOST_STEPS, "of": len(steps)},
    }


def _steps(rng: np.random.Generator, count: int) -> np.ndarray:
    """Newton steps of allocations of 12 random thrusters, some lost, wrenches up to far beyond reach."""
    n, weight = 12, np.sqrt([1, 1, 9e4, 300, 300, 300])
    A = rng.normal(size=(count, 6, n))
    A *= rng.choice([0.0, 0.5, 1.0, 1.0], (count, 1, n)) / np.abs(A).sum(axis=2, keepdims=True)
    b = np.clip(np.einsum("kij,kj->ki", A, rng.normal(size=(count, n)) * rng.choice([0.3, 1, 3], (count, 1))), -1, 1)
    lower, upper = -rng.uniform(0.2, 1, (count, n)), rng.uniform(0.2, 1, (count, n))
    return np.asarray(steps_taken(*map(jnp.asarray, (A * weight[:, None], b * weight, lower, upper))))
