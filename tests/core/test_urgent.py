"""Running before others: for as long as it is asked for, where the system lets it, and no child with it."""

import os
import threading

import pytest

from rovtwin.core.urgent import PRIORITY, urgent


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
