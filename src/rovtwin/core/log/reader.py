"""A log in memory: its channels as arrays, from a file or from arrays."""

import io
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from mcap import records
from mcap.opcode import Opcode
from numpy.typing import ArrayLike

from rovtwin.core.errors import LogError
from rovtwin.core.extras import require
from rovtwin.core.log import message
from rovtwin.core.log.channel import Channel, channel_table, suggestion
from rovtwin.core.log.face import LogFace
from rovtwin.core.log.mcapfile import FOOTER_SIZE, MAGIC, decompress, gather, iter_records, message_offsets, parse
from rovtwin.core.log.writer import FORMAT, METADATA_NAME, LogWriter, text_metadata
from rovtwin.core.user_files.files import checked

if TYPE_CHECKING:
    import pandas
    import xarray

_OTHERS = {
    b"PK\x03\x04": "a renamed zip",
    b"#ROSBAG": "a ROS 1 bag",
    b"SQLite format 3": "a ROS 2 bag of the sqlite3 kind",
    b"\x89HDF": "a netCDF or HDF5 file",
    b"CDF": "a netCDF file",
    b"\x1f\x8b": "gzip",
    b"\x28\xb5\x2f\xfd": "zstd",
}


@dataclass(frozen=True, eq=False)
class Series:
    """One channel of a log: times t [s], shape (N,), on a grid of 1 ns, and values, shape (N, n); both read-only."""

    t: np.ndarray
    values: np.ndarray
    channel: Channel

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, field: str) -> np.ndarray:
        """One component, shape (N,)."""
        return self.values[:, self.channel.index(field)]

    def to_xarray(self) -> "xarray.DataArray":
        """By `time` and `field`, with the unit of each field and the frame as attributes."""
        require("xarray", "notebook", "Series.to_xarray")
        import xarray

        about = {"units": self.channel.unit, "frame": self.channel.frame}
        coordinates = {"time": self.t, "field": list(self.channel.fields)}
        name = self.channel.name.replace("/", "_")  # netCDF names have no slash
        return xarray.DataArray(self.values, coordinates, ("time", "field"), name, about)

    def to_pandas(self) -> "pandas.DataFrame":
        """A column for each field, indexed by time [s]."""
        require("pandas", "notebook", "Series.to_pandas")
        import pandas

        return pandas.DataFrame(self.values, pandas.Index(self.t, name="time"), list(self.channel.fields))


@dataclass(frozen=True, eq=False, repr=False)
class Log(LogFace):
    """Named channels and provenance, all in memory.

    Example:
        >>> from rovtwin.core.log import Channel
        >>> log = rovtwin.Log.from_arrays([Channel("depth", ("z",), "m", "n")], {"depth": ([0.0, 1.0], [[2], [3]])})
        >>> log
        <Log log: 1 channels, 1.0 s>
        >>> log["depth"].to_xarray().sizes["time"]
        2

    Attributes:
        channels: What the channels are, by name.
        metadata: Provenance: version, configuration, seed, `created`; the only place for wall-clock time.
        notes: What was left out or put right while reading, one line each.
        source: Where the log is from, for messages.
    """

    channels: dict[str, Channel]
    metadata: dict[str, str]
    notes: tuple[str, ...] = ()
    source: str = "log"
    _series: dict[str, Series] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        end = max((series.t[-1] for series in self._series.values() if len(series)), default=0.0)
        return f"<Log {self.source}: {len(self.channels)} channels, {end:.1f} s>"

    @staticmethod
    def read(path: str | Path) -> "Log":
        """Read a whole MCAP log; checksums are verified.

        Raises:
            LogError: The file is missing, not a log, unfinished or damaged.
        """
        path = Path(path)
        with open_mcap(path) as stream:
            check_finished(stream, path)
            return Collector(path).collect(stream)

    @staticmethod
    def from_arrays(
        channels: Iterable[Channel],
        data: Mapping[str, tuple[ArrayLike, ArrayLike]],
        metadata: Mapping[str, Any] | None = None,
    ) -> "Log":
        """A log without a file.

        Args:
            channels: The channels.
            data: Times [s], shape (N,), and values, shape (N, n), by channel name; a channel left out is empty.
            metadata: Provenance, as for `LogWriter`.

        Raises:
            LogError: A channel is unknown, or times or shapes are wrong.
        """
        table, series = channel_table(channels), {}
        for name in data:
            _known(name, table, "log")
        for name, channel in table.items():
            t, values = message.check_block(channel, *data.get(name, ([], np.empty((0, len(channel.fields))))), "log")
            series[name] = _series(channel, message.to_nanoseconds(t), values)
        return Log(table, text_metadata(metadata or {}), (), "log", series)

    def write(self, path: str | Path, overwrite: bool = False) -> Path:
        """Write the log as a file, channels interleaved in time; returns the path.

        Raises:
            LogError: The file can't be written, or it exists.
        """
        seconds = [np.floor(series.t) for series in self._series.values()]
        edges = np.unique(np.concatenate([*seconds, np.empty(0)]))
        cuts = {name: np.searchsorted(series.t, [*edges, np.inf]) for name, series in self._series.items()}
        with LogWriter(path, self.channels.values(), self.metadata, overwrite) as writer:
            for k in range(len(edges)):
                for name, series in self._series.items():
                    start, stop = cuts[name][k : k + 2]
                    if start < stop:
                        writer.write_many(name, series.t[start:stop], series.values[start:stop])
        return Path(path)

    def __getitem__(self, name: str) -> Series:
        _known(name, self.channels, self.source)
        return self._series[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.channels)

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def field(self, name: str, field: str) -> np.ndarray:
        """One component of a channel, shape (N,)."""
        return self[name][field]

    @property
    def start(self) -> float:
        """Time of the first sample of any channel [s]; 0 when there is none."""
        return min((float(series.t[0]) for series in self._series.values() if len(series)), default=0.0)

    @property
    def end(self) -> float:
        """Time of the last sample of any channel [s]; 0 when there is none."""
        return max((float(series.t[-1]) for series in self._series.values() if len(series)), default=0.0)

    @property
    def duration(self) -> float:
        """From the first sample of any channel to the last of any [s]."""
        return self.end - self.start

    def sample(self, name: str, t: ArrayLike) -> np.ndarray:
        """Values in between, by linear interpolation. An angle that wraps is not handled: unwrap it first.

        Args:
            name: The channel.
            t: Times [s], scalar or shape (M,), within the times of the channel.

        Returns:
            Values, shape (n,) or (M, n).

        Raises:
            LogError: A time lies outside.
        """
        series, times = self[name], np.asarray(t, np.float64)
        if not len(series):
            raise LogError(f"{self.source}: {name}: has no samples to interpolate")
        outside = times[~((times >= series.t[0]) & (times <= series.t[-1]))]
        if outside.size:
            raise LogError(
                f"{self.source}: {name}: t = {outside.flat[0]} s is outside of the channel, which has samples from "
                f"{series.t[0]} to {series.t[-1]} s"
            )
        columns = [np.interp(times, series.t, series.values[:, k]) for k in range(len(series.channel.fields))]
        return np.stack(columns, axis=-1)

    def equal_data(self, other: "Log") -> bool:
        """Whether channels, times and values are the same bit for bit, whatever the provenance and the order."""
        return not self.differences(other)

    def differences(self, other: "Log") -> list[str]:
        """The first difference of every channel, a line each; empty when the data are the same bit for bit."""
        only = [f"{name}: only in one of the logs" for name in sorted(self.channels.keys() ^ other.channels.keys())]
        both = [_difference(self[name], other[name]) for name in self.channels if name in other.channels]
        return only + [line for line in both if line]


@contextmanager
def open_mcap(path: Path) -> Iterator[BinaryIO]:
    """Open a file that starts as MCAP does.

    Raises:
        LogError: It doesn't, or can't be read.
    """
    with open_file(path) as stream:
        check_start(stream.read(16), path)
        yield stream


@contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file whatever it starts with.

    Raises:
        LogError: It can't be read.
    """
    try:
        with io.BufferedReader(_Raw(checked(path, math.inf))) as stream:
            yield stream
    except FileNotFoundError as error:
        raise LogError(f"{path}: no such file. Check the name; `rovtwin fly` writes a log") from error
    except IsADirectoryError as error:
        inside = sorted(path.glob("*.mcap"))
        hint = f"Did you mean {str(inside[0])!r}?" if inside else "There is none in it"
        raise LogError(f"{path}: is a folder, expected an MCAP file. {hint}") from error
    except OSError as error:
        raise _unreadable(path, error) from error


class _Raw(io.FileIO):
    """A file whose errors of reading name it, also inside a block that writes another file."""

    def readinto(self, buffer: Any, /) -> int | None:
        """Read into a buffer; the number of bytes. Raises LogError where the system cannot."""
        try:
            return super().readinto(buffer)
        except OSError as error:
            raise _unreadable(self.name, error) from error

    def readall(self) -> bytes:
        """The rest of the file. Raises LogError where the system cannot read it."""
        try:
            return super().readall()
        except OSError as error:
            raise _unreadable(self.name, error) from error


def _unreadable(path: Any, error: OSError) -> LogError:
    what = error.strerror or error
    return LogError(f"{path}: cannot be read: {what}. Check the permissions and the disk")


def check_start(start: bytes, path: Path) -> None:
    """Raises LogError when the first bytes of a file, at least 16 where it has them, aren't those of MCAP."""
    if start.startswith(MAGIC):
        return
    if MAGIC.startswith(start):
        raise LogError(
            f"{path}: empty: {len(start)} bytes, expected an MCAP file. Its run ended before it began; run it again"
        )
    hint = next((f". Is it {what}?" for magic, what in _OTHERS.items() if start.startswith(magic)), "")
    raise LogError(f"{path}: not an MCAP file: starts with {start[:8]!r}, expected the MCAP magic {MAGIC!r}{hint}")


def is_finished(stream: BinaryIO) -> bool:
    """Whether the file ends as MCAP does."""
    size = stream.seek(0, 2)
    stream.seek(max(0, size - FOOTER_SIZE))
    end = stream.read()
    return size >= len(MAGIC) + FOOTER_SIZE and end.startswith(b"\x02\x14" + bytes(7)) and end.endswith(MAGIC)


def check_finished(stream: BinaryIO, path: Path) -> None:
    """Raises LogError when the file doesn't end as MCAP does."""
    if not is_finished(stream):
        raise LogError(
            f"{path}: unfinished: {stream.tell()} bytes without the index at the end; its run was killed, still goes "
            f"on, or the file was cut. Rebuild it with `rovtwin log repair {path}`"
        )


class Collector:
    """Gathers what a file holds by channel."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.foreign: dict[int, str] = {}
        self.schemas: dict[int, records.Schema] = {}
        self.parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        self.metadata: dict[str, str] = {}
        self.notes: list[str] = []

    def collect(self, stream: BinaryIO) -> Log:
        """Read all records."""
        loose: list[bytes] = []
        for record in iter_records(stream):
            if not record.complete:
                raise self._damaged(record.offset, "not a whole record")
            try:
                if record.opcode == Opcode.DATA_END:
                    expected = parse(records.DataEnd, record.content).data_section_crc
                    if expected not in (0, record.crc):
                        raise self._damaged(record.offset, "the checksum of the data does not match")
                    break
                if record.opcode == Opcode.FOOTER:
                    break
                if record.opcode == Opcode.MESSAGE:
                    loose.append(record.header + record.content)
                elif record.opcode == Opcode.CHUNK:
                    self._messages(decompress(parse(records.Chunk, record.content)))
                else:
                    self.declare(record.opcode, record.content)
            except ValueError as error:
                raise self._damaged(record.offset, str(error)) from error
        else:
            raise self._damaged(stream.tell(), "the end of the data is missing")
        try:
            self._messages(b"".join(loose))
        except ValueError as error:
            raise self._damaged(len(MAGIC), str(error)) from error
        return self._log()

    def declare(self, opcode: int, content: bytes) -> None:
        """Take in a schema, a channel or our metadata."""
        if opcode == Opcode.SCHEMA:
            schema = parse(records.Schema, content)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            self._channel(parse(records.Channel, content))
        elif opcode == Opcode.METADATA:
            metadata = parse(records.Metadata, content)
            if metadata.name == METADATA_NAME:
                self.metadata.update(metadata.metadata)

    def _channel(self, declared: records.Channel) -> None:
        if declared.id in self.channels or declared.id in self.foreign:
            return
        channel = message.channel_from_metadata(declared.topic, declared.metadata)
        schema = self.schemas.get(declared.schema_id)
        kind = f"{schema.name} in {schema.encoding}" if schema else "no schema"
        if channel is None or declared.message_encoding != "cdr":
            self.foreign[declared.id] = (
                f"{declared.topic}: left out: {kind}, messages in {declared.message_encoding or 'nothing'}"
            )
        elif any(known.name == channel.name and known != channel for known in self.channels.values()):
            self.foreign[declared.id] = f"{declared.topic}: left out: declared again in another way"
        else:
            self.channels[declared.id] = channel
            self.parts.setdefault(channel.name, [])

    def _messages(self, data: bytes) -> None:
        contents = message_offsets(data)
        if contents.end != len(data):
            raise ValueError("a message reaches beyond the end of its chunk")
        for opcode, content in contents.others:
            self.declare(opcode, content)
        for number, offsets in contents.messages.items():
            channel = self.channels.get(number)
            if channel is not None:
                self.parts[channel.name].append(self._decode(channel, data, offsets))
            elif number not in self.foreign:
                self.foreign[number] = f"channel {number}: left out: messages without a declaration"

    def _decode(self, channel: Channel, data: bytes, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        dtype = message.record_dtype(len(channel.fields))
        lengths = gather(data, offsets + 1, np.dtype("<u8")) + message.HEADER_SIZE
        if (lengths != dtype.itemsize).any():
            raise ValueError(
                f"{channel.name}: message of {lengths[lengths != dtype.itemsize][0]} bytes, expected {dtype.itemsize} "
                f"for {len(channel.fields)} fields"
            )
        block = gather(data, offsets, dtype)
        if (block["encapsulation"].view("<u4") != int.from_bytes(message.CDR_LITTLE_ENDIAN, "little")).any():
            raise ValueError(f"{channel.name}: a message isn't little-endian CDR")
        return block["log_time"].astype(np.int64), block["values"]

    def _log(self) -> Log:
        foreign = sorted(self.foreign.values())
        if not self.channels:
            found = "; ".join(foreign[:5]) or "no channels at all"
            raise LogError(
                f"{self.path}: no channels that rovtwin wrote, found {found}. Import another program's recording first"
            )
        if self.metadata.get("log_format", FORMAT) != FORMAT:
            raise LogError(
                f"{self.path}: log format {self.metadata['log_format']!r}, this version of rovtwin reads {FORMAT!r}. "
                "Update rovtwin"
            )
        table, series = {}, {}
        for channel in self.channels.values():
            stamps, values = _join(self.parts.pop(channel.name, []), len(channel.fields))
            if channel.name in table:
                continue
            if (np.diff(stamps) < 0).any():
                order = np.argsort(stamps, kind="stable")
                stamps, values = stamps[order], values[order]
                self.notes.append(f"{channel.name}: messages were out of order, now sorted by time")
            table[channel.name], series[channel.name] = channel, _series(channel, stamps, values)
        return Log(table, self.metadata, (*self.notes, *foreign), str(self.path), series)

    def _damaged(self, offset: int, what: str) -> LogError:
        return LogError(
            f"{self.path}: damaged at byte {offset}: {what}. Copy the file again if you can; "
            f"`rovtwin log repair {self.path}` keeps what is whole"
        )


def _join(parts: list[tuple[np.ndarray, np.ndarray]], size: int) -> tuple[np.ndarray, np.ndarray]:
    stamps = np.concatenate([part[0] for part in parts] or [np.empty(0, np.int64)])
    return stamps, np.concatenate([part[1] for part in parts] or [np.empty((0, size))])


def _series(channel: Channel, stamps: np.ndarray, values: np.ndarray) -> Series:
    t, values = message.to_seconds(stamps), np.array(values, np.float64)
    t.flags.writeable = values.flags.writeable = False
    return Series(t, values, channel)


def _known(name: str, channels: Iterable[str], source: str) -> None:
    if name not in channels:
        raise LogError(f"{source}: no such channel: {name!r}. {suggestion(name, channels)}")


def _difference(a: Series, b: Series) -> str:
    """The first difference of two series, or nothing."""
    name = a.channel.name
    if a.channel != b.channel:
        return f"{name}: declared as {a.channel} and {b.channel}"
    if len(a) != len(b):
        return f"{name}: {len(a)} and {len(b)} samples"
    both = [np.column_stack([s.t, s.values]) for s in (a, b)]
    rows, columns = np.nonzero(both[0].view(np.uint64) != both[1].view(np.uint64))
    if not len(rows):
        return ""
    row, column = rows[0], columns[0]
    return (
        f"{name}: sample {row} (t = {a.t[row]} s): {('t', *a.channel.fields)[column]} is {both[0][row, column]!r} "
        f"and {both[1][row, column]!r}"
    )
