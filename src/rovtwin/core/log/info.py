"""What is in a log, from the index at its end: the messages aren't read."""

import os
import struct
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap import records
from mcap.opcode import Opcode

from rovtwin.core.datum import Datum, datum_of
from rovtwin.core.errors import LogError
from rovtwin.core.log import message
from rovtwin.core.log.channel import Channel
from rovtwin.core.log.mcapfile import FOOTER_SIZE, message_offsets, parse
from rovtwin.core.log.reader import Collector, Log, check_finished, open_mcap


@dataclass(frozen=True)
class ChannelInfo:
    """A channel in short.

    Rates are in Hz: `rate` is measured, `nominal_rate` declared. `first` and `last` [s] are None in an empty channel.
    """

    name: str
    messages: int
    rate: float | None
    unit: str | tuple[str, ...]
    frame: str
    fields: tuple[str, ...]
    first: float | None
    last: float | None
    nominal_rate: float | None
    description: str


@dataclass(frozen=True)
class LogInfo:
    """A log in short: channels as rows, provenance, what a reader leaves out, and where on Earth it is, if it says."""

    path: str
    size: int
    duration: float
    messages: int
    rows: tuple[ChannelInfo, ...]
    metadata: dict[str, str]
    notes: tuple[str, ...]
    datum: Datum | None


def info(path: str | Path) -> LogInfo:
    """Look at a log quickly. Only the index and the provenance are read; a file without index is read as a whole.

    Raises:
        LogError: The file is missing, not a log, unfinished or damaged.
    """
    path = Path(path)
    try:
        rows, collector = _from_index(path)
        metadata, notes = collector.metadata, collector.foreign.values()
    except ValueError:
        log = Log.read(path)
        metadata, notes = log.metadata, log.notes
        rows = [
            _row(series.channel, len(series), series.t[:1], series.t[-1:])
            for series in map(log.__getitem__, log.channels)
        ]
    ends = [time for row in rows for time in (row.first, row.last) if time is not None]
    return LogInfo(
        str(path),
        path.stat().st_size,
        max(ends) - min(ends) if ends else 0.0,
        sum(row.messages for row in rows),
        tuple(rows),
        metadata,
        tuple(sorted(notes)),
        datum_of(metadata),
    )


def summary(path: str | Path) -> dict[str, Any]:
    """The same as `info` in plain types, for JSON."""
    return asdict(info(path))


def log_of(path: Path) -> Path:
    """The log of a run by its folder; a file is its own.

    Raises:
        LogError: A folder without a log.
    """
    if not path.is_dir():
        return path
    if not (path / "log.mcap").is_file():
        raise LogError(f"{path}: found a folder without a log.mcap, expected that of a run, or a log")
    return path / "log.mcap"


def _from_index(path: Path) -> tuple[list[ChannelInfo], Collector]:
    """Raises ValueError when the index is missing or doesn't have it all."""
    with open_mcap(path) as stream:
        check_finished(stream, path)
        collector, chunks, statistics = Collector(path), [], None
        for opcode, content in index_records(stream):
            if opcode == Opcode.CHUNK_INDEX:
                chunks.append(parse(records.ChunkIndex, content))
            elif opcode == Opcode.STATISTICS:
                statistics = parse(records.Statistics, content)
            elif opcode == Opcode.METADATA_INDEX:
                collector.declare(
                    Opcode.METADATA, _content(stream, parse(records.MetadataIndex, content).offset, Opcode.METADATA)
                )
            else:
                collector.declare(opcode, content)
        names = [channel.name for channel in collector.channels.values()]
        if statistics is None or not names or len(set(names)) < len(names):
            raise ValueError("the index doesn't have it all")
        rows = [
            _row(channel, statistics.channel_message_counts.get(number, 0), *_span(stream, chunks, number))
            for number, channel in collector.channels.items()
        ]
    return rows, collector


def index_records(stream: BinaryIO) -> list[tuple[int, bytes]]:
    """Records of the index at the end of a file.

    Raises:
        ValueError: There is none, or it is damaged.
    """
    size = stream.seek(0, 2)
    stream.seek(size - FOOTER_SIZE)
    footer = stream.read(29)
    start, _, crc = struct.unpack("<QQI", footer[9:])
    if not 0 < start < size - FOOTER_SIZE:
        raise ValueError("no index")
    stream.seek(start)
    index = stream.read(size - FOOTER_SIZE - start)
    if crc not in (0, zlib.crc32(footer[:25], zlib.crc32(index))):
        raise ValueError("the checksum of the index does not match")
    return message_offsets(index).others


def _span(stream: BinaryIO, chunks: list[records.ChunkIndex], number: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] of a channel in the first and in the last chunk that has any; empty arrays when none has."""
    offsets = [chunk.message_index_offsets[number] for chunk in chunks if number in chunk.message_index_offsets]
    stamps = [
        np.frombuffer(_content(stream, offset, Opcode.MESSAGE_INDEX)[6:], "<u8")[::2]
        for offset in (offsets[:1] + offsets[-1:])
    ]
    first, last = stamps or [np.empty(0)] * 2
    return message.to_seconds(first), message.to_seconds(last)


def _content(stream: BinaryIO, offset: int, opcode: int) -> bytes:
    stream.seek(offset)
    header = stream.read(message.HEADER_SIZE)
    if len(header) < message.HEADER_SIZE or header[0] != opcode:
        raise ValueError("the index points at another record")
    return stream.read(min(int.from_bytes(header[1:], "little"), os.fstat(stream.fileno()).st_size))


def _row(channel: Channel, messages: int, first: np.ndarray, last: np.ndarray) -> ChannelInfo:
    if bool(messages) != bool(len(first)):
        raise ValueError("the index doesn't have all messages")
    start, end = (float(first.min()), float(last.max())) if messages else (0.0, 0.0)
    return ChannelInfo(
        channel.name,
        messages,
        (messages - 1) / (end - start) if end > start else None,
        channel.unit,
        channel.frame,
        channel.fields,
        start if messages else None,
        end if messages else None,
        channel.rate,
        channel.description,
    )
