"""Many vehicles on a graphics processor: vehicle-steps per second of the bare plant, float64 and float32."""

import time
from typing import Any

import numpy as np

from benchmarks.dynamics import fly, open_tcp_server, water
from rovtwin.core.numerics import jax, jnp

NONE = "no GPU that JAX sees here"
SIZES = (1_000, 10_000, 100_000, 1_000_000)
STEPS = 100


def batch(quick: bool) -> dict[str, Any]:
    """Median rates by type and number of vehicles; commands are held, so that they take no room."""
    if jax.default_backend() != "gpu":
        return {"device": NONE}
    found: dict[str, Any] = {"device": jax.devices()[0].device_kind}
    for dtype in (jnp.float64, jnp.float32):
        environment = jax.tree.map(lambda leaf, dtype=dtype: leaf.astype(dtype), water())

        def alone(model, state, u, environment=environment):
            return fly(model, state, jnp.broadcast_to(u, (STEPS, *u.shape)), environment)

        run = jax.jit(jax.vmap(alone))
        for n in SIZES[:1] if quick else SIZES:
            models, starts, u = open_tcp_server(n, 1, dtype)
            found[f"{jnp.dtype(dtype).name}_vehicles_{n}"] = n * STEPS / _median(run, models, starts, u[:, 0])
    return found


def _median(run: Any, *arguments: Any) -> float:
    """Wall-clock time of a run [s]: the processor's own says nothing about a device."""
    jax.block_until_ready(run(*arguments))
    times = []
    for _ in range(7):
        begin = time.perf_counter()
        jax.block_until_ready(run(*arguments))
        times.append(time.perf_counter() - begin)
    return float(np.median(times))
