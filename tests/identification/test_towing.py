"""Towing: damping recovered from noisy records with tare, rig and vibration; what cannot be right is called out."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import rovtwin.cli
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.steady.damping_fit import fit_damping
from rovtwin.identification.steady.towing import towing
from rovtwin.identification.steady.towing_files import TowRun, read_towing
from rovtwin.identification.steady.towing_force import lowpass
from rovtwin.vehicle import load_vehicle, vehicle_from_dict

AHEAD, ASTERN, RIG, TARE, INERTIA = (6.48, 158.86), (0.07, 189.75), (0.4, 6.0), 1.7, 61.3  # thesis (4.3)
SPEEDS = (0.1, 0.2, 0.3, 0.4, -0.1, -0.2, -0.3, -0.4)
TRUTH = np.array([*AHEAD, *ASTERN])
BOX = (0.354, 0.64)


def drag(v: np.ndarray, ahead: tuple[float, float], astern: tuple[float, float]) -> np.ndarray:
    return np.where(v >= 0, ahead[0] * v + ahead[1] * v * v, astern[0] * v - astern[1] * v * v)


def tow(
    speed: float,
    rng: np.random.Generator,
    *,
    ahead: tuple[float, float] = AHEAD,
    astern: tuple[float, float] = ASTERN,
    rig: tuple[float, float] = (0.0, 0.0),
    tare: float = TARE,
    rate: float = 100.0,
    rest: float = 4.0,
    hold: float = 25.0,
    ramp: float = 0.1,
    noise: float = 1.5,
    vibration: float = 2.0,
) -> TowRun:
    """Rest, ramp up, hold, ramp down, rest; inertia in the ramps, 12 Hz of the rig throughout."""
    t = np.arange(0, 2 * rest + hold + 2 * abs(speed) / ramp, 1 / rate)
    up = np.clip((t - rest) * ramp, 0, abs(speed))
    down = np.clip((t - rest - abs(speed) / ramp - hold) * ramp, 0, abs(speed))
    v = np.sign(speed) * (up - down)
    force = drag(v, ahead, astern) + drag(v, rig, rig) + INERTIA * np.gradient(v, t) + tare
    force += vibration * np.sin(2 * np.pi * 12 * t) + rng.normal(0, noise, t.size)
    return TowRun(f"{speed:+.2f}", t, v + rng.normal(0, 0.002, t.size), force)


def tows(seed: int, **others) -> list[TowRun]:
    rng = np.random.default_rng(seed)
    return [tow(speed, rng, **others) for speed in SPEEDS]


def test_recovers_ahead_and_astern_apart() -> None:
    result = towing(tows(0), across=BOX)
    at = np.array([-0.4, -0.25, 0.25, 0.4])
    assert result.fit.force(at) == pytest.approx(drag(at, AHEAD, ASTERN), rel=0.02)
    assert result.fit.quadratic == pytest.approx([AHEAD[1], ASTERN[1]], rel=0.06)
    assert len(result.pulls) == len(SPEEDS)
    assert all(abs(p.tare - TARE) < 0.3 for p in result.pulls)
    assert 1 < result.drag_coefficient < 2.2  # type: ignore[operator]  (given a size, it is a number)


@pytest.mark.slow  # 100 fits
def test_intervals_and_bands_hold_the_truth_over_100_seeds() -> None:
    at, inside, bands = np.array([-0.35, -0.2, 0.2, 0.35]), [], []
    for seed in range(100):
        fit = towing(tows(seed, rate=25.0, vibration=0.5), across=BOX).fit
        interval, (low, high) = fit.interval(), fit.force_band(at)
        inside.append((interval[:, 0] <= TRUTH) & (interval[:, 1] >= TRUTH))
        bands.append((low <= drag(at, AHEAD, ASTERN)) & (high >= drag(at, AHEAD, ASTERN)))
    assert np.all(np.mean(inside, axis=0) >= 0.89), np.mean(inside, axis=0)
    assert 0.92 <= np.mean(bands) <= 0.995, np.mean(bands, axis=0)


def test_the_rig_is_subtracted_and_its_absence_reported() -> None:
    alone = towing(tows(1, ahead=(0, 0), astern=(0, 0), rig=RIG, noise=0.3, vibration=0.3)).fit
    runs = tows(2, rig=RIG)
    with_rig, without = towing(runs, rig=alone), towing(runs)
    at = np.array([-0.4, 0.4])
    assert with_rig.fit.force(at) == pytest.approx(drag(at, AHEAD, ASTERN), rel=0.02)
    assert np.all(np.abs(without.fit.force(at)) > 1.02 * np.abs(drag(at, AHEAD, ASTERN)))
    assert np.all(with_rig.fit.std > without.fit.std)
    assert any("rig was not given" in note for note in without.notes)
    assert not any("rig was not given" in note for note in with_rig.notes)


def test_tare_from_rests_given_or_missing() -> None:
    runs = [TowRun(r.name, r.t[800:-800], r.speed[800:-800], r.force[800:-800]) for r in tows(3, rest=4.0, ramp=1.0)]
    with pytest.raises(IdentificationError, match="differ in the sign|same sign"):
        towing([TowRun(r.name, r.t, r.speed, r.force + 60) for r in runs])
    assert any("no tare" in note for note in towing(runs).notes)
    assert towing(runs, tare=TARE).fit.force(np.array([0.3]))[0] == pytest.approx(16.24, rel=0.03)


def test_a_tare_that_drifts_is_reported_and_followed() -> None:
    runs = [TowRun(r.name, r.t, r.speed, r.force + 0.05 * r.t) for r in tows(4)]
    result = towing(runs, across=BOX)
    assert any("drifts" in note for note in result.notes)
    at = np.array([-0.4, 0.4])
    assert result.fit.force(at) == pytest.approx(drag(at, AHEAD, ASTERN), rel=0.03)


def test_a_stroke_of_15_centimetres_is_called_out() -> None:
    """The heave test of the thesis, errata 28."""
    rng = np.random.default_rng(5)
    speeds = (0.02, 0.03, 0.04, 0.05, 0.06)
    short = [
        tow(v, rng, ahead=(22.75, 1009.85), hold=0.15 / v - v / 0.3, ramp=0.3, noise=0.3, vibration=0.3) for v in speeds
    ]
    result = towing(short, shortest=1.0, across=(0.64, 0.95))
    message = " ".join(result.notes)
    assert (
        "5 of 5" in message and "0.64 m" in message and "Keulegan-Carpenter" in message and "start-up flow" in message
    )
    assert "C_D is" in message
    assert all(0.12 < p.stroke < 0.17 for p in result.pulls)
    assert result.fit.force(np.array([0.05]))[0] == pytest.approx(3.66, rel=0.03), "fitted all the same, as it is"


def test_short_strokes_are_left_out_where_others_remain() -> None:
    result = towing(tows(6, hold=15.0), across=BOX)
    assert {p.run for p in result.pulls if not p.used} == {"+0.10", "-0.10"}
    assert all(p.travelled > 1.7 for p in result.pulls if p.used)
    assert any("left out" in note for note in result.notes)


def test_the_sign_of_the_force() -> None:
    runs = tows(7)
    turned = towing([TowRun(r.name, r.t, r.speed, -r.force) for r in runs])
    assert turned.fit.coefficients == pytest.approx(towing(runs).fit.coefficients)
    assert any("sign turned" in note for note in turned.notes)
    lost = [TowRun(r.name, r.t, r.speed, np.sign(r.speed.mean()) * (r.force - TARE)) for r in runs]
    with pytest.raises(IdentificationError, match="sign of the force or of the speed was lost"):
        towing(lost)


@pytest.mark.parametrize(
    ("cutoff", "rate", "words"),
    [(500.0, 100.0, "hold nothing above 50 Hz"), (500.0, 2000.0, "cannot have"), (0.3, 100.0, "smears")],
)
def test_a_cutoff_without_sense_is_called_out(cutoff: float, rate: float, words: str) -> None:
    rng = np.random.default_rng(8)
    runs = [tow(v, rng, rate=rate, hold=8.0) for v in (0.2, 0.3, 0.4)]
    try:
        message = " ".join(towing(runs, cutoff=cutoff).notes)
    except IdentificationError as error:
        message = str(error)
    assert words in message


def test_the_lowpass_has_no_phase_and_halves_at_its_cutoff() -> None:
    t = np.arange(0, 60, 0.01)
    middle = slice(1000, -1000)
    for frequency, gain in ((0.1, 1.0), (1.0, 0.5), (10.0, 0.0)):
        wave = np.sin(2 * np.pi * frequency * t)
        assert lowpass(t, wave, 1.0)[middle] == pytest.approx(gain * wave[middle], abs=0.01)


def write(path: Path, runs: list[TowRun], header: str = "run,t [s],speed [m/s],force [N]") -> Path:
    rows = [f"{r.name},{a:.3f},{b:.5f},{c:.4f}" for r in runs for a, b, c in zip(r.t, r.speed, r.force, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_files_read_back(tmp_path: Path) -> None:
    runs = tows(9, rate=20.0)
    read = read_towing([write(tmp_path / "tow.csv", runs)])
    assert [r.name for r in read] == [f"tow:{r.name}" for r in runs]
    assert read[3].force == pytest.approx(runs[3].force, abs=1e-4)
    one = tmp_path / "one.csv"
    one.write_text("time;velocity;force 1;force 2\n" + "\n".join(f"{k / 10};0.2;{k};1" for k in range(40)))
    (single,) = read_towing([one])
    assert single.force == pytest.approx(np.arange(40) + 1.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "lines"),
        ("t,speed\n0,1\n", "no column 'force'"),
        ("t,speed [mm/s],force\n0,1,1\n", "not in m/s"),
        ("t,speed,force\n0,1,x\n", "line 2"),
        ("t,speed,force\n0,1," + "9" * 300_000 + "\n1,1,1\n", "no table of numbers"),
        ("t,speed,velocity,force\n0,1,1,1\n", "keep one"),
        ("t,speed,force\n" + "0,1,1\n" * 30, "does not increase"),
        ("t,speed,force\n0,1,1\n1,1,1\n", "at least 20"),
        ("t,speed,force\n" + "".join(f"{k},200,1\n" for k in range(30)), "mm/s"),
        ("t,speed,force\n" + "".join(f"{k},nan,1\n" for k in range(30)), "not finite"),
    ],
)
def test_bad_files_are_named(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "tow.csv"
    path.write_text(text)
    with pytest.raises(IdentificationError, match=words) as result:
        read_towing([path])
    assert "tow.csv" in str(result.value)


@pytest.mark.parametrize("option", [{"cutoff": 0.0}, {"shortest": -1.0}, {"across": (0.3, 0.0)}])
def test_options_without_sense_are_named(option: dict) -> None:
    with pytest.raises(IdentificationError, match="expected more than 0"):
        towing(tows(12, rate=20.0), **option)


def test_one_pair_for_both_directions_is_reported() -> None:
    assert any("one pair" in note for note in towing(tows(14)[:5], across=BOX).notes)
    assert not any("one pair" in note for note in towing(tows(14), across=BOX).notes)


def test_one_speed_is_not_enough() -> None:
    with pytest.raises(IdentificationError, match="two speeds"):
        towing(tows(13)[:1])


def test_a_missing_file_and_a_tow_that_never_settles(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match="no such file"):
        read_towing([tmp_path / "surge.csv"])
    t = np.arange(0, 20, 0.05)
    with pytest.raises(IdentificationError, match="no steady window"):
        towing([TowRun("ramp", t, 0.05 + 0.02 * t, t)])


def test_damping_is_what_the_plant_needs_to_keep_its_speed() -> None:
    """The model's own drag, logged as a rig would, comes back."""
    from rovtwin.core.numerics import as_array
    from rovtwin.vehicle.physics.dynamics import damping_wrench

    model = load_vehicle("double_blueye").model()
    speeds = np.array(SPEEDS)
    nu = np.zeros((len(speeds), 6))
    nu[:, 0] = speeds
    forces = np.array([float(np.asarray(damping_wrench(model, as_array(row)))[0]) for row in nu])
    assert forces == pytest.approx(fit_damping(speeds, forces, astern=True).force(speeds))
    assert fit_damping(speeds, forces, astern=True).coefficients == pytest.approx(TRUTH, abs=1e-6)


@pytest.mark.system
def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "surge.csv", tows(10, rate=20.0, rig=RIG))
    rig = write(tmp_path / "rig.csv", tows(11, rate=20.0, ahead=(0, 0), astern=(0, 0), rig=RIG, noise=0.3))
    words = ["rovtwin", "evidence", "towing", str(path), "--vehicle", "double_blueye", "--rig", str(rig)]
    words += ["--figure", str(tmp_path / "f.png"), "-o", str(tmp_path / "d.yaml")]

    def run(*more: str) -> int | str | None:
        monkeypatch.setattr(sys, "argv", [*words, *more])
        with pytest.raises(SystemExit) as stopped:
            rovtwin.cli.main()
        return stopped.value.code

    assert run("--json") == 0
    data = json.loads(capsys.readouterr().out)
    assert data["coefficients"]["astern"]["quadratic"] == pytest.approx(ASTERN[1], rel=0.05)
    assert len(data["windows"]) == len(SPEEDS)
    assert run() == 0
    assert "surge astern" in capsys.readouterr().out
    assert (tmp_path / "f.png").stat().st_size > 10_000
    block = yaml.safe_load((tmp_path / "d.yaml").read_text())
    described = load_vehicle("double_blueye").to_dict()
    described["hydrodynamics"] |= {k: v for k, v in block["hydrodynamics"].items() if k != "sources"}
    for kind in ("linear_damping", "quadratic_damping"):  # only surge was towed
        described["hydrodynamics"][kind][1:] = load_vehicle("double_blueye").to_dict()["hydrodynamics"][kind][1:]
    assert vehicle_from_dict(described).model().quadratic_damping_astern[0, 0] == pytest.approx(ASTERN[1], rel=0.05)
    assert run("--dof", "yaw") == 2
    assert "expected surge, sway or heave" in capsys.readouterr().err
    assert run("--cutoff", "500") == 2
    assert "hold nothing above" in capsys.readouterr().err
