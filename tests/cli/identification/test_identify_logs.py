"""Logs that `rovtwin identify` is given: a bad held-out one is left out, a trusted one is used, both are reported."""

import json

import numpy as np
import pytest
from tests.identification.flown import fly
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.cli.identification import identify as command
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.identification import identify as module
from rovtwin.identification.identify import identify
from rovtwin.report.identification.tables import record_table
from rovtwin.vehicle import load_vehicle

PQR, ANGLES = ("p", "q", "r"), ("phi", "theta", "psi")


def write_log(path, seed, gain=1.0):
    """A CSV of commands, attitude and gyro on one clock, its gyro times `gain`."""
    record = fly("bluerov2", "multisine", seed)
    t = record.t_command[10:-10:2]
    columns = {"t": t} | dict(zip(load_vehicle("bluerov2").thruster_names, record.command_at(t).T, strict=True))
    for name, parts, scale in (("attitude", ANGLES, 1.0), ("gyro", PQR, gain), ("velocity", ("u", "v", "w"), 1.0)):
        signal = record.signals[name]
        value = np.unwrap(signal.value, axis=0) if name == "attitude" else signal.value
        columns |= {c: scale * np.interp(t, signal.t, column) for c, column in zip(parts, value.T, strict=True)}
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    return {
        name: write_log(folder / f"{name}.csv", seed, gain)
        for name, seed, gain in (("good", 3, 1.0), ("other", 4, 1.0), ("bad", 5, 60.0), ("worse", 6, 60.0))
    }


@pytest.fixture
def run(logs, tmp_path, monkeypatch):
    """The command with these words, its fit replaced by one of nothing; what it printed and what was to be fitted."""
    nothing = identify(load_vehicle("bluerov2"), [], free=["added_mass.yaw"])
    seen = {}

    def fit(vehicle, records, *, validate, **_):
        seen.update(fit=[r.name for r in records], held_out=[r.name for r in validate])
        return nothing

    monkeypatch.setattr(module, "identify", fit)

    def words_of(*words):
        given = [str(logs[w]) if w in logs else str(w) for w in words]
        result = CliRunner().invoke(app, ["identify", "bluerov2", *given, "-o", str(tmp_path / "out.yaml")])
        return result, seen

    return words_of


@pytest.mark.system
def test_a_bad_held_out_log_is_left_out_and_the_fit_goes_on(run):
    result, seen = run("good", "--validate", "bad", "--validate", "other", "--json")
    assert result.exit_code == 0, result.output
    assert seen == {"fit": ["good"], "held_out": ["other"]}
    data = json.loads(result.stdout)
    (row,) = [r for r in data["tests"] if r["use"] == "left out"]
    assert row["name"] == "bad" and "degrees" in row["notes"][0]
    assert any(f.startswith("bad was to be held out and is left out: gyro: ") for f in data["findings"])


def test_what_is_left_out_is_reported_on_the_screen_and_in_the_report(run, monkeypatch, logs):
    output, _ = run("good", "--validate", "bad")
    assert "bad was to be held out and is left out: gyro: " in " ".join(output.output.split())
    kept = {}
    monkeypatch.setattr(command, "_print", lambda screen, result: kept.update(result=result))
    run("good", "--validate", "bad")
    (row,) = record_table(kept["result"]).rows
    assert row[:2] == ["bad", "left out"] and "degrees" in row[-1]


def test_a_held_out_log_that_cannot_be_read_is_left_out_but_a_missing_one_is_refused(run, tmp_path):
    (tmp_path / "broken.csv").write_text("t,p\n")
    result, seen = run("good", "--validate", tmp_path / "broken.csv")
    assert result.exit_code == 0, result.output
    assert seen == {"fit": ["good"], "held_out": []}
    assert "broken was to be held out and is left out" in result.output
    result, _ = run("good", "--validate", tmp_path / "gone.csv")
    assert isinstance(result.exception, IdentificationError) and "no such file" in str(result.exception)


def test_a_bad_log_that_is_to_be_fitted_is_refused_and_the_way_out_is_that_log(run):
    result, _ = run("good", "bad", "--fit-share", 1)
    assert isinstance(result.exception, IdentificationError)
    assert "bad: gyro: " in str(result.exception) and "--trust 'bad'" in str(result.exception)
    assert "--trust 'good'" not in str(result.exception)


def test_trust_is_of_one_log_and_findings_of_the_checks_stay(run):
    result, seen = run("good", "bad", "--fit-share", 1, "--trust", "bad", "--json")
    assert result.exit_code == 0, result.output
    assert seen["fit"] == ["good", "bad"]
    assert any("bad is used though the checks say: gyro: " in f for f in json.loads(result.stdout)["findings"])
    result, _ = run("bad", "worse", "--fit-share", 1, "--trust", "bad.csv")
    assert isinstance(result.exception, IdentificationError)
    assert "worse: gyro" in str(result.exception) and "bad: gyro" not in str(result.exception)


def test_the_old_flag_trusts_all_and_says_all(run):
    result, seen = run("bad", "worse", "--fit-share", 1, "--trust-logs")
    assert result.exit_code == 0, result.output
    assert seen["fit"] == ["bad", "worse"]
    assert all(f"{name} is used though the checks say" in result.output for name in ("bad", "worse"))


def test_trust_in_a_log_that_is_not_there_is_a_mistake(run):
    result, _ = run("good", "--fit-share", 1, "--trust", "goood")
    assert isinstance(result.exception, ConfigError) and "Did you mean 'good'" in str(result.exception)


def test_the_held_out_part_of_a_log_is_checked_with_the_log(run, logs, tmp_path):
    """Not as a log of its own: a part is too short to tell a clock, and would be judged otherwise than the rest."""
    text = f"vehicle: bluerov2\nlogs: [{{file: {logs['bad']}, fit_share: 0.7}}]"
    (tmp_path / "evidence.yaml").write_text(text)
    result, _ = run("--evidence", tmp_path / "evidence.yaml")
    assert isinstance(result.exception, IdentificationError)
    assert str(result.exception).count("gyro: ") == 1
    result, seen = run("--evidence", tmp_path / "evidence.yaml", "--trust", "bad")
    assert result.exit_code == 0, result.output
    assert seen == {"fit": ["bad (fitted part)"], "held_out": ["bad (held out)"]}
