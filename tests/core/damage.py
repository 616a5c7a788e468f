"""Logs that are damaged on purpose, and what the outside `mcap` library finds in their repair."""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import breakup_chunk

from rovtwin.core.log import Channel, LogWriter
from rovtwin.core.log.repair import Repair, repair

CHANNELS = (
    Channel("truth/eta", ("x", "y", "z", "phi", "theta", "psi"), ("m", "m", "m", "rad", "rad", "rad"), "n", rate=100.0),
    Channel("truth/nu", ("u", "v", "w", "p", "q", "r"), "m/s", "b", rate=100.0),
    Channel("autopilot/tau", ("X", "Y", "Z", "K", "M", "N"), "N", "b", rate=20.0),
    Channel("sensor/depth", ("depth",), "m", "n", rate=10.0),
    Channel("thrusters/command", tuple(f"t{k}" for k in range(8)), "1", "", rate=20.0),
)
Message = tuple[str, int, bytes]  # topic, time [ns], content


def write_log(path: Path, seconds: int, seed: int = 1) -> Path:
    """A log of five channels, 250 messages a second, in chunks of half a second as a run in real time has them."""
    random = np.random.default_rng(seed)
    with LogWriter(path, CHANNELS, {"seed": seed, "scenario": "vehicle: blueye\n" * 40}) as writer:
        for k in range(2 * seconds):
            for channel in CHANNELS:
                t = 0.5 * k + np.arange(round((channel.rate or 1) / 2)) / (channel.rate or 1)
                noise = random.normal(size=(len(t), len(channel.fields))).cumsum(axis=0)
                writer.write_many(channel.name, t, noise.round(3))
            writer.flush()
    return path


@dataclass(frozen=True)
class Original:
    """A whole log: its bytes, and the messages of each chunk by the bytes that the chunk fills."""

    content: bytes
    chunks: dict[tuple[int, int], Counter[Message]]

    @cached_property
    def every(self) -> Counter[Message]:
        """All messages."""
        return sum(self.chunks.values(), Counter())

    @property
    def data_end(self) -> int:
        """The first byte behind the data."""
        return self.content.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")

    def untouched(self, start: int, end: int) -> Counter[Message]:
        """Messages of the chunks that have none of some bytes."""
        touched = (found for (a, b), found in self.chunks.items() if a < end and start < b)
        return self.every - sum(touched, Counter())


def original(path: Path) -> Original:
    """What the outside library finds in a whole log."""
    content, chunks = path.read_bytes(), {}
    with open(path, "rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        topics = {number: channel.topic for number, channel in summary.channels.items()}
        for index in summary.chunk_indexes:
            stream.seek(index.chunk_start_offset + 9)
            messages = [m for m in breakup_chunk(Chunk.read(ReadDataStream(stream)), True) if hasattr(m, "log_time")]
            found = Counter((topics[m.channel_id], m.log_time, m.data) for m in messages)
            chunks[index.chunk_start_offset, index.chunk_start_offset + index.chunk_length] = found
    return Original(content, chunks)


def messages_in(path: Path) -> Counter[Message]:
    """All messages of a log as the outside library reads them, with its checks."""
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        return Counter((c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages(log_time_order=False))


def flipped(content: bytes, byte: int, bit: int) -> bytes:
    """A copy with one bit changed."""
    changed = bytearray(content)
    changed[byte] ^= 1 << bit
    return bytes(changed)


def erased(content: bytes, start: int, size: int) -> bytes:
    """A copy with a block of zeros, as a lost sector leaves it."""
    return content[:start] + bytes(min(size, len(content) - start)) + content[start + size :]


@dataclass(frozen=True)
class Outcome:
    """How a repair went: messages of chunks that were whole, how many of them it kept, and messages it made up."""

    whole: int
    kept: int
    invented: int
    saved: Repair | None

    @property
    def good(self) -> bool:
        """Whether it kept what it promises, and nothing else."""
        return self.kept == self.whole and not self.invented


def outcome(made: Original, damaged: bytes, start: int, end: int, folder: Path) -> Outcome:
    """Repair a damaged copy of a log, of which the bytes from start to end were changed."""
    bad = folder / "bad.mcap"
    bad.write_bytes(damaged)
    whole = made.untouched(start, end)
    try:
        saved = repair(bad, folder / "saved.mcap", overwrite=True)
    except Exception:  # whatever it is, nothing was saved: the promise is broken
        return Outcome(whole.total(), 0, 0, None)
    found = messages_in(saved.path)
    return Outcome(whole.total(), (whole & found).total(), (found - made.every).total(), saved)
