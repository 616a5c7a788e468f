"""The MCAP container: writing a chunked file from blocks of message records, and walking over the records of any file.

The record types are those of the `mcap` library. Its writer takes one message a call, 3 us each; a simulated run is
logged in blocks, which numpy packs five times faster, hence the small writer here.
"""

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BufferedWriter, BytesIO
from typing import BinaryIO, NamedTuple, TypeVar

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
DECLARED_EVERY = 64  # chunks: so often one repeats the declarations, under its checksum
FOOTER_SIZE = 9 + 20 + len(MAGIC)
_HEADER = struct.Struct("<BQ")
SHORTEST_MESSAGE = 22
_MESSAGE_HEADER = struct.Struct("<BQH")
_R = TypeVar("_R", bound=McapRecord)


class McapFile:
    """An MCAP file being written, chunk by chunk; every chunk is on its way to the disk when `chunk` returns."""

    def __init__(self, stream: BufferedWriter) -> None:
        self._stream = stream
        self._offset = self._crc = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.counts: dict[int, int] = {}
        self.end_time = 0
        self._kept = (0, 0, 0)  # bytes, their checksum and the last time [ns] that are with the operating system
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._append(MAGIC)
        self._append(_pack(Header(profile="ros2", library="rovtwin")))

    def schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; returns its number."""
        self._schemas.append(Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data))
        self._append(_pack(self._schemas[-1]))
        return len(self._schemas)

    def channel(self, topic: str, schema_id: int, encoding: str, metadata: dict[str, str]) -> int:
        """Add a channel; returns its number."""
        number = len(self._channels) + 1
        self._channels.append(
            Channel(id=number, topic=topic, message_encoding=encoding, schema_id=schema_id, metadata=metadata)
        )
        self._append(_pack(self._channels[-1]))
        return number

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        """Add a record of key-value metadata."""
        record = _pack(Metadata(name=name, metadata=entries))
        self._metadata.append(MetadataIndex(offset=self._offset, length=len(record), name=name))
        self._append(record)

    def chunk(self, data: bytes) -> None:
        """Write message records as one chunk with its index, and flush.

        Now and then the declarations stand in it once more: a killed file has no other copy.
        """
        if not data:
            return
        if len(self._chunks) % DECLARED_EVERY == 0:
            data = b"".join(map(_pack, (*self._schemas, *self._channels))) + data
        found = message_offsets(data).messages
        times = {channel: gather(data, offsets + 15, np.dtype("<u8")) for channel, offsets in found.items()}
        start, end = (int(f([f(t) for t in times.values()])) for f in (min, max))
        body = self._compressor.compress(data)
        record = _pack(
            Chunk(
                message_start_time=start,
                message_end_time=end,
                uncompressed_size=len(data),
                uncompressed_crc=zlib.crc32(data),
                compression="zstd",
                data=body,
            )
        )
        at = self._offset
        self._append(record)
        index_at, index_offsets = self._offset, {}
        for channel, offsets in found.items():
            index_offsets[channel] = self._offset
            self._append(_pack_message_index(channel, times[channel], offsets))
            self.counts[channel] = self.counts.get(channel, 0) + len(offsets)
        self._chunks.append(
            ChunkIndex(
                message_start_time=start,
                message_end_time=end,
                chunk_start_offset=at,
                chunk_length=len(record),
                message_index_offsets=index_offsets,
                message_index_length=self._offset - index_at,
                compression="zstd",
                compressed_size=len(body),
                uncompressed_size=len(data),
            )
        )
        self.end_time = max(self.end_time, end)
        self.flush()

    def flush(self) -> None:
        """Hand what was added so far to the operating system."""
        self._stream.flush()
        self._kept = (self._offset, self._crc, self.end_time)

    def end_early(self) -> int | None:
        """End a file that can't be written any further, as on a full disk: behind its last chunk, without an index.

        The stream is closed. Cutting off what is in part there makes room for the few bytes of the end.

        Returns:
            The last time in it [ns], or None when that doesn't work either.
        """
        size, crc, last = self._kept
        end = _pack(DataEnd(data_section_crc=crc)) + _pack(Footer(0, 0, 0)) + MAGIC
        try:
            os.ftruncate(self._stream.fileno(), size)
            written = os.pwrite(self._stream.fileno(), end, size)
            os.fsync(self._stream.fileno())
        except (OSError, ValueError):  # ValueError: it is closed already
            return None
        finally:
            self._stream.raw.close()  # past its buffer, which still holds what could not be written
        return last if written == len(end) else None

    def finish(self) -> None:
        """Write the index and the end of the file. The stream stays open."""
        self._append(_pack(DataEnd(data_section_crc=self._crc)))
        start, summary, offsets = self._offset, b"", []
        statistics = Statistics(
            message_count=sum(self.counts.values()),
            schema_count=len(self._schemas),
            channel_count=len(self._channels),
            attachment_count=0,
            metadata_count=len(self._metadata),
            chunk_count=len(self._chunks),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=self.end_time,
            channel_message_counts=self.counts,
        )
        for group in (self._schemas, self._channels, [statistics], self._chunks, self._metadata):
            block = b"".join(map(_pack, group))
            if block:
                offsets.append(
                    SummaryOffset(group_opcode=block[0], group_start=start + len(summary), group_length=len(block))
                )
            summary += block
        offset_start = start + len(summary)
        summary += b"".join(map(_pack, offsets))
        covered = summary + _HEADER.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", start, offset_start)
        footer = Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=zlib.crc32(covered))
        self._append(summary + _pack(footer) + MAGIC)
        self._stream.flush()

    def _append(self, data: bytes) -> None:
        self._stream.write(data)
        self._crc = zlib.crc32(data, self._crc)
        self._offset += len(data)


def _pack(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _pack_message_index(channel: int, times: np.ndarray, offsets: np.ndarray) -> bytes:
    entries = np.stack([times, offsets.astype(np.uint64)], axis=1).astype("<u8").tobytes()
    return _HEADER.pack(Opcode.MESSAGE_INDEX, 6 + len(entries)) + struct.pack("<HI", channel, len(entries)) + entries


class Contents(NamedTuple):
    """What a run of records holds: byte offsets of the message records by channel number, and the other records."""

    messages: dict[int, np.ndarray]
    others: list[tuple[int, bytes]]
    end: int


def message_offsets(data: bytes) -> Contents:
    """Find the records of a chunk; stops at the first incomplete one, whose offset is `end`.

    Raises:
        ValueError: A message is too short to be one.
    """
    found: dict[int, list[int]] = {}
    others: list[tuple[int, bytes]] = []
    position, end, unpack = 0, len(data), _MESSAGE_HEADER.unpack_from
    while position + _MESSAGE_HEADER.size <= end:
        opcode, length, channel = unpack(data, position)
        following = position + 9 + length
        if following > end:
            break
        if opcode == Opcode.MESSAGE and length < SHORTEST_MESSAGE:
            raise ValueError(f"a message of {length} bytes, expected at least {SHORTEST_MESSAGE}")
        if opcode != Opcode.MESSAGE:
            others.append((opcode, data[position + 9 : following]))
        elif channel in found:
            found[channel].append(position)
        else:
            found[channel] = [position]
        position = following
    return Contents({channel: np.array(offsets) for channel, offsets in found.items()}, others, position)


def gather(data: bytes, offsets: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Read one item at each byte offset, shape (N,): numpy picks from a view with a stride of one byte."""
    view = np.ndarray((len(data) - dtype.itemsize + 1,), dtype, data, strides=(1,))
    return view[offsets]


class Record(NamedTuple):
    """A record of a file: where it starts, its bytes, whether they are all there, and the checksum of all before."""

    offset: int
    opcode: int
    header: bytes
    content: bytes
    complete: bool
    crc: int


def iter_records(stream: BinaryIO) -> Iterator[Record]:
    """Walk over the records behind the magic, up to the footer or the end of the file, whichever comes first."""
    size = os.fstat(stream.fileno()).st_size
    offset, crc = stream.seek(len(MAGIC)), zlib.crc32(MAGIC)
    while len(header := stream.read(_HEADER.size)) == _HEADER.size:
        opcode, length = _HEADER.unpack(header)
        content = stream.read(min(length, size))
        complete = opcode != 0 and len(content) == length
        yield Record(offset, opcode, header, content, complete, crc)
        if opcode == Opcode.FOOTER or not complete:
            return
        offset += _HEADER.size + length
        crc = zlib.crc32(content, zlib.crc32(header, crc))


def parse(kind: type[_R], content: bytes) -> _R:
    """Read a record with the library.

    Raises:
        ValueError: The content is not such a record.
    """
    try:
        return kind.read(ReadDataStream(BytesIO(content)))  # pyright: ignore[reportAttributeAccessIssue]
    except (McapError, struct.error, UnicodeDecodeError) as error:
        raise ValueError(f"not a {kind.__name__} record: {error}") from error


def decompress(chunk: Chunk, partial: bool = False) -> bytes:
    """Records inside a chunk; with `partial`, as many as a cut-off chunk still gives.

    Raises:
        ValueError: The content is damaged or its compression is unknown.
    """
    try:
        data = _decompressor(chunk.compression)(chunk.data)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        if partial:
            return b""
        raise ValueError(f"cannot decompress: {error}") from error
    whole = len(data) == chunk.uncompressed_size
    if not (whole or partial) or (whole and chunk.uncompressed_crc not in (0, zlib.crc32(data))):
        raise ValueError("the checksum does not match")
    return data


def _decompressor(name: str) -> Callable[[bytes], bytes]:
    if name == "zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress
    if name == "lz4":
        return lz4.frame.LZ4FrameDecompressor().decompress
    if name == "":
        return bytes
    raise ValueError(f"compression {name!r} is unknown, expected zstd, lz4 or none")
