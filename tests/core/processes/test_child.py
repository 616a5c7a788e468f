"""A child process: it answers over its pipe, ends when that closes, and is killed where it does not."""

import os
import time

import pytest

from rovtwin.core.processes.child import end, started


def answering(pipe, word):
    pipe.send((word, os.getpid(), os.nice(0)))
    with pytest.raises(EOFError):
        pipe.recv()


def deaf(pipe):
    pipe.send("here")
    time.sleep(600)


@pytest.mark.parametrize("nice", [None, 3])
def test_answers_and_ends_when_the_pipe_closes(nice):
    process, pipe = started(answering, "hello", name="test", nice=nice)
    assert pipe.poll(60)
    word, pid, niceness = pipe.recv()
    assert (word, pid) == ("hello", process.pid) and process.daemon and process.name == "test"
    assert niceness >= min(19, os.nice(0) + (nice or 0)) or os.name != "posix"
    end(process, pipe, 60.0)
    assert process.exitcode == 0
    end(process, pipe, 0.0)


def test_who_does_not_end_is_killed():
    process, pipe = started(deaf, name="test")
    assert pipe.poll(60) and pipe.recv() == "here"
    end(process, pipe, 0.1)
    assert not process.is_alive() and process.exitcode == -9
