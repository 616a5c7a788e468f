"""The process that works for the web server: one thing at a time, and it can be ended whatever it is at."""

import asyncio
import os
import threading
import time

import pytest
from tests.console import errands
from tests.console.loops import ran

from rovtwin.console import worker as module
from rovtwin.console.worker import Worker
from rovtwin.core.errors import ConfigError, RovtwinError


@pytest.fixture(scope="module")
def worker():
    made = Worker("the work")
    yield made
    made.close()


def test_it_works_elsewhere_and_stays(worker):
    async def ask():
        return await asyncio.gather(worker.call(os.getpid), worker.call(os.getpid), worker.call(len, "abc"))

    one, other, length = ran(ask())
    assert one == other != os.getpid() and length == 3


def test_errors_come_back_as_they_are(worker):
    with pytest.raises(ConfigError, match="line 3"):
        ran(worker.call(errands.fail, ConfigError("line 3")))
    with pytest.raises(RuntimeError, match="here: that"):
        ran(worker.call(errands.fail_pickily))
    assert ran(worker.call(len, "ab")) == 2


def test_a_plain_one_unpickles_nothing():
    plain = Worker("the work", plain=True)
    assert ran(plain.call(errands.give_own)) == "own" and type(ran(plain.call(errands.give_own))) is str
    with pytest.raises(RovtwinError, match="^line 3$"):
        ran(plain.call(errands.fail, ConfigError("line 3")))
    with pytest.raises(RovtwinError, match="Picky: here: that") as caught:
        ran(plain.call(errands.fail_pickily))
    assert type(caught.value) is RovtwinError
    with pytest.raises(RovtwinError, match="allocate_lock: what it gives cannot be sent"):
        ran(plain.call(threading.Lock))
    plain.close()


def test_an_answer_that_cannot_be_sent_says_so_and_the_process_stays(worker):
    process = ran(worker.call(os.getpid))
    with pytest.raises(RuntimeError, match="allocate_lock: what it gives cannot be sent: .*pickle"):
        ran(worker.call(threading.Lock))
    assert ran(worker.call(os.getpid)) == process


def test_a_process_that_is_killed_is_reported_and_another_takes_its_place(worker):
    with pytest.raises(RovtwinError, match="the work: its process ended"):
        ran(worker.call(os._exit, 9))
    assert ran(worker.call(len, "ab")) == 2


def test_what_takes_too_long_is_ended():
    hasty = Worker("the work", patience=0.2)
    with pytest.raises(RovtwinError, match="found no end within 0.2 s"):
        ran(hasty.call(time.sleep, 60.0))
    assert ran(hasty.call(len, "ab")) == 2
    hasty.close()


@pytest.mark.parametrize("begun", [False, True])
def test_the_end_waits_for_nothing(worker, begun):
    """Ctrl-C: no thread may be left that waits for the process."""

    async def end():
        if begun:
            await worker.call(len, "")
        task = asyncio.create_task(worker.call(time.sleep, 60.0))
        await asyncio.sleep(0.1 if begun else 0.0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    if not begun:
        worker.close()
    began, before = time.monotonic(), threading.active_count()
    ran(end())  # which waits for threads
    assert time.monotonic() - began < 30.0 and threading.active_count() <= before


def test_more_than_can_wait_are_refused(monkeypatch):
    monkeypatch.setattr(module, "MOST_WAITING", 2)
    busy = Worker("the work")

    async def open_tcp_server():
        return await asyncio.gather(*(busy.call(len, "ab") for _ in range(4)), return_exceptions=True)

    found = ran(open_tcp_server())
    busy.close()
    assert found[:2] == [2, 2] and all("2 others wait already" in str(error) for error in found[2:])
