"""The process of a stage: questions and answers, no is no, STOP, what is named when it breaks down."""

import os
import signal
import time

import pytest
from tests.commission.waterside import Yes
from tests.console.commissioning.cheap import STAGES

from rovtwin.commission.dossier import Dossier, status
from rovtwin.commission.request import Request
from rovtwin.commission.run import commission
from rovtwin.console.commissioning import person as persons
from rovtwin.console.commissioning import process as processes
from rovtwin.console.commissioning.process import Job, StageProcess

CHEAP = "tests.console.commissioning.cheap"
SOON = 120.0  # on a machine that is busy [s]


@pytest.fixture
def folder(tmp_path):
    Dossier.begin(tmp_path / "c", Request("double_blueye", "twin://"))
    return tmp_path / "c"


@pytest.fixture
def started(folder):
    """`started("asks")` starts a stage; all are ended."""
    every = []

    def start(stage, stages="STAGES"):
        every.append(StageProcess(Job(folder, stage, folder / "stop", f"{CHEAP}:{stages}"), None))
        return every[-1]

    yield start
    for one in every:
        one.stop()
        one.close()


def until(process, *kinds):
    """The messages up to the first of these kinds."""
    found, late = [], time.monotonic() + SOON
    while time.monotonic() < late:
        message = process.message(0.1)
        if message is not None:
            found.append(message)
            if message[0] in kinds:
                return found
    raise AssertionError(f"no {kinds} among {found}")


def passed(folder, *stages):
    """Pass stages without a process."""
    commission(Dossier.open(folder).request, folder, STAGES, Yes(), only=stages)


def states(folder):
    return [words for _, words, _ in status(Dossier.open(folder), STAGES)]


@pytest.mark.system
def test_questions_are_asked_and_answers_come_back(folder, started):
    looked = until(started("looks"), "ended")
    assert ("say", "it is looked at") in looked and ("progress", ("looking at it", 0.5)) in looked
    process = started("asks")
    question = until(process, "question")[-1][1]
    assert question["kind"] == "confirm" and "hands away" in question["text"]
    process.answer(question["id"], True)
    *between, (_, second) = until(process, "question")
    assert [one for one in between if one[0] == "phase"] == [("phase", "turning"), ("phase", "resting")]
    assert (second["kind"], second["unit"]) == ("number", "N") and second["id"] != question["id"]
    process.answer(second["id"], 12.5)
    assert until(process, "ended")[-1][1] == ("go", "")
    assert Dossier.open(folder).measured("asks") == {"reading": 12.5}
    assert states(folder) == ["passed", "passed", "to do", "to do"]


@pytest.mark.system
def test_no_moves_nothing(folder, started):
    passed(folder, "looks")
    process = started("asks")
    question = until(process, "question")[-1][1]
    process.answer(question["id"] - 1, True)  # to an earlier question
    process.answer(question["id"], False)
    assert until(process, "ended")[-1][1] == ("no-go", "")
    attempt = Dossier.open(folder).attempts("asks")[0]
    assert not (attempt.folder / "moved").exists() and "not confirmed" in attempt.outcome.reasons[0]


@pytest.mark.system
def test_stop_ends_a_flight_at_once_and_keeps_its_page_and_log(folder, started):
    passed(folder, "looks", "asks")
    process = started("flies")
    process.answer(until(process, "question")[-1][1]["id"], True)
    while until(process, "progress")[-1][1][0] != "flying":
        pass
    began = time.monotonic()
    process.stop()
    process.stop()  # the button's second way
    assert until(process, "ended")[-1][1] == ("no-go", "") and time.monotonic() - began < 2.0
    attempt = Dossier.open(folder).attempts("flies")[0]
    assert "interrupted" in attempt.outcome.reasons[0]
    assert (attempt.folder / "log.mcap").read_bytes() == b"what was measured"


@pytest.mark.system
def test_stop_while_it_asks_moves_nothing_and_leaves_an_attempt_that_was_cut_off(folder, started):
    passed(folder, "looks")
    process = started("asks")
    question = until(process, "question")[-1][1]
    process.stop()
    process.answer(question["id"], True)  # too late
    assert until(process, "ended")[-1][1] == ("stopped", "")
    assert states(folder)[1] == "cut off"
    assert not (Dossier.open(folder).attempts("asks")[0].folder / "moved").exists()


@pytest.mark.system
def test_a_console_that_is_gone_ends_its_stage(folder, started):
    passed(folder, "looks")
    process = started("asks")
    until(process, "question")
    process._pipe.close()  # as a killed console leaves it
    process._process.join(SOON)
    assert process._process.exitcode is not None and states(folder)[1] == "cut off"


@pytest.mark.system
def test_what_does_not_end_is_killed(folder, started, monkeypatch):
    passed(folder, "looks")
    monkeypatch.setattr(processes, "ENDING", 0.2)
    process = started("asks")
    until(process, "question")
    os.kill(process.pid, signal.SIGSTOP)  # it hangs
    process.stop()
    assert until(process, "ended")[-1][1] == ("stopped", "")
    assert states(folder)[1] == "cut off" and persons.ENDING > 1.0


@pytest.mark.system
def test_a_process_that_dies_is_named(folder, started):
    how, why = until(started("dies", "DIES"), "ended")[-1][1]
    assert how == "died" and "exit code -9" in why and "memory" in why
    assert Dossier.open(folder).attempts("dies")[0].outcome is None
    how, why = until(started("fails", "FAILS"), "ended")[-1][1]
    assert (how, why) == ("failed", "TypeError: a mistake of ours")


@pytest.mark.system
def test_one_process_a_folder_and_stages_in_their_order(folder, started):
    how, why = until(started("asks"), "ended")[-1][1]
    assert how == "refused" and "looks comes first" in why
    with Dossier.open(folder).locked():
        how, why = until(started("looks"), "ended")[-1][1]
    assert how == "refused" and "another process is commissioning here" in why
    assert states(folder)[0] == "to do"
