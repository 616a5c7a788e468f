"""Running before others: what moves a vehicle has little to do, and must not wait for who has much."""

import gc
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing.process import BaseProcess

PRIORITY = 5  # of SCHED_RR: above all that is not real-time, below the system's own threads


def start_below(process: BaseProcess, nice: int) -> None:
    """Start a process that is below others in priority from its first line on: what it imports costs seconds.

    Args:
        process: That has not been started.
        nice: How much nicer than this one.
    """

    def start() -> None:
        if sys.platform == "linux":  # where this is a thread's own, and goes on to its children
            os.nice(nice)
        process.start()

    with ThreadPoolExecutor(1) as pool:
        pool.submit(start).result()


def settle() -> None:
    """Look for garbage now, and from then on among what comes only: before a loop that has to keep time begins.

    Python looks through all that lives every now and then, and everything stands still meanwhile: 0.2 s where an
    autopilot was compiled.
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()


@contextmanager
def urgent(enabled: bool = True) -> Iterator[bool]:
    """Within, this thread runs before all others that do not ask for the same; gives whether the system lets it.

    Linux lets root, and whoever has a limit `rtprio` (/etc/security/limits.conf). Elsewhere nothing changes: the loop
    keeps time as well as the machine's load allows. Threads and processes started within are ordinary ones.
    """
    if not enabled or not hasattr(os, "SCHED_RR"):
        yield False
        return
    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except OSError:
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
