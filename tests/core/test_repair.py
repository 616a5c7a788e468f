"""`rovtwin log repair`: whatever one damage hits, every message of a chunk that is whole is kept."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from tests.core.damage import CHANNELS, Original, erased, flipped, messages_in, original, outcome, write_log

from rovtwin.core.errors import LogError
from rovtwin.core.log import Log, repair
from rovtwin.core.log.pictures import PictureWriter, read_pictures


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Original:
    return original(write_log(tmp_path_factory.mktemp("whole") / "run.mcap", 3))


def places(made: Original, content: bytes) -> list[int]:
    """Bytes of all kinds: anywhere, of the declarations, and of the kind and the length of each chunk."""
    random, first = np.random.default_rng(4), min(a for a, _ in made.chunks)
    heads = [a + int(k) for a, _ in sorted(made.chunks) for k in random.integers(0, 53, 2) if a + 53 < len(content)]
    return [*random.integers(0, len(content), 25).tolist(), *random.integers(0, first, 25).tolist(), *heads]


@pytest.mark.system
@pytest.mark.parametrize("killed", [False, True])
def test_one_bit_costs_no_more_than_its_chunk(made: Original, tmp_path: Path, killed: bool) -> None:
    content = made.content[: made.data_end] if killed else made.content
    random = np.random.default_rng(5)
    for at in places(made, content):
        found = outcome(made, flipped(content, at, int(random.integers(8))), at, at + 1, tmp_path)
        assert found.good, at
        assert found.saved is not None and found.saved.notes and Log.read(found.saved.path), at


@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.parametrize("size", [100, 4096])
def test_a_lost_block_costs_no_more_than_its_chunks(made: Original, tmp_path: Path, killed: bool, size: int) -> None:
    content = made.content[: made.data_end] if killed else made.content
    earliest = min(a for a, _ in made.chunks) if killed else 0  # without an index, something has to declare channels
    for start in np.random.default_rng(6).integers(earliest, len(content) - size, 10).tolist():
        found = outcome(made, erased(content, start, size), start, start + size, tmp_path)
        assert found.good and found.saved is not None and Log.read(found.saved.path), start


def test_a_changed_length_costs_nothing(made: Original, tmp_path: Path) -> None:
    """What was measured: 26,964 of 275,412 messages kept; with one bit of the header, none."""
    chunk = sorted(made.chunks)[2][0]
    for at in (9, 10, 11, 13, chunk + 1, chunk + 2, chunk + 4, chunk + 46):  # of the header, and of a chunk
        for bit in (0, 6):
            found = outcome(made, flipped(made.content, at, bit), at, at + 1, tmp_path)
            assert found.saved is not None and sum(found.saved.messages.values()) == made.every.total(), (at, bit)
            assert found.saved.lost == 0 and not found.saved.finished


def test_a_chunk_of_another_kind_is_still_a_chunk(made: Original, tmp_path: Path) -> None:
    """One bit makes it an end of the file, which must not end the search for more."""
    for start, _ in sorted(made.chunks):
        for bit in range(8):
            found = outcome(made, flipped(made.content, start, bit), start, start + 1, tmp_path)
            assert found.saved is not None and sum(found.saved.messages.values()) == made.every.total(), (start, bit)


def test_what_was_lost_has_its_time(made: Original, tmp_path: Path) -> None:
    start, end = sorted(made.chunks)[3]
    found = outcome(made, flipped(made.content, (start + end) // 2, 3), start, end, tmp_path)
    assert found.saved is not None and found.saved.lost == made.chunks[start, end].total()
    assert found.saved.notes == (
        f"lost the chunk at byte {start}, 1.5 to 1.99 s: {found.saved.notes[0].split(': ')[1]}",
    )
    found = outcome(made, erased(made.content, start - 10, end - start + 20), start - 10, end + 10, tmp_path)
    assert any(f"lost the chunk at byte {start}, 1.5 to 1.99 s" in note for note in found.saved.notes)  # by the index


def test_a_damaged_checksum_costs_nothing(made: Original, tmp_path: Path) -> None:
    start, end = sorted(made.chunks)[3]
    found = outcome(made, flipped(made.content, start + 34, 2), start, end, tmp_path)
    assert found.saved is not None and sum(found.saved.messages.values()) == made.every.total()
    found = outcome(made, erased(made.content, start, 53), start, end, tmp_path)  # the header with its checksum
    assert found.saved is not None and sum(found.saved.messages.values()) == made.every.total()
    assert any("no header; the index behind it agrees" in note for note in found.saved.notes)


def test_zeros_that_a_power_cut_leaves(made: Original, tmp_path: Path) -> None:
    start, end = sorted(made.chunks)[-1]
    content = made.content[: (start + end) // 2] + bytes(20_000)
    found = outcome(made, content, start, end, tmp_path)
    assert found.good and found.saved is not None and "cut off or damaged" in found.saved.notes[0]


def test_cut_at_both_ends(made: Original, tmp_path: Path) -> None:
    """Without beginning and index, the channels are those that a chunk repeats."""
    start = made.content.index(b"\x04", 200)
    content = flipped(made.content[: made.data_end - 900], start, 1)
    found = outcome(made, content, made.data_end - 900, made.data_end, tmp_path)
    assert found.good


def rewritten(made: Original, path: Path, **options: object) -> Original:
    """The same messages as another program writes them."""
    path.with_suffix(".ours").write_bytes(made.content)
    with open(path.with_suffix(".ours"), "rb") as source, open(path, "wb") as target:
        writer, numbers = Writer(target, chunk_size=10_000, **options), {}  # pyright: ignore[reportArgumentType]
        writer.start("ros2", "another program")
        for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
            if channel.topic not in numbers:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.topic] = writer.register_channel(channel.topic, "cdr", kind, channel.metadata)
            writer.add_message(numbers[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    return original(path)


@pytest.mark.system
@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_every_compression(made: Original, tmp_path: Path, compression: CompressionType) -> None:
    other = rewritten(made, tmp_path / "other.mcap", compression=compression)
    random = np.random.default_rng(7)
    for at in places(other, other.content):
        assert outcome(other, flipped(other.content, at, int(random.integers(8))), at, at + 1, tmp_path).good, at
    for start in random.integers(8, len(other.content) - 4096, 8).tolist():
        assert outcome(other, erased(other.content, start, 4096), start, start + 4096, tmp_path).good, start


def test_messages_outside_of_chunks(made: Original, tmp_path: Path) -> None:
    """Nothing but their place speaks for them: one changed length costs that message, not those behind it."""
    path = tmp_path / "loose.mcap"
    rewritten(made, path, use_chunking=False)
    content, every = path.read_bytes(), messages_in(path)
    starts = [k for k in range(8, made.data_end) if content[k : k + 4] == b"\x05\x52\0\0"][100:600:90]
    assert starts
    for at in starts:
        path.write_bytes(flipped(content, at + 2, 1))
        saved = repair(path, tmp_path / "saved.mcap", overwrite=True)
        found = messages_in(saved.path)
        assert found <= every and (every - found).total() <= 1


def test_pictures_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "camera.mcap"
    with PictureWriter(path, "port") as pictures:
        for k in range(20):
            pictures.write(0.1 * k, 0.1 * k, bytes([k]) * 1000)
    content = path.read_bytes()
    path.write_bytes(flipped(content, content.index(b"\x28\xb5\x2f\xfd", 2500) - 50, 4))
    saved = repair(path)
    assert sum(saved.messages.values()) == 20 and len(list(read_pictures(saved.path))) == 20


@pytest.mark.parametrize("harm", [lambda content: content, lambda content: content[:-200]])
def test_another_programs_log_is_left_as_it_is(tmp_path: Path, harm: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "theirs.mcap"
    with open(path, "wb") as target:
        writer = Writer(target)
        writer.start("ros2", "recorder 3")
        number = writer.register_channel("/imu", "json", 0)
        for k in range(50):
            writer.add_message(number, k, b"{}", k)
        writer.finish()
    path.write_bytes(harm(path.read_bytes()))
    with pytest.raises(LogError, match=r"another program's log \(recorder 3\): found the channels /imu, expected one"):
        repair(path)
    assert list(tmp_path.iterdir()) == [path]


def test_provenance_survives_a_letter(made: Original, tmp_path: Path) -> None:
    at = made.content.index(b"vehicle: blueye")
    found = outcome(made, flipped(made.content, at, 7), at, at + 1, tmp_path)
    assert found.saved is not None and "letters of the metadata 'rovtwin' were damaged" in found.saved.notes
    assert Log.read(found.saved.path).metadata["seed"] == "1"
    found = outcome(made, flipped(made.content, at, 0), at, at + 1, tmp_path)
    assert "a checksum differs" in found.saved.notes[0]


def test_lost_declarations_are_named(made: Original, tmp_path: Path) -> None:
    """Both copies of a channel are gone, and so is the index."""
    content = made.content[: made.data_end]
    declared, chunk = content.index(b"/truth/nu") - 17, sorted(made.chunks)[0]
    content = erased(erased(content, declared, 60), chunk[0], chunk[1] - chunk[0])
    (tmp_path / "bad.mcap").write_bytes(content)
    saved = repair(tmp_path / "bad.mcap")
    assert any("whose declaration is lost" in note for note in saved.notes)
    assert set(Log.read(saved.path)) == {channel.name for channel in CHANNELS} - {"truth/nu"}
