"""Running before others: what moves a vehicle has little to do, and must not wait for who has much."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 5  # of SCHED_RR: above all that is not real-time, below the system's own threads


def settle() -> None:
    """Look for garbage now, and from then on among what comes only: before a loop that has to keep time begins.

    Python looks through all that lives every now and then, and everything stands still meanwhile: 0.2 s where an
    autopilot was compiled.
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()


@contextmanager
def urgent(wanted: bool = True) -> Iterator[bool]:
    """Within, this thread runs before all others that do not ask for the same; gives whether the system lets it.

    Linux lets root, and whoever has a limit `rtprio` (/etc/security/limits.conf). Elsewhere nothing changes: the loop
    keeps time as well as the machine's load allows. Threads and processes started within are ordinary ones.
    """
    if not wanted or not hasattr(os, "SCHED_RR"):
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
