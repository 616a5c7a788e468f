"""Readers: the same motion written in different formats, units and frames comes back as the same Record."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.conftest import shared_folder

from rovtwin.core.arrays.rotations import euler_from_rotation, rotation_from_euler
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.log import Channel, Log
from rovtwin.identification.logs.evidence_file import LogSpec, read_evidence
from rovtwin.identification.logs.readers import read_record, read_tests
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.thrust_curve import read_points

EXAMPLES = Path(__file__).parents[2] / "examples"
T = np.arange(0.0, 4.0, 0.1)
EULER = np.stack([0.3 * np.sin(T), 0.2 * np.cos(T), 0.5 * T], axis=1)
PLACE = np.stack([T, 0.5 * T, 2.0 + 0.1 * T], axis=1)
RATE = np.stack([0.1 * np.cos(T), 0.2 * np.sin(T), 0.5 + 0 * T], axis=1)


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("bluerov2")


@pytest.fixture
def command(vehicle):
    return np.random.default_rng(1).uniform(-1, 1, (len(T), len(vehicle.thruster_names)))


def spec(**given):
    return LogSpec.model_validate(given)


def write_csv(path, columns):
    header = ",".join(columns)
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=header, comments="", fmt="%.12g")
    return path


def test_csv_with_plain_names_needs_no_map(tmp_path, vehicle, command):
    columns = {"time": T} | dict(zip(vehicle.thruster_names, command.T, strict=True))
    columns |= dict(zip(("phi", "theta", "psi"), EULER.T, strict=True)) | dict(zip("pqr", RATE.T, strict=True))
    record = read_record(write_csv(tmp_path / "run.csv", columns), vehicle)
    assert set(record.signals) == {"attitude", "gyro"}
    np.testing.assert_allclose(record.command, command[:-1], atol=1e-9)
    np.testing.assert_allclose(rotation_from_euler(record.signals["attitude"].value), rotation_from_euler(EULER))
    assert record.end == pytest.approx(T[-1])


def test_csv_columns_may_be_in_capitals_but_not_both_ways(tmp_path, vehicle, command):
    drives = dict(zip(vehicle.thruster_names, command.T, strict=True))
    loud = {"Time": T} | drives | dict(zip("PQR", RATE.T, strict=True))
    record = read_record(write_csv(tmp_path / "run.csv", loud), vehicle)
    np.testing.assert_allclose(record.signals["gyro"].value, RATE, atol=1e-9)
    # `R` beside `r`: what is spelled as documented counts.
    both = loud | {"p": 2 * RATE[:, 0], "q": RATE[:, 1], "r": RATE[:, 2]}
    record = read_record(write_csv(tmp_path / "both.csv", both), vehicle)
    np.testing.assert_allclose(record.signals["gyro"].value[:, 0], 2 * RATE[:, 0], atol=1e-9)


def test_npz_in_other_units_and_frames_is_the_same_record(tmp_path, vehicle, command):
    """PWM, degrees, millimetres, z up, ENU quaternions, time from 1970."""
    flip = np.array([1.0, -1.0, -1.0])
    ned_enu = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    enu_flu = Rotation.from_matrix(ned_enu @ rotation_from_euler(EULER) @ np.diag(flip))
    np.savez(
        tmp_path / "run.npz",
        drive=np.column_stack([T + 1.7e9, 1500 + 400 * command]),
        pose=np.column_stack([T + 1.7e9, 1e3 * PLACE @ ned_enu.T, enu_flu.as_quat()]),
        imu=np.column_stack([T + 1.7e9, np.degrees(RATE * flip)]),
    )
    given = spec(
        file="run.npz",
        commands={"from": "drive", "columns": list(range(1, 7)), "unit": "pwm"},
        signals={
            "position": {"from": "pose", "columns": [1, 2, 3], "unit": "mm", "frame": "enu"},
            "attitude": {"from": "pose", "columns": [4, 5, 6, 7], "quaternion": "xyzw", "frame": "enu", "sigma": 0.01},
            "gyro": {"from": "imu", "columns": [1, 2, 3], "unit": "deg/s", "frame": "flu"},
        },
        tether_length=12,
        water_density=998,
    )
    record = read_record(tmp_path / "run.npz", vehicle, given)
    np.testing.assert_allclose(record.signals["position"].value, PLACE, atol=1e-9)
    expected = euler_from_rotation(rotation_from_euler(EULER))
    np.testing.assert_allclose(record.signals["attitude"].value, expected, atol=1e-9)
    np.testing.assert_allclose(record.signals["gyro"].value, RATE, atol=1e-9)
    np.testing.assert_allclose(record.command, command[:-1], atol=1e-9)
    np.testing.assert_allclose(record.signals["attitude"].t, T, atol=1e-6)
    assert np.all(record.signals["attitude"].sigma == np.full(3, 0.01))
    assert (record.tether_length, record.water_density) == (12, 998)
    assert any("1700000000.000 s" in note for note in record.notes)


def test_depth_from_pressure_uses_the_water(tmp_path, vehicle, command):
    np.savez(tmp_path / "p.npz", c=np.column_stack([T, command]), p=np.column_stack([T, 1013 + 1025 * 9.81 * T / 100]))
    given = spec(
        file="p.npz",
        water_density=1025,
        commands={"from": "c", "columns": [1, 2, 3, 4, 5, 6]},
        signals={"depth": {"from": "p", "columns": [1], "unit": "mbar", "zero": 1013}},
    )
    np.testing.assert_allclose(read_record(tmp_path / "p.npz", vehicle, given).signals["depth"].value[:, 0], T)


def test_gaps_and_repeats_are_left_out_and_reported(tmp_path, vehicle, command):
    rate = RATE.copy()
    rate[7] = np.nan
    rate[12] = rate[11]
    np.savez(tmp_path / "g.npz", c=np.column_stack([T, command]), g=np.column_stack([T, rate]))
    given = spec(
        file="g.npz",
        commands={"from": "c", "columns": [1, 2, 3, 4, 5, 6]},
        signals={"gyro": {"from": "g", "columns": [1, 2, 3], "repeats": "drop"}},
    )
    record = read_record(tmp_path / "g.npz", vehicle, given)
    assert len(record.signals["gyro"].t) == len(T) - 2
    assert any("1 of 40 rows without a number" in n for n in record.notes)
    assert any("1 repeated rows" in n for n in record.notes)


def test_pilot_axes_are_mixed_to_thrusters(tmp_path, vehicle):
    names = vehicle.thruster_names
    axes = np.column_stack([0.8 * np.ones_like(T), np.where(T > 2, 0.5, 0.0)])
    np.savez(tmp_path / "m.npz", c=np.column_stack([T, axes]), g=np.column_stack([T, RATE]))
    mix = {name: [1.0, 1.0] if i == 0 else [0.0, -1.0] for i, name in enumerate(names)}
    given = spec(
        file="m.npz",
        commands={"from": "c", "columns": [1, 2], "mix": mix},
        signals={"gyro": {"from": "g", "columns": [1, 2, 3]}},
    )
    record = read_record(tmp_path / "m.npz", vehicle, given)
    np.testing.assert_allclose(record.command_at(np.array([1.0]))[0], [0.8, 0, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(record.command_at(np.array([3.0]))[0], [1, *[-0.5] * 5], atol=1e-12)
    assert any("clipped" in note for note in record.notes)


@pytest.mark.parametrize("named", ["{}_t", "t_{}", "{}_time", "{}.timestamps", "other_{}"])
def test_npz_with_a_time_array_for_each_signal(tmp_path, vehicle, command, named):
    """Found by its name, or named by `time`; data were read as the time, in silence."""
    t_rate = T + 0.03
    arrays = {"thrusters": command, named.format("thrusters"): T, "gyro": RATE, named.format("gyro"): t_rate}
    np.savez(tmp_path / "run.npz", depth=PLACE[:, 2], **{named.format("depth"): T}, **arrays)
    reported = (lambda name: {"time": named.format(name)}) if named == "other_{}" else lambda name: {}
    given = spec(
        file="run.npz",
        commands={"from": "thrusters", "columns": list(range(6))} | reported("thrusters"),
        signals={
            "gyro": {"from": "gyro", "columns": [0, 1, 2]} | reported("gyro"),
            "depth": {"from": "depth", "columns": [0]} | reported("depth"),
        },
    )
    record = read_record(tmp_path / "run.npz", vehicle, given)
    np.testing.assert_allclose(record.signals["gyro"].t, t_rate[:-1], atol=1e-9)
    np.testing.assert_allclose(record.signals["gyro"].value, RATE[:-1])
    np.testing.assert_allclose(record.signals["depth"].value[:, 0], PLACE[:, 2])
    np.testing.assert_allclose(record.command_at(T[1:-1]), command[1:-1])


def test_one_time_array_may_serve_all(tmp_path, vehicle, command):
    np.savez(tmp_path / "run.npz", t=T, u=command, gyro=RATE, imu=np.column_stack([T + 0.01, RATE]))
    given = spec(
        file="run.npz",
        commands={"from": "u", "columns": list(range(6))},
        signals={"gyro": {"from": "gyro"}, "velocity": {"from": "imu", "columns": [1, 2, 3]}},
    )
    record = read_record(tmp_path / "run.npz", vehicle, given)
    np.testing.assert_allclose(record.signals["gyro"].t, T, atol=1e-9)
    np.testing.assert_allclose(record.signals["velocity"].t, T[:-1] + 0.01, atol=1e-9)  # its own first column


@pytest.mark.parametrize(
    ("gyro", "message"),
    [
        ({"columns": [0, 1, 2]}, r"signals.gyro: nothing says where its times are.*read as data too.*time.*: clock"),
        ({"columns": [1, 2, 2]}, r"first column, which is taken then, falls in \d+%.*increasing: clock"),
        ({"columns": [0, 1, 2], "time": "clok"}, r"gyro.time: no column or array 'clok'. Did you mean 'clock'"),
        ({"columns": [0, 1, 2], "time": "u"}, r"'u' has 40 rows, 6 columns, expected 40 rows, 1 column.*: clock"),
    ],
)
def test_data_are_not_read_as_the_time(tmp_path, vehicle, command, gyro, message):
    np.savez(tmp_path / "run.npz", u=command, clock=T, gyro=RATE)
    commands = {"from": "u", "columns": list(range(6)), "time": "clock"}
    good = spec(
        file="run.npz", commands=commands, signals={"gyro": {"from": "gyro", "columns": [0, 1, 2], "time": "clock"}}
    )
    read_record(tmp_path / "run.npz", vehicle, good)
    with pytest.raises(IdentificationError, match=message):
        read_record(
            tmp_path / "run.npz",
            vehicle,
            spec(file="run.npz", commands=commands, signals={"gyro": {"from": "gyro"} | gyro}),
        )


def test_no_commands_lists_what_is_there_and_what_may_be_some(tmp_path, vehicle, command):
    np.savez(tmp_path / "run.npz", rovio_thrusters=np.column_stack([T, command]), imu=np.column_stack([T, RATE]))
    given = spec(file="run.npz", signals={"gyro": {"from": "imu", "columns": [1, 2, 3]}})
    with pytest.raises(IdentificationError) as refused:
        read_record(tmp_path / "run.npz", vehicle, given)
    text = str(refused.value)
    assert "found no commands" in text and "Perhaps 'rovio_thrusters'" in text
    assert "rovio_thrusters (40 rows, 7 columns)" in text and "imu (40 rows, 4 columns)" in text
    columns = {"time": T, "motor1": T, "p": T, "q": T, "r": T}
    with pytest.raises(
        IdentificationError, match=r"Perhaps 'motor1'.*run \(40 rows, 5 columns: time, motor1, p, q, r\)"
    ):
        read_record(write_csv(tmp_path / "run.csv", columns), vehicle)


def rovtwin_log(path, vehicle, command):
    t = np.arange(40) * 0.1
    tables = {
        Channel("autopilot/command", tuple(vehicle.thruster_names), "1", ""): (t, command),
        Channel("sensor/position", ("north", "east", "t_valid"), ("m", "m", "s"), "n"): (
            t + 0.02,
            np.column_stack([PLACE[:, :2], t]),
        ),
        Channel("sensor/pressure", ("depth", "t_valid"), ("m", "s"), "n"): (t, np.column_stack([PLACE[:, 2], t])),
        Channel("sensor/gyro", ("x", "y", "z", "t_valid"), ("rad/s",) * 3 + ("s",), "sensor"): (
            t,
            np.column_stack([RATE, t]),
        ),
    }
    about = {"noise": [0.1, 0.2, 0.3], "lever": [0.1, 0, 0], "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}
    metadata = {"sensors": json.dumps({"gyro": about}), "water_density": "1025.0"}
    Log.from_arrays(list(tables), {c.name: values for c, values in tables.items()}, metadata).write(path)
    return path


def test_rovtwin_log_with_its_own_noise_and_mounting(tmp_path, vehicle, command):
    record = read_record(rovtwin_log(tmp_path / "log.mcap", vehicle, command), vehicle)
    assert set(record.signals) == {"horizontal", "depth", "gyro"}
    np.testing.assert_allclose(record.signals["horizontal"].t, T[:-1], atol=1e-8)  # when it was true, not delivered
    gyro = record.signals["gyro"]
    turned = np.column_stack([-RATE[:, 1], RATE[:, 0], RATE[:, 2]])
    np.testing.assert_allclose(gyro.value, turned[: len(gyro.t)], atol=1e-12)
    np.testing.assert_allclose(gyro.lever, [0.1, 0, 0])
    np.testing.assert_allclose(gyro.sigma, [0.2, 0.1, 0.3])  # of its axes, turned to those of b
    assert record.water_density == 1025


def test_a_log_of_another_vehicle_is_refused(tmp_path, vehicle, command):
    path = rovtwin_log(tmp_path / "log.mcap", vehicle, command)
    with pytest.raises(IdentificationError, match="Give the vehicle that flew"):
        read_record(path, load_vehicle("double_blueye"))


BAD = {
    "no such array": (
        {"signals": {"gyro": {"from": "gg", "columns": [1, 2, 3]}}},
        "has c .40 rows, 7 columns., g .40 rows, 4 columns",
    ),
    "no such column": ({"signals": {"gyro": {"from": "g", "columns": [1, 2, 9]}}}, "number from 0 to 3"),
    "too few columns": ({"signals": {"gyro": {"from": "g", "columns": [1, 2]}}}, "found 2, expected p, q, r"),
    "no columns": ({"signals": {"gyro": {"from": "g"}}}, "columns: missing"),
    "pilot's axes": ({"commands": {"from": "c", "columns": [1, 2]}}, "expected 6 .* give mix"),
    "unknown thruster": ({"commands": {"from": "c", "columns": [1], "mix": {"nobody": [1]}}}, "no thruster 'nobody'"),
    "no common time": ({"span": [1000, 2000]}, "no time in common"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_maps_say_what_is_wrong(tmp_path, vehicle, command, case):
    changes, message = BAD[case]
    np.savez(tmp_path / "x.npz", c=np.column_stack([T, command]), g=np.column_stack([T, RATE]))
    good = {
        "file": "x.npz",
        "commands": {"from": "c", "columns": [1, 2, 3, 4, 5, 6]},
        "signals": {"gyro": {"from": "g", "columns": [1, 2, 3]}},
    }
    read_record(tmp_path / "x.npz", vehicle, spec(**good))
    with pytest.raises(IdentificationError, match=message):
        read_record(tmp_path / "x.npz", vehicle, spec(**good | changes))


def _packed(size: int) -> bytes:
    """A zip whose directory says that its one file has so many bytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as packed:
        packed.writestr("a.npy", b"x" * 100)
        packed.infolist()[0].file_size = size
    return file.getvalue()


def _npz_of(count: int) -> bytes:
    """A file whose one array says that it has so many numbers, and has none."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},), }}".ljust(117) + "\n"
    array, file = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode(), io.BytesIO()
    with zipfile.ZipFile(file, "w") as packed:
        packed.writestr("a.npy", array)
    return file.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("gone.csv", None, "no such file"),
        ("odd.xyz", b"1", "unknown ending"),
        ("empty.csv", b"", "found 0 lines"),
        ("numbers.csv", b"1,2\n3,4\n5,6\n", "expected a header"),
        ("broken.npz", b"PK nothing", "cannot be read as npz"),
        ("cut.npz", b"PK\x03\x04 and no more", "cannot be read as npz"),
        ("huge.npz", _npz_of(10**12), "cannot be read as npz"),
        ("cut_head.npz", _npz_of(10**3)[:70], "cannot be read as npz"),
        ("bomb.npz", _packed(5_000_000_000), "holds 5,000 MB, expected at most 4,000 MB"),
        ("cell.csv", b"t,p\n0,1\n1," + b"9" * 300_000 + b"\n", "is no table of numbers"),
        ("broken.mcap", b"nothing", "."),
    ],
    ids=lambda one: one if isinstance(one, str) else "",  # archives hold the time at which they are made
)
def test_bad_files_are_refused_without_a_traceback(tmp_path, vehicle, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(IdentificationError, match=message):
        read_record(tmp_path / name, vehicle)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("logs: []", "logs: found 0 values, expected 1"),
        ("logs: [{use: fit}]", "expected either 'file' or 'files'"),
        ("logs: [{file: a.npz, use: fitt}]", "Did you mean 'fit'"),
        ("logs: [{file: a.npz, use: validate, fit_share: 0.5}]", "never fitted"),
        ("logs: [{file: a.npz, signals: {gyros: {columns: [1]}}}]", "gyros: no such signal. Did you mean 'gyro'"),
        ("logs: [{file: a.npz, signals: {gyro: {columns: [1], unit: deg}}}]", "expected one of rad/s, deg/s"),
        ("logs: [{file: a.npz, signals: {gyro: {colums: [1]}}}]", "Did you mean 'columns'"),
    ],
)
def test_bad_evidence_files_say_what_is_wrong(tmp_path, text, message):
    (tmp_path / "evidence.yaml").write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_evidence(tmp_path / "evidence.yaml")


def test_thrust_of_a_text_file(tmp_path):
    (tmp_path / "thrust.txt").write_text("Thrust [N]  Amount [-]\n\n-40 -1\n0 0\n50 1\n")
    np.testing.assert_allclose(read_points(tmp_path / "thrust.txt")[1], [[-1, -40], [0, 0], [1, 50]])
    (tmp_path / "bad.txt").write_text("Thrust [N]  Amount [-]\n-40 -1\n0 0\n50 0.5\n")
    with pytest.raises(ConfigError, match="increase from -1 to 1"):
        read_points(tmp_path / "bad.txt")


def test_shipped_evidence_of_the_linkoping_bluerov():
    shared_folder("data", "bluerov_liu")
    evidence = read_evidence(EXAMPLES / "bluerov_liu" / "evidence.yaml")
    assert evidence.vehicle
    vehicle = load_vehicle(evidence.vehicle)
    tests = {test.record.name: test for test in read_tests(evidence, vehicle)}
    assert [name for name, test in tests.items() if test.use == "fit"] == ["all_2"]
    assert {"all_3", "yaw_4"} <= set(tests)
    record = tests["all_3"].record
    # Cut to the span of the commands: the states run 3.65 s longer.
    assert record.duration == pytest.approx(11.688, abs=0.01)
    assert np.abs(record.command).max() == pytest.approx(0.6)
    # K, M, N of the published geometry.
    T_ = np.asarray(vehicle.model().thrusters.configuration)
    np.testing.assert_allclose(T_[3], [0.11, -0.11, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(T_[4], [0.16, 0.16, -0.044, -0.044, -0.2, 0], atol=1e-12)
    np.testing.assert_allclose(T_[5], [0, 0, 0.11, -0.11, 0, 0], atol=1e-12)


def test_shipped_evidence_of_the_tank():
    shared_folder("data", "bluerov2_heavy_tank")
    evidence = read_evidence(EXAMPLES / "bluerov2_heavy_tank" / "evidence.yaml")
    assert evidence.vehicle
    vehicle = load_vehicle(evidence.vehicle)
    tests = read_tests(evidence, vehicle)
    assert [test.use for test in tests] == ["fit", "validate"] * 2
    share = tests[0].record.duration / (tests[0].record.duration + tests[1].record.duration)
    assert share == pytest.approx(0.7, abs=1e-6)
    # Velocity of the file against the rate of its position: the frames of both are read the same way.
    record = tests[2].record
    p, a, v = (record.signals[name] for name in ("position", "attitude", "velocity"))
    rate = np.gradient(p.value, p.t, axis=0)
    from_position = np.einsum("nji,nj->ni", rotation_from_euler(a.value), rate)
    for axis in range(3):
        assert np.corrcoef(from_position[:, axis], v.value[:, axis])[0, 1] > 0.8
