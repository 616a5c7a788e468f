"""The command line as a user meets it: help, JSON, exit codes, and every kind of bad input as a table."""

import ast
import inspect
import json
import re
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from tests.campaign.identified import identified_vehicle

import rovtwin.cli
from rovtwin.cli.flight.logs import in_short
from rovtwin.core.log import Log


def run(capsys, *words: str | Path) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command, in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["rovtwin", *map(str, words)])
        with pytest.raises(SystemExit) as stopped:
            rovtwin.cli.main()
    out, err = capsys.readouterr()
    return int(stopped.value.code or 0), out, err


# The baseline compiles in a fraction of the time, and any flight will do.
SHORT = ("--set", "autopilot=thesis", "--set", "duration=12", "--no-report")


@pytest.fixture(scope="module")
def short_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "short"
    code = subprocess.run(
        [sys.executable, "-m", "rovtwin.cli", "fly", "lawnmower_waves", *SHORT, "--out", folder, "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert code.returncode == 1, code.stderr
    return folder, json.loads(code.stdout)


@pytest.mark.system
def test_fly_says_all_that_a_script_needs(short_run):
    folder, text = short_run
    assert text["run_dir"] == str(folder)
    assert text["completed"] is False and text["reason"].startswith("not finished after 12 s: ")
    assert {"duration_s", "cross_track_rms_m", "cross_track_max_m", "depth_rms_m", "position_error_rms_m",
            "nees_position_mean"} <= set(text)  # fmt: skip
    assert len(text["position_error_rms_m"]) == 2
    assert Path(text["files"]["log.mcap"]).is_file() and Path(text["files"]["scenario.yaml"]).is_file()


@pytest.mark.system
def test_a_device_is_bolted_on_and_taken_off_again(capsys, tmp_path):
    new, bare = tmp_path / "new.yaml", tmp_path / "bare.yaml"
    words = ("vehicle", "add", "double_blueye", "dvl_a50", "--at", "-0.2,0,0.16", "--name", "dvl", "-o", new)
    code, out, err = run(capsys, *words)
    assert code == 0 and not err
    assert "net buoyancy" in out and "foam at" in out and "it sinks with 1.03 N" in out
    written = new.read_text()
    code, out, _ = run(capsys, *words, "--ballast", "--overwrite", "--json")
    report = json.loads(out)
    figures = {row["key"]: row for row in report["figures"]}
    assert code == 0 and report["ballasted"] and report["file"] == str(new)
    assert new.read_text().partition("parts:")[2].startswith(written.partition("parts:")[2])
    assert "--ballast" in new.read_text().splitlines()[0] and "g of foam added" in new.read_text()
    assert figures["mass"]["change"] == pytest.approx(0.17 + sum(p["mass_kg"] for p in report["ballast"]))
    assert abs(figures["net_buoyancy"]["after"]) < 0.03 and abs(figures["trim"]["after"]) < 0.1
    assert figures["hotel_load"]["change"] == 4 and figures["endurance"]["change"] < 0
    code, out, _ = run(capsys, "vehicle", "remove", new, "dvl", "-o", bare)
    assert code == 0 and "part: dvl_a50" not in bare.read_text() and "-dvl" in out
    assert "new.yaml and bare.yaml" in out  # not what new.yaml calls the vehicle
    assert "new.yaml, before and after" in run(capsys, "vehicle", "remove", new, "dvl")[1]
    code, out, _ = run(capsys, "vehicle", "diff", "double_blueye", bare, "--json")
    assert code == 0 and {row["key"]: row for row in json.loads(out)["figures"]}["hotel_load"]["change"] == 0


@pytest.mark.system
def test_figures_of_an_identified_vehicle_say_which_are_predicted(capsys, monkeypatch, tmp_path):
    """Only the last remark of `vehicle add` said that both columns were not what tests had found."""
    monkeypatch.setenv("COLUMNS", "160")  # words of a head are not broken, however long the path is
    known, more = identified_vehicle(tmp_path / "known.yaml"), tmp_path / "more.yaml"
    code, out, _ = run(capsys, "vehicle", "add", known, "lead_500g", "--at", "0,0,0.2", "-o", more)
    heading = out[: out.index("mass")]
    assert code == 0 and heading.count("predicted, not identified") == 2
    heading = (out := run(capsys, "vehicle", "diff", known, more)[1])[: out.index("mass")]
    assert heading.count("predicted, not identified") == 1 and heading.count("identified") == 2
    plain = run(capsys, "vehicle", "add", "double_blueye", "lead_500g", "--at", "0,0,0.2")[1]
    assert "identified" not in plain


@pytest.mark.system
def test_a_vehicle_that_sank_before_is_asked_for_its_buoyancy(capsys, monkeypatch, tmp_path):
    """Devices bolted on one by one left the net buoyancy of each step's before, -1 N, and nothing said so."""
    monkeypatch.setattr("rovtwin.runs.vehicle_figures.compared", lambda before, after: [])
    heavy, words = tmp_path / "heavy.yaml", ("lead_500g", "--at", "0,0,0.2")
    assert run(capsys, "vehicle", "add", "double_blueye", *words, "-o", heavy)[0] == 0
    code, out, _ = run(capsys, "vehicle", "add", heavy, *words, "--ballast")
    assert code == 0 and "before, it sank with 4.47 N, and ballast makes it do so again: --ballast --buoyancy 3N" in out
    code, out, _ = run(capsys, "vehicle", "add", heavy, *words, "--ballast", "--buoyancy", "1.5N")
    assert code == 0 and "it sank" not in out and "it sinks" not in out
    assert "ballast for +1.5 N of net buoyancy and level trim (on it now)" in out and "; +1.5" in out
    code, out, _ = run(capsys, "vehicle", "remove", heavy, "lead_500g", "--ballast", "--buoyancy", "1.5N")
    assert code == 0 and "ballast for +1.5 N of net buoyancy and level trim (on it now)" in out


def test_ballast_that_cannot_be_is_not_called_needless(capsys, monkeypatch):
    monkeypatch.setattr("rovtwin.runs.vehicle_figures.compared", lambda before, after: [])
    _, out, _ = run(capsys, "vehicle", "add", "gladius_mini", "battery_pod", "--at", "2,0,0.2")
    assert "ballast: none found." in out and "it needs none" not in out


def test_a_vehicle_without_drag_is_reported_to_have_no_bound(capsys, tmp_path):
    """Its speed was inf, its power nan, and the reason for "-" was not given."""
    bare = tmp_path / "bare.yaml"
    thruster = "{name: t, direction: [1, 0, 0], force: 9}"
    bare.write_text(f"{{name: bare, mass: 6.0, inertia: [1, 1, 1], volume: 0.006, thrusters: [{thruster}]}}")
    code, out, err = run(capsys, "vehicle", "add", bare, "lead_500g", "--at", "0,0,0.1")
    assert code == 0 and not err
    assert "no bound of the position: nothing drags it" in out and " inf" not in out and "nan" not in out


@pytest.mark.system
def test_sea_says_whether_the_vehicle_can_hold_its_place(capsys):
    storm = "world.waves={model: airy, significant_height: 1.5, zero_crossing_period: 5.7}"
    code, out, _ = run(capsys, "sea", "lawnmower_sea", "--set", storm, "--json")
    report = json.loads(out)
    assert code == 0 and report["verdict"] == "swept" and len(report["places"]) == 3
    assert report["places"][0]["horizontal_rms_n"] > 10 and report["places"][0]["available_n"] == pytest.approx(20)
    code, out, _ = run(capsys, "sea", "lawnmower_waves")
    assert code == 0 and "holds on average" in out and "0.503 N rms" in out
    code, out, _ = run(capsys, "scenario", "check", "lawnmower_sea")
    assert code == 0 and "usable" in out and "N rms" in out
    code, out, _ = run(capsys, "scenario", "check", "lawnmower_calm", "--json")
    assert code == 0 and json.loads(out)["holds_place"] is None
    assert run(capsys, "sea", "lawnmower_see")[0] == 2


@pytest.mark.slow
def test_an_empty_battery_is_reported_before_the_flight(capsys, tmp_path):
    flat = ("--set", "battery={charge: 0}")
    code, out, _ = run(capsys, "scenario", "check", "lawnmower_calm", *flat)
    assert code == 0 and "battery empty from the start (all): its thrusters do nothing" in out
    half = ("--set", "battery={charge: {port: 0, starboard: 0.5}}")
    code, out, _ = run(capsys, "scenario", "check", "lawnmower_calm", *half, "--json")
    assert code == 0 and "(port)" in json.loads(out)["battery_line"]
    assert "battery" not in run(capsys, "scenario", "check", "lawnmower_calm", "--set", "battery=true")[1]
    short = ("--set", "autopilot=thesis", "--set", "duration=1", "--out", str(tmp_path / "flat"), "--no-report")
    assert "battery empty from the start (all)" in run(capsys, "fly", "lawnmower_calm", *flat, *short)[1]


@pytest.mark.system
def test_a_file_that_exists_is_named_with_the_option_that_replaces_it(short_run, tmp_path, monkeypatch, capsys):
    """Commands said it in four ways; `log export` asked for `overwrite=True`, which is Python."""
    monkeypatch.chdir(tmp_path)
    log, there = short_run[0] / "log.mcap", "exists already. Choose another name"
    for target in ("run.nc", "csv"):
        words = ("log", "export", log, target)
        assert run(capsys, *words)[0] == 0
        code, _, err = run(capsys, *words)
        assert code == 2 and f"{there}, or replace it with --overwrite" in err and "overwrite=True" not in err
        assert run(capsys, *words, "--overwrite")[0] == 0


@pytest.mark.system
def test_log_commands(short_run, tmp_path, capsys):
    folder, _ = short_run
    code, out, _ = run(capsys, "log", "info", folder / "log.mcap", "--json")
    rows = {row["name"]: row for row in json.loads(out)["rows"]}
    assert code == 0 and rows["sensor/gyro"]["messages"] == 1200 and rows["truth/eta"]["frame"] == "n"
    code, out, _ = run(capsys, "log", "info", folder / "log.mcap")
    assert code == 0 and "datum: 63.450000° N, 10.360000° E, water level 0 m, start 2021-06-01T10:00:00Z" in out
    again = tmp_path / "again.mcap"
    again.write_bytes((folder / "log.mcap").read_bytes())
    code, several, _ = run(capsys, "log", "info", folder, again, "--json")
    assert code == 0 and [one["path"] for one in json.loads(several)["logs"]] == [str(folder / "log.mcap"), str(again)]
    assert json.loads(several)["logs"][0] == json.loads(run(capsys, "log", "info", folder, "--json")[1])
    code, table, _ = run(capsys, "log", "info", folder, again)
    assert code == 0 and "2 logs" in table and "is not in" not in table
    assert run(capsys, "log", "info", folder, tmp_path)[0] == 2  # a folder without a log
    assert in_short(["x", "y"]) == "x y" and in_short([f"x{i}" for i in range(60)]) == "x0 … x59 (60)"
    assert run(capsys, "log", "export", folder / "log.mcap", tmp_path / "run.nc")[0] == 0
    assert run(capsys, "log", "export", folder / "log.mcap", tmp_path / "csv")[0] == 0
    for ending in ("geojson", "gpx", "kml"):
        assert run(capsys, "log", "export", folder / "log.mcap", tmp_path / f"track.{ending}")[0] == 0
        assert "63.45" in (tmp_path / f"track.{ending}").read_text()
    whole = (folder / "log.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert run(capsys, "log", "info", tmp_path / "cut.mcap")[0] == 2
    assert run(capsys, "log", "repair", tmp_path / "cut.mcap")[0] == 0
    assert len(Log.read(tmp_path / "cut.repaired.mcap")["truth/eta"]) > 10


@pytest.mark.system
def test_report_of_a_log(short_run, tmp_path, capsys):
    folder, _ = short_run
    code, out, _ = run(capsys, "report", folder / "log.mcap", "--out", tmp_path, "--json")
    assert code == 0 and Path(json.loads(out)["report"]).stat().st_size > 10_000


@pytest.mark.parametrize(
    "words",
    [("scenario", "list"), ("scenario", "show", "square"), ("scenario", "check", "square_dvl"), ("scenario", "schema"),
     ("vehicle", "list"), ("vehicle", "show", "double_blueye"), ("vehicle", "check", "bluerov2"), ("vehicle", "schema"),
     ("vehicle", "ballast", "double_blueye", "--buoyancy", "200g", "--at", "-0.1,0,50mm"),
     ("campaign", "--schema"), ("--version",), ("--help",), ("fly", "--help"), ("log", "--help")],
)  # fmt: skip
def test_looking_is_done(words, capsys):
    code, out, _ = run(capsys, *words)
    assert code == 0 and out.strip()


@pytest.mark.parametrize("words", [("scenario", "list"), ("vehicle", "list"), ("vehicle", "show", "bluerov2_heavy"),
                                   ("vehicle", "ballast", "double_blueye", "--buoyancy", "-2N", "--level"),
                                   ("vehicle", "check", "double_blueye"), ("scenario", "show", "square")])  # fmt: skip
def test_json_is_one_object_on_standard_output(words, capsys):
    code, out, _ = run(capsys, *words, "--json")
    assert code == 0 and isinstance(json.loads(out), dict)


VEHICLE = """
name: mine
parts:
  - name: hull
    mass: {mass}
    center_of_gravity: [0, 0, 0.02]
    inertia: {inertia}
    volume: 0.0098
    shape: {{box: [0.5, 0.3, 0.3]}}
    {extra}
"""

SCENARIO = "vehicle: {vehicle}\nmission: square\n{extra}"
CAMPAIGN = """
scenario: square
vary: {{"{path}": {{distribution: uniform, low: -0.2, high: -0.1}}}}
{extra}
"""


def files(folder: Path) -> dict[str, Path]:
    """Bad files of every kind."""
    texts = {
        "negative_mass.yaml": VEHICLE.format(mass=-9, inertia="[0.2, 0.2, 0.2]", extra=""),
        "nan_mass.yaml": VEHICLE.format(mass=".nan", inertia="[0.2, 0.2, 0.2]", extra=""),
        "bad_inertia.yaml": VEHICLE.format(mass=9.8, inertia="[0.2, 0.2, -0.2]", extra=""),
        "no_triangle.yaml": VEHICLE.format(mass=9.8, inertia="[0.1, 0.1, 0.9]", extra=""),
        "unknown_key.yaml": VEHICLE.format(mass=9.8, inertia="[0.2, 0.2, 0.2]", extra="coloour: red"),
        "not_yaml.yaml": "name: [mine",
        "empty.yaml": "",
        "list.yaml": "- 1\n- 2",
        "twice.yaml": "name: a\nname: b",
        "scenario_unknown.yaml": SCENARIO.format(vehicle="double_blueye", extra="wrold: {}"),
        "scenario_vehicle.yaml": SCENARIO.format(vehicle="double_bluey", extra=""),
        "scenario_nan.yaml": SCENARIO.format(vehicle="double_blueye", extra="duration: .nan"),
        "scenario_degrees.yaml": SCENARIO.format(vehicle="double_blueye", extra="start: {heading_deg: 1000}"),
        "mission_far.yaml": "waypoints: [{position: [0, 0]}]",
        "mission_text.yaml": "waypoints: [{position: [a, b, c]}]",
        "campaign.yaml": CAMPAIGN.format(extra="samples: 2", path="world.current.velocity[1]"),
        "campaign_path.yaml": CAMPAIGN.format(extra="samples: 2", path="world.curent.velocity[1]"),
        "campaign_scatter.yaml": CAMPAIGN.format(extra="scatter: [depth_rms]", path="world.current.velocity[1]"),
        "campaign_noise.yaml": CAMPAIGN.format(extra="samples: 2", path="sensors.position.noise"),
        "empty.mcap": "",
        "not.mcap": "PK\x03\x04 something else altogether, long enough to have had an index",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    return {name: folder / name for name in texts}


BAD = [
    (("vehicle", "check", "negative_mass.yaml"), "mass"),
    (("vehicle", "check", "nan_mass.yaml"), "finite"),
    (("vehicle", "check", "bad_inertia.yaml"), "inertia"),
    (("vehicle", "check", "no_triangle.yaml"), "inertia"),
    (("vehicle", "check", "unknown_key.yaml"), "coloour: no such key"),
    (("vehicle", "check", "not_yaml.yaml"), "not YAML"),
    (("vehicle", "check", "empty.yaml"), "empty"),
    (("vehicle", "check", "list.yaml"), "expected"),
    (("vehicle", "check", "twice.yaml"), "given twice"),
    (("vehicle", "check", "nowhere.yaml"), "no such"),
    (("vehicle", "show", "double_bluey"), "double_blueye"),
    (("vehicle", "show", "double_blueye", "--water", "salt"), "expected fresh, sea, a density"),
    (("vehicle", "show", "double_blueye", "--water", "-3C 34"), "it freezes"),
    (("vehicle", "ballast", "double_blueye"), "nothing is asked for"),
    (("vehicle", "ballast", "double_bluey", "--level"), "double_blueye"),
    (("vehicle", "ballast", "negative_mass.yaml", "--level"), "mass"),
    (("vehicle", "ballast", "double_blueye", "--buoyancy", "2mm"), "expected a force such as 2N"),
    (("vehicle", "ballast", "double_blueye", "--buoyancy", "-5kN"), "can be reached"),
    (("vehicle", "ballast", "double_blueye", "--bg", "20"), "did you mean 20mm"),
    (("vehicle", "ballast", "double_blueye", "--bg", "0"), "capsizes"),
    (("vehicle", "ballast", "double_blueye", "--bg", "nan"), "expected a length"),
    (("vehicle", "ballast", "double_blueye", "--bg", "500mm", "-o", "x.yaml"), "at most"),
    (("vehicle", "ballast", "double_blueye", "--level", "--at", "0,0"), "expected x,y,z"),
    (("vehicle", "ballast", "double_blueye", "--buoyancy", "1", "--water", "1.025"), "expected 900 to 1100"),
    (("vehicle", "ballast", "double_blueye", "--buoyancy", "1", "--foam-density", "-1"), "above 0"),
    (("vehicle", "ballast", "double_blueye", "--buoyancy", "1", "--round", "0g"), "above 0"),
    (("vehicle", "ballast", "double_blueye", "--buoyancy", "1", "-o", "empty.yaml"), "exists already. Choose"),
    (("vehicle", "ballast", "double_blueye", "--buoyancy", "1", "-o", "x.json"), "expected .yaml"),
    (("vehicle", "add", "double_blueye", "dvl_a05", "--at", "0,0,0.2"), "Did you mean 'dvl_a50'"),
    (("vehicle", "add", "double_blueye", "dvl_a50", "--at", "0,0"), "expected x,y,z"),
    (("vehicle", "add", "double_blueye", "dvl_a50", "--at", "0,0,0", "--attitude-deg", "1"), "expected roll,pitch,yaw"),
    (("vehicle", "add", "double_blueye", "dvl_a50", "--at", "0,0,0", "-o", "empty.yaml"), "it with --overwrite"),
    (("vehicle", "add", "double_blueye", "dvl_a50", "--at", "0,0,0", "-o", "x.json"), "expected .yaml"),
    (("vehicle", "add", "double_blueye", "uhi", "--at", "0,0,0", "--buoyancy", "1N"), "found without --ballast"),
    (("vehicle", "remove", "double_blueye", "uhi", "--ballast", "--buoyancy", "2mm"), "expected a force such as 2N"),
    (("vehicle", "remove", "double_blueye", "dvl"), "its parts are port, starboard, uhi, frame"),
    (("vehicle", "diff", "double_blueye", "double_blu"), "Did you mean 'double_blueye'"),
    (("scenario", "check", "scenario_unknown.yaml"), "Did you mean 'world'"),
    (("scenario", "check", "scenario_vehicle.yaml"), "double_blueye"),
    (("scenario", "check", "scenario_nan.yaml"), "duration"),
    (("scenario", "check", "scenario_degrees.yaml"), "heading_deg"),
    (("scenario", "check", "empty.yaml"), "empty"),
    (("fly", "lawnmower_clam"), "Did you mean 'lawnmower_calm'"),
    (("fly", "lawnmower_seas"), "no such scenario"),
    (("fly", "square", "--set", "mission=mission_far.yaml"), "position"),
    (("fly", "square", "--set", "mission=mission_text.yaml"), "position"),
    (("fly", "square", "--set", "world.current=[.nan,0,0]"), "finite"),
    (("fly", "square", "--set", "vehicle=negative_mass.yaml"), "mass"),
    (("fly", "square", "--set", "sensors.dvl.latency=1"), "on_board"),
    (("fly", "square", "--set", "vehicle=uhi"), "no thrusters"),
    (("fly", "square", "--set", "world.water=1.025"), "Is it in g/cm3?"),
    (("fly", "square", "--set", "datum.latitude=163"), "datum.latitude"),
    (("fly", "square", "--set", "mission.waypoints=[{geodetic: [10.36, 63.45, 3]}]"), "swap latitude and longitude"),
    (("fly", "square", "--set", "world.net_buoyancy=-1000"), "no more buoyancy"),
    (("scenario", "check", "x" * 5000), "no such scenario"),
    (("report", "not.mcap", "--out", "empty.yaml"), "not an MCAP"),
    (("fly",), "SCENARIO"),
    (("fly", "square", "--seed", "minus"), "seed"),
    (("score", "square", "--seeds", "x"), "seeds"),
    (("fly", "square", "--replay", "x/3"), "leave out SCENARIO"),
    (("fly", "--replay", "3"), "expected the campaign's folder and the sample's number: DIR/INDEX"),
    (("campaign",), "found no file"),
    (("tune", "lawnmower_calm", "--set", "autopilot=thesis"), "found thesis, expected model_based"),
    (("tune", "lawnmower_calm", "--set", "autopilot=model_based", "--budget-s", "0"), "--budget-s: found 0"),
    (("tune", "lawnmower_calm", "--set", "autopilot=model_based", "--evaluations", "0"), "expected at least 1"),
    (("tune", "lawnmower_calm", "--only", "control.dampingratio"), "Did you mean 'control.damping_ratio'"),
    (("tune", "lawnmower_calm", "--weight", "speed=1"), "expected one of path, depth"),
    (("tune", "lawnmower_calm", "--set", "autopilot=nowhere.yaml"), "no autopilot 'nowhere.yaml'"),
    (("campaign", "nowhere.yaml"), "no such file"),
    (("campaign", "empty.yaml"), "empty"),
    (("campaign", "campaign_path.yaml"), "world.curent: no such key. Did you mean 'current'"),
    (("campaign", "campaign_path.yaml", "--samples", "0"), "samples"),
    (("campaign", "campaign.yaml", "--workers", "2", "--scheduler", "tcp://x:1"), "expected one of them"),
    (("campaign", "campaign_scatter.yaml", "--dry-run"), "Did you mean 'depth_rms_m'"),
    (("campaign", "campaign_noise.yaml", "--dry-run"), "sample 0 drew seed"),
    (("log", "info", "nowhere.mcap"), "nowhere.mcap"),
    (("log", "info", "empty.mcap"), "empty"),
    (("log", "info", "not.mcap"), "not an MCAP"),
    (("log", "export", "not.mcap", "out.nc"), "not an MCAP"),
    (("log", "export", "not.mcap", "out.xyz"), "expected .nc"),
    (("log", "repair", "empty.mcap"), "empty.mcap"),
    (("report", "not.mcap"), "not an MCAP"),
    (
        ("record", "square", "--link", "blueye://192.168.1.101", "--out", "x.mcap", "--speed", "2"),
        "may be a real vehicle",
    ),
    (("flyy",), "flyy"),
    # Options that would do nothing beside others.
    (("fly", "square", "--link", "twin://", "--realtime", "--film"), "--realtime, --film: nothing would come of it"),
    (("fly", "square", "--arm"), "go with --link"),
    (("console", "--replay", "nowhere", "--speed", "2"), "--speed: nothing would come of it"),
    (("console", "square", "--replay", "nowhere"), "square: nothing would come of it"),
    (("render", "pool", "--view", "third-person", "--seed", "3"), "--seed: nothing would come of it"),
    (("score", "square", "--vehicle", "bluerov2", "--set", "vehicle=minerva"), "--vehicle bluerov2: nothing would"),
    (("serve", "bluerov2_heavy", "--protocol", "ardusub-json", "--speed", "2"), "give its --speedup"),
    (("evidence", "thrust", "x.csv", "--full", "20"), "--full: nothing would come of it: without --speeds"),
    (("evidence", "panel", "minerva", "--scale", "0.001"), "--scale: nothing would come of it: minerva is a vehicle"),
    (("identify", "bluerov2", "--prior", "bluerov2", "--track", "aruco"), "--track: nothing would come of it"),
    (
        ("scenario", "check", "square", "--set", "vehicle=minerva", "--set", "vehicle.mass=9"),
        "names its vehicle (minerva)",
    ),
]


@pytest.mark.parametrize(("words", "expected"), BAD, ids=[" ".join(words)[:60] for words, _ in BAD])
def test_bad_input_is_one_message_and_exit_code_2(words, expected, tmp_path, monkeypatch, capsys):
    files(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    code, out, err = run(capsys, *words)
    assert code == 2
    assert expected in " ".join(err.split()) and "Traceback" not in err
    assert out == ""
    assert sorted(tmp_path.iterdir()) == before, "bad input must leave nothing behind"


def test_ballast_writes_a_vehicle_that_can_be_checked_and_shown(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ("vehicle", "ballast", "double_blueye", "--buoyancy", "2N", "--level", "--bg", "30mm", "-o", "new.yaml")
    code, out, _ = run(capsys, *words)
    assert code == 0 and "lead_1" in out and "wrote new.yaml" in out
    assert "--bg 30mm" in Path("new.yaml").read_text().splitlines()[0]
    code, out, _ = run(capsys, "vehicle", "show", "new.yaml", "--json")
    shown = json.loads(out)
    assert code == 0 and shown["net_buoyancy_N"] == pytest.approx(2.0, abs=1e-6)
    assert shown["metacentric_height_m"] == pytest.approx(0.03, abs=1e-6)
    assert run(capsys, *words)[0] == 2, "an existing file is not overwritten"


def test_check_says_when_a_vehicle_is_of_no_use_in_the_water(tmp_path, capsys):
    path = tmp_path / "heavy.yaml"
    path.write_text(VEHICLE.format(mass=10.8, inertia="[0.2, 0.2, 0.2]", extra=""))
    code, out, _ = run(capsys, "vehicle", "check", path, "--json")
    report = json.loads(out)
    assert code == 0 and report["valid"] is True
    assert report["reservations"] == ["it sinks with 9.81 N", "it has no thrusters"]
    assert report["verdict"] == "usable, but: it sinks with 9.81 N; it has no thrusters"
    code, out, _ = run(capsys, "vehicle", "check", path)
    assert code == 0 and report["verdict"] in out.splitlines()[0]
    assert run(capsys, "vehicle", "check", "double_blueye")[1].startswith("double_blueye: usable\n")


def test_bad_input_with_json_is_an_object_too(capsys):
    code, out, err = run(capsys, "fly", "lawnmower_clam", "--json")
    assert code == 2 and "no such scenario" in json.loads(out)["error"] and "no such scenario" in err


def _commands(command: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    yield words, command
    for name, inner in getattr(command, "commands", {}).items():
        yield from _commands(inner, (*words, name))


def test_help_of_every_command_keeps_its_units(capsys, monkeypatch):
    """Rich takes `[m]` for a mark of its own and leaves it out."""
    monkeypatch.setenv("COLUMNS", "240")
    named = 0
    for words, command in _commands(typer.main.get_command(rovtwin.cli.app)):
        texts = [getattr(parameter, "help", None) or "" for parameter in command.params]
        units = re.findall(r"\[[^\]]*\]", " ".join(texts))
        if units:
            code, out, _ = run(capsys, *words, "--help")
            named += len(units)
            assert code == 0 and all(unit in out for unit in units), words
    assert named > 30


def test_help_loads_nothing_that_computes():
    """So that it answers at once: what it loads is the command line's own."""
    code = """
import sys
import rovtwin.cli
sys.argv = ["rovtwin", "--help"]
try:
    rovtwin.cli.main()
except SystemExit:
    print(*{module.split(".")[0] for module in sys.modules}, file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = set(done.stderr.split())
    assert "rovtwin" in loaded and "typer" in loaded
    computing = {"jax", "numpy", "scipy", "equinox", "matplotlib", "pydantic", "yaml", "trimesh", "capytaine", "mcap"}
    assert not loaded & computing


@pytest.mark.slow
def test_ctrl_c_ends_with_a_readable_log_and_a_report(tmp_path):
    folder = tmp_path / "interrupted"
    process = subprocess.Popen(
        [sys.executable, "-m", "rovtwin.cli", "fly", "lawnmower_waves", "--set", "autopilot=thesis", "--realtime",
         "--out", folder, "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 120
        while not (folder / "log.mcap").exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(4.0)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    report = json.loads(out)
    assert process.returncode == 1 and "Traceback" not in err
    assert report["reason"] == "interrupted" and report["interrupted"] is True
    log = Log.read(folder / "log.mcap")
    assert log["truth/eta"].t[-1] == pytest.approx(report["duration_s"], abs=0.11)
    assert (folder / "report.html").stat().st_size > 10_000


def _names_used(function: Any) -> set[str]:
    """Names that a function's body reads."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}


def test_no_command_leaves_an_option_unread():
    """An option that nothing reads would be ignored in silence; those that have no role beside others are refused."""
    count = 0
    for words, command in _commands(typer.main.get_command(rovtwin.cli.app)):
        given = {p.name for p in command.params} - {"help", "version"}
        function = inspect.unwrap(command.callback) if command.callback else None
        if function is None or not given:
            continue
        count += len(given)
        if "schema" in words[-1:]:  # the root has no words
            given -= {"as_json"}  # a schema is JSON in any case
        unread = given - _names_used(function)
        assert not unread, f"{' '.join(words)}: {', '.join(sorted(unread))}"
    assert count > 300
