"""What is whole of a damaged log, copied into a new one."""

import zlib
from collections import Counter
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap import records
from mcap.opcode import Opcode

from rovtwin.core.log import message
from rovtwin.core.log.chunks import Piece
from rovtwin.core.log.info import index_records
from rovtwin.core.log.mcapfile import DECLARED_EVERY, MAGIC, McapFile, gather, message_offsets, parse
from rovtwin.core.log.pictures import TYPE
from rovtwin.core.log.reader import check_start, is_finished
from rovtwin.core.log.scan import Scanner

_CHUNK_SIZE = 1 << 20
_DECLARATIONS: dict[int, type[records.McapRecord]] = {
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.METADATA: records.Metadata,
}
_INDEXED: dict[int, type[records.McapRecord]] = {
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.CHUNK_INDEX: records.ChunkIndex,
    Opcode.STATISTICS: records.Statistics,
}


class Salvage:
    """Copies what is whole of a broken file into a new one. Schemas and channels may get other numbers on the way."""

    def __init__(self, file: McapFile) -> None:
        self.file = file
        self.schemas: dict[int, int] = {0: 0}
        self.channels: dict[int, int] = {}
        self.topics: dict[int, str] = {}
        self.readable = False  # whether there is a channel that rovtwin reads
        self.library = ""
        self.lost: int | None = None
        self.notes: list[str] = []
        self._complete = False  # whether the index declares all channels
        self._sizes: dict[int, int] = {}  # of the message records of our channels
        self._pictures: set[int] = set()  # schemas
        self._types: set[str] = set()
        self._strangers: Counter[int] = Counter()
        self._misfits = 0
        self._pending = bytearray()

    def take(self, stream: BinaryIO, path: Path) -> None:
        """Save what can be saved of a file.

        Raises:
            LogError: It isn't MCAP.
        """
        finished = is_finished(stream)
        index = self._index(stream, finished)
        self._check_magic(stream, path, finished)
        for record in index or _declared_again(stream):  # a checksum covers it; one that stands by itself has none
            self._declare(record)
        statistics = [one for one in index if isinstance(one, records.Statistics)]
        self._complete = any(one.channel_count == len(self.channels) for one in statistics)
        chunks = {one.chunk_start_offset: one for one in index if isinstance(one, records.ChunkIndex)}
        scanner = Scanner(stream, {at: chunk.chunk_length for at, chunk in chunks.items()})
        crc = zlib.crc32(MAGIC)
        for piece in scanner.pieces():
            self._add(piece)
            if piece.opcode == Opcode.CHUNK:
                chunks.pop(piece.offset, None)
            end = piece.record
            if isinstance(end, records.DataEnd) and not self.notes and end.data_section_crc not in (0, crc):
                self.notes.append("something outside of the chunks was changed, maybe provenance: a checksum differs")
            crc = 0 if self.notes else zlib.crc32(scanner.read(piece.offset, piece.end), crc)
        self._write()
        self._note_losses(statistics, chunks.values())
        if not (finished or self.notes):
            self.notes.append("the end of the file was missing")

    def saved(self) -> dict[str, int]:
        """Number of messages by channel name."""
        return {topic.removeprefix("/"): self.file.counts.get(number, 0) for number, topic in self.topics.items()}

    @property
    def last_time(self) -> float | None:
        """Time of the last message [s]."""
        return self.file.end_time / message.NANOSECONDS if self.file.counts else None

    def _index(self, stream: BinaryIO, finished: bool) -> list[records.McapRecord]:
        """What the index at the end says of declarations, chunks and numbers."""
        if not finished:
            return []
        try:
            return [parse(_INDEXED[opcode], one) for opcode, one in index_records(stream) if opcode in _INDEXED]
        except ValueError as error:
            self.notes.append(f"the index at the end is written anew: {error}")
            return []

    def _check_magic(self, stream: BinaryIO, path: Path, finished: bool) -> None:
        stream.seek(0)
        start = stream.read(16)
        if start.startswith(MAGIC):
            return
        if not finished and (start[8:9] != bytes([Opcode.HEADER]) or any(start[12:])):
            check_start(start, path)
        self.notes.append("the first bytes of the file were damaged")

    def _add(self, piece: Piece) -> None:
        """Save what can be saved of a part of the file."""
        if piece.note:
            self.notes.append(piece.note)
        if piece.data:
            self._messages(piece)
        elif piece.opcode == Opcode.ATTACHMENT:
            self.notes.append(f"left out the attachment at byte {piece.offset}")
        elif piece.record:
            self._declare(piece.record)

    def _declare(self, record: records.McapRecord) -> None:
        if isinstance(record, records.Schema) and record.id not in self.schemas:
            self.schemas[record.id] = self.file.schema(record.name, record.encoding, record.data)
            self._pictures |= {record.id} if record.name == TYPE else set()
        elif isinstance(record, records.Channel) and record.id not in self.channels and not self._complete:
            self._channel(record)
        elif isinstance(record, records.Metadata):
            self.file.metadata(record.name, record.metadata)
            if "\ufffd" in str(record.metadata):
                self.notes.append(f"letters of the metadata {record.name!r} were damaged")
        elif isinstance(record, records.Header):
            self.library = record.library

    def _channel(self, declared: records.Channel) -> None:
        channel = message.channel_from_metadata(declared.topic, declared.metadata)
        schema = self.schemas.get(declared.schema_id, 0)
        if channel is not None and declared.message_encoding == "cdr":
            self._sizes[declared.id] = message.record_dtype(len(channel.fields)).itemsize
            self.readable = True
            if not schema:  # it was lost, but follows from the fields
                definition = message.message_definition(channel).encode()
                schema = self.file.schema(message.message_type(channel, self._types), "ros2msg", definition)
        self.readable |= declared.schema_id in self._pictures
        number = self.file.channel(declared.topic, schema, declared.message_encoding, declared.metadata)
        self.channels[declared.id], self.topics[number] = number, declared.topic

    def _messages(self, piece: Piece) -> None:
        try:
            contents = message_offsets(piece.data)
            for opcode, content in contents.others:
                if opcode in _DECLARATIONS:
                    self._declare(parse(_DECLARATIONS[opcode], content))
        except ValueError as error:
            self.notes.append(f"lost {piece.end - piece.offset} bytes at byte {piece.offset}: {error}")
            return
        data, kept = bytearray(piece.data), [np.empty((0, 2), np.int64)]
        for number, offsets in contents.messages.items():
            if number not in self.channels:
                self._strangers[number] += len(offsets)
                continue
            lengths = gather(piece.data, offsets + 1, np.dtype("<u8")).astype(np.int64) + message.HEADER_SIZE
            whole = lengths == self._sizes.get(number, lengths)
            self._misfits += int((~whole).sum())
            kept.append(np.stack([offsets[whole], lengths[whole]], axis=1))
            _renumber(data, offsets, self.channels[number])
        self._keep(data, np.concatenate(kept))

    def _keep(self, data: bytearray, messages: np.ndarray) -> None:
        """Take over messages by their offsets and lengths, shape (N, 2), in the order they stand in."""
        if messages[:, 1].sum() == len(data):
            self._pending += data
        else:
            for offset, length in messages[np.argsort(messages[:, 0])].tolist():
                self._pending += data[offset : offset + length]
        if len(self._pending) >= _CHUNK_SIZE:
            self._write()

    def _write(self) -> None:
        self.file.chunk(bytes(self._pending))
        self._pending.clear()

    def _note_losses(self, statistics: list[records.Statistics], chunks: Iterable[records.ChunkIndex]) -> None:
        """What is missing by the index, and what nobody can read."""
        for chunk in chunks:
            times = f"{chunk.message_start_time / 1e9:.10g} to {chunk.message_end_time / 1e9:.10g} s"
            self.notes.append(f"lost the chunk at byte {chunk.chunk_start_offset}, {times}: it is not there")
        for number, count in sorted(self._strangers.items()):
            self.notes.append(f"lost {count} messages of channel {number}, whose declaration is lost")
        if self._misfits:
            self.notes.append(f"lost {self._misfits} messages of another length than their channel has")
        if statistics:
            self.lost = max(0, statistics[0].message_count - sum(self.file.counts.values()))


def _declared_again(stream: BinaryIO) -> list[records.McapRecord]:
    """The declarations that stand in one of the first whole chunks once more; empty where none has them."""
    chunks = (piece for piece in Scanner(stream, {}).pieces() if piece.opcode == Opcode.CHUNK and not piece.note)
    for piece in islice(chunks, DECLARED_EVERY):
        try:
            found = [parse(_DECLARATIONS[opcode], one) for opcode, one in message_offsets(piece.data).others]
        except (ValueError, KeyError):
            continue
        if found:
            return found
    return []


def _renumber(data: bytearray, offsets: np.ndarray, number: int) -> None:
    """Write the number of their channel into messages at byte offsets, shape (N,)."""
    view = np.frombuffer(data, np.uint8)
    view[offsets + 9], view[offsets + 10] = number % 256, number // 256
