"""`rovtwin watch` as a user types it."""

import json
import shutil
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from tests.identification.commands import run

from rovtwin.monitoring.reference import UNIT_TO_UNIT, identified_std
from rovtwin.runs.fly import fly
from rovtwin.runs.watch import watch_runs
from rovtwin.scenario.files import load_scenario

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two short runs: as described, and with one thruster that has lost a third of its force."""
    folder = tmp_path_factory.mktemp("runs")
    for name, seed, health in (("before", 1, 1.0), ("after", 2, 0.6)):
        given = ["duration=75", f"world.thruster_health={{port.surge: {health}}}"]
        fly(load_scenario("square", given, seed), folder / name)
    return folder


watch = partial(run, command="watch")


def test_what_has_changed_is_reported_and_drawn(runs, monkeypatch, capsys, tmp_path):
    code, out, _ = watch(monkeypatch, capsys, runs / "before", runs / "after", "-o", tmp_path / "page", "--json")
    data = json.loads(out)
    assert code == 0 and data["against"] == "before" and data["baseline_runs"] == 1
    before, after = data["runs"]
    assert before["changed"] == [] and before["seconds"] > 60
    (change,) = [c for c in after["changed"] if c["quantity"].startswith("thruster.")]
    assert change["quantity"] == "thruster.port.surge"
    assert np.exp(change["difference"]) == pytest.approx(0.6, abs=0.1)
    assert any("look at port.surge" in cause for cause in after["causes"])
    page = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    assert "Something has changed" in page and "port.surge against others" in page


def test_nothing_has_changed_says_how_little_it_could_tell(runs):
    found = watch_runs([runs / "before", runs / "before"])
    readings = [replace(one, value=0.0, std=one.prior_std) for one in found.runs[1].run.readings]
    blind = replace(found.runs[1], run=replace(found.runs[1].run, readings=readings))
    (line,) = [text for text, _ in replace(found, runs=[found.runs[0], blind]).words() if "nothing has changed" in text]
    assert f"that it can tell; 0 of {len(readings)} quantities were learnt in it and before, and no thruster" in line
    (line,) = [text for text, _ in found.words() if "nothing has changed" in text]
    learnt = sum(one.learnt for one in found.runs[1].run.readings)
    assert (
        0 < learnt < len(readings) and f"{learnt} of {len(readings)} quantities" in line and "thrusters could" in line
    )


def test_one_run_of_a_vehicle_that_was_not_identified_says_so(runs, monkeypatch, capsys):
    code, out, _ = watch(monkeypatch, capsys, runs / "before")
    assert code == 0 and "nothing to compare it with" in out and "surge top speed" in out


def test_mistakes(runs, monkeypatch, capsys, tmp_path):
    code, _, err = watch(monkeypatch, capsys, runs / "before", "--baseline", 1)
    assert code == 2 and "expected more runs than that, found 1" in err
    alone = shutil.copy(runs / "before" / "log.mcap", tmp_path / "alone.mcap")
    code, _, err = watch(monkeypatch, capsys, alone)
    assert code == 2 and "give --vehicle" in err
    code, _, err = watch(monkeypatch, capsys, alone, "--vehicle", "bluerov2")
    assert code == 2 and "Give the vehicle that flew" in err
    code, _, err = watch(monkeypatch, capsys, runs / "befor")
    assert code == 2 and "no such file" in err


def test_what_the_identification_does_not_say_is_not_known():
    text = {"linear_damping.surge": 0.3, "quadratic_damping.surge": 0.04, "thrusters.h.force_ahead": 0.03}
    estimate = SimpleNamespace(
        parameters=[SimpleNamespace(name=name, std=std) for name, std in text.items()], groups={"h": ["a", "b"]}
    )
    vehicle = SimpleNamespace(file=SimpleNamespace(identified=SimpleNamespace(estimate=estimate)))
    names = ["drag.surge", "drag.sway", "force.surge", "top_speed.surge", "thruster.a"]

    vehicle.thruster_names = ["a", "b"]
    found = identified_std(vehicle, names)
    np.testing.assert_allclose(found, [0.3, np.nan, 0.03, 0.5 * np.hypot(0.3, 0.03), np.hypot(0.03, UNIT_TO_UNIT)])
    vehicle.thruster_names = ["a", "b", "v"]
    assert np.isnan(identified_std(vehicle, ["force.surge", "top_speed.surge", "thruster.v"])).all()
    vehicle.file.identified = None
    assert identified_std(vehicle, names) is None


def test_what_only_the_later_run_tells_is_not_called_unchanged(runs):
    """A baseline that does not tell the port thruster's force cannot say that it is what it was."""
    found = watch_runs([runs / "before", runs / "after"])
    names = [reading.quantity.name for reading in found.runs[0].run.readings]
    unlearnt = np.array([name.startswith(("thruster.", "force.", "top_speed.")) for name in names])
    std = np.where(unlearnt, np.nan, found.before.std)
    found = replace(found, before=replace(found.before, std=std, unlearnt=unlearnt))
    assert found.changes[1] == []
    message = " ".join(text for text, _ in found.words())
    assert "after: not as described, where nothing is known from before: " in message
    assert "force of port.surge against others" in message and "nothing has changed" not in message
