"""Chunks of a file that may be damaged: those that are whole, and those that only look as if they were not."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from typing import BinaryIO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap import records
from mcap.opcode import Opcode

from rovtwin.core.log.mcapfile import MAGIC, decompress, gather, message_offsets

HEADER = struct.Struct("<BQ")  # of any record: opcode and length
FRAMES = (b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18")  # how a compressed block starts: zstd, lz4
_CHUNK = struct.Struct("<QQQII")  # first and last time, size and checksum of the content, length of the compression
_CRC_AT = HEADER.size + 24
_BODIES = (("zstd", 53, FRAMES[0]), ("lz4", 52, FRAMES[1]), ("", 49, b""))  # where the content starts, and with what
_PIECE = 1 << 16
_LARGEST = 1 << 30  # bytes of a chunk
_TAIL = 512  # zero bytes at the end that a power cut leaves, and no record does
_OPCODES = frozenset(Opcode)


class Piece(NamedTuple):
    """A part of a file, from one byte up to another.

    Attributes:
        offset: Its first byte.
        end: The byte behind it.
        opcode: What record it is; 0 for bytes that are none.
        record: The record, of one that is neither message nor chunk.
        data: Message records: the content of a chunk, or the message.
        note: What is wrong with it; empty when it is whole.
    """

    offset: int
    end: int
    opcode: int
    record: records.McapRecord | None = None
    data: bytes = b""
    note: str = ""


class Source:
    """The bytes of a file.

    Args:
        stream: The file.
        chunks: Length of each chunk by its first byte [bytes], as far as the file's index says.
    """

    def __init__(self, stream: BinaryIO, chunks: Mapping[int, int]) -> None:
        self.stream, self.chunks = stream, chunks
        self.size = stream.seek(0, 2)
        written = self._last_byte()
        self.written = written if self.size - written >= _TAIL else self.size

    def read(self, start: int, end: int) -> bytes:
        """Bytes of the file, as many as there are."""
        self.stream.seek(min(start, self.size))
        return self.stream.read(max(0, min(end, self.size) - start))

    def plausible(self, at: int) -> bool:
        """Whether the file ends at a byte, or a record may start there."""
        header = self.read(at, at + HEADER.size)
        if at >= self.size or len(header) < HEADER.size:
            return at == self.size or header == MAGIC or bool(header and header[0] in _OPCODES)
        opcode, length = HEADER.unpack(header)
        fits = at + HEADER.size + length <= self.size
        return opcode in _OPCODES and (fits or (opcode == Opcode.CHUNK and length < _LARGEST))

    def _last_byte(self) -> int:
        """The byte behind the last that is not zero."""
        end = self.size
        while end:
            start = max(0, end - _PIECE)
            block = self.read(start, end).rstrip(b"\0")
            if block:
                return start + len(block)
            end = start
        return 0


class Chunks:
    """Reads the chunks of a file."""

    def __init__(self, source: Source) -> None:
        self._source, self._read = source, source.read

    def whole(self, at: int, length: int) -> Piece | None:
        """A chunk whose lengths agree."""
        end = at + HEADER.size + length
        head = self._read(at + HEADER.size, at + HEADER.size + _CHUNK.size)
        if end > self._source.size or len(head) < _CHUNK.size:
            return None
        first, last, size, crc, letters = _CHUNK.unpack(head)
        body = at + HEADER.size + _CHUNK.size + letters + 8
        if letters > 32 or end - body != int.from_bytes(self._read(body - 8, body), "little"):
            return None
        name = self._read(body - 8 - letters, body - 8).decode("utf-8", "replace")
        try:
            chunk = records.Chunk(name, self._read(body, end), last, first, crc, size)
            return Piece(at, end, Opcode.CHUNK, data=decompress(chunk))
        except ValueError as error:
            mended = self.mended(at)
            if mended is not None or not self._source.plausible(end):
                return mended
            when = f"{first / 1e9:.10g} to {last / 1e9:.10g} s"
            return Piece(at, end, Opcode.CHUNK, note=f"lost the chunk at byte {at}, {when}: {error}")

    def mended(self, at: int) -> Piece | None:
        """A chunk with a damaged header, whose content its checksum still confirms."""
        crc = int.from_bytes(self._read(at + _CRC_AT, at + _CRC_AT + 4), "little")
        for name, body, magic in _BODIES:
            if self._read(at + body, at + body + len(magic)) != magic:
                continue
            for end in self._ends(name, at, at + body):
                data, end = self._unpacked(name, at + body, end)
                # One changed bit may be the checksum's own; in the content it would change half of its bits.
                if data and crc and (zlib.crc32(data) ^ crc).bit_count() <= 1:
                    return Piece(at, end, Opcode.CHUNK, data=data, note=f"the chunk at byte {at} has a damaged header")
        return None

    def headless(self, body: int) -> Piece | None:
        """A compressed block whose chunk may have lost its header, checksum and all."""
        name, before, _ = next(one for one in _BODIES if self._read(body, body + 4) == one[2])
        mended = self.mended(body - before)
        if mended is not None:
            return mended
        data, end = self._unpacked(name, body, self._source.size)
        if not data or not self._indexed(data, end):
            return None
        note = f"the chunk at byte {body - before} has no header; the index behind it agrees with what is in it"
        return Piece(body - before, end, Opcode.CHUNK, data=data, note=note)

    def cut(self, at: int) -> Piece:
        """The rest of a file, behind which no record is whole: what a chunk gives that was cut off."""
        size, head = self._source.size, self._read(at, at + HEADER.size + _CHUNK.size)
        note, name = f"the file is cut off or damaged at byte {at}, {size - at} bytes before its end", None
        if len(head) == HEADER.size + _CHUNK.size and head[0] == Opcode.CHUNK:
            letters = int.from_bytes(head[-4:], "little")
            name = self._read(at + len(head), at + len(head) + letters if letters <= 4 else 0).decode(
                "utf-8", "replace"
            )
        if name is None or name not in {one[0] for one in _BODIES}:
            return Piece(at, size, 0, note=note)
        data, _ = self._unpacked(name, at + len(head) + len(name) + 8, self._source.written, partial=True)
        return Piece(at, size, Opcode.CHUNK, data=data, note=note)

    def _indexed(self, data: bytes, at: int) -> bool:
        """Whether the message index behind a chunk has exactly its messages."""
        found = {}
        while (head := self._read(at, at + 15))[:1] == bytes([Opcode.MESSAGE_INDEX]) and len(head) == 15:
            size = int.from_bytes(head[11:15], "little") // 16 * 16
            entries = np.frombuffer(self._read(at + 15, at + 15 + size), "<u8")
            found[int.from_bytes(head[9:11], "little")] = entries[::2], entries[1::2]
            at += 15 + size
        try:
            messages = message_offsets(data).messages
        except ValueError:
            return False
        return found.keys() == messages.keys() and all(
            np.array_equal(found[number][0], gather(data, offsets + 15, np.dtype("<u8")))
            and np.array_equal(found[number][1], offsets)
            for number, offsets in messages.items()
        )

    def _ends(self, name: str, at: int, body: int) -> list[int]:
        """Where the content of a chunk may end; a compressed one ends by itself."""
        if name:
            return [self._source.size]
        outer = at + HEADER.size + int.from_bytes(self._read(at + 1, at + HEADER.size), "little")
        inner = body + int.from_bytes(self._read(body - 8, body), "little")
        return [end for end in (outer, inner, at + self._source.chunks.get(at, 0)) if body < end <= self._source.size]

    def _unpacked(self, name: str, start: int, end: int, partial: bool = False) -> tuple[bytes, int]:
        """Content of a compressed block and the byte behind it; of a damaged one nothing, or with `partial` a part."""
        if not name:
            return self._read(start, end), end
        zstd = name == "zstd"
        decoder = zstandard.ZstdDecompressor().decompressobj() if zstd else lz4.frame.LZ4FrameDecompressor()
        data = bytearray()
        while start < end and not decoder.eof and len(data) < _LARGEST:
            piece = self._read(start, min(end, start + _PIECE))
            try:
                data += decoder.decompress(piece)
            except (zstandard.ZstdError, RuntimeError, EOFError):
                break
            start += len(piece)
        if not (decoder.eof or partial):
            return b"", start
        return bytes(data), start - len(decoder.unused_data or b"")
