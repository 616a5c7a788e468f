"""Logs of ArduSub (.BIN), of ground stations (.tlog) and of PX4 (.ulg): the same motion, and real ones."""

import numpy as np
import pytest
from tests.conftest import shared_folder
from tests.identification.autopilot_logs import (
    DEPTH,
    EULER,
    PARAMETERS,
    RATE,
    START,
    T,
    write_dataflash,
    write_tlog,
    write_ulog,
)

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.identification.checks.check import check_record
from rovtwin.identification.logs.evidence_file import LogSpec
from rovtwin.identification.logs.log_spec import SourceSpec
from rovtwin.identification.logs.motion import body_rates, on_grid, rotation_on_grid
from rovtwin.identification.logs.readers import read_record, read_records
from rovtwin.identification.logs.readers.autopilots.motors import FRAMES, NoCommands, drives, matched
from rovtwin.identification.logs.readers.autopilots.tlog import _on_one_epoch
from rovtwin.identification.logs.readers.autopilots.turning import stretches
from rovtwin.identification.logs.readers.convert import to_body
from rovtwin.identification.logs.readers.reading import read_raw
from rovtwin.vehicle import load_vehicle

HORIZONTAL = ["front_starboard", "front_port", "rear_starboard", "rear_port"]


@pytest.fixture(scope="module")
def heavy():
    return load_vehicle("bluerov2_heavy")


@pytest.fixture(scope="module")
def six():
    return load_vehicle("bluerov2")


def without(*names, **more):
    return {name: value for name, value in PARAMETERS.items() if not name.startswith(names)} | more


def check_motion(record, atol=2e-4):
    """Everything but the commands is that of the test, by the times that the record says."""
    origin = next(float(n.split()[3]) for n in record.notes if n.startswith("time zero")) - START
    attitude, gyro, depth = (record.signals[name] for name in ("attitude", "gyro", "depth"))
    angles = [np.interp(attitude.t + origin, T, axis) for axis in EULER.T]
    expected = rotation_from_euler(np.stack(angles, axis=1))
    np.testing.assert_allclose(rotation_from_euler(attitude.value), expected, atol=atol)
    np.testing.assert_allclose(gyro.value, np.stack([np.interp(gyro.t + origin, T, x) for x in RATE.T], 1), atol=atol)
    np.testing.assert_allclose(depth.value[:, 0], np.interp(depth.t + origin, T, DEPTH), atol=1e-3)
    velocity = record.signals["velocity"]
    np.testing.assert_allclose(velocity.value - [0.5, 0.1, -0.2], 0.0, atol=1e-5)
    np.testing.assert_allclose((velocity.t + origin) % 0.1, 0.05, atol=1e-3)  # in the middle of each step
    np.testing.assert_allclose(record.signals["accelerometer"].value.mean(axis=0), [0, 0, -9.81], atol=0.01)
    assert record.water_density == 1024


def check_commands(record, vehicle):
    """Surge first, then heave down, whichever way round propellers are; half a reading before the pulses."""
    origin = next(float(n.split()[3]) for n in record.notes if n.startswith("time zero")) - START
    wrench = np.asarray(vehicle.model().thrusters.configuration)
    ahead, down = record.command_at(np.array([3.7, 5.2]) - origin) @ wrench.T
    assert ahead[0] == pytest.approx(4 * 0.5 * np.sqrt(0.5)) and np.abs(ahead[1:]).max() < 1e-9
    assert down[2] == pytest.approx(4 * 0.25) and np.abs(np.delete(down, 2)).max() < 1e-9
    begin = record.t_command[np.flatnonzero(np.abs(record.command).max(axis=1) > 0)[0]]
    assert begin + origin == pytest.approx(3.0 - 0.05, abs=1e-6)
    assert record.command_interval == pytest.approx(0.1)


def test_a_dataflash_log_needs_no_map(tmp_path, heavy):
    record = read_record(write_dataflash(tmp_path / "00000012.BIN"), heavy)
    check_motion(record)
    check_commands(record, heavy)
    assert any("used: 102.0 to 109.0 s of 100.0 to 111.9 s; cut: 5.0 s disarmed" in note for note in record.notes)


def test_a_telemetry_log_needs_no_map(tmp_path, heavy):
    pytest.importorskip("pymavlink", reason="pip install 'rovtwin[mavlink]'")
    record = read_record(write_tlog(tmp_path / "dive.tlog"), heavy)
    check_motion(record)
    check_commands(record, heavy)


def test_outputs_that_are_read_rarely_are_reported_to_be(tmp_path, heavy):
    pytest.importorskip("pymavlink", reason="pip install 'rovtwin[mavlink]'")
    record = read_record(write_tlog(tmp_path / "slow.tlog", every=5), heavy)
    (found,) = [f for f in check_record(record, heavy.model()) if f.what == "rare"]
    assert found.severity == "warning" and "read every 0.5 s" in found.message and "inertia" in found.message
    record = read_record(write_tlog(tmp_path / "fast.tlog"), heavy)
    assert not any(f.what == "rare" for f in check_record(record, heavy.model()))


MOTORS = {
    # The six of a BlueROV2 and the eight of a Heavy, named and turned as in the files of the vehicles.
    "bluerov2": (1, [*HORIZONTAL, "vertical_starboard", "vertical_port"], 1.0),
    "bluerov2_heavy": (
        2,
        [*HORIZONTAL, *(f"vertical_{end}_{side}" for end in ("front", "rear") for side in ("starboard", "port"))],
        -1.0,
    ),
}


@pytest.mark.parametrize("name", MOTORS)
def test_motors_of_frames_are_found_by_where_they_push(name):
    vehicle, (frame, order, sign) = load_vehicle(name), MOTORS[name]
    T_ = np.asarray(vehicle.model().thrusters.configuration)
    outputs = list(range(1, 9))
    found, _ = drives({"FRAME_CONFIG": frame}, T_, vehicle.thruster_names, outputs)
    assert {n: (d.motor, d.sign) for n, d in found.items()} == {n: (i, sign) for i, n in enumerate(order, 1)}
    # Any outputs, and a propeller the other way round.
    moved = {f"SERVO{9 - n}_FUNCTION": 32.0 + n for n in range(1, len(order) + 1)}
    found, _ = drives({"FRAME_CONFIG": frame, "MOT_2_DIRECTION": -1, **moved}, T_, vehicle.thruster_names, outputs)
    assert found["front_port"].output == 7 and found["front_port"].sign == -sign


@pytest.mark.parametrize("frame", FRAMES)
def test_every_frame_finds_its_own_motors(frame):
    factors = np.array(FRAMES[frame][1], dtype=float)[:, [4, 5, 3, 0, 1, 2]] * [1, 1, -1, 1, 1, 1]
    order = np.random.default_rng(frame).permutation(len(factors))
    motor, cosine = matched(
        factors, (factors[order] * [1, 1, 1, 0.2, 0.2, 0.2] * np.where(order % 2, 1, -1)[:, None]).T
    )
    np.testing.assert_allclose(factors[motor], factors[order])
    np.testing.assert_allclose(cosine, np.where(order % 2, 1, -1))


REFUSED = {
    "no servo outputs": (
        {"without": ("RCOU",)},
        r"no RCOU messages .*it has ARM, ATT, BARO, BARO\[1\], FMTU, IMU, PARM, VISO\)",
    ),
    "other vehicle": ({"parameters": without(FRAME_CONFIG=1.0)}, "VECTORED has 6 motors, the vehicle has 8 thrusters"),
    "own frame": ({"parameters": without(FRAME_CONFIG=7.0)}, "FRAME_CONFIG is 7, a frame of its own"),
    "motor nowhere": ({"parameters": without(SERVO3_FUNCTION=0.0)}, "no output has motor 3 .function 35."),
    "output not logged": (
        {"parameters": without(SERVO3_FUNCTION=0.0, SERVO11_FUNCTION=35.0)},
        "output 11 is not logged",
    ),
    "never armed": ({"armed": ((11.9, 1),)}, "never turn while armed .*11.9 s disarmed"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_commands_that_cannot_be_had_say_why(tmp_path, heavy, case):
    changes, message = REFUSED[case]
    path = write_dataflash(tmp_path / "log.bin", **changes)
    with pytest.raises(IdentificationError, match=message):
        read_record(path, heavy)
    # The signals are there all the same, for commands of another file or for a decay test.
    raw = read_raw(path, SourceSpec.model_validate({"file": path.name}), heavy)
    assert {"attitude", "gyro", "depth"} <= set(raw.signals)


def test_a_frame_of_ones_own_is_mapped_by_hand(tmp_path, heavy):
    path = write_dataflash(tmp_path / "log.BIN", parameters=without(FRAME_CONFIG=7.0))
    order = MOTORS["bluerov2_heavy"][1]
    commands = {"from": "RCOU", "columns": [f"C{n}" for n in range(1, 9)], "unit": "pwm", "thrusters": order}
    record = read_record(path, heavy, LogSpec.model_validate({"file": path.name, "commands": commands}))
    by_motor = record.command_at(np.array([4.0]))[0][[heavy.thruster_names.index(name) for name in order]]
    np.testing.assert_allclose(by_motor, [0.5, 0.5, 0.5, 0.5, 0, 0, 0, 0], atol=1e-9)


def test_what_the_log_lacks_is_assumed_and_reported(tmp_path, heavy):
    path = write_dataflash(tmp_path / "log.BIN", parameters={})
    notes = " ".join(read_record(path, heavy).notes)
    assert "FRAME_CONFIG is not in the log: VECTORED_6DOF taken" in notes
    assert "motor n taken for output n" in notes and "1 taken; a check finds wrong signs" in notes


def test_a_vehicle_of_another_shape_is_refused():
    names = [f"t{i}" for i in range(8)]
    with pytest.raises(NoCommands, match="pushes like the vehicle's thruster t"):
        drives({"FRAME_CONFIG": 2.0}, np.tile([[1.0], [0], [0], [0], [0], [0]], 8), names, list(range(1, 9)))


def test_stretches_keep_what_is_known():
    t = np.arange(0.0, 60.0, 0.1)
    u = np.zeros((len(t), 2))
    u[(t > 10) & (t < 12)] = 0.5
    u[(t > 30) & (t < 50)] = -0.5
    found = stretches(t, u, [(5.0, True), (45.0, False)])
    np.testing.assert_allclose(found.used, [(9.1, 17.0), (29.1, 45.0)], atol=0.11)
    # Without a log for a while, and never armed.
    kept = (t < 33) | (t > 40)
    found = stretches(t[kept], u[kept], [])
    np.testing.assert_allclose(found.used, [(9.1, 17.0), (29.1, 32.9), (40.1, 55.0)], atol=0.11)
    assert "7.2 s without servo outputs" in found.text
    assert stretches(t, u, [(float("inf"), True)]).used == ()


@pytest.mark.parametrize("content", [b"", b"\xa3\x95\x80", b"no log at all\n" * 100, bytes(range(256)) * 40])
@pytest.mark.parametrize("name", ["x.BIN", "x.tlog", "x.ulg"])
def test_files_that_are_no_logs_are_refused(tmp_path, heavy, name, content):
    for module in {"x.tlog": ["pymavlink"], "x.ulg": ["pyulog"]}.get(name, []):
        pytest.importorskip(module)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(IdentificationError, match="expected a|cannot be read|no heartbeat"):
        read_record(tmp_path / name, heavy)


def test_damaged_dataflash_logs_are_read_as_far_as_they_go(tmp_path, heavy):
    data = bytearray(write_dataflash(tmp_path / "whole.BIN").read_bytes())
    (tmp_path / "cut.BIN").write_bytes(data[: len(data) * 3 // 4 - 7])
    record = read_record(tmp_path / "cut.BIN", heavy)
    assert any("cut off or damaged: read to 108.7 s" in note for note in record.notes)
    rng = np.random.default_rng(3)
    for place in rng.integers(len(data) // 3, len(data), 60):
        data[place] = rng.integers(256)
    data[-3000:-2500] = rng.bytes(500)
    (tmp_path / "holes.BIN").write_bytes(data)
    assert read_record(tmp_path / "holes.BIN", heavy).duration > 4


@pytest.mark.parametrize("kind", ["BIN", "tlog", "ulg"])
def test_whatever_is_damaged_is_read_or_refused(tmp_path, heavy, kind):
    for module in {"tlog": ["pymavlink"], "ulg": ["pyulog"]}.get(kind, []):
        pytest.importorskip(module)
    path, rng = tmp_path / f"log.{kind}", np.random.default_rng(5)
    made = {"BIN": write_dataflash, "tlog": write_tlog, "ulg": lambda p: px4(p, heavy, np.full((len(T), 12), 0.3))}
    whole, read = made[kind](path).read_bytes(), 0
    for _ in range(20):
        data = bytearray(whole)
        for place in rng.integers(len(data), size=rng.integers(1, 40)):
            data[place] = rng.integers(256)
        path.write_bytes(data[: rng.integers(1, len(data))] if rng.random() < 0.3 else data)
        try:
            read += len(read_records(path, heavy))
        except IdentificationError as refused:
            assert "found no" in str(refused) or "cannot be read" in str(refused)
    assert read


def test_a_cut_telemetry_log_is_read_as_far_as_it_goes(tmp_path, heavy):
    pytest.importorskip("pymavlink", reason="pip install 'rovtwin[mavlink]'")
    data = write_tlog(tmp_path / "whole.tlog").read_bytes()
    (tmp_path / "cut.tlog").write_bytes(data[: len(data) * 3 // 4 - 7])
    check_commands(read_record(tmp_path / "cut.tlog", heavy), heavy)


def px4(path, vehicle, motors, **changes):
    """A log of PX4 whose rotors are the vehicle's thrusters in reverse order, every second one turned round."""
    thrusters = vehicle.thruster_names
    configuration = np.asarray(vehicle.model().thrusters.configuration)
    parameters = {"CA_ROTOR_COUNT": len(thrusters)}
    for rotor in range(len(thrusters)):
        force, moment = np.split(configuration[:, -1 - rotor], 2)
        sign = -1.0 if rotor % 2 else 1.0
        for axis, a, p in zip("XYZ", sign * force, np.cross(force, moment), strict=True):
            parameters |= {f"CA_ROTOR{rotor}_A{axis}": float(a), f"CA_ROTOR{rotor}_P{axis}": float(p)}
    half = 0.5 * EULER
    sines, cosines = np.sin(half), np.cos(half)
    quaternion = np.stack([cosines[:, 2], 0 * T, 0 * T, sines[:, 2]], axis=1)
    topics = {
        "vehicle_attitude": (["float[4] q"], T, quaternion),
        "sensor_combined": (["float[3] gyro_rad", "float[3] accelerometer_m_s2"], T, np.c_[RATE, 0 * RATE - 9.81]),
        "vehicle_local_position": (["float z"], T, DEPTH[:, None]),
        "vehicle_status": (["uint8_t arming_state"], [0.0, 2.0, 9.0], [[1], [2], [1]]),
        "actuator_motors": (["float[12] control"], T, motors),
    }
    return write_ulog(path, parameters | changes, topics)


def test_a_px4_log_needs_no_map(tmp_path, heavy):
    pytest.importorskip("pyulog", reason="pip install 'rovtwin[px4]'")
    motors = np.full((len(T), 12), np.nan)
    motors[(T > 3) & (T < 6), :8] = 0.1 * np.arange(1, 9)
    path = px4(tmp_path / "dive.ulg", heavy, motors)
    record = read_record(path, heavy)
    expected = [0.1 * (8 - i) * (1 if i % 2 else -1) for i in range(8)]
    np.testing.assert_allclose(record.command_at(np.array([4.5]))[0], expected, atol=1e-6)
    assert set(record.signals) == {"attitude", "gyro", "accelerometer", "depth"}
    np.testing.assert_allclose(
        record.signals["depth"].value[:, 0], np.interp(record.signals["depth"].t, T, DEPTH), atol=1e-5
    )
    np.testing.assert_allclose(
        np.unwrap(record.signals["attitude"].value[:, 2]), 0.5 * record.signals["attitude"].t, atol=1e-5
    )
    # Cut in the middle of a message.
    data = path.read_bytes()
    (tmp_path / "cut.ulg").write_bytes(data[: len(data) * 3 // 4 - 7])
    assert read_record(tmp_path / "cut.ulg", heavy).duration > 4
    with pytest.raises(IdentificationError, match="it has 6 rotors .CA_ROTOR_COUNT., the vehicle has 8"):
        read_record(px4(tmp_path / "six.ulg", heavy, motors, CA_ROTOR_COUNT=6), heavy)


def test_pyulog_is_asked_for_where_it_is_missing(tmp_path, heavy, monkeypatch):
    (tmp_path / "x.ulg").write_bytes(b"1")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"needs pyulog: pip install 'rovtwin\[px4\]'"):
        read_record(tmp_path / "x.ulg", heavy)


# ---- logs that nobody of this project wrote ----


def alike(record, width=0.3):
    """Slope and correlation of each body rate of the gyro against that of the attitude, through one kernel."""
    grid = np.arange(record.start, record.end, 0.02)
    from_attitude = body_rates(*rotation_on_grid(record.signals["attitude"], grid, width))
    gyro = on_grid(record.signals["gyro"].t, record.signals["gyro"].value, grid, width)[0]
    good = np.isfinite(from_attitude).all(axis=1) & np.isfinite(gyro).all(axis=1)
    a, g = from_attitude[good], gyro[good]
    return [(np.polyfit(a[:, i], g[:, i], 1)[0], np.corrcoef(a[:, i], g[:, i])[0, 1]) for i in range(3)]


def firmware(name, heavy):
    path = shared_folder("data", "ardusub") / name
    return read_raw(path, SourceSpec.model_validate({"file": name}), heavy), read_records(path, heavy)


@pytest.mark.system
def test_the_firmware_flying_our_twin(heavy):
    """The truth is in the log: SIM (attitude) and SIM2 (position) are what the simulation told the firmware."""
    raw, records = firmware("modes.BIN", heavy)
    assert [round(r.duration) for r in records] == [114, 13]
    record, truth = records[0], raw.tables["SIM2"]
    assert not [f for r in records for f in check_record(r, heavy.model()) if f.severity != "note"]
    for slope, correlation in alike(record):
        assert slope == pytest.approx(1.0, abs=0.05) and correlation > 0.995
    origin = next(float(n.split()[3]) for n in record.notes if n.startswith("time zero"))
    depth, place = record.signals["depth"], record.signals["horizontal"]
    down = np.interp(depth.t + origin, truth.t, truth.values[:, 2])
    # Zeroed 0.75 m under the water, with 0.12 m of noise, in sea water (1.024) that BARO_SPEC_GRAV calls fresh.
    slope, offset = np.polyfit(down, depth.value[:, 0], 1)
    assert slope == pytest.approx(1.024, abs=0.01) and offset == pytest.approx(-0.75, abs=0.1)
    there = np.stack([np.interp(place.t + origin - 0.12, truth.t, c) for c in truth.values[:, :2].T], axis=1)
    assert np.std(place.value - there) < 0.01


def test_pilot_and_thrusters_of_the_firmware_agree(heavy):
    """Sticks of the pilot against the wrench of what was made of the outputs, while in MANUAL."""
    raw, _ = firmware("modes.BIN", heavy)
    commands, sticks = raw.tables["thrusters"], raw.tables["RCIN"]
    manual = commands.t < 99
    wrench = (commands.values @ np.asarray(heavy.model().thrusters.configuration).T)[manual]
    for axis, stick, sign in ((0, "C5", 1), (1, "C6", 1), (2, "C3", -1), (5, "C4", 1)):
        given = np.interp(commands.t[manual], sticks.t, sticks.column(stick))
        assert sign * np.corrcoef(wrench[:, axis], given)[0, 1] > 0.97


def test_a_truncated_log_of_the_firmware(heavy):
    _, (record,) = firmware("truncated.BIN", heavy)
    assert record.duration == pytest.approx(7.7, abs=0.1)
    assert any("cut off or damaged: read to 79.5 s" in note for note in record.notes)


@pytest.mark.system
def test_telemetry_of_a_real_vehicle(heavy):
    """A BlueROV2 Heavy whose propellers go both ways round: what the pilot asked for is what its thrusters make."""
    pytest.importorskip("pymavlink", reason="pip install 'rovtwin[mavlink]'")
    path = shared_folder("data", "ardusub_real") / "small.tlog"
    record = read_record(path, heavy)
    assert record.duration == pytest.approx(16, abs=0.5) and record.command_interval == pytest.approx(0.5, abs=0.01)
    for slope, correlation in alike(record)[:2]:  # it hardly turned
        assert slope == pytest.approx(1.0, abs=0.05) and correlation > 0.98
    gravity = -9.81 * rotation_from_euler(record.signals["attitude"].value)[:, 2, :].mean(axis=0)
    np.testing.assert_allclose(record.signals["accelerometer"].value.mean(axis=0), gravity, atol=0.1)
    assert np.abs(record.signals["depth"].value).max() < 0.1  # at the surface all the time
    found = {f.what: f.severity for f in check_record(record, heavy.model()) if f.severity != "note"}
    assert found["rare"] == "warning" and "error" not in found.values()
    wrench = record.command @ np.asarray(heavy.model().thrusters.configuration).T
    # MANUAL_CONTROL: x 1000 ahead at 903 s; z 1000, which is up, at 905 s.
    ahead, up = wrench[np.argmax(wrench[:, 0])], wrench[np.argmin(wrench[:, 2])]
    assert ahead[0] == pytest.approx(1.41, abs=0.01) and np.abs(ahead[2:]).max() < 0.1
    assert up[2] == pytest.approx(-2.0, abs=0.01) and np.abs(np.delete(up, 2)).max() < 0.1


def test_the_log_of_a_real_vehicle_on_the_bench(six, heavy):
    path = shared_folder("data", "ardusub_real") / "small.BIN"
    with pytest.raises(IdentificationError, match="thrusters never turn while armed"):
        read_record(path, six)
    with pytest.raises(IdentificationError, match="VECTORED has 6 motors, the vehicle has 8 thrusters"):
        read_record(path, heavy)
    raw = read_raw(path, SourceSpec.model_validate({"file": path.name}), six)
    imu, attitude = raw.tables["IMU"], raw.tables["ATT"]
    mounting = to_body(raw.signals["accelerometer"])  # AHRS_TRIM: 1.5 deg in roll and pitch
    force = mounting @ np.mean([imu.column(f"Acc{axis}") for axis in "XYZ"], axis=1)
    assert np.linalg.norm(force) == pytest.approx(9.81, abs=0.1)
    # A vehicle that rests shows gravity along its own axes: roll and pitch follow from it.
    roll, pitch = np.degrees([np.arctan2(-force[1], -force[2]), np.arctan2(force[0], np.hypot(*force[1:]))])
    assert roll == pytest.approx(attitude.column("Roll").mean(), abs=0.1)
    assert pitch == pytest.approx(attitude.column("Pitch").mean(), abs=0.1)
    assert raw.signals["depth"].table == "BARO[1]"  # the one in the water: BARO_PRIMARY 1


@pytest.mark.parametrize("booted", [60.0, 4300.0, 4280.0, 9000.0])
def test_a_clock_that_begins_again_every_71_minutes_goes_on(booted):
    """SERVO_OUTPUT_RAW has 32 bits of microseconds: 4300 s after the start its commands were 71 minutes early."""
    arrival = 1.7e9 + np.arange(0.0, 40.0, 0.5)
    since = booted + np.arange(0.0, 40.0, 0.5)
    blocks = {name: arrival[:, None] + 0.02 for name in ("ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT")}
    clocks = {"ATTITUDE": since, "SERVO_OUTPUT_RAW": np.mod(since, 2**32 * 1e-6), "HEARTBEAT": None}
    found = _on_one_epoch(blocks, clocks)
    np.testing.assert_allclose(found["SERVO_OUTPUT_RAW"], since)
    np.testing.assert_allclose(found["ATTITUDE"], since)
    assert found["HEARTBEAT"] is None
