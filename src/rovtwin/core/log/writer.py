"""Writing a log while it happens."""

import errno
import json
import os
import struct
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rovtwin.core.errors import LogError
from rovtwin.core.log import message
from rovtwin.core.log.channel import Channel, channel_table, suggestion
from rovtwin.core.log.files import exists_error, write_error
from rovtwin.core.log.mcapfile import McapFile

METADATA_NAME = "rovtwin"
FORMAT = "1"
_CHUNK_SIZE = 1 << 20
_PENDING_LIMIT = 64 << 20  # bytes that wait for a slow disk before `write` does too
_FLUSH_PERIOD = 0.5  # s of wall time
_SYNC_PERIOD = 1.0  # s of wall time
_SINGLE = struct.Struct("<BQHIQQ4siI")


class LogWriter:
    """Writes channels to an MCAP file; a context manager.

    What was written is with the operating system at most a second later, and at once after `flush`, so that a
    killed process loses no more than that: `repair` rebuilds the file. Methods may be called from several threads.

    Args:
        path: The file to write, by custom with the ending `.mcap`.
        channels: All channels the log will have.
        metadata: Provenance; values that aren't text are stored as JSON. The time of creation is added as `created`.
        overwrite: Whether a file that exists may be replaced.

    Raises:
        LogError: The file can't be written, or it exists.
    """

    def __init__(
        self,
        path: str | Path,
        channels: Iterable[Channel],
        metadata: Mapping[str, Any] | None = None,
        overwrite: bool = False,
    ) -> None:
        self.path = Path(path)
        self.channels = channel_table(channels)
        provenance = text_metadata(metadata or {})
        self._failure: LogError | None = None
        self._annotations: dict[str, str] = {}
        self._lock = threading.RLock()
        self._condition = threading.Condition(self._lock)
        self._pending: list[bytes] = []
        self._pending_size = self._added = self._written = 0
        self._hurry = self._closed = False
        try:
            self._stream = open(self.path, "wb" if overwrite else "xb")
        except OSError as error:
            raise exists_error(self.path) if error.errno == errno.EEXIST else write_error(self.path, error) from error
        self._file = McapFile(self._stream)
        try:
            self._file.metadata(METADATA_NAME, provenance)
            self._tracks = self._declare()
            self._file.flush()
        except OSError as error:
            self._close_stream()
            raise self._broken(error) from error
        self._thread = threading.Thread(target=self._work, name=f"log {self.path.name}", daemon=True)
        self._thread.start()

    def write(self, channel: str, t: float, values: ArrayLike) -> None:
        """Write one sample.

        Args:
            channel: Name of the channel.
            t: Time on the data clock [s]; not before the channel's last.
            values: The sample, shape (n,).

        Raises:
            LogError: The channel is unknown, the time or the shape is wrong, or the file can't be written.
        """
        track, t = self._track(channel), float(t)
        sample = np.asarray(values, "<f8")
        if sample.size != track.size or sample.ndim > 1 or not 0 <= t < message.LATEST:
            message.check_block(track.channel, [t], [sample], str(self.path))
        with self._condition:
            stamp = round(t * message.NANOSECONDS)
            track.advance(stamp, stamp, self.path)
            seconds, rest = divmod(stamp, message.NANOSECONDS)
            header = _SINGLE.pack(
                message.MESSAGE_OPCODE,
                track.length,
                track.number,
                track.count % 2**32,
                stamp,
                stamp,
                message.CDR_LITTLE_ENDIAN,
                seconds,
                rest,
            )
            track.count += 1
            self._add(header + sample.tobytes())

    def write_many(self, channel: str, t: ArrayLike, values: ArrayLike) -> None:
        """Write a block of samples.

        Args:
            channel: Name of the channel.
            t: Times on the data clock [s], shape (N,); none before the one it follows.
            values: The samples, shape (N, n); shape (N,) will do when n = 1.

        Raises:
            LogError: As for `write`.
        """
        track = self._track(channel)
        times, samples = message.check_block(track.channel, t, values, str(self.path))
        if not len(times):
            return
        stamps = message.to_nanoseconds(times)
        rows = max(1, _CHUNK_SIZE // (track.length + 9))
        with self._condition:
            track.advance(int(stamps[0]), int(stamps[-1]), self.path)
            sequence, track.count = track.count, track.count + len(stamps)
        for k in range(0, len(stamps), rows):
            block = message.encode(track.number, sequence + k, stamps[k : k + rows], samples[k : k + rows])
            with self._condition:
                self._add(block)

    def flush(self) -> None:
        """Hand all that was written to the operating system: a killed process no longer loses it.

        Raises:
            LogError: The file can't be written.
        """
        with self._condition:
            self._wait(self._added)

    def annotate(self, metadata: Mapping[str, Any]) -> None:
        """Add to the provenance what is known only now, such as a verdict; it is written with the next samples.

        A key given before is replaced.

        Raises:
            LogError: The log is closed.
        """
        with self._condition:
            if self._closed:
                raise LogError(f"{self.path}: the log is closed, nothing can be added. Write inside the `with` block")
            self._annotations |= as_text(metadata)

    def close(self) -> None:
        """Write the index and close the file; closing twice does nothing.

        Raises:
            LogError: The file can't be written.
        """
        with self._condition:
            if self._closed:
                return
            self._closed = self._hurry = True
            self._condition.notify_all()
        self._let_go()
        self._thread.join()
        self._close_stream()
        if self._failure:
            raise self._failure

    def _let_go(self) -> None:
        """Release what Ctrl-C left locked: it may strike between taking a lock and the `with` that frees it."""
        while True:
            try:
                self._lock.release()
            except RuntimeError:  # not ours, or free
                return

    def __enter__(self) -> "LogWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except LogError:
            if error is None:
                raise

    def _declare(self) -> dict[str, "_Track"]:
        tracks, types = {}, set()
        for channel in self.channels.values():
            schema = self._file.schema(
                message.message_type(channel, types), "ros2msg", message.message_definition(channel).encode()
            )
            number = self._file.channel("/" + channel.name, schema, "cdr", message.channel_metadata(channel))
            tracks[channel.name] = _Track(channel, number)
        return tracks

    def _track(self, name: str) -> "_Track":
        if self._failure:
            raise self._failure
        if self._closed:
            raise LogError(
                f"{self.path}: the log is closed, nothing can be written to it. Write inside the `with` block"
            )
        track = self._tracks.get(name)
        if track is None:
            raise LogError(f"{self.path}: no such channel: {name!r}. {suggestion(name, self._tracks)}")
        return track

    def _add(self, block: bytes) -> None:
        self._pending.append(block)
        self._added += 1
        self._pending_size += len(block)
        if self._pending_size >= _PENDING_LIMIT:
            self._wait(self._added)
        elif self._pending_size >= _CHUNK_SIZE and not self._hurry:
            self._hurry = True
            self._condition.notify_all()

    def _wait(self, blocks: int) -> None:
        """Wait until so many blocks are with the operating system."""
        self._hurry = True
        self._condition.notify_all()
        self._condition.wait_for(lambda: self._written >= blocks or self._failure)
        if self._failure:
            raise self._failure

    def _work(self) -> None:
        """The one thread that touches the file: Ctrl-C cuts no write in two, a slow disk holds up no control loop."""
        closed, synced = False, time.monotonic()
        while not (closed or self._failure):
            with self._condition:
                self._condition.wait_for(lambda: self._hurry, _FLUSH_PERIOD)
                blocks, self._pending, self._pending_size = self._pending, [], 0
                self._hurry, closed = False, self._closed
                notes, self._annotations = self._annotations, {}
            try:
                for chunk in _chunks(blocks):
                    self._file.chunk(chunk)
                if notes:  # at once: what a killed process was flying is not lost with it
                    self._file.metadata(METADATA_NAME, notes)
                    self._file.flush()
                self._report(len(blocks))
                if closed:
                    self._file.finish()
                if closed or time.monotonic() - synced > _SYNC_PERIOD:
                    self._sync()
                    synced = time.monotonic()
            except Exception as error:  # whatever it is, the next call of the writer raises it
                self._broken(error)
                self._report(0)

    def _report(self, blocks: int) -> None:
        with self._condition:
            self._written += blocks
            self._condition.notify_all()

    def _sync(self) -> None:
        try:
            os.fsync(self._stream.fileno())
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a pipe or a device has nothing to sync
                raise

    def _close_stream(self) -> None:
        try:
            self._stream.close()
        except (OSError, ValueError):
            pass  # reported by the write that failed, which may have closed what lies below

    def _broken(self, error: Exception) -> LogError:
        self._failure = cut_short(self.path, error, self._file)
        return self._failure


def cut_short(path: Path, error: Exception, file: McapFile) -> LogError:
    """End a log that can't be written any further; the error that says what is kept of it."""
    last = file.end_early()
    if last is None:
        return LogError(f"{write_error(path, error)}. `rovtwin log repair {path}` saves what was written so far")
    return LogError(f"{write_error(path, error)}. What was logged up to {last / message.NANOSECONDS:.2f} s is kept")


@dataclass(slots=True)
class _Track:
    """A channel being written: its number, messages so far and last stamp [ns]."""

    channel: Channel
    number: int
    size: int = 0
    length: int = 0
    count: int = 0
    last: int = 0

    def __post_init__(self) -> None:
        self.size = len(self.channel.fields)
        self.length = message.record_dtype(self.size).itemsize - message.HEADER_SIZE

    def advance(self, first: int, last: int, path: Path) -> None:
        if first < self.last:
            raise message.backwards(
                self.channel, first / message.NANOSECONDS, self.last / message.NANOSECONDS, str(path)
            )
        self.last = last


def _chunks(blocks: list[bytes]) -> Iterator[bytes]:
    """Blocks joined to about the size of a chunk."""
    first, size = 0, 0
    for k, block in enumerate(blocks):
        size += len(block)
        if size >= _CHUNK_SIZE or k == len(blocks) - 1:
            yield b"".join(blocks[first : k + 1])
            first, size = k + 1, 0


def text_metadata(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Metadata as text: what isn't text becomes JSON. Adds the time of creation and the version of the format."""
    created = datetime.now(UTC).isoformat(timespec="milliseconds")
    return {"created": created, **as_text(metadata), "log_format": FORMAT}


def as_text(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Metadata with what isn't text as JSON."""
    return {
        str(key): value if isinstance(value, str) else json.dumps(value, default=str) for key, value in metadata.items()
    }
