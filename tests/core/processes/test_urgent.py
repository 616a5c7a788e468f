"""Running before others: for as long as it is asked for, where the system lets it, and no child with it."""

import gc
import multiprocessing
import os
import threading
import time

import pytest

from rovtwin.core.processes.urgent import PRIORITY, settle, start_below, urgent


def policy():
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


def test_for_as_long_as_it_lasts():
    before = policy()
    with urgent() as is_so:
        if not is_so:
            assert policy() == before
            pytest.skip("this user may not ask for real-time scheduling")
        assert policy() == os.SCHED_RR
        assert os.sched_getparam(0).sched_priority == PRIORITY
        found = []
        child = threading.Thread(target=lambda: found.append(policy()))
        child.start()
        child.join()
        assert found == [os.SCHED_OTHER]
    assert policy() == os.SCHED_OTHER


def test_not_where_nobody_wants_it_or_the_system_refuses(monkeypatch):
    with urgent(False) as is_so:
        assert not is_so

    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with urgent() as is_so:
        assert not is_so


def report(pipe):
    pipe.send(os.nice(0))


def test_process_below_others_is_so_from_its_beginning_and_nobody_else():
    before = os.nice(0)
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=report, args=(theirs,))
    start_below(process, 3)
    assert ours.poll(30.0) and ours.recv() == before + 3
    process.join()
    assert os.nice(0) == before


def look_through(pipe):
    """How long a million objects take before and after, and whether garbage that comes later is found all the same."""

    def looking():
        began = time.perf_counter()
        gc.collect()
        return time.perf_counter() - began

    held = [[i] for i in range(1_000_000)]
    before = min(looking() for _ in range(3))
    settle()
    after = min(looking() for _ in range(3))
    own: list = []
    own.append(own)
    del own
    pipe.send((before, after, gc.collect(), len(held)))


def test_what_was_there_before_is_looked_through_no_more():
    """In a process of its own: this one may hold so much that every look takes seconds."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=look_through, args=(theirs,))
    process.start()
    assert ours.poll(60.0)
    before, after, found, _ = ours.recv()
    process.join()
    assert after < 0.2 * before and found >= 1
