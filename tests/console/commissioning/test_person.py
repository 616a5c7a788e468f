"""Answers of a page: only a yes to the very question is one, and once it is over nothing more is asked."""

import multiprocessing
import signal
import threading

import pytest

from rovtwin.console.commissioning import person as module
from rovtwin.console.commissioning.person import RemotePerson


@pytest.fixture
def both(monkeypatch):
    """The person, and the console's end of the pipe; nothing is killed."""
    monkeypatch.setattr(module, "ENDING", 0.0)
    killed = []
    monkeypatch.setattr(module.os, "kill", lambda pid, number: killed.append(number))
    monkeypatch.setattr(module.os, "killpg", lambda group, number: killed.append(number))
    console, theirs = multiprocessing.Pipe()
    person = RemotePerson(theirs)
    person.killed = killed
    person.attend()
    yield person, console
    console.close()
    for thread in [one for one in threading.enumerate() if one.name == "answers"]:
        thread.join()  # or what it kills at its end would be real


def answering(console, *answers):
    """Give answers to the next question: the number of the question it is about, less the asked one's, and a value."""

    def answer():
        kind, question = console.recv()
        assert kind == "question"
        for offset, value in answers:
            console.send(("answer", (question["id"] + offset, value)))

    threading.Thread(target=answer, daemon=True).start()


@pytest.mark.parametrize("value", [False, None, 1, 1.0, "yes", [True]])
def test_nothing_else_is_a_yes(both, value):
    person, console = both
    answering(console, (-1, True), (1, True), (0, value))
    assert person.confirm("May it move?") is False
    answering(console, (0, True))  # the yes that was given to another question waits no more
    assert person.confirm("Really?") is True


@pytest.mark.parametrize("value, found", [(12, 12.0), (0.0, 0.0), (None, None), (True, None), ("7", None)])
def test_a_figure_is_a_number_or_none(both, value, found):
    person, console = both
    answering(console, (0, value))
    assert person.number("What does it read", "N") == found


def test_a_stop_while_it_asks_is_no_answer(both):
    person, console = both

    def stop():
        _, question = console.recv()
        console.send(("stop", None))
        console.send(("answer", (question["id"], True)))

    threading.Thread(target=stop, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        person.confirm("May it move?")
    with pytest.raises(KeyboardInterrupt):
        person.number("What does it read", "N")
    assert not console.poll(), "nothing is asked any more"


def test_a_console_that_is_gone_ends_it(both):
    person, console = both
    console.close()
    with pytest.raises(KeyboardInterrupt):
        person.confirm("May it move?")
    for _ in range(1000):
        if len(person.killed) == 2:
            break
        threading.Event().wait(0.01)
    assert person.killed == [signal.SIGINT, signal.SIGKILL]


def test_progress_comes_at_a_pace_and_waits_for_nobody(both):
    person, console = both
    for share in range(1000):
        person.progress("flying", share / 1000)
    person.progress("landing", None)
    found = []
    while console.poll():
        found.append(console.recv())
    assert found[0] == ("progress", ("flying", 0.0)) and found[-1] == ("progress", ("landing", None))
    assert len(found) < 20
    for number in range(20_000):  # nobody reads: none of these may wait
        person.progress(f"step {number}", None)
