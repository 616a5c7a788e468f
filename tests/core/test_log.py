"""Logs: what is written is what is read, by us and by others, also after a crash; bad input is named."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rovtwin.core.datum import Datum
from rovtwin.core.errors import LogError
from rovtwin.core.log import (
    Channel,
    Log,
    LogWriter,
    export_csv,
    export_map,
    export_netcdf,
    info,
    repair,
    summary,
)

POSITION = Channel("truth/position", ("x", "y", "z"), "m", "n", "origin of b", 100.0)
TAU = Channel("autopilot/tau", ("X", "N"), ("N", "N m"), "b")
PHASE = Channel("autopilot/phase", ("phase",), "1", "")
CHANNELS = (POSITION, TAU, PHASE)


@pytest.fixture
def log() -> Log:
    """Three channels with clocks of their own; `autopilot/phase` has a time twice."""
    t = np.arange(250) * 0.01
    wave = np.column_stack([np.sin(t), np.cos(t) / 3, -t])
    data = {
        "truth/position": (t, wave),
        "autopilot/tau": (t[::5] + 0.003, wave[::5, :2] * 1e5),
        "autopilot/phase": ([0.5, 1.5, 1.5], [0, 1, 2]),
    }
    return Log.from_arrays(CHANNELS, data, {"version": "0.1.0", "seed": 7, "configuration": "vehicle: blueye\n"})


@pytest.fixture
def path(log: Log, tmp_path: Path) -> Path:
    return log.write(tmp_path / "run.mcap")


# ------------------------------------------------------------------------------------------------------ round trip

NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,5}(/[A-Za-z][A-Za-z0-9_]{0,5}){0,2}", fullmatch=True)
FIELDS = st.lists(st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,4}", fullmatch=True), min_size=1, max_size=5, unique=True)


@st.composite
def logs(draw: st.DrawFn) -> Log:
    channels, data = [], {}
    for name in draw(st.lists(NAMES, min_size=1, max_size=4, unique=True)):
        fields = tuple(draw(FIELDS))
        units = draw(
            st.one_of(
                st.just("m/s2"),
                st.lists(st.sampled_from(["m", "1", "N m"]), min_size=len(fields), max_size=len(fields)).map(tuple),
            )
        )
        rate = draw(st.none() | st.floats(0.1, 1e4))
        channels.append(
            Channel(name, fields, units, draw(st.sampled_from(["n", "b", ""])), draw(st.text(max_size=9)), rate)
        )
        t = sorted(draw(st.lists(st.floats(0, 1e5), max_size=8)))
        data[name] = (t, draw(arrays(np.float64, (len(t), len(fields)), elements=st.floats(allow_nan=True))))
    return Log.from_arrays(channels, data, {"text": draw(st.text(st.characters(codec="utf-8"), max_size=9))})


@given(logs())
def test_a_log_survives_its_file_bit_for_bit(tmp_path_factory: pytest.TempPathFactory, made: Log) -> None:
    path = made.write(tmp_path_factory.mktemp("log") / "run.mcap")
    read = Log.read(path)
    assert read.differences(made) == []
    assert read.channels == made.channels
    assert read.metadata == made.metadata
    assert read.notes == ()
    for name in made:
        assert read[name].values.tobytes() == made[name].values.tobytes()
        assert read[name].t.tobytes() == made[name].t.tobytes()


def test_times_are_kept_to_the_nanosecond(tmp_path: Path) -> None:
    t = np.arange(42_000) / 42.0
    with LogWriter(tmp_path / "run.mcap", [PHASE]) as writer:
        writer.write_many("autopilot/phase", t, t)
    series = Log.read(tmp_path / "run.mcap")["autopilot/phase"]
    assert np.abs(series.t - t).max() <= 0.5e-9 + 1e-12
    assert series.values[:, 0].tobytes() == t.tobytes()
    assert 0.3 in Log.from_arrays([PHASE], {"autopilot/phase": ([0.1 + 0.2], [1])})["autopilot/phase"].t


def test_single_samples_blocks_and_arrays_give_the_same_log(log: Log, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "single.mcap", CHANNELS) as single, LogWriter(tmp_path / "many.mcap", CHANNELS) as many:
        for name in log:
            series = log[name]
            many.write_many(name, series.t[:40], series.values[:40])
            many.write_many(name, series.t[40:], series.values[40:])
            for t, sample in zip(series.t, series.values, strict=True):
                single.write(name, t, sample)
    assert Log.read(tmp_path / "single.mcap").differences(log) == []
    assert Log.read(tmp_path / "many.mcap").differences(log) == []


def test_a_block_larger_than_a_chunk(tmp_path: Path) -> None:
    t = np.arange(100_000) * 0.002
    values = np.random.default_rng(1).standard_normal((len(t), 3))
    with LogWriter(tmp_path / "run.mcap", [POSITION]) as writer:
        writer.write_many("truth/position", t, values)
    series = Log.read(tmp_path / "run.mcap")["truth/position"]
    assert series.values.tobytes() == values.tobytes() and np.abs(series.t - t).max() <= 0.5e-9 + 1e-12
    row = info(tmp_path / "run.mcap").rows[0]
    assert (row.messages, row.first, row.last) == (len(t), 0.0, series.t[-1]) and row.rate == pytest.approx(500.0)


def test_wall_clock_time_is_only_in_the_metadata(log: Log, tmp_path: Path) -> None:
    times = ["2026-01-01T00:00:00+00:00", "2031-06-01T12:00:00+00:00"]
    for k, created in enumerate(times):
        with LogWriter(tmp_path / f"{k}.mcap", CHANNELS, {"created": created}) as writer:
            for name in log:
                writer.write_many(name, log[name].t, log[name].values)
    first, second = (Log.read(tmp_path / f"{k}.mcap") for k in range(2))
    assert [first.metadata["created"], second.metadata["created"]] == times
    assert first.equal_data(second)


def test_a_difference_is_found_and_named(log: Log) -> None:
    data = {name: (log[name].t, np.array(log[name].values)) for name in log}
    data["autopilot/tau"][1][3, 1] = np.nextafter(data["autopilot/tau"][1][3, 1], 1e9)
    data["autopilot/phase"] = (data["autopilot/phase"][0][:2], data["autopilot/phase"][1][:2])
    other = Log.from_arrays([*CHANNELS, Channel("extra", ("a",), "1", "")], data)
    assert not log.equal_data(other)
    lines = log.differences(other)
    assert lines[0] == "extra: only in one of the logs"
    assert lines[1].startswith("autopilot/tau: sample 3 (t = 0.153 s): N is ")
    assert lines[2] == "autopilot/phase: 3 and 2 samples"
    assert not Log.from_arrays([PHASE], {"autopilot/phase": ([1], [0.0])}).equal_data(
        Log.from_arrays([PHASE], {"autopilot/phase": ([1], [-0.0])})
    )


# ---------------------------------------------------------------------------------------------------- looking at it


def test_the_face_of_a_log(log: Log) -> None:
    assert list(log) == [channel.name for channel in CHANNELS] and "truth/position" in log and "truth" not in log
    assert len(log["autopilot/tau"]) == 50 and log["truth/position"].values.shape == (250, 3)
    assert (log.field("truth/position", "z") == log["truth/position"].values[:, 2]).all()
    assert (log.start, log.end, log.duration) == (0.0, 2.49, 2.49)
    assert log.metadata["seed"] == "7" and log.metadata["configuration"] == "vehicle: blueye\n"
    with pytest.raises(ValueError, match="read-only"):
        log["truth/position"].values[0, 0] = 1.0
    with pytest.raises(LogError, match=r"no such channel: 'truth/positon'\. Did you mean 'truth/position'\?"):
        log["truth/positon"]
    with pytest.raises(LogError, match="channel 'autopilot/tau': no such field: 'K'. There is: X, N"):
        log.field("autopilot/tau", "K")


def test_from_arrays_copies(log: Log) -> None:
    values = np.zeros((1, 1))
    made = Log.from_arrays([PHASE], {"autopilot/phase": (np.zeros(1), values)})
    values[:] = 1.0
    assert made["autopilot/phase"].values[0, 0] == 0.0


def test_sample_interpolates_and_refuses_to_extrapolate() -> None:
    log = Log.from_arrays([TAU], {TAU.name: ([0, 1, 3], [[0, 10], [1, 20], [5, 20]])})
    assert log.sample(TAU.name, 2.0).tolist() == [3.0, 20.0]
    assert log.sample(TAU.name, [0.5, 1, 3]).tolist() == [[0.5, 15.0], [1.0, 20.0], [5.0, 20.0]]
    for t in (-0.1, 3.1, np.nan):
        with pytest.raises(LogError, match="outside of the channel, which has samples from 0.0 to 3.0 s"):
            log.sample(TAU.name, [1.0, t])


def test_info_reads_the_index_only(path: Path, log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = Log.read(path)
    monkeypatch.setattr(Log, "read", staticmethod(lambda path: pytest.fail("read the messages")))
    found = info(path)
    assert [row.name for row in found.rows] == list(slow.channels)
    position, tau, phase = found.rows
    assert (position.messages, position.first, position.last, position.unit, position.frame) == (
        250,
        0.0,
        2.49,
        "m",
        "n",
    )
    assert position.rate == pytest.approx(100.0) and position.nominal_rate == 100.0
    assert tau.rate == pytest.approx(20.0) and tau.unit == ("N", "N m") and tau.fields == ("X", "N")
    assert phase.rate == pytest.approx(2.0)
    assert found.metadata == slow.metadata and found.duration == 2.49 and found.messages == 303
    assert found.size == path.stat().st_size
    again = json.loads(json.dumps(summary(path), allow_nan=False))
    assert again["rows"][1]["fields"] == ["X", "N"] and again["metadata"]["seed"] == "7"


def test_info_of_a_log_without_samples(tmp_path: Path) -> None:
    found = info(Log.from_arrays(CHANNELS, {}).write(tmp_path / "run.mcap"))
    assert [(row.messages, row.rate, row.first) for row in found.rows] == [(0, None, None)] * 3
    assert found.duration == 0.0 and Log.read(tmp_path / "run.mcap").duration == 0.0


def test_looking_at_a_log_is_quick() -> None:
    code = (
        "import sys, rovtwin.core.log; print([m for m in ('jax', 'netCDF4', 'xarray', 'rosbags') if m in sys.modules])"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )


# -------------------------------------------------------------------------------------------------- other programs


def test_opens_in_rosbags(path: Path, log: Log) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([path]) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        assert kinds["/truth/position"] == "rovtwin_msgs/msg/TruthPosition"
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
        assert counts == {"/truth/position": 250, "/autopilot/tau": 50, "/autopilot/phase": 3}
        found = {name: [] for name in log}
        for connection, timestamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            assert message.stamp.sec * 10**9 + message.stamp.nanosec == timestamp
            fields = [field.lower() for field in log.channels[connection.topic[1:]].fields]
            found[connection.topic[1:]].append([timestamp / 1e9, *(getattr(message, field) for field in fields)])
    for name in log:
        assert np.array_equal(found[name], np.column_stack([log[name].t, log[name].values]))


def test_message_definitions_parse_as_ros_2_types() -> None:
    typesys = pytest.importorskip("rosbags.typesys")
    from rovtwin.core.log.message import message_definition, message_type

    channel = Channel("a/imu_0", ("X", "x", "stamp", "a__b_", "M_A"), ("N", "m", "s", "1", "kg m2"), "")
    name = message_type(channel, set())
    fields = typesys.get_types_from_msg(message_definition(channel), name)[name][1]
    assert name == "rovtwin_msgs/msg/AImu0"
    assert [field for field, _ in fields] == ["stamp", "x", "x_2", "stamp_2", "a_b", "m_a"]


def test_every_channel_has_a_type_of_its_own(tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    channels = [Channel("a/b_c", ("x",), "m", ""), Channel("a_b/c", ("x", "y"), "m", "")]
    data = {"a/b_c": ([1.0], [[1.0]]), "a_b/c": ([2.0], [[3.0, 4.0]])}
    path = Log.from_arrays(channels, data).write(tmp_path / "run.mcap")
    with highlevel.AnyReader([path]) as reader:
        messages = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()]
    assert messages[1].y == 4.0 and not hasattr(messages[0], "y")


def test_the_mcap_library_reads_it_through_the_index(path: Path, log: Log) -> None:
    from mcap.reader import make_reader

    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        index = reader.get_summary()
        assert index is not None and index.statistics is not None and index.statistics.message_count == 303
        times = [message.log_time for _, _, message in reader.iter_messages(topics=["/truth/position"])]
        sequences = [message.sequence for _, _, message in reader.iter_messages(topics=["/truth/position"])]
        some = list(reader.iter_messages(topics=["/truth/position"], starting_at=10**9, ending_before=2 * 10**9))
        assert next(iter(reader.iter_metadata())).metadata["seed"] == "7"
    assert times == [k * 10_000_000 for k in range(250)] and sequences == list(range(250)) and len(some) == 100


@pytest.mark.parametrize("options", [{}, {"use_chunking": False}, {"compression": "LZ4"}, {"compression": "NONE"}])
def test_reads_what_another_writer_made_of_it(path: Path, log: Log, tmp_path: Path, options: dict) -> None:
    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer

    if "compression" in options:
        options = {"compression": CompressionType[options["compression"]]}
    with open(path, "rb") as source, open(tmp_path / "other.mcap", "wb") as target:
        writer, reader = Writer(target, chunk_size=1000, **options), make_reader(source)
        writer.start()
        camera = writer.register_channel(
            "/camera", "cdr", writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"")
        )
        odd = writer.register_channel("/odd", "json", 0, {"fields": "[", "unit": "", "frame": ""})
        numbers: dict[str, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.topic not in numbers:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.topic] = writer.register_channel(channel.topic, "cdr", kind, channel.metadata)
            writer.add_message(numbers[channel.topic], message.log_time, message.data, message.publish_time)
            writer.add_message(camera, message.log_time, b"not a picture", message.publish_time)
            writer.add_message(odd, message.log_time, b"{}", message.publish_time)
        writer.finish()
    other = Log.read(tmp_path / "other.mcap")
    assert other.differences(log) == []
    assert other.notes == (
        "/camera: left out: sensor_msgs/msg/Image in ros2msg, messages in cdr",
        "/odd: left out: no schema, messages in json",
    )
    assert info(tmp_path / "other.mcap").notes == other.notes
    assert {row.name: row.messages for row in info(tmp_path / "other.mcap").rows} == {n: len(log[n]) for n in log}
    saved = repair(tmp_path / "other.mcap")
    assert saved.finished and saved.messages["camera"] == 303
    assert Log.read(saved.path).differences(log) == []


def test_messages_out_of_order_are_sorted_and_noted(path: Path, log: Log, tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap.writer import Writer

    with open(path, "rb") as source, open(tmp_path / "other.mcap", "wb") as target:
        writer, messages = (
            Writer(target),
            list(make_reader(source).iter_messages(topics="/truth/position", reverse=True)),
        )
        schema, channel, _ = messages[0]
        writer.start()
        kind = writer.register_schema(schema.name, schema.encoding, schema.data)
        number = writer.register_channel(channel.topic, "cdr", kind, channel.metadata)
        for _, _, message in messages:
            writer.add_message(number, message.log_time, message.data, message.publish_time)
        writer.finish()
    other = Log.read(tmp_path / "other.mcap")
    assert other["truth/position"].values.tobytes() == log["truth/position"].values.tobytes()
    assert other.notes == ("truth/position: messages were out of order, now sorted by time",)


# ------------------------------------------------------------------------------------------------- after an accident

KILLED = """
import sys, time
from rovtwin.core.log import Channel, LogWriter
writer = LogWriter(sys.argv[1], [Channel("clock", ("wall", "k"), "s", "")])
k = 0
while True:
    writer.write("clock", k * 1e-3, [time.time(), k])
    k += 1
    if k == 300:
        print("going", flush=True)
    time.sleep(0.001)
"""


def test_a_killed_run_loses_no_more_than_a_second(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "going\n"
    time.sleep(1.3)
    killed = time.time()
    process.send_signal(signal.SIGKILL)
    process.wait()
    with pytest.raises(LogError, match=f"unfinished.*rovtwin log repair {path}"):
        Log.read(path)
    before = path.read_bytes()
    saved = repair(path)
    assert path.read_bytes() == before and not saved.finished
    series = Log.read(saved.path)["clock"]
    assert saved.path == tmp_path / "run.repaired.mcap" and saved.messages == {"clock": len(series)}
    assert saved.last_time == series.t[-1]
    assert killed - series["wall"][-1] < 1.0
    assert (series["k"] == np.arange(len(series))).all()


FLUSHED = """
import os, sys
from rovtwin.core.log import Channel, LogWriter
writer = LogWriter(sys.argv[1], [Channel("clock", ("k",), "1", "")])
for k in range(100):
    writer.write("clock", k, k)
writer.flush()
os.kill(os.getpid(), 9)
"""


def test_after_flush_nothing_is_lost(tmp_path: Path) -> None:
    assert subprocess.run([sys.executable, "-c", FLUSHED, str(tmp_path / "run.mcap")]).returncode == -signal.SIGKILL
    assert repair(tmp_path / "run.mcap").messages == {"clock": 100}


def test_a_log_being_written_can_be_looked_at(log: Log, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, CHANNELS) as writer:
        writer.write("autopilot/phase", 1.0, 5)
        writer.flush()
        with pytest.raises(LogError, match="unfinished.*still goes on"):
            info(path)
        assert Log.read(repair(path).path)["autopilot/phase"]["phase"].tolist() == [5.0]
        writer.write("autopilot/phase", 2.0, 6)
    assert Log.read(path)["autopilot/phase"]["phase"].tolist() == [5.0, 6.0]


def test_an_exception_in_the_run_still_gives_a_whole_log(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), LogWriter(tmp_path / "run.mcap", [PHASE]) as writer:
        writer.write("autopilot/phase", 0.0, 1)
        raise KeyboardInterrupt
    assert len(Log.read(tmp_path / "run.mcap")["autopilot/phase"]) == 1


INTERRUPTED = """
import signal, sys
import numpy as np
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job starts deaf to it
from rovtwin.core.log import Channel, LogWriter
with LogWriter(sys.argv[1], [Channel("clock", ("k",), "1", "")]) as writer:
    for k in range(10**6):
        writer.write_many("clock", k + np.arange(1000) / 1000, 1000 * k + np.arange(1000))
        writer.flush()
        if k == 10:
            print("going", flush=True)
"""


@pytest.mark.parametrize("wait", [0.0, 0.01, 0.05, 0.1])
def test_ctrl_c_leaves_a_whole_log(tmp_path: Path, wait: float) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", INTERRUPTED, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "going\n"
            time.sleep(wait)
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=120) != 0
        finally:
            process.kill()
    series = Log.read(path)["clock"]
    assert len(series) >= 11_000 and (series["k"] == np.arange(len(series))).all()


def test_a_lock_that_ctrl_c_left_taken_does_not_hold_up_the_end(tmp_path: Path) -> None:
    """As when the interrupt strikes between taking the lock and entering the block that frees it."""
    path = tmp_path / "run.mcap"

    def interrupted() -> None:
        writer = LogWriter(path, [Channel("clock", ("k",), "1", "")])
        writer.write("clock", 0.0, [1.0])
        writer._lock.acquire()
        writer.close()

    thread = threading.Thread(target=interrupted, daemon=True)
    thread.start()
    thread.join(timeout=30)
    assert not thread.is_alive()
    assert len(Log.read(path)["clock"]) == 1


def is_prefix(part: Log, whole: Log) -> bool:
    return all(
        part[name].values.tobytes() == whole[name].values[: len(part[name])].tobytes()
        and part[name].t.tobytes() == whole[name].t[: len(part[name])].tobytes()
        for name in part
    )


@pytest.mark.system
def test_a_cut_file_gives_an_error_and_its_repair_a_prefix(log: Log, tmp_path: Path) -> None:
    path, cut = tmp_path / "run.mcap", tmp_path / "cut.mcap"
    with LogWriter(path, CHANNELS) as writer:
        for k in range(0, 250, 50):  # chunks of their own
            writer.write_many(
                "truth/position", log["truth/position"].t[k : k + 50], log["truth/position"].values[k : k + 50]
            )
            writer.flush()
    content, whole, kept = path.read_bytes(), Log.read(path), []
    for size in [*range(0, len(content), 97), *range(len(content) - 60, len(content))]:
        cut.write_bytes(content[:size])
        with pytest.raises(LogError):
            Log.read(cut)
        with pytest.raises(LogError):
            info(cut)
        try:
            saved = repair(cut, overwrite=True)
        except LogError:
            kept.append(-1)
            continue
        part = Log.read(saved.path)
        assert is_prefix(part, whole) and not saved.finished and saved.notes
        kept.append(len(part["truth/position"]) if "truth/position" in part else -1)
    assert kept == sorted(kept) and {-1, 0, 50, 100, 150, 200, 250} <= set(kept)


def test_the_messages_of_a_cut_chunk_are_saved(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    values = np.random.default_rng(3).standard_normal((9_000, 3))
    whole = Log.from_arrays([POSITION], {POSITION.name: (np.arange(9_000) * 1e-4, values)})
    whole.write(path)
    content = path.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
    saved = Log.read(repair(tmp_path / "cut.mcap").path)
    assert is_prefix(saved, whole) and 1_000 < len(saved[POSITION.name]) < 9_000


@pytest.mark.system
def test_a_changed_byte_is_noticed(path: Path, log: Log, tmp_path: Path) -> None:
    content, bad = path.read_bytes(), tmp_path / "bad.mcap"
    noticed = 0
    for offset in range(0, len(content), 41):
        changed = bytearray(content)
        changed[offset] ^= 0x55
        bad.write_bytes(changed)
        try:
            assert Log.read(bad).differences(log) == []
        except LogError:
            noticed += 1
        for use in (info, lambda path: repair(path, tmp_path / "saved.mcap", overwrite=True)):
            try:
                use(bad)
            except LogError:
                pass
    data_end = content.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")
    assert noticed >= data_end // 41  # every one before the index, which reading doesn't need


def test_a_damaged_chunk_costs_that_chunk_only(log: Log, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    position, sizes = log["truth/position"], []
    with LogWriter(path, [POSITION]) as writer:
        for k in range(0, 250, 50):
            sizes.append(path.stat().st_size)
            writer.write_many(POSITION.name, position.t[k : k + 50], position.values[k : k + 50])
            writer.flush()
    content = bytearray(path.read_bytes())
    content[sizes[2] + 200] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(LogError, match=r"damaged at byte \d+: .*rovtwin log repair"):
        Log.read(path)
    saved = repair(path)
    assert saved.messages == {POSITION.name: 200} and not saved.finished and "lost" in saved.notes[0]
    assert (Log.read(saved.path)[POSITION.name].t == np.delete(position.t, np.s_[100:150])).all()


def test_repair_keeps_provenance_and_refuses_to_overwrite(path: Path, log: Log, tmp_path: Path) -> None:
    saved = repair(path)
    again = Log.read(saved.path)
    assert saved.finished and saved.notes == () and again.metadata == log.metadata and again.equal_data(log)
    with pytest.raises(LogError, match="exists already"):
        repair(path)
    with pytest.raises(LogError, match="is the log itself"):
        repair(path, path, overwrite=True)
    assert sorted(tmp_path.iterdir()) == [path, saved.path]


# --------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "empty: 0 bytes"),
        (b"\x89MCA", "empty: 4 bytes"),
        (b"PK\x03\x04 and more", r"not an MCAP file: starts with b'PK\\x03\\x04 and', .*Is it a renamed zip\?"),
        (b"SQLite format 3\0", "a ROS 2 bag"),
        (b"\x89MCAP0\r\n", "unfinished"),
        (b"\x89MCAP0\r\n" * 20, "unfinished"),
    ],
)
def test_other_files_are_distinguished(tmp_path: Path, content: bytes, expected: str) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    for use in (Log.read, info):
        with pytest.raises(LogError, match=f"^{path}: .*{expected}"):
            use(path)
    with pytest.raises(LogError):
        repair(path)
    assert list(tmp_path.iterdir()) == [path]


def test_missing_files_and_folders(path: Path, tmp_path: Path) -> None:
    for use in (Log.read, info, repair):
        with pytest.raises(LogError, match=r"nothing\.mcap: no such file"):
            use(tmp_path / "nothing.mcap")
        with pytest.raises(LogError, match=r"is a folder, expected an MCAP file. Did you mean '.*run\.mcap'\?"):
            use(tmp_path)


def test_a_file_of_others_only(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with open(tmp_path / "run.mcap", "wb") as target:
        writer = Writer(target)
        writer.start()
        number = writer.register_channel("/camera", "json", 0)
        writer.add_message(number, 0, b"{}", 0)
        writer.finish()
    for use in (Log.read, info):
        with pytest.raises(LogError, match="no channels that rovtwin wrote, found /camera: left out"):
            use(tmp_path / "run.mcap")


def test_a_log_of_a_later_version(path: Path, log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rovtwin.core.log.writer.FORMAT", "2")
    log.write(tmp_path / "later.mcap")
    with pytest.raises(LogError, match="log format '2', this version of rovtwin reads '1'. Update rovtwin"):
        Log.read(tmp_path / "later.mcap")


@pytest.mark.parametrize(
    ("name", "t", "values", "expected"),
    [
        ("truth/positon", 1.0, [1, 2, 3], "no such channel: 'truth/positon'. Did you mean 'truth/position'"),
        (
            "truth/position",
            1.0,
            [1, 2],
            r"values of shape \(1, 2\), expected \(N,\) and \(N, 3\) for the fields x, y, z",
        ),
        ("truth/position", 1.0, [[1, 2, 3]], r"values of shape \(1, 1, 3\)"),
        ("truth/position", np.nan, [1, 2, 3], "t = nan s"),
        ("truth/position", np.inf, [1, 2, 3], "t = inf s"),
        ("truth/position", -1.0, [1, 2, 3], "t = -1.0 s at sample 0, expected seconds since the start"),
        ("truth/position", 2.0**31, [1, 2, 3], "Wall-clock time belongs in the metadata"),
        ("truth/position", 0.4, [1, 2, 3], "t = 0.4 s after t = 0.5 s: time goes backwards"),
    ],
)
def test_bad_samples_are_refused_and_the_log_stays_whole(tmp_path: Path, name, t, values, expected) -> None:
    with LogWriter(tmp_path / "run.mcap", [POSITION]) as writer:
        writer.write("truth/position", 0.5, [1, 2, 3])
        with pytest.raises(LogError, match=expected):
            writer.write(name, t, values)
        with pytest.raises(LogError, match=expected):
            writer.write_many(name, [t], [values])
        writer.write("truth/position", 0.5, [4, 5, 6])
    assert Log.read(tmp_path / "run.mcap")["truth/position"].values.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_time_within_a_block_goes_forward() -> None:
    with pytest.raises(LogError, match="t = 1.0 s after t = 2.0 s"):
        Log.from_arrays([PHASE], {"autopilot/phase": ([0, 2, 1], [0, 0, 0])})
    with pytest.raises(LogError, match="no such channel: 'phase'"):
        Log.from_arrays([PHASE], {"phase": ([0], [0])})


def test_writing_after_close(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap", [PHASE]) as writer:
        pass
    writer.close()
    for write in (
        lambda: writer.write("autopilot/phase", 0, 1),
        lambda: writer.write_many("autopilot/phase", [0], [1]),
    ):
        with pytest.raises(LogError, match="the log is closed"):
            write()


def test_where_a_log_cannot_be_written(path: Path, tmp_path: Path) -> None:
    for where, expected in [
        (path, "exists already. Choose another name, or replace it with overwrite=True"),
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "run.mcap", "No such file or directory. Create the folder first"),
        (path / "run.mcap", "Part of the path is a file"),
    ]:
        with pytest.raises(LogError, match=f"^{where}: .*{expected}"):
            LogWriter(where, [PHASE])
    LogWriter(path, [PHASE], overwrite=True).close()
    assert list(Log.read(path)) == ["autopilot/phase"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(LogError, match="Choose a folder you may write to"):
        LogWriter(tmp_path / "run.mcap", [PHASE])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LogError, match=r"No space left on device. Free some space"):
        LogWriter("/dev/full", [PHASE], overwrite=True)
    writer = LogWriter(tmp_path / "run.mcap", [PHASE])
    with open("/dev/full", "wb") as full:
        os.dup2(full.fileno(), writer._stream.fileno())  # the disk fills up during the run
        writer.write("autopilot/phase", 0.0, 1)
        for use in (writer.flush, lambda: writer.write("autopilot/phase", 1.0, 1), writer.close):
            with pytest.raises(LogError, match="No space left on device.*rovtwin log repair"):
                use()
    writer.close()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("truth position", ("x",), "m", "n"), "not a channel name"),
        (("0/x", ("x",), "m", "n"), "not a channel name"),
        (("a//b", ("x",), "m", "n"), "not a channel name"),
        (("a", (), "m", "n"), "expected one or more different names"),
        (("a", ("x", "x"), "m", "n"), "expected one or more different names"),
        (("a", ("x y",), "m", "n"), "expected one or more different names"),
        (("a", ("x", "y"), ("m",), "n"), "expected one unit, or one for each field"),
        (("a", ("x",), "", "n"), "write '1' for what has none"),
        (("a", ("x",), "m", "n", "", 0.0), "rate 0.0 Hz"),
    ],
)
def test_bad_channels_are_refused(arguments: tuple, expected: str) -> None:
    with pytest.raises(LogError, match=expected):
        Channel(*arguments)


def test_channels_are_compared_by_what_they_mean() -> None:
    assert Channel("a", ("x", "y"), ("m", "m"), "") == Channel("a", ("x", "y"), "m", "")
    assert Channel("a", ("x", "y"), "m", "").units == ("m", "m")
    assert Channel("a", "x", "m", "").fields == ("x",)
    with pytest.raises(LogError, match="channel 'a': declared twice"):
        Log.from_arrays([Channel("a", ("x",), "m", ""), Channel("a", ("y",), "m", "")], {})


# ------------------------------------------------------------------------------------------------------------ export


def test_netcdf_opens_in_xarray(path: Path, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    log = Log.read(path)
    out = export_netcdf(log, tmp_path / "run.nc", title="A test")
    with xarray.open_dataset(out) as data:
        assert data.attrs["Conventions"] == "CF-1.11" and data.attrs["title"] == "A test"
        assert "run.mcap" in data.attrs["history"] and data.attrs["source"] == "rovtwin 0.1.0"
        assert data.attrs["rovtwin_seed"] == "7" and data.attrs["rovtwin_configuration"] == "vehicle: blueye\n"
        for name, channel in log.channels.items():
            flat = name.replace("/", "_")
            for field, unit in zip(channel.fields, channel.units, strict=True):
                variable = data[f"{flat}_{field}"]
                assert variable.values.tobytes() == np.ascontiguousarray(log.field(name, field)).tobytes()
                assert variable.attrs["units"] == unit and variable.attrs.get("frame", "") == channel.frame
                assert variable.attrs["long_name"] == f"{name} {field}"
                assert variable[f"{flat}_time"].values.tobytes() == log[name].t.tobytes()
                assert variable[f"{flat}_time"].attrs["units"] == "s"
        assert data.truth_position_x.sel(truth_position_time=1.0).item() == np.sin(1.0)
        assert data.truth_position_x.dims == ("truth_position_time",)
        assert data.autopilot_phase_phase.dims == ("autopilot_phase_sample",)  # it has a time twice


def test_netcdf_names_do_not_collide(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    channels = [Channel("a", ("b_c", "time"), "m", ""), Channel("a/b", ("c",), "s", "")]
    log = Log.from_arrays(channels, {"a": ([0.0], [[1.0, 2.0]]), "a/b": ([5.0], [[3.0]])})
    with xarray.open_dataset(export_netcdf(log, tmp_path / "run.nc")) as data:
        assert {name: data[name].item() for name in data.variables} == {
            "a_time": 0.0, "a_b_c": 1.0, "a_time_2": 2.0, "a_b_time": 5.0, "a_b_c_2": 3.0,
        }  # fmt: skip


# --------------------------------------------------------------------------------------------------------------- maps

ETA = ("x", "y", "z", "phi", "theta", "psi")
DATUM = Datum(63.45, 10.36, 40.0, "2021-06-01T10:00:00Z")
MISSION = [{"position": [6.0, 0.0, 3.0], "speed": 0.2}, {"position": [6.0, 3.0, 3.0]}]


@pytest.fixture
def flown() -> Log:
    """Truth and estimate on a circle at 3 m depth, with a datum and way-points."""
    t = np.arange(100) * 0.1
    pose = np.column_stack([50 * np.sin(t), 50 * np.cos(t), 3 + 0 * t, 0 * t, 0 * t, t])
    units = ("m",) * 3 + ("rad",) * 3
    channels = [Channel(name, ETA, units, "n", rate=10.0) for name in ("truth/eta", "autopilot/eta")]
    metadata = {"name": "circle", "datum": DATUM.metadata(), "mission": MISSION}
    return Log.from_arrays([*channels, PHASE], {"truth/eta": (t, pose), "autopilot/eta": (t, pose + 0.25)}, metadata)


def test_netcdf_has_the_tracks_on_the_map(flown: Log, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(export_netcdf(flown, tmp_path / "run.nc")) as data:
        assert data.attrs["utc_start"] == data.attrs["time_coverage_start"] == "2021-06-01T10:00:00Z"
        assert json.loads(data.attrs["rovtwin_datum"])["height"] == 40.0
        for name in ("truth_eta", "autopilot_eta"):
            latitude, longitude = data[f"{name}_latitude"], data[f"{name}_longitude"]
            for variable, what in ((latitude, "latitude"), (longitude, "longitude")):
                assert variable.attrs["standard_name"] == what
                assert variable.dims == (f"{name}_time",)
            assert latitude.attrs["units"] == "degrees_north" and longitude.attrs["units"] == "degrees_east"
            depth = data[f"{name}_z"]
            assert {f"{name}_latitude", f"{name}_longitude"} <= set(depth.coords)
            assert depth.attrs.get("grid_mapping", depth.encoding.get("grid_mapping")) == "crs"
            place = DATUM.position(latitude, longitude, depth)
            np.testing.assert_allclose(place, flown[name.replace("_", "/")].values[:, :3], rtol=0, atol=1e-6)
        crs = data["crs"].attrs
        assert crs["grid_mapping_name"] == "latitude_longitude" and crs["semi_major_axis"] == 6378137.0
        assert crs["inverse_flattening"] == pytest.approx(298.257223563)
        assert "autopilot_phase_latitude" not in data
        assert data["truth_eta_time"].attrs["units"] == "s"  # relative still


def test_netcdf_without_a_datum_has_no_map(log: Log, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(export_netcdf(log, tmp_path / "run.nc")) as data:
        assert "crs" not in data and "utc_start" not in data.attrs


def test_geojson_is_that_of_rfc_7946(flown: Log, tmp_path: Path) -> None:
    found = json.loads(export_map(flown, tmp_path / "track.geojson").read_text())
    assert found["type"] == "FeatureCollection" and found["name"] == "circle" and found["datum"]["latitude"] == 63.45
    kinds = [(f["geometry"]["type"], f["properties"]["name"], f["properties"]["kind"]) for f in found["features"]]
    assert kinds == [("LineString", "truth", "track"), ("LineString", "estimate", "track"),
                     ("Point", "1", "way-point"), ("Point", "2", "way-point")]  # fmt: skip
    assert all(feature["type"] == "Feature" for feature in found["features"])
    truth, estimate, first, _ = found["features"]
    longitude, latitude, height = np.array(truth["geometry"]["coordinates"]).T
    np.testing.assert_allclose(longitude, 10.36, atol=0.01)  # longitude first
    place = DATUM.position(latitude, longitude, 40.0 - height)
    np.testing.assert_allclose(place, flown["truth/eta"].values[:, :3], rtol=0, atol=1e-3)
    assert truth["properties"]["utc_start"] == "2021-06-01T10:00:00.000Z"
    assert truth["properties"]["utc_end"] == "2021-06-01T10:00:09.900Z"
    assert len(estimate["geometry"]["coordinates"]) == 100
    point = first["geometry"]["coordinates"]
    np.testing.assert_allclose(DATUM.position(point[1], point[0], 40.0 - point[2]), [6, 0, 3], rtol=0, atol=1e-3)
    assert first["properties"]["depth_m"] == 3.0


def test_gpx_and_kml_say_the_same(flown: Log, tmp_path: Path) -> None:
    json_rows = json.loads(export_map(flown, tmp_path / "t.geojson").read_text())["features"][0]["geometry"]
    gpx = ElementTree.parse(export_map(flown, tmp_path / "t.gpx")).getroot()
    space = {"g": "http://www.topografix.com/GPX/1/1", "k": "http://www.opengis.net/kml/2.2"}
    points = gpx.findall("g:trk[g:name='truth']/g:trkseg/g:trkpt", space)
    rows = [[float(p.attrib["lon"]), float(p.attrib["lat"])] for p in points]
    assert rows == [row[:2] for row in json_rows["coordinates"]]
    assert points[15].findtext("g:time", namespaces=space) == "2021-06-01T10:00:01.500Z"
    assert points[15].findtext("g:ele", namespaces=space) == "-3.000"
    assert [w.findtext("g:name", namespaces=space) for w in gpx.findall("g:wpt", space)] == ["1", "2"]
    kml = ElementTree.parse(export_map(flown, tmp_path / "t.kml")).getroot()
    marks = kml.findall("k:Document/k:Placemark", space)
    assert [mark.findtext("k:name", namespaces=space) for mark in marks] == ["truth", "estimate", "1", "2"]
    line = marks[0].findtext("k:LineString/k:coordinates", namespaces=space)
    assert line is not None
    assert [[float(v) for v in row.split(",")[:2]] for row in line.split()] == rows


def test_a_track_over_the_date_line_does_not_jump(tmp_path: Path) -> None:
    t = np.arange(3.0)
    channel = Channel("truth/eta", ETA, "m", "n")
    pose = np.zeros((3, 6))
    pose[:, 1] = [-100, 0, 100]
    log = Log.from_arrays([channel], {"truth/eta": (t, pose)}, {"datum": Datum(-17.0, 180.0).metadata()})
    rows = json.loads(export_map(log, tmp_path / "t.geojson").read_text())["features"][0]["geometry"]["coordinates"]
    assert np.abs(np.diff([row[0] for row in rows])).max() < 0.01
    gpx = ElementTree.parse(export_map(log, tmp_path / "t.gpx")).getroot()
    longitudes = [float(p.attrib["lon"]) for p in gpx.iter("{http://www.topografix.com/GPX/1/1}trkpt")]
    assert longitudes[0] > 179.9 and longitudes[2] < -179.9
    assert {p.text for p in gpx.iter("{http://www.topografix.com/GPX/1/1}ele")} == {"0.000"}


def test_what_cannot_be_drawn_on_a_map(log: Log, flown: Log, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="log: has no datum"):
        export_map(log, tmp_path / "t.geojson")
    with pytest.raises(LogError, match=r"found the ending '.shp', expected .geojson, .gpx, .kml"):
        export_map(flown, tmp_path / "t.shp")
    bare = Log.from_arrays(CHANNELS, {}, {"datum": DATUM.metadata(), "mission": "not JSON"})
    with pytest.raises(LogError, match="nothing to draw"):
        export_map(bare, tmp_path / "t.kml")
    assert not list(tmp_path.iterdir())
    one = Log.from_arrays([Channel("truth/eta", ETA, "m", "n")], {"truth/eta": ([0.0, 1.0], [[0.0] * 6, [np.nan] * 6])},
                          {"datum": DATUM.metadata()})  # fmt: skip
    (feature,) = json.loads(export_map(one, tmp_path / "t.geojson").read_text())["features"]
    assert feature["geometry"]["type"] == "Point"


def test_info_knows_the_datum(flown: Log, log: Log, tmp_path: Path) -> None:
    assert info(flown.write(tmp_path / "flown.mcap")).datum == DATUM
    assert summary(tmp_path / "flown.mcap")["datum"]["longitude"] == 10.36
    assert info(log.write(tmp_path / "log.mcap")).datum is None


def test_csv_keeps_every_digit(log: Log, tmp_path: Path) -> None:
    written = export_csv(log, tmp_path / "csv")
    assert sorted(file.name for file in written) == [
        "autopilot_phase.csv", "autopilot_tau.csv", "channels.csv", "metadata.json", "truth_position.csv",
    ]  # fmt: skip
    assert (tmp_path / "csv" / "autopilot_tau.csv").read_text().startswith("t [s],X [N],N [N m]\n")
    for name in log:
        rows = np.loadtxt(tmp_path / "csv" / f"{name.replace('/', '_')}.csv", delimiter=",", skiprows=1, ndmin=2)
        assert rows.tobytes() == np.column_stack([log[name].t, log[name].values]).tobytes()
    with open(tmp_path / "csv" / "channels.csv", newline="") as stream:
        table = {row["channel"]: row for row in csv.DictReader(stream)}
    assert table["autopilot/tau"]["unit"] == "N; N m" and table["truth/position"]["frame"] == "n"
    assert json.loads((tmp_path / "csv" / "metadata.json").read_text())["seed"] == "7"


def test_csv_of_one_channel(log: Log, tmp_path: Path) -> None:
    assert export_csv(log, tmp_path / "phase.csv", channel="autopilot/phase") == [tmp_path / "phase.csv"]
    assert (tmp_path / "phase.csv").read_text() == "t [s],phase [1]\n0.5,0.0\n1.5,1.0\n1.5,2.0\n"
    with pytest.raises(LogError, match="no such channel"):
        export_csv(log, tmp_path / "x.csv", channel="phase")


def test_exports_refuse_to_overwrite(log: Log, tmp_path: Path) -> None:
    (tmp_path / "run.nc").write_text("mine")
    (tmp_path / "csv").mkdir()
    (tmp_path / "csv" / "channels.csv").write_text("mine")
    with pytest.raises(LogError, match=r"run\.nc: exists already"):
        export_netcdf(log, tmp_path / "run.nc")
    with pytest.raises(LogError, match=r"channels\.csv: exists already"):
        export_csv(log, tmp_path / "csv")
    assert (tmp_path / "run.nc").read_text() == "mine" and len(list((tmp_path / "csv").iterdir())) == 1
    export_netcdf(log, tmp_path / "run.nc", overwrite=True)
    export_csv(log, tmp_path / "csv", overwrite=True)
    assert (tmp_path / "run.nc").read_bytes()[:4] == b"\x89HDF" and len(list((tmp_path / "csv").iterdir())) == 5
    for export in (export_netcdf, export_csv):
        with pytest.raises(LogError, match="Create"):
            export(log, tmp_path / "no" / "folder")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["csv", "run.nc"]


def test_what_is_known_only_at_the_end_is_in_the_metadata(tmp_path):
    path = tmp_path / "run.mcap"
    with LogWriter(path, [Channel("a", ("x",), "m", "n")], {"seed": 1, "verdict": "flying"}) as writer:
        writer.write("a", 0.0, [1.0])
        writer.annotate({"verdict": "completed", "figures": {"rms": 0.5}})
    metadata = Log.read(path).metadata
    assert metadata["verdict"] == "completed" and metadata["figures"] == '{"rms": 0.5}' and metadata["seed"] == "1"
    assert info(path).metadata == metadata
    with pytest.raises(LogError, match="closed"):
        writer.annotate({"more": 1})


def test_the_page_interpolates_a_heading_across_half_a_turn(tmp_path, monkeypatch):
    """Its code for reading, on a log whose heading passes +-pi between two samples."""
    page = (Path(__file__).parents[2] / "docs" / "logs.md").read_text()
    code = re.search(r"## Reading in Python\n\n```python\n(.*?)```", page, re.S)[1]
    t, six = np.array([0.0, 2.0, 3.0]), tuple("abcdef")
    eta = np.zeros((3, 6))
    eta[:, 5] = [3.0, 3.1, 3.1 + 0.2 - 2 * np.pi]
    channels = [
        Channel("truth/eta", ("x", "y", "z", "phi", "theta", "psi"), "1", "n"),
        Channel("truth/nu", six, "1", "b"),
    ]
    log = Log.from_arrays(channels, {"truth/eta": (t, eta), "truth/nu": (t, eta)}, {"scenario": "a: 1"})
    log.write(tmp_path / "run.mcap")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(code, names)
    np.testing.assert_allclose(names["psi"], [3.05, 3.2])
