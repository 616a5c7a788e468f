"""Free running: damping from whole tests of the plant, against the thesis's own method; added mass of one start."""

import json
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import rovtwin.cli
from rovtwin.core.block import Start
from rovtwin.core.errors import IdentificationError
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler
from rovtwin.core.log import Channel, Log
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.identification.logs.record import Ballast, Record, Signal
from rovtwin.identification.steady.forces import forces
from rovtwin.identification.steady.free_running import FreeRunning, free_running
from rovtwin.identification.steady.smoothed_motion import motion_of
from rovtwin.identification.steady.start_up import start_up, start_up_residual
from rovtwin.vehicle import Model, load_vehicle
from rovtwin.vehicle.physics.dynamics import State, rollout

DT, PUSH, PAUSE = 0.02, 18.0, 6.0
LEVELS = {  # in the order of the thrusters: port surge, sway, heave, starboard surge, sway, heave
    "surge": [0.3, 0.5, 0.7, 0.9, -0.4, -0.7, -1.0],
    "sway": [0.3, 0.5, 0.7, 0.9],
    "heave": [0.4, 0.6, 0.8],
    "yaw": [0.3, 0.5, 0.7, 0.9],
}
PATTERN = {
    "surge": [1, 0, 0, 1, 0, 0],
    "sway": [0, 1, 0, 0, 1, 0],
    "heave": [0, 0, 1, 0, 0, 1],
    "yaw": [1, 0, 0, -1, 0, 0],
}
DOF = {"surge": 0, "sway": 1, "heave": 2, "yaw": 5}


@cache
def model() -> Model:
    return load_vehicle("double_blueye").model()


@cache
def flight(dof: str, psi: float = 0.6) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions, Euler angles and commands of pushes from rest, one after the other; times of the commands."""
    steps, rest = int(PUSH / DT), int(PAUSE / DT)
    start = Start(as_array([0.0, 0, 20]), quaternion_from_euler(as_array([0.0, 0, psi])), as_array(np.zeros(6)))
    vehicle = model()  # not within the trace: a description is read on the host
    run = jax.jit(lambda u: rollout(vehicle, State.at(vehicle, start), jax.vmap(Command)(u), Environment.calm(), DT))
    positions, angles, commands, origin = [], [], [], np.zeros(3)
    for level in LEVELS[dof]:
        u = np.zeros((steps + rest, 6))
        u[rest // 2 : rest // 2 + steps] = level * np.array(PATTERN[dof])
        states = run(jnp.asarray(u))
        place = np.asarray(states.position) - np.array([0, 0, 20])
        positions.append(origin + place)
        angles.append(np.asarray(jax.vmap(euler_from_quaternion)(states.attitude)))
        commands.append(u)
        origin = origin + place[-1]
    # Pushes follow each other as if the vehicle were brought to rest between: each is a test of its own.
    t = DT * np.arange(1, len(u) + 1)
    return t, np.array(positions), np.array(angles), np.array(commands), t - DT


def records(dof: str, seed: int, noise: float = 0.03, gap: bool = False) -> list[Record]:
    """One record a push, with ArUco-like positions (3 cm, 15 Hz), depth to 2 mm at 10 Hz and a compass to 0.5 deg."""
    rng = np.random.default_rng(seed)
    t, positions, angles, commands, t_command = flight(dof)

    def read(rate: float, values: np.ndarray, sigma: float) -> Signal:
        at = np.arange(0.05, t[-1], 1 / rate)
        if gap and rate == 15:
            at = at[(at < 7.0) | (at > 8.5)]
        columns = [np.interp(at, t, column) for column in values.T]
        return Signal(at, np.stack(columns, axis=1) + rng.normal(0, sigma, (len(at), len(columns))))

    return [
        Record(
            name=f"{dof} {level:+.1f}",
            t_command=t_command,
            command=u,
            signals={
                "horizontal": read(15, p[:, :2], noise),
                "depth": read(10, p[:, 2:], 0.002),
                "attitude": wrapped(read(20, np.unwrap(a, axis=0), np.radians(0.5))),
            },
            end=float(t[-1]),
            water_density=1000.0,
        )
        for level, p, a, u in zip(LEVELS[dof], positions, angles, commands, strict=True)
    ]


def wrapped(signal: Signal) -> Signal:
    return replace(signal, value=np.mod(signal.value + np.pi, 2 * np.pi) - np.pi)


def truth(dof: str, v: np.ndarray) -> np.ndarray:
    i = DOF[dof]
    m = model()
    ahead, astern = (
        (np.asarray(a)[i, i], np.asarray(b)[i, i])
        for a, b in (
            (m.linear_damping_ahead, m.quadratic_damping_ahead),
            (m.linear_damping_astern, m.quadratic_damping_astern),
        )
    )
    return np.where(v >= 0, ahead[0] * v + ahead[1] * v * v, astern[0] * v - astern[1] * v * v)


def speeds(result: FreeRunning, dof: str) -> np.ndarray:
    return np.array([run.velocity for run in result.runs if run.dof == dof])


@pytest.mark.system
@pytest.mark.parametrize(("dof", "tolerance"), [("surge", 0.03), ("sway", 0.03), ("heave", 0.03), ("yaw", 0.03)])
def test_recovers_the_damping_force(dof: str, tolerance: float) -> None:
    result = free_running(model(), records(dof, 0))
    assert set(result.fits) == {dof}
    v = np.linspace(0.4, 1, 5) * np.abs(speeds(result, dof)).max()
    assert result.fits[dof].force(v) == pytest.approx(truth(dof, v), rel=tolerance)
    assert len(speeds(result, dof)) == len(LEVELS[dof])
    if dof == "surge":
        back = -np.linspace(0.5, 1, 4) * np.abs(speeds(result, dof).min())
        assert result.fits[dof].force(back) == pytest.approx(truth(dof, back), rel=tolerance)


@pytest.mark.system
def test_the_thesis_s_own_method_on_the_same_records_is_far_off() -> None:
    tests = records("surge", 1)
    steady, thesis = free_running(model(), tests), free_running(model(), tests, method="thesis")
    v = np.array([0.15, 0.25])
    errors = [np.abs(r.fits["surge"].force(v) / truth("surge", v) - 1) for r in (steady, thesis)]
    assert np.all(errors[0] < 0.03)
    assert np.all(errors[1] > 0.14), "a linear curve and averages over the start"


@pytest.mark.slow
def test_bands_hold_the_truth_over_100_seeds() -> None:
    held, at = [], np.array([0.15, 0.3])
    for seed in range(100):
        fit = free_running(model(), records("surge", seed)[:4], dofs=["surge"]).fits["surge"]
        low, high = fit.force_band(at)
        held.append((low <= truth("surge", at)) & (high >= truth("surge", at)))
    assert np.all(np.mean(held, axis=0) >= 0.89), np.mean(held, axis=0)


def test_gaps_of_motion_capture() -> None:
    result = free_running(model(), records("surge", 2, gap=True))
    assert all(run.start > 8.4 or run.end < 7.1 for run in result.runs)
    assert any("gap" in note for note in result.notes)
    v = np.array([0.15, 0.3])
    assert result.fits["surge"].force(v) == pytest.approx(truth("surge", v), rel=0.04)


def test_a_current_is_taken_off() -> None:
    current = (0.05, -0.02, 0.0)
    moved = []
    for record in records("surge", 3):
        there = record.signals["horizontal"]
        drift = there.t[:, None] * np.array(current[:2])
        moved.append(
            replace(
                record,
                current=current,
                signals={**record.signals, "horizontal": replace(there, value=there.value + drift)},
            )
        )
    v = np.array([0.15, 0.3])
    assert free_running(model(), moved).fits["surge"].force(v) == pytest.approx(truth("surge", v), rel=0.03)


def test_ballast_is_a_force_in_heave() -> None:
    (light, *_) = records("heave", 4)
    heavy = replace(light, ballast=(Ballast(1.0, 0.0002, (0, 0, 0)),))
    runs = [free_running(model(), [one, *records("heave", 4)[1:]], dofs=["heave"]).runs[0] for one in (light, heavy)]
    assert runs[1].force - runs[0].force == pytest.approx(9.80665 * 0.8, rel=0.05)


@pytest.mark.system
def test_the_scale_of_the_thrust_goes_into_the_band() -> None:
    tests = records("surge", 5)
    known, unsure = (free_running(model(), tests, thrust_std=s).fits["surge"] for s in (0.0, 0.02))
    v = np.array([0.3])
    wide = np.sqrt((known.force_band(v)[1] - known.force(v)) ** 2 + (1.96 * 0.02 * known.force(v)) ** 2)
    assert unsure.force_band(v)[1] - unsure.force(v) == pytest.approx(wide, rel=0.05)
    assert any("as the vehicle's curve says" in note for note in free_running(model(), tests).notes)


def test_a_heading_that_is_not_held_is_left_out() -> None:
    turning = []
    for record in records("surge", 6):
        compass = record.signals["attitude"]
        swung = compass.value + np.stack([0 * compass.t, 0 * compass.t, 0.05 * compass.t], axis=1)
        turning.append(replace(record, signals={**record.signals, "attitude": replace(compass, value=swung)}))
    with pytest.raises(IdentificationError, match="heading not held"):
        free_running(model(), turning, dofs=["surge"])


def test_motion_of_the_plant_and_forces_of_its_commands() -> None:
    (record, *_) = records("surge", 7, noise=0.001)
    motion = motion_of(record)
    settled = motion.t > 15
    assert np.std(motion.velocity["sway"][settled]) < 0.003
    assert motion.tracks["north"].sigma == pytest.approx(0.001, rel=0.1)
    full = forces(model(), record, np.array([10.0]))[0]
    assert full[0] == pytest.approx(2 * 10 * ((0.3 - 0.07) / 0.93) ** 1.33, rel=1e-6)
    assert forces(model(), record, np.array([10.0]), linear=True)[0, 0] == pytest.approx(6.0)


def test_depth_alone_gives_heave_and_nothing_gives_an_error() -> None:
    alone = [replace(r, signals={"depth": r.signals["depth"]}) for r in records("heave", 8)]
    v = np.array([0.15, 0.2])
    assert free_running(model(), alone).fits["heave"].force(v) == pytest.approx(truth("heave", v), rel=0.03)
    blind = replace(alone[0], signals={"gyro": records("heave", 8)[0].signals["attitude"]})
    with pytest.raises(IdentificationError, match="no velocity"):
        free_running(model(), [blind])


@pytest.mark.system
def test_a_wrong_sign_is_reported() -> None:
    turned = [replace(record, command=-record.command) for record in records("surge", 12)]
    result = free_running(model(), turned, dofs=["surge"])
    assert any("7 of 7 windows move against their thrust" in note for note in result.notes)
    assert not any("against" in note for note in free_running(model(), records("surge", 12), dofs=["surge"]).notes)


def test_bad_input_is_named() -> None:
    tests = records("surge", 9)
    with pytest.raises(IdentificationError, match="no records"):
        free_running(model(), [])
    with pytest.raises(IdentificationError, match="'roll'"):
        free_running(model(), tests, dofs=["roll"])
    with pytest.raises(IdentificationError, match="two speeds"):
        free_running(model(), tests[:1])
    still = [replace(r, command=0 * r.command) for r in tests]
    with pytest.raises(IdentificationError, match="no steady window"):
        free_running(model(), still)


def test_added_mass_of_one_start_where_thrust_and_damping_are_right() -> None:
    record = records("heave", 10)[2]
    push = start_up(record, model(), "heave", 0.1, 14.0)
    i = DOF["heave"]
    linear, quadratic = (
        float(np.asarray(a)[i, i]) for a in (model().linear_damping_ahead, model().quadratic_damping_ahead)
    )
    residual = start_up_residual(push, linear, quadratic)
    mass = least_squares(lambda x: residual(x[0]), [40.0], bounds=(5, 500)).x[0]
    # The lag of the thrusters, 0.2 s, is not in this model of the thesis: it looks like mass.
    assert mass == pytest.approx(float(np.asarray(model().inertia)[i, i]), rel=0.2)
    wrong = start_up_residual(push, 2 * linear, quadratic)
    assert abs(least_squares(lambda x: wrong(x[0]), [40.0], bounds=(5, 500)).x[0] / mass - 1) > 0.5, "errata 6"
    with pytest.raises(IdentificationError, match="readings"):
        start_up(record, model(), "heave", 0.1, 0.3)


def write_log(path: Path, record: Record) -> Path:
    """As a rovtwin log."""
    names = tuple(name.replace(".", "_") for name in load_vehicle("double_blueye").thruster_names)
    channels = [Channel("autopilot/command", names, "1", "")]
    data = {"autopilot/command": (record.t_command, record.command)}
    for sensor, name, fields, unit in (
        ("position", "horizontal", ("north", "east"), "m"),
        ("pressure", "depth", ("depth",), "m"),
        ("attitude", "attitude", ("phi", "theta", "psi"), "rad"),
    ):
        signal = record.signals[name]
        channels.append(Channel(f"sensor/{sensor}", (*fields, "t_valid"), (*(unit,) * len(fields), "s"), "n"))
        data[f"sensor/{sensor}"] = (signal.t, np.concatenate([signal.value, signal.t[:, None]], axis=1))
    return Log.from_arrays(channels, data, {"log_format": "1"}).write(path)


@pytest.mark.system
def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    logs = [str(write_log(tmp_path / f"{k}.mcap", record)) for k, record in enumerate(records("surge", 11)[:4])]
    words = ["rovtwin", "evidence", "free-running", "double_blueye", *logs]
    words += ["--figure", str(tmp_path / "f.png"), "-o", str(tmp_path / "d.yaml")]

    def run(*more: str) -> int | str | None:
        monkeypatch.setattr(sys, "argv", [*words, *more])
        with pytest.raises(SystemExit) as stopped:
            rovtwin.cli.main()
        return stopped.value.code

    assert run("--json") == 0
    data = json.loads(capsys.readouterr().out)
    assert data["fits"]["surge"]["coefficients"]["both"]["quadratic"] == pytest.approx(158.86, rel=0.1)
    assert data["thesis"]["fits"]["surge"]["coefficients"]["both"]["linear"] > 20
    assert run("--dof", "surge") == 0
    assert "thesis's method" in capsys.readouterr().out
    assert (tmp_path / "f.png").stat().st_size > 10_000
    assert "linear_damping: [" in (tmp_path / "d.yaml").read_text()
    assert run("--method", "magic") == 2
    assert "expected steady or thesis" in capsys.readouterr().err
