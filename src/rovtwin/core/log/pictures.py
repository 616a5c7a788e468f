"""Pictures of a camera in an MCAP file of their own: compressed, one message each, sensor_msgs/msg/CompressedImage.

The message carries when the picture was taken, the record when it was delivered. Foxglove, rosbags and ROS 2 show them.
"""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import numpy as np
from mcap import records
from mcap.opcode import Opcode

from rovtwin.core.errors import LogError
from rovtwin.core.log.files import exists_error, write_error
from rovtwin.core.log.info import index_records
from rovtwin.core.log.mcapfile import Contents, McapFile, decompress, iter_records, message_offsets, parse
from rovtwin.core.log.reader import check_finished, open_mcap
from rovtwin.core.log.writer import cut_short

TYPE = "sensor_msgs/msg/CompressedImage"
# Field by field the published interface definitions of ROS 2: names and types are the contract.
_DEFINITION = """std_msgs/Header header
string format
uint8[] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_RECORD = struct.Struct("<BQHIQQ")  # operation, length, channel, sequence, time of log and of publication
_LENGTH = struct.Struct("<Q")
_BODY = _RECORD.size - 9  # of the record, what its length counts
_LITTLE = b"\x00\x01\x00\x00"  # plain CDR, little endian


class PictureWriter:
    """Writes the pictures of one camera; a context manager.

    Args:
        path: New file.
        camera: Name of the camera: topic `/camera/<name>` and frame.
        encoding: What the bytes are, `jpeg` or `png`.

    Raises:
        LogError: The file exists, or cannot be written.
    """

    def __init__(self, path: str | Path, camera: str, encoding: str = "jpeg") -> None:
        self.path, self._frame, self._encoding, self._count = Path(path), camera, encoding, 0
        try:
            self._stream = open(self.path, "xb")
        except FileExistsError:
            raise exists_error(self.path) from None
        except OSError as error:
            raise write_error(self.path, error) from error
        self._file, self._failed = McapFile(self._stream), False
        schema = self._file.schema(TYPE, "ros2msg", _DEFINITION.encode())
        self._channel = self._file.channel(f"/camera/{camera.replace('.', '_')}", schema, "cdr", {})

    def write(self, taken: float, delivered: float, data: bytes) -> None:
        """One picture, compressed; times by the clock of the run [s]."""
        message = _encode(round(taken * 1e9), self._frame, self._encoding, data)
        at = round(delivered * 1e9)
        head = _RECORD.pack(5, _BODY + len(message), self._channel, self._count, at, at)
        self._count += 1
        try:
            self._file.chunk(head + message)
        except OSError as error:
            self._failed = True
            raise cut_short(self.path, error, self._file) from error

    def __enter__(self) -> "PictureWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._failed:
            return
        try:
            self._file.finish()
            self._stream.close()
        except OSError as wrong:
            raise cut_short(self.path, wrong, self._file) from wrong


def read_pictures(
    path: Path, topic: str | None = None, damaged: Callable[[str], None] = lambda why: None
) -> Iterator[tuple[float, bytes]]:
    """Time at which each picture was taken [s], and its compressed bytes, in the order of the file.

    Args:
        path: MCAP, ours or a recording of ROS 2.
        topic: Where several cameras are in the file.
        damaged: Told of each part that cannot be read and is left out.

    Raises:
        LogError: It is no such file or unfinished, has no pictures, or those of several cameras and none is named.
    """
    with open_mcap(path) as stream:
        check_finished(stream, path)
        found = _cameras(stream)
        numbers = {number for number, name in found.items() if topic in (None, name)}
        if len({found[number] for number in numbers}) != 1:
            topics = ", ".join(sorted(set(found.values()))) or "none"
            raise LogError(f"{path}: found topics with pictures: {topics}; expected {topic or 'one'}")
        for data, contents in _blocks(stream, damaged):
            places = sorted((int(at), n) for n in numbers for at in contents.messages.get(n, ()))
            for at, _ in places:
                length = _LENGTH.unpack_from(data, at + 1)[0]
                try:
                    yield _decode(data[at + _RECORD.size : at + 9 + length])
                except ValueError as error:
                    damaged(str(error))


class Album:
    """The pictures of a `PictureWriter`, any of them at once, by the index at the end of their file.

    Attributes:
        times: When each was delivered [s], shape (n,).
    """

    def __init__(self, path: Path) -> None:
        """Raises LogError where the file is missing, unfinished or damaged, or has no pictures."""
        self.path = path
        with open_mcap(path) as stream:
            check_finished(stream, path)
            try:
                found = [parse(records.ChunkIndex, c) for o, c in index_records(stream) if o == Opcode.CHUNK_INDEX]
            except ValueError as error:
                raise LogError(f"{path}: {error}. Rebuild it with `rovtwin log repair {path}`") from None
        found.sort(key=lambda one: one.message_start_time)
        self.times = np.array([1e-9 * one.message_start_time for one in found])
        self._offsets = [one.chunk_start_offset for one in found]

    def number_at(self, t: float) -> int | None:
        """Number of the newest picture that was there at a time [s]; None before the first."""
        number = int(np.searchsorted(self.times, t + 1e-6, side="right")) - 1
        return None if number < 0 else number

    def picture(self, number: int) -> bytes:
        """One of them, compressed.

        Raises:
            LogError: There is none of this number, or it is damaged.
        """
        if not 0 <= number < len(self.times):
            raise LogError(f"{self.path}: found {len(self.times)} pictures, asked for number {number}")
        with open(self.path, "rb") as stream:
            stream.seek(self._offsets[number] + 1)
            content = stream.read(_LENGTH.unpack(stream.read(8))[0])
        try:
            data = decompress(parse(records.Chunk, content))
            at = min(int(offsets[0]) for offsets in message_offsets(data).messages.values())
            return _decode(data[at + _RECORD.size : at + 9 + _LENGTH.unpack_from(data, at + 1)[0]])[1]
        except ValueError as error:
            raise LogError(f"{self.path}: picture {number} is damaged: {error}") from None


def _cameras(stream: BinaryIO) -> dict[int, str]:
    """Topic of each channel with pictures, by its number."""
    schemas: set[int] = set()
    channels: list[records.Channel] = []
    for _, contents in _blocks(stream, lambda why: None):
        for opcode, content in contents.others:
            try:
                if opcode == Opcode.SCHEMA:
                    schema = parse(records.Schema, content)
                    schemas |= {schema.id} if schema.name == TYPE else set()
                elif opcode == Opcode.CHANNEL:
                    channels.append(parse(records.Channel, content))
            except ValueError:
                continue  # of a declaration that cannot be read the pictures cannot, either
    return {channel.id: channel.topic for channel in channels if channel.schema_id in schemas}


def _blocks(stream: BinaryIO, damaged: Callable[[str], None]) -> Iterator[tuple[bytes, Contents]]:
    """Message records and declarations, chunk by chunk."""
    for record in iter_records(stream):
        try:
            if not record.complete:
                raise ValueError("a record that is not whole: what follows it is lost")
            if record.opcode == Opcode.DATA_END:
                expected = parse(records.DataEnd, record.content).data_section_crc
                if expected not in (0, record.crc):
                    raise ValueError("the checksum of the data does not match")
                return
            whole = record.opcode == Opcode.CHUNK
            data = decompress(parse(records.Chunk, record.content)) if whole else record.header + record.content
            yield data, message_offsets(data)
        except ValueError as error:
            damaged(str(error))


def _encode(stamp: int, frame: str, encoding: str, data: bytes) -> bytes:
    body = struct.pack("<iI", *divmod(stamp, 1_000_000_000))
    for text in (frame, encoding):
        raw = text.encode() + b"\0"
        body += struct.pack("<I", len(raw)) + raw
        body += b"\0" * (-len(body) % 4)
    return _LITTLE + body + struct.pack("<I", len(data)) + data


def _decode(message: bytes) -> tuple[float, bytes]:
    """Raises ValueError where it is no such message."""
    if message[:2] != _LITTLE[:2]:
        raise ValueError("a picture in an encoding other than plain little-endian CDR")
    body = memoryview(message)[4:]
    try:
        seconds, nanoseconds = struct.unpack_from("<iI", body)
        at = 8
        for _ in range(2):
            at += 4 + struct.unpack_from("<I", body, at)[0]
            at += -at % 4
        (length,) = struct.unpack_from("<I", body, at)
    except struct.error:
        raise ValueError("a picture that is cut short") from None
    if at + 4 + length > len(body):
        raise ValueError("a picture that is cut short")
    return seconds + 1e-9 * nanoseconds, bytes(body[at + 4 : at + 4 + length])
