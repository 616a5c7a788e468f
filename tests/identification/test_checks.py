"""Mistakes planted into clean records: each is found and called by its name; clean and real records raise no alarm."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.conftest import shared_folder
from tests.identification.flown import EXCITATIONS, SENSORS, fly, model_of

import rovtwin.cli
from rovtwin.core.arrays.rotations import euler_from_rotation, rotation_from_euler
from rovtwin.identification.checks import against_model
from rovtwin.identification.checks.among_signals import check_motion, pairs
from rovtwin.identification.checks.check import check_commands, check_record
from rovtwin.identification.checks.findings import Finding
from rovtwin.identification.logs.evidence_file import read_evidence
from rovtwin.identification.logs.motion import Motion
from rovtwin.identification.logs.readers import read_tests
from rovtwin.identification.logs.readers.assemble import flung
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.system

EXAMPLES = Path(__file__).parents[2] / "examples"
FLU = np.array([1.0, -1.0, -1.0])


def changed(record, name, value=lambda x: x, late=0.0):
    """The record with another value, or other times, of one signal."""
    signal = record.signals[name]
    new = replace(signal, value=value(signal.value), t=signal.t + late)
    return replace(record, signals=record.signals | {name: new})


def commanded(record, change):
    return replace(record, command=change(record.command))


def only(record, *names):
    return replace(record, signals={name: record.signals[name] for name in names})


def without(record, name, start, end):
    signal = record.signals[name]
    keep = (signal.t < start) | (signal.t > end)
    new = replace(signal, t=signal.t[keep], value=signal.value[keep])
    return replace(record, signals=record.signals | {name: new})


def swapped(*order):
    return lambda x: x[:, [*order, *range(len(order), x.shape[1])]]


def all_late(record, dt):
    """The commands' clock differs from that of everything else."""
    return replace(record, signals={n: replace(s, t=s.t + dt) for n, s in record.signals.items()})


def in_world(record):
    """Velocity over ground in n, where b is expected."""
    velocity, attitude = record.signals["velocity"], record.signals["attitude"]
    angles = [np.interp(velocity.t, attitude.t, np.unwrap(a)) for a in attitude.value.T]
    R = rotation_from_euler(np.stack(angles, axis=1))
    return changed(record, "velocity", lambda v: np.einsum("nij,nj->ni", R, v))


def averaged_over_the_wrap(record):
    """A running mean of yaw, taken where yaw goes from 180 to -180 degrees."""

    def mean(euler):
        out = euler.copy()
        yaw = (euler[:, 2] - euler[len(euler) // 2, 2] + 2 * np.pi) % (2 * np.pi) - np.pi
        out[:, 2] = yaw
        out[3:-3, 2] = np.convolve(yaw, np.ones(7) / 7, "valid")
        return out

    return only(changed(record, "attitude", mean), "attitude")


MISTAKES = {
    "no excitation": (lambda r: commanded(r, lambda u: 0 * u + 0.3), "no_excitation", "commands"),
    "commands in PWM": (lambda r: commanded(r, lambda u: 1500 + 400 * u), "beyond", "commands"),
    "commands beyond 1": (lambda r: commanded(r, lambda u: 1.6 * u), "beyond", "commands"),
    "sign of yaw rate": (lambda r: changed(r, "gyro", lambda x: x * [1, 1, -1]), "sign", "gyro"),
    "sign of yaw rate, gyro alone": (
        lambda r: only(changed(r, "gyro", lambda x: x * [1, 1, -1]), "gyro"),
        "sign",
        "yaw",
    ),
    "sign of one thruster": (
        lambda r: commanded(r, lambda u: u * np.eye(u.shape[1])[0] * -2 + u),
        "sign",
        "thruster 1",
    ),
    "sign of all commands": (lambda r: commanded(r, lambda u: -u), "sign", "commands"),
    "p and q swapped": (lambda r: changed(r, "gyro", swapped(1, 0)), "swapped", "gyro"),
    "p and r swapped, gyro alone": (lambda r: only(changed(r, "gyro", swapped(2, 1, 0)), "gyro"), "swapped", "p, r"),
    "u and v swapped": (lambda r: changed(r, "velocity", swapped(1, 0)), "swapped", "velocity"),
    "two commands swapped": (lambda r: commanded(r, swapped(1, 0)), "swapped", "thrusters 1, 2"),
    "gyro in degrees": (lambda r: changed(r, "gyro", np.degrees), "degrees", "gyro"),
    "attitude in degrees": (lambda r: changed(r, "attitude", np.degrees), "degrees", "attitude"),
    "position in mm": (lambda r: changed(r, "position", lambda x: 1000 * x), "millimetres", "position"),
    "depth in mm": (lambda r: changed(r, "depth", lambda x: 1000 * x), "millimetres", "depth"),
    "velocity in mm/s": (lambda r: changed(r, "velocity", lambda x: 1000 * x), "millimetres", "velocity"),
    "gyro 1 s late": (lambda r: changed(r, "gyro", late=1.0), "clock", "gyro"),
    "commands 1 s early": (lambda r: all_late(r, 1.0), "clock", "commands"),
    "commands 1 s late": (lambda r: all_late(r, -1.0), "clock", "commands"),
    "z up, body": (lambda r: only(changed(r, "gyro", lambda x: x * FLU), "gyro", "attitude"), "z_up", "gyro"),
    "z up, depth": (lambda r: changed(r, "depth", lambda x: -x), "z_up", "depth"),
    "north and east swapped": (
        lambda r: only(changed(r, "position", swapped(1, 0)), "position", "attitude", "gyro"),
        "horizontal",
        "position",
    ),
    "east with the wrong sign": (
        lambda r: only(changed(r, "position", lambda x: x * [1, -1, 1]), "position", "attitude", "gyro"),
        "horizontal",
        "position",
    ),
    "velocity in n": (in_world, "frame", "velocity"),
    "velocity three times too large": (lambda r: changed(r, "velocity", lambda x: 3 * x), "disagree", "velocity"),
    "motion capture blind for 6 s": (lambda r: without(r, "position", 20.0, 26.0), "gap", "position"),
    "mean over a wrap": (averaged_over_the_wrap, "wrap", "attitude"),
    "commands cut at 0.5": (lambda r: commanded(r, lambda u: np.clip(u, -0.5, 0.5)), "clipped", "commands"),
}


@pytest.mark.parametrize("name", ["bluerov2", pytest.param("double_blueye", marks=pytest.mark.slow)])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_every_mistake_is_named(name, mistake):
    plant, what, where = MISTAKES[mistake]
    # The Double Blueye is slow: within a swing of a multisine it hardly moves against 1 cm of noise.
    kind = "multisine" if name == "bluerov2" or what == "clipped" else "steps"
    found = [f for f in check_record(plant(fly(name, kind, 3)), model_of(name)) if f.severity != "note"]
    assert (what, where) in [(f.what, f.where) for f in found], [str(f) for f in found]
    # Nothing else is called an error: the user is not sent looking in the wrong place.
    assert {f.what for f in found if f.severity == "error"} <= {what}


@pytest.mark.parametrize(
    ("name", "pair", "where"),
    [
        ("bluerov2", (4, 5), "thrusters 5, 6"),
        ("double_blueye", (0, 3), "yaw"),
        ("double_blueye", (2, 5), "roll"),
        ("double_blueye", (1, 4), None),
    ],
)
def test_equal_thrusters_that_are_swapped_turn_the_vehicle_the_other_way(name, pair, where):
    """Named where they turn it: on one line, as the two in sway, they do the same and nothing is wrong."""
    i, k = pair
    order = np.arange(6)
    order[[i, k]] = k, i
    record = commanded(fly(name, "multisine", 3), lambda u: u[:, order])
    found = [f for f in check_record(record, model_of(name)) if f.severity == "error"]
    assert [f.where for f in found] == ([where] if where else [])
    assert all(f"thrusters {i + 1} and {k + 1} are swapped" in f.message for f in found)


def test_thrust_that_is_clipped_on_the_way_is_named():
    record = fly("bluerov2", "multisine", 3, plant=lambda u: np.clip(u, -0.4, 0.4))
    found = check_record(record, model_of("bluerov2"))
    assert any(f.what == "clipped" and "0.4" in f.message for f in found), [str(f) for f in found]


@pytest.mark.parametrize("kind", EXCITATIONS)
@pytest.mark.parametrize("name", ["bluerov2", "double_blueye"])
@pytest.mark.parametrize("seed", [11, pytest.param(12, marks=pytest.mark.slow)])
def test_clean_records_raise_no_alarm(name, kind, seed):
    found = check_record(fly(name, kind, seed), model_of(name))
    assert not [str(f) for f in found if f.severity != "note"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", EXCITATIONS)
@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy", "double_blueye"])
def test_clean_records_of_few_sensors_raise_no_alarm(name, kind):
    """Whatever is on board: with fewer signals less can be found, and nothing is called an error."""
    subsets = [("gyro",), ("gyro", "attitude", "depth"), ("position", "attitude"), ("velocity", "gyro"), ("attitude",)]
    for seed in (21, 22):
        record = fly(name, kind, seed)
        for sensors in [tuple(SENSORS), *subsets]:
            found = check_record(only(record, *sensors), model_of(name))
            assert not [str(f) for f in found if f.severity == "error"], sensors


@pytest.mark.parametrize(
    ("scale", "what", "fix"),
    [([1, 1, 1], None, ""), ([1, -1, -1], "z_up", "frame: flu"), ([0.102] * 3, "units", "unit: g")],
)
def test_an_accelerometer_shows_gravity(scale, what, fix):
    record = fly("bluerov2", "gentle", 3)
    t = np.arange(0.0, 60.0, 0.02)
    force = np.random.default_rng(1).normal([0.1, 0.2, -9.81], 0.1, (len(t), 3))
    signals = record.signals | {"accelerometer": Signal(t, force * scale)}
    found = [f for f in check_record(replace(record, signals=signals), model_of("bluerov2")) if f.severity == "error"]
    assert [f.what for f in found] == ([what] if what else [])
    assert all(fix in f.fix for f in found)


def test_unexcited_axes_are_notes():
    record = commanded(fly("bluerov2", "multisine", 3), lambda u: u * [0, 0, 0, 0, 1, 1])
    found = check_record(only(record, "gyro"), model_of("bluerov2"))
    assert {f.where for f in found if f.what == "unexcited"} == {"surge", "sway", "yaw"}


@pytest.mark.parametrize("example", ["bluerov_liu", pytest.param("bluerov2_heavy_tank", marks=pytest.mark.slow)])
def test_real_logs_raise_no_alarm(example):
    shared_folder("data", example)
    evidence = read_evidence(EXAMPLES / example / "evidence.yaml")
    assert evidence.vehicle
    vehicle = load_vehicle(evidence.vehicle)
    for test in read_tests(evidence, vehicle):
        found = check_record(test.record, vehicle.model())
        assert not [str(f) for f in found if f.severity != "note"], test.record.name
    if example == "bluerov_liu":
        silent = {f.where for f in check_record(read_tests(evidence, vehicle)[2].record, vehicle.model())}
        assert {"sway", "heave", "roll"} <= silent


def test_real_mistakes_of_the_tank_are_found():
    """Yaw averaged over its wrap in three places; late commands, as well as smoothing both ways leaves them."""
    shared_folder("data", "bluerov2_heavy_tank")
    evidence = read_evidence(EXAMPLES / "bluerov2_heavy_tank" / "evidence.yaml")
    vehicle = load_vehicle("bluerov2_heavy")
    first = read_tests(evidence, vehicle)[0].record
    assert any("readings that turn far and at once back" in note and " 3 " in note for note in first.notes)
    late = replace(first, t_command=first.t_command + 0.32)
    (found,) = [f for f in check_record(late, vehicle.model()) if f.severity == "error"]
    assert found.what == "clock"
    reported = re.search(r"time_offset: (-?[\d.]+)", found.fix)
    assert reported and float(reported[1]) == pytest.approx(-0.32, abs=0.2), (
        "readings are smoothed both ways, and at 6 Hz"
    )


def each_late(record, **late):
    """Every named signal's times are that much too large [s]."""
    return replace(record, signals={n: replace(s, t=s.t + late.get(n, 0.0)) for n, s in record.signals.items()})


@pytest.mark.parametrize(
    "late",
    [{"gyro": 1.0}, {"attitude": 1.0}, {"velocity": 1.0}, {"position": -1.0}, {"gyro": 0.5}, {"attitude": 0.4}]
    + [{"gyro": 0.8, "position": -0.8}, {"gyro": 0.6, "velocity": 1.2}]
    + [{"gyro": 1.0, "attitude": 1.0}, {"velocity": -0.6, "position": -0.6}],
)
def test_a_signal_that_is_late_is_distinguished_from_the_one_it_is_compared_with(late):
    """The commands tell which of two it is; what to write is that signal's own, and nobody else's."""
    record = only(fly("bluerov2", "multisine", 3), "gyro", "attitude", "velocity", "position")
    found = [f for f in check_record(each_late(record, **late), model_of("bluerov2")) if f.severity == "error"]
    assert {f.where for f in found} == set(late), [str(f) for f in found]
    for f in found:
        expected = re.search(rf"signals\.{f.where}\.time_offset: (-?[\d.]+)", f.fix)
        assert expected and float(expected[1]) == pytest.approx(-late[f.where], abs=0.1), str(f)


@pytest.mark.parametrize("late", [-1.0, 0.5, 1.0])
def test_signals_that_are_all_late_are_mended_at_the_commands(late):
    record = fly("bluerov2", "multisine", 3)
    shifted = all_late(record, late)
    (found,) = [f for f in check_record(shifted, model_of("bluerov2")) if f.severity == "error"]
    assert (found.what, found.where) == ("clock", "commands")
    assert "the same for position, attitude, gyro, velocity and depth" in found.message
    assert "no time_offset at a signal" in found.fix and "clock: estimate" in found.fix
    offset = float(re.search(r"commands.time_offset: (-?[\d.]+)", found.fix)[1])
    assert offset == pytest.approx(late, abs=0.11)
    mended = replace(shifted, t_command=shifted.t_command + offset)
    for part in (mended, mended.cut(mended.start + 40.0, mended.end - 2.0)):
        assert not [str(f) for f in check_record(part, model_of("bluerov2")) if f.severity == "error"]


def in_rows(record, step=0.15):
    """The record as one table has it: everything at the same times."""
    t = np.arange(0.5, 59.0, step)
    signals = {
        n: replace(s, t=t, value=np.stack([np.interp(t, s.t, c) for c in np.unwrap(s.value, axis=0).T], axis=1))
        for n, s in record.signals.items()
    }
    euler = signals["attitude"]
    signals["attitude"] = replace(euler, value=(euler.value + np.pi) % (2 * np.pi) - np.pi)
    return replace(record, t_command=t, command=record.command_at(t), signals=signals)


@pytest.mark.parametrize("rows", [3, -4])
def test_commands_paired_with_the_wrong_rows_are_named_with_the_rows(rows):
    table = in_rows(fly("bluerov2", "multisine", 3))
    assert not [str(f) for f in check_record(table, model_of("bluerov2")) if f.severity == "error"]
    slipped = replace(table, command=np.roll(table.command, rows, axis=0))
    (found,) = [f for f in check_record(slipped, model_of("bluerov2")) if f.severity == "error"]
    assert f"the commands are {abs(rows)} samples {'later' if rows > 0 else 'earlier'} than all others" in found.message


def test_a_column_that_slipped_by_rows_is_named_with_the_rows():
    table = in_rows(fly("bluerov2", "multisine", 3))
    gyro = table.signals["gyro"]
    late = replace(gyro, value=np.roll(gyro.value, 4, axis=0))
    (found,) = [
        f
        for f in check_record(replace(table, signals=table.signals | {"gyro": late}), model_of("bluerov2"))
        if f.severity == "error"
    ]
    assert found.where == "gyro" and "Its columns are 4 samples later than the others" in found.message


@pytest.mark.parametrize("seed", [3, 4, 5, 6, 7, 8])
def test_without_a_velocity_a_right_clock_is_not_called_wrong(seed):
    record = only(fly("bluerov2", "multisine", seed), "gyro", "attitude", "depth")
    assert not [str(f) for f in check_record(record, model_of("bluerov2")) if f.severity == "error"]


def test_the_command_says_what_is_wrong(tmp_path, monkeypatch, capsys):
    record = fly("bluerov2", "multisine", 3)
    vehicle, gyro = load_vehicle("bluerov2"), record.signals["gyro"]
    names = ["t", *vehicle.thruster_names]
    table = np.column_stack([record.t_command, record.command])
    np.savetxt(tmp_path / "commands.csv", table, delimiter=",", header=",".join(names), comments="")
    table = np.column_stack([gyro.t, 60 * gyro.value])
    np.savetxt(tmp_path / "imu.csv", table, delimiter=",", header="t,p,q,r", comments="")
    (tmp_path / "evidence.yaml").write_text(
        "vehicle: bluerov2\nlogs: [{files: [{file: commands.csv}, {file: imu.csv}]}]"
    )
    words = ["rovtwin", "evidence", "check", str(tmp_path / "evidence.yaml"), "--json"]
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as stopped:
        rovtwin.cli.main()
    report = json.loads(capsys.readouterr().out)
    assert stopped.value.code == 1
    assert report["usable"] is False
    assert [f["what"] for f in report["records"][0]["findings"] if f["severity"] == "error"] == ["degrees"]


def spinning(turn, attitude_rate, gain=1.0):
    """Somersaults back and forth at up to `turn` [rad/s], attitude and gyro exact but for their noise."""
    t, rng = np.arange(0.0, 60.0, 0.01), np.random.default_rng(5)
    p, q, r = (
        turn * np.sin(2 * np.pi * f * t + k) * size for k, (f, size) in enumerate([(0.12, 1), (0.1, 1), (0.2, 0.3)])
    )
    omega = np.stack([p, q, r], axis=1)
    steps = Rotation.from_rotvec(0.01 * omega)
    turned, R = [Rotation.identity()], Rotation.identity()
    for step in steps[:-1]:
        R = R * step
        turned.append(R)
    rows = np.arange(0, len(t), round(100 / attitude_rate))
    euler = euler_from_rotation(Rotation.concatenate([turned[i] for i in rows]).as_matrix())
    signals = {
        "gyro": Signal(t + 0.005, gain * omega + rng.normal(0, 0.01, omega.shape)),
        "attitude": Signal(t[rows], euler + rng.normal(0, 0.003, euler.shape)),
    }
    return Record("somersaults", t[::10], rng.uniform(-1, 1, (len(t[::10]), 6)), signals, end=60.0)


@pytest.mark.parametrize("attitude_rate", [5, 10, 50])
def test_fast_rotations_that_are_right_are_not_called_wrong(attitude_rate):
    """A mean of rotations shrinks with the turn within its kernel; both signals go through the same one."""
    record = spinning(6.0 if attitude_rate > 5 else 4.0, attitude_rate)
    (pair,) = pairs(Motion.of(record))
    good = np.isfinite(pair.a).all(axis=1) & np.isfinite(pair.b).all(axis=1)
    ratio = pair.a[good].std(axis=0) / pair.b[good].std(axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.1)
    assert not [str(f) for f in check_motion(model_of("bluerov2"), Motion.of(record)) if f.severity == "error"]


@pytest.mark.parametrize(("gain", "what"), [(1.8, "disagree"), (1 / 1.8, "disagree"), (57.3, "degrees")])
def test_a_gyro_of_another_size_is_found_in_fast_rotations_too(gain, what):
    found = check_motion(model_of("bluerov2"), Motion.of(spinning(6.0, 10, gain)))
    assert [(f.what, f.where) for f in found if f.severity == "error"] == [(what, "gyro")]
    assert what == "degrees" or f"{gain:.2f} times" in found[0].message


@pytest.mark.parametrize("log", ["pitch_roll_1", "pitch_roll_2", "all_2", "all_3", "yaw_1", "yaw_4"])
def test_real_rotations_thinned_to_few_readings_raise_no_alarm(log):
    """Somersaults of 6 rad/s, their attitude at 5 to 20 Hz as many vehicles log it."""
    path = shared_folder("data", "bluerov_liu") / f"{log}.npz"
    states = np.load(path)["sensor_fusion_states"]
    for every in (10, 20, 40):
        signals = {"gyro": Signal(states[:, 0], states[:, 4:7])}
        signals["attitude"] = Signal(states[::every, 0], states[::every, 1:4])
        record = Record(log, states[:1, 0], np.zeros((1, 6)), signals, end=float(states[-1, 0]))
        assert not [str(f) for f in check_motion(model_of("bluerov2"), Motion.of(record)) if f.severity == "error"], (
            every
        )


def test_flung_readings_are_only_those():
    t = np.arange(0, 10, 0.1)
    euler = np.stack([0.1 * np.sin(t), 0.1 * np.cos(t), 0.5 * t], axis=1)
    assert not flung(euler).any()
    euler[40, 2] -= 3.0
    assert np.flatnonzero(flung(euler)).tolist() == [40]


def test_a_release_is_no_mistake():
    """Thrusters off and the vehicle swinging is a decay test; off and still is a log of nothing."""
    t = np.arange(0.0, 10.0, 0.02)
    swing = np.stack([0.5 * np.exp(-0.3 * t) * np.cos(t), 0 * t, 0 * t], axis=1)
    model = load_vehicle("double_blueye").model()

    def record(value):
        return Record("release", np.zeros(1), np.zeros((1, 6)), {"attitude": Signal(t, value)}, 10.0)

    assert [f.what for f in check_commands(record(swing), model)] == ["release"]
    assert [f.what for f in check_commands(record(0.001 * swing), model)] == ["no_excitation"]


def test_a_lag_of_one_axis_is_no_clock(monkeypatch):
    """A Pioneer, which nothing turns, had its clock doubted for what its yaw did: 1.4 s late in pitch, 2 s in yaw."""
    monkeypatch.setattr(against_model, "thruster_forces", lambda model, motion, lag: lag)
    motion = SimpleNamespace(rotation=np.eye(3), velocity=np.zeros((1, 3)), record=fly("bluerov2", "multisine", 3))

    def late(*best):
        """Each axis is explained to 90 % at its own lag, and to 10 % more than 0.3 s from it."""

        def against(lag):
            return SimpleNamespace(explainable=np.array([0.9 - 0.8 * min(abs(lag - b) / 0.3, 1.0) for b in best]))

        return against_model._late(None, motion, SimpleNamespace(against=against))[0]

    assert late(1.4, 1.4, 1.5) == pytest.approx(1.4)
    assert late(1.0, 2.0) == 0.0, "they disagree, and one has no end within the search"
    assert late(2.0, 2.0) == 0.0


def test_thrusters_are_named_where_their_names_are_known():
    """Those of a vehicle are in its file's order, and nobody counts them."""
    message = "commands of thrusters 1 and 2 are swapped, or thruster 3 pushes the other way"
    finding = Finding("error", "swapped", "thrusters 1, 2", message, "")
    named = finding.named(["port", "starboard", "aft"])
    assert named.where == "thrusters port, starboard"
    assert named.message == "commands of thrusters port and starboard are swapped, or thruster aft pushes the other way"
    assert finding.named(()) == finding
