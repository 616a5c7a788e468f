"""What is said of missions that were flown again: what the change has cost, and what it has not."""

from dataclasses import replace
from typing import cast

import pytest
from tests.commission.after.test_watching import certificate

from rovtwin.commission.after import envelope as module
from rovtwin.commission.after.envelope import Envelope
from rovtwin.commission.proving.cells import Cell, Proof
from rovtwin.runs.watch import WatchedRun


def found(certified, control, now, versions=()):
    return Envelope([], {0.0: certified}, {0.0: control}, {0.0: now}, versions)


@pytest.mark.parametrize(
    ("certified", "control", "now", "verdicts"),
    [
        (0.2, 0.2, 0.2, ["ok"]),
        (0.2, 0.2, 0.1, ["stop"]),
        (0.2, 0.2, None, ["stop"]),
        (0.0, 0.0, None, ["stop"]),
        (None, None, None, ["ok"]),
        (0.2, 0.1, 0.1, ["warning", "note"]),  # not of the change
        (0.2, 0.1, None, ["stop", "note"]),
        (0.2, 0.3, 0.2, ["ok", "note"]),
    ],
)
def test_only_what_the_change_has_cost_is_laid_to_it(certified, control, now, verdicts):
    one = found(certified, control, now, ("jax 0.1 then, 0.2 now (newer)",))
    assert [line.verdict for line in one.lines()] == verdicts
    assert one.holds == (verdicts[0] == "ok")
    if "note" in verdicts:
        assert "jax 0.1 then" in one.lines()[-1].text


@pytest.mark.system
def test_the_unchanged_vehicle_flies_beside_with_the_numbers_of_the_proof(tmp_path, monkeypatch):
    """Its seed and missions are those of the proof, whatever was asked for since."""
    given = {}

    def fly(places, samples, seed, base, kinds, progress):
        given.update(places=places, samples=samples, seed=seed, kinds=kinds)
        proofs = [(2, 2), (2, 1)]
        cells = [[Cell(0.1 * k, 0.0, 2, n, ()) for k, n in enumerate(one)] for one in proofs]
        return [Proof(one, [], [], []) for one in cells]

    made = certificate(tmp_path / "bundle", None)
    made = replace(made, request=replace(made.request, seed=9, samples=50), versions=("numpy 1 then, 2 now (newer)",))
    monkeypatch.setattr(module, "flown_beside", fly)
    monkeypatch.setattr(module, "learnt", lambda run: None)
    again = module.flown_again(made, cast(WatchedRun, None), lambda share: None)
    assert given["places"] == [(0.0, 0.0), (0.0, 0.1)] and (given["samples"], given["seed"]) == (2, 1)
    assert len(given["kinds"]) == 2 and given["kinds"][0].drawn is not given["kinds"][1].drawn
    assert again is not None and again.control == {0.0: 0.1} and again.after == {0.0: 0.0}
    assert again.versions == made.versions
