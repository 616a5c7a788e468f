"""Stages in their order, go and no-go, and what a break or a kill leaves."""

import json

import pytest
from tests.commission.waterside import Yes

from rovtwin.commission.dossier import Dossier, status
from rovtwin.commission.request import Request
from rovtwin.commission.run import commission
from rovtwin.commission.stage import Check, Outcome, Stage
from rovtwin.core.errors import ConfigError, LinkTimeout

REQUEST = Request("double_blueye", "twin://")


def stage(name, *checks, done=None, error=None):
    def run(work):
        if done is not None:
            done.append(name)
        if error:
            raise error
        return Outcome(checks, {"found": name}, seconds=1.0)

    return Stage(name, name.title(), "a purpose", "What comes next.", False, run)


def words(folder, stages):
    return [found for _, found, _ in status(Dossier.open(folder), stages)]


def test_stages_follow_each_other_and_are_not_done_again(tmp_path):
    done = []
    stages = [stage("one", done=done), stage("two", done=done)]
    shown = []
    commission(REQUEST, tmp_path / "c", stages, Yes(), shown=lambda one, attempt: shown.append(attempt.outcome.go))
    assert done == ["one", "two"] and shown == [True, True]
    found = commission(REQUEST, tmp_path / "c", stages, Yes())
    assert done == ["one", "two"] and found.measured("two") == {"found": "two"}
    commission(REQUEST, tmp_path / "c", stages, Yes(), only=["one"])
    assert done == ["one", "two", "one"] and len(found.attempts("one")) == 1
    assert len(Dossier.open(tmp_path / "c").attempts("one")) == 2


def test_a_no_go_ends_it_with_the_reason(tmp_path):
    done = []
    stopped = stage("one", Check("ok", "a", "fine"), Check("stop", "leak", "it leaks.", "Dry it."), done=done)
    found = commission(REQUEST, tmp_path / "c", [stopped, stage("two", done=done)], Yes())
    outcome = found.attempts("one")[0].outcome
    assert done == ["one"] and not outcome.go and outcome.reasons == ["leak: it leaks. Dry it."]
    mended = [stage("one", done=done), stage("two", done=done)]
    commission(REQUEST, tmp_path / "c", mended, Yes())
    assert done == ["one", "one", "two"]


def test_a_link_that_is_lost_is_a_no_go_and_no_traceback(tmp_path):
    stages = [stage("one", error=LinkTimeout("nobody answers"))]
    found = commission(REQUEST, tmp_path / "c", stages, Yes())
    assert (
        words(tmp_path / "c", stages) == ["no-go"] and "nobody answers" in found.attempts("one")[0].outcome.reasons[0]
    )


def test_a_killed_attempt_leaves_its_log_and_is_done_again(tmp_path):
    class Killed(BaseException):
        pass

    def run(work):
        (work.folder / "log.mcap").write_bytes(b"what was measured")
        raise Killed

    killed = [Stage("one", "One", "a purpose", "next", True, run)]
    with pytest.raises(Killed):
        commission(REQUEST, tmp_path / "c", killed, Yes())
    assert words(tmp_path / "c", killed) == ["cut off"]
    found = commission(REQUEST, tmp_path / "c", [stage("one")], Yes())
    first, second = found.attempts("one")
    assert first.outcome is None and (first.folder / "log.mcap").read_bytes() == b"what was measured"
    assert second.outcome.go and found.logs("one") == [first.folder / "log.mcap"]


def test_a_description_that_changed_since_is_out_of_date(tmp_path):
    vehicle = tmp_path / "mine.yaml"
    body = "name: mine\nmass: 10\nvolume: 0.01\nthrusters: [{name: a, direction: [1, 0, 0], force: 10}]\n"
    vehicle.write_text(body + "shape: {box: [0.4, 0.3, 0.2]}\n")
    request, stages = Request(str(vehicle), "twin://"), [stage("one"), stage("two")]
    commission(request, tmp_path / "c", stages, Yes())
    assert words(tmp_path / "c", stages) == ["passed", "passed"]
    vehicle.write_text(vehicle.read_text().replace("mass: 10", "mass: 10.5"))
    assert words(tmp_path / "c", stages) == ["out of date", "out of date"]
    commission(request, tmp_path / "c", stages, Yes(), only=["one"])
    assert words(tmp_path / "c", stages) == ["passed", "out of date"]


def test_mistakes_are_words(tmp_path):
    folder = tmp_path / "c"
    with pytest.raises(ConfigError, match="6x3"):
        commission(Request("double_blueye", "twin://", tank="big"), folder, [], Yes())
    assert not folder.exists()
    commission(REQUEST, folder, [stage("one")], Yes())
    with pytest.raises(ConfigError, match="--stage three: expected one of one, two"):
        commission(REQUEST, folder, [stage("one"), stage("two")], Yes(), only=["three"])
    with pytest.raises(ConfigError, match="two comes first"):
        commission(REQUEST, folder, [stage("one"), stage("two"), stage("three")], Yes(), only=["three"])
    (folder / "commission.json").write_text(json.dumps({"format": 1}))
    with pytest.raises(ConfigError, match=r"commission\.json"):
        Dossier.open(folder)
    other = tmp_path / "other"
    other.mkdir()
    (other / "precious.txt").write_text("mine")
    with pytest.raises(ConfigError, match="new folder"):
        commission(REQUEST, other, [], Yes())
    assert [path.name for path in other.iterdir()] == ["precious.txt"]


def test_two_at_once_are_refused(tmp_path):
    commission(REQUEST, tmp_path / "c", [stage("one")], Yes())
    with (
        Dossier.open(tmp_path / "c").locked(),
        pytest.raises(ConfigError, match="another process"),
    ):
        commission(REQUEST, tmp_path / "c", [stage("one")], Yes())
