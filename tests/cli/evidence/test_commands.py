"""`rovtwin evidence decay` and `thrust`: what is printed and written, and bad input without a traceback."""

import json

import numpy as np
import pytest
import yaml
from tests.identification.commands import run

from rovtwin.identification.decay.motion import swing
from rovtwin.identification.decay.read import read_angle
from rovtwin.vehicle import load_vehicle

J, K, D_L, D_Q = 5.17, 7.36, 3.04, 4.04


def write_decay(path, seed=0, added_k=0.0, added_J=0.0, header="t,roll_deg"):
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 20.0, 0.05)
    ratios = np.array([K + added_k, D_L, D_Q]) / (J + added_J)
    angle = np.full(t.shape, -0.58)
    angle[t >= 3] = swing(t[t >= 3], (-0.58, 0.0), *ratios, 0.02)
    measured = np.degrees(angle) + 1.5 + rng.normal(0, 0.2, t.size)
    path.write_text("\n".join([header, *(f"{x:.2f},{y:.3f}" for x, y in zip(t, measured, strict=True))]))
    return path


@pytest.fixture
def surge(tmp_path):
    path = tmp_path / "surge.csv"
    path.write_text("command,velocity\n0.2,0.048\n0.4,0.1415\n0.5,0.1745\n0.6,0.2124\n0.8,0.2685\n0.9,0.2872\n")
    return path


def test_decay_says_ratios_only_and_refuses_to_write_them(tmp_path, monkeypatch, capsys):
    path = write_decay(tmp_path / "roll.csv")
    code, out, _ = run(monkeypatch, capsys, "decay", path)
    assert code == 0 and "ratios only" in out and "with units" not in out
    code, _, err = run(monkeypatch, capsys, "decay", path, "-o", tmp_path / "x.yaml")
    assert code == 2 and "--stiffness" in err and not (tmp_path / "x.yaml").exists()


def test_decay_writes_a_block_and_a_figure(tmp_path, monkeypatch, capsys):
    path, block, picture = write_decay(tmp_path / "roll.csv"), tmp_path / "roll.yaml", tmp_path / "roll.png"
    words = ("decay", path, "--vehicle", "double_blueye", "--stiffness", f"{K}:0.1", "-o", block, "--figure", picture)
    code, out, err = run(monkeypatch, capsys, *words)
    assert code == 0 and "added inertia" in out, err
    written = yaml.safe_load(block.read_text())["hydrodynamics"]
    rigid = load_vehicle("double_blueye").assembly.solid.inertia[0, 0]
    assert written["added_mass"][3] == pytest.approx(J - rigid, rel=0.1)
    assert written["linear_damping"][3] == pytest.approx(D_L, rel=0.05) and written["linear_damping"][0] is None
    assert picture.stat().st_size > 10_000


def test_decay_with_a_known_weight(tmp_path, monkeypatch, capsys):
    plain, heavy = write_decay(tmp_path / "a.csv", 1), write_decay(tmp_path / "b.csv", 2, 2.683, 0.09)
    code, out, _ = run(monkeypatch, capsys, "decay", plain, "--ballasted", heavy, "--weight", 2.683, 0.09, "--json")
    data = json.loads(out)["coefficients"]
    assert code == 0 and data["inertia_kgm2"] == pytest.approx(J, rel=0.06)
    assert data["stiffness_Nm_per_rad"] == pytest.approx(K, rel=0.06)


def test_decay_from_a_log_of_another_kind_needs_its_vehicle(tmp_path, monkeypatch, capsys):
    path = tmp_path / "log.npz"
    np.savez(path, a=np.zeros((30, 3)))
    code, _, err = run(monkeypatch, capsys, "decay", path)
    assert code == 2 and "--vehicle" in err


def test_radians_and_degrees_are_distinguished_by_the_name(tmp_path):
    _, degrees = read_angle(write_decay(tmp_path / "a.csv", header="time,Roll [deg]"), "roll")
    _, radians = read_angle(write_decay(tmp_path / "b.csv", header="time,phi"), "roll")
    assert np.degrees(degrees) == pytest.approx(radians)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--axis", "yaw"], "expected roll or pitch"),
        (["--axis", "pitch"], "--column"),
        (["--stiffness", "big"], "value:standard_deviation"),
        (["--stiffness", "7", "--inertia", "5"], "give one scale"),
        (["--trust-bg"], "--vehicle"),
        (["--ballasted", "roll.csv"], "go together"),
        (["--stiffness", "-3"], "more than 0"),
        (["--vehicle", "double_blueye", "--inertia", "1.0", "-o", "x.yaml"], "not above the vehicle's own"),
        (["--column", "nix"], "no column 'nix'"),
        (["--figure", "x.jpg"], "unknown ending"),
    ],
)
def test_decay_bad_input(tmp_path, monkeypatch, capsys, words, message):
    write_decay(tmp_path / "roll.csv")
    monkeypatch.chdir(tmp_path)
    code, out, err = run(monkeypatch, capsys, "decay", "roll.csv", *words)
    assert code == 2 and message in err and "Traceback" not in err + out


def test_degrees_read_as_radians_are_named(tmp_path, monkeypatch, capsys):
    code, _, err = run(monkeypatch, capsys, "decay", write_decay(tmp_path / "roll.csv", header="t,roll"))
    assert code == 2 and "looks like degrees" in err


def test_thrust_writes_what_a_vehicle_file_takes(tmp_path, monkeypatch, capsys):
    u = np.linspace(-1, 1, 21)
    force = np.sign(u) * np.where(u < 0, 40, 50) * np.maximum((np.abs(u) - 0.06) / 0.94, 0) ** 1.6
    test, block = tmp_path / "test.csv", tmp_path / "thruster.yaml"
    test.write_text("\n".join(["command,force_N", *(f"{a},{b}" for a, b in zip(u, force, strict=True))]))
    code, out, err = run(monkeypatch, capsys, "thrust", test, "-o", block, "--figure", tmp_path / "t.png")
    assert code == 0 and "1.60" in out, err
    written = yaml.safe_load(block.read_text())
    assert written["force"] == {"ahead": 50, "astern": 40} and written["curve"]["power"] == pytest.approx(1.6)
    from rovtwin.vehicle import vehicle_from_dict

    thruster = {"name": "one", "direction": [1, 0, 0], **written}
    ball = {"name": "ball", "mass": 10, "volume": 0.01, "shape": {"sphere": 0.1}, "thrusters": [thruster]}
    model = vehicle_from_dict(ball).model()
    assert float(model.thrusters.exponent[0]) == pytest.approx(1.6)


def test_thrust_and_damping_from_speeds(tmp_path, monkeypatch, capsys, surge):
    block, picture = tmp_path / "surge.yaml", tmp_path / "surge.png"
    code, out, err = run(monkeypatch, capsys, "thrust", "--speeds", surge, "--full", "20:0.4", "-o", block, "--figure",
                         picture)  # fmt: skip
    assert code == 0 and "54.2" in out, err
    written = yaml.safe_load(block.read_text())["hydrodynamics"]
    assert written["quadratic_damping"][0] == pytest.approx(153.5, abs=1)
    assert picture.stat().st_size > 10_000
    code, out, _ = run(monkeypatch, capsys, "thrust", "--speeds", surge, "--full", "20", "--exponent", "1", "--json")
    assert code == 0 and json.loads(out)["speeds"]["linear"] == pytest.approx(55.6, abs=0.5)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "no file"),
        (["nix.csv"], "no such file"),
        (["--speeds", "surge.csv"], "needs --full"),
        (["--speeds", "surge.csv", "--full", "x"], "value:standard_deviation"),
        (["--speeds", "nix.csv", "--full", "20"], "no such file"),
        (["--speeds", "surge.csv", "--full", "20", "--dof", "up", "-o", "x.yaml"], "--dof"),
    ],
)
def test_thrust_bad_input(tmp_path, monkeypatch, capsys, surge, words, message):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(monkeypatch, capsys, "thrust", *words)
    assert code == 2 and message in err and "Traceback" not in err + out
