"""How things are timed: in turns, so that whatever disturbs the machine hits both sides alike; medians.

Throughput is measured in processor time of this process, which a busy machine does not inflate as it does wall-clock
time; all of it runs on one thread (`PJRT_NPROC=1`). Latency and compile times are wall-clock times.
"""

import gc
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any


def seconds(action: Callable[[], Any]) -> float:
    """Processor time of one call."""
    begin = time.process_time()
    action()
    return time.process_time() - begin


def in_turns(actions: dict[str, Callable[[], Any]], rounds: int) -> dict[str, list[float]]:
    """Times of all actions, one after the other, `rounds` times over; each has run once before."""
    for action in actions.values():
        action()
    gc.collect()
    times: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(rounds):
        for name, action in actions.items():
            times[name].append(seconds(action))
    return times


def rates(times: list[float], work: float) -> dict[str, float]:
    """Work per second: median, and the quarter and three-quarter points."""
    values = sorted(work / t for t in times)
    low, middle, high = statistics.quantiles(values, n=4) if len(values) > 1 else values * 3
    return {"median": middle, "quarter": low, "three_quarters": high}


def ratio(fast: list[float], slow: list[float], fast_work: float, slow_work: float) -> dict[str, float]:
    """How many times as much work per second: median and range over the rounds, each round by itself."""
    values = [(fast_work / f) / (slow_work / s) for f, s in zip(fast, slow, strict=True)]
    return {"median": statistics.median(values), "least": min(values), "most": max(values)}


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    return {
        "cpu": _cpu(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "load_before": os.getloadavg()[0],
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: version(name) for name in ("rovtwin", "jax", "jaxlib", "numpy")},
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "date": time.strftime("%Y-%m-%d"),
    }


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names and names[0] != "unknown" else f"unnamed {platform.machine()}"
