"""Work that goes on beside."""

import os
import signal
import time
from functools import partial

import pytest

from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.core.processes.aside import Aside


def doubled(value, say):
    say(f"doubling {value}")
    return 2 * value


def refused(say):
    raise ConfigError("vehicle.yaml: mass: expected a number")


def killed(say):
    os.kill(os.getpid(), signal.SIGKILL)


def test_results_come_in_order_with_messages_on_the_way():
    lines = []
    with Aside([partial(doubled, 2), partial(doubled, 5)]) as aside:
        assert [aside.result(lines.append), aside.result(lines.append)] == [4, 10]
    assert lines == ["doubling 2", "doubling 5"]


def test_ctrl_c_while_it_starts_is_not_its_own():
    with Aside([partial(doubled, 2)]) as aside:
        pid = aside._process.pid
        assert pid is not None
        for _ in range(20):  # while it imports, too
            os.kill(pid, signal.SIGINT)
            time.sleep(0.01)
        assert aside.result() == 4


def test_an_error_is_raised_where_the_result_is_waited_for():
    with Aside([partial(doubled, 1), refused, partial(doubled, 2)]) as aside:
        assert aside.result() == 2
        with pytest.raises(ConfigError, match="mass"):
            aside.result()


class TwoArguments(Exception):
    def __init__(self, what, where):
        super().__init__(f"{what} at {where}")


def unreadable(say):
    open("/nonexistent/x")


def awkward(say):
    raise TwoArguments("a leak", "the bow")


def test_errors_of_a_task_are_its_own_and_arrive():
    with Aside([unreadable]) as aside, pytest.raises(FileNotFoundError, match="nonexistent"):
        aside.result()
    with Aside([awkward]) as aside, pytest.raises(RuntimeError, match="a leak at the bow"):
        aside.result()


def test_a_process_that_is_killed_is_no_wait_for_ever():
    with Aside([killed]) as aside, pytest.raises(RovtwinError, match="ended before .*-9: is there memory"):
        aside.result()


def pid_of(say):
    return os.getpid()


def endless(say):
    while True:
        time.sleep(1)


def test_closing_ends_what_runs():
    aside = Aside([pid_of, endless])
    pid = aside.result()
    os.kill(pid, 0)  # it lives
    aside.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
