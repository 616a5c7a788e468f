"""The records of a file that may be damaged: which of them are whole, and where the next whole one starts.

A record says its length twice: in front, and by the lengths inside. Where the two agree, and for a chunk its checksum
holds, it is whole. Where they don't, the rest is searched for the next record that is.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from typing import BinaryIO

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode

from rovtwin.core.log.chunks import FRAMES, HEADER, Chunks, Piece, Source
from rovtwin.core.log.mcapfile import MAGIC, SHORTEST_MESSAGE

_CANDIDATE = re.compile(rb"(?=[\x01-\x0f].{5}\x00{3}|" + b"|".join(map(re.escape, FRAMES)) + b")", re.DOTALL)
_WINDOW = 1 << 20
_LARGEST_PLAIN = 1 << 26  # bytes of a declaration
_KINDS = {
    Opcode.HEADER: records.Header,
    Opcode.FOOTER: records.Footer,
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.CHUNK_INDEX: records.ChunkIndex,
    Opcode.ATTACHMENT_INDEX: records.AttachmentIndex,
    Opcode.STATISTICS: records.Statistics,
    Opcode.METADATA: records.Metadata,
    Opcode.METADATA_INDEX: records.MetadataIndex,
    Opcode.SUMMARY_OFFSET: records.SummaryOffset,
    Opcode.DATA_END: records.DataEnd,
}


class Scanner:
    """Takes a file apart into records that are whole and the bytes between.

    Args:
        stream: The file.
        chunks: Length of each chunk by its first byte [bytes], as far as the file's index says.
    """

    def __init__(self, stream: BinaryIO, chunks: Mapping[int, int]) -> None:
        self._source = Source(stream, chunks)
        self._chunks = Chunks(self._source)
        self._chunked, self._lost = bool(chunks), False  # whether there are chunks, and whether this may be inside one
        self._lengths: dict[bytes, int] = {}

    def pieces(self) -> Iterator[Piece]:
        """Every part of the file behind the magic, in order, up to the footer or the end."""
        at = len(MAGIC)
        while at < self._source.size:
            piece = self._record(at, True)
            if piece is None:
                piece, self._lost = self._search(at + 1), True
                yield self._chunks.cut(at) if piece is None else _gap(at, piece.offset)
            if piece is None:
                return
            yield piece
            if piece.opcode == Opcode.FOOTER and piece.end + len(MAGIC) >= self._source.size:
                return
            if piece.opcode == Opcode.CHUNK:
                self._chunked, self._lost = True, False
            at = piece.end

    def read(self, start: int, end: int) -> bytes:
        """Bytes of the file, as many as there are."""
        return self._source.read(start, end)

    def _search(self, start: int) -> Piece | None:
        """The first whole record that starts at a byte or behind it."""
        while start < self._source.size:
            window = self._source.read(start, start + _WINDOW + HEADER.size)
            found = {match.start() for match in _CANDIDATE.finditer(window)}
            found |= {at - start for at in self._source.chunks if start <= at < start + _WINDOW}
            for place in sorted(found):
                at, frame = start + place, window[place : place + 4] in FRAMES
                piece = self._chunks.headless(at) if frame else self._record(at, at in self._source.chunks)
                if piece is not None and place < _WINDOW:
                    return piece
            start += _WINDOW
        return None

    def _record(self, at: int, expected: bool) -> Piece | None:
        """The record at a byte; `expected` says whether one should start there. None when there is no whole one."""
        header = self._source.read(at, at + HEADER.size)
        if len(header) < HEADER.size:
            return None
        opcode, length = HEADER.unpack(header)
        if opcode == Opcode.CHUNK:
            return self._chunks.whole(at, length) or self._chunks.mended(at)
        if opcode == Opcode.MESSAGE:
            piece = self._message(at, length, expected)
        else:
            piece = self._plain(at, opcode, length, expected)
        if piece is not None or not expected:
            return piece
        return (
            self._chunks.mended(at)  # first: its checksum leaves no doubt
            or self._mended_opcode(at, length)
            or self._mended_length(at, opcode, length)
            or self._unknown(at, opcode, length)
        )

    def _plain(self, at: int, opcode: int, length: int, expected: bool) -> Piece | None:
        """A record of neither messages nor a chunk, whose lengths agree."""
        inner, record = self._measured(at, opcode)
        end = at + HEADER.size + length
        if inner != length or end > self._source.size or not (expected or self._source.plausible(end)):
            return None
        return Piece(at, end, opcode, record)

    def _mended_length(self, at: int, opcode: int, length: int) -> Piece | None:
        """The same where the lengths don't agree: the one inside counts if a record seems to follow it."""
        inner, record = self._measured(at, opcode)
        if inner is None:
            return None
        start = at + HEADER.size
        if self._source.plausible(start + inner):
            return Piece(at, start + inner, opcode, record, note=f"the length of the record at byte {at} was wrong")
        if inner < length and self._source.plausible(start + length):  # fields that a later version of MCAP adds
            return Piece(at, start + length, opcode, record)
        return None

    def _measured(self, at: int, opcode: int) -> tuple[int | None, records.McapRecord | None]:
        """Length of a record's content by the lengths inside, and the record."""
        start = at + HEADER.size
        if opcode == Opcode.MESSAGE_INDEX:
            entries = int.from_bytes(self._source.read(start + 2, start + 6), "little")
            return (6 + entries if entries % 16 == 0 else None), None
        if opcode == Opcode.ATTACHMENT:
            return self._attachment(start), None
        kind = _KINDS.get(opcode)  # pyright: ignore[reportArgumentType, reportCallIssue]
        if kind is None:
            return None, None
        self._source.stream.seek(start)
        content = _Content(self._source.stream, min(self._source.size - start, _LARGEST_PLAIN))
        try:
            record = kind.read(content)
            return content.count, record
        except (McapError, struct.error, ValueError):
            return None, None

    def _attachment(self, start: int) -> int | None:
        """Length of an attachment's content by the lengths inside; what is attached isn't read."""
        self._source.stream.seek(start)
        content = _Content(self._source.stream, min(self._source.size - start, _LARGEST_PLAIN))
        try:
            content.read(16)
            for _ in ("name", "media type"):
                content.read_prefixed_string()
            return content.read8() + content.count + 4
        except (McapError, struct.error):
            return None

    def _message(self, at: int, length: int, expected: bool) -> Piece | None:
        """A message outside of a chunk: it has no second length, so what follows or its channel has to speak for it."""
        end = at + HEADER.size + length
        if length < SHORTEST_MESSAGE or end > self._source.size or self._chunked and (self._lost or not expected):
            return None
        if self._measured(at, Opcode.MESSAGE_INDEX)[0] == length:  # one changed bit makes a message of an index
            return Piece(at, end, Opcode.MESSAGE_INDEX)
        data = self._source.read(at, end)
        channel = data[HEADER.size : HEADER.size + 2]
        if not self._source.plausible(end) and self._lengths.get(channel) != length:
            return None
        self._lengths[channel] = length
        return Piece(at, end, Opcode.MESSAGE, data=data)

    def _mended_opcode(self, at: int, length: int) -> Piece | None:
        """A declaration or provenance whose first byte is damaged."""
        for opcode in (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.MESSAGE_INDEX):
            inner, record = self._measured(at, opcode)
            end = at + HEADER.size + length
            if inner == length and end <= self._source.size:
                return Piece(at, end, opcode, record, note=f"the kind of the record at byte {at} was damaged")
        return None

    def _unknown(self, at: int, opcode: int, length: int) -> Piece | None:
        """A record of a kind that MCAP leaves to others, or may define later."""
        end = at + HEADER.size + length
        if opcode <= max(Opcode) or not self._source.plausible(end):
            return None
        return Piece(at, end, opcode, note=f"left out a record of the unknown kind {opcode} at byte {at}")


def _gap(at: int, end: int) -> Piece:
    return Piece(at, end, 0, note=f"lost {end - at} bytes at byte {at}, which are no record")


class _Content(ReadDataStream):
    """The content of a record, read no further than it can reach; letters that are no text become a mark."""

    def __init__(self, stream: BinaryIO, limit: int) -> None:
        super().__init__(stream)
        self._limit = limit

    def read(self, length: int) -> bytes:
        data = super().read(length) if length <= self._limit - self.count else b""
        if len(data) < length:
            raise EndOfFile
        return data

    def read_prefixed_string(self) -> str:
        return self.read(self.read4()).decode("utf-8", "replace")
