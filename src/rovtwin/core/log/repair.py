"""Rebuilding a log whose run was killed, or whose file was cut or damaged."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap import records
from mcap.opcode import Opcode

from rovtwin.core.errors import LogError
from rovtwin.core.log import message
from rovtwin.core.log.files import atomic
from rovtwin.core.log.mcapfile import McapFile, Record, decompress, iter_records, message_offsets, parse
from rovtwin.core.log.reader import is_finished, open_mcap

_CHUNK_SIZE = 1 << 20


@dataclass(frozen=True)
class Repair:
    """What a repair saved.

    Attributes:
        path: The new file.
        messages: Number of messages saved, by channel name.
        last_time: Time of the last of them [s], or None when there is none.
        finished: Whether the original was whole, so that there was nothing to repair.
        notes: What was lost, one line each.
    """

    path: Path
    messages: dict[str, int]
    last_time: float | None
    finished: bool
    notes: tuple[str, ...]


def repair(path: str | Path, out: str | Path | None = None, overwrite: bool = False) -> Repair:
    """Write a whole log from an unfinished or damaged one, which is left as it is.

    Args:
        path: The log.
        out: The new file; by default `run.repaired.mcap` beside `run.mcap`.
        overwrite: Whether an earlier repair may be replaced.

    Raises:
        LogError: The file is missing, not MCAP or holds nothing to save, or the new one can't be written.
    """
    path = Path(path)
    out = path.with_name(f"{path.stem}.repaired.mcap") if out is None else Path(out)
    if out.exists() and out.samefile(path):
        raise LogError(f"{out}: is the log itself. A repair leaves the original alone: name another file")
    with open_mcap(path) as stream, atomic(out, overwrite) as temporary, open(temporary, "wb") as target:
        salvage = _Salvage(McapFile(target))
        for record in iter_records(stream):
            salvage.add(record)
        if not salvage.channels:
            raise LogError(f"{path}: nothing to save: its {path.stat().st_size} bytes end before a channel is declared")
        salvage.finish(is_finished(stream))
    return Repair(out, salvage.saved(), salvage.last_time, salvage.finished, tuple(salvage.notes))


class _Salvage:
    """Copies the records of a broken file into a new one. The numbers of schemas and channels may change on the way."""

    def __init__(self, file: McapFile) -> None:
        self.file = file
        self.schemas: dict[int, int] = {0: 0}
        self.channels: dict[int, int] = {}
        self.topics: dict[int, str] = {}
        self.pending = bytearray()
        self.notes: list[str] = []
        self.finished = False

    def add(self, record: Record) -> None:
        """Save what can be saved of a record."""
        try:
            self._add(record)
        except ValueError as error:
            self.notes.append(f"lost {len(record.content)} bytes at byte {record.offset}: {error}")

    def finish(self, finished: bool) -> None:
        """Write what is pending and the index; `finished` says whether the original ends as it should."""
        self._write()
        self.file.finish()
        if not finished and not self.notes:
            self.notes.append("the end of the file was missing")
        self.finished = not self.notes

    def saved(self) -> dict[str, int]:
        """Number of messages by channel name."""
        return {topic.removeprefix("/"): self.file.counts.get(number, 0) for number, topic in self.topics.items()}

    @property
    def last_time(self) -> float | None:
        """Time of the last message [s]."""
        return self.file.end_time / message.NANOSECONDS if self.file.counts else None

    def _add(self, record: Record) -> None:
        if not record.complete:
            self.notes.append(f"the file is cut off or damaged in the record at byte {record.offset}")
        if record.opcode == Opcode.CHUNK:
            self._messages(decompress(parse(records.Chunk, record.content), partial=not record.complete))
        elif not record.complete:
            pass
        elif record.opcode == Opcode.MESSAGE:
            self._messages(record.header + record.content)
        elif record.opcode == Opcode.DATA_END and parse(records.DataEnd, record.content).data_section_crc not in (
            0,
            record.crc,
        ):
            self.notes.append("the checksum of the data does not match")
        else:
            self._declaration(record.opcode, record.content)

    def _declaration(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = parse(records.Schema, content)
            if schema.id not in self.schemas:
                self.schemas[schema.id] = self.file.schema(schema.name, schema.encoding, schema.data)
        elif opcode == Opcode.CHANNEL:
            channel = parse(records.Channel, content)
            if channel.id not in self.channels:
                number = self.file.channel(
                    channel.topic, self.schemas.get(channel.schema_id, 0), channel.message_encoding, channel.metadata
                )
                self.channels[channel.id], self.topics[number] = number, channel.topic
        elif opcode == Opcode.METADATA:
            metadata = parse(records.Metadata, content)
            self.file.metadata(metadata.name, metadata.metadata)
        elif opcode == Opcode.ATTACHMENT:
            self.notes.append("left out an attachment")

    def _messages(self, data: bytes) -> None:
        contents = message_offsets(data)
        for opcode, content in contents.others:
            self._declaration(opcode, content)
        known = [offsets for number, offsets in contents.messages.items() if number in self.channels]
        for offset in np.sort(np.concatenate([*known, np.empty(0, int)])).tolist():
            length = int.from_bytes(data[offset + 1 : offset + 9], "little")
            number = self.channels[int.from_bytes(data[offset + 9 : offset + 11], "little")]
            self.pending += (
                data[offset : offset + 9] + number.to_bytes(2, "little") + data[offset + 11 : offset + 9 + length]
            )
        if len(self.pending) >= _CHUNK_SIZE:
            self._write()

    def _write(self) -> None:
        self.file.chunk(bytes(self.pending))
        self.pending.clear()
