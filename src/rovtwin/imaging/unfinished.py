"""Lines that a process has made so far, kept beside the file they are for: after a kill the next one goes on there."""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt16

from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import write_text

_AT_ONCE = 64  # lines read back at a time


class Unfinished:
    """Counts of lines in a file of their own, whole lines only.

    Args:
        target: The file of lines that is being made.
        key: Of all that the lines depend on; what was made of another one is thrown away.
        shape: Pixels and bands of a line.

    Raises:
        LogError: They cannot be written.
    """

    def __init__(self, target: Path, key: str, shape: tuple[int, int]) -> None:
        self._data = target.with_name(f".{target.name}.lines")
        self._note = target.with_name(f".{target.name}.lines.json")
        self._target, self._shape = target, shape
        self._bytes = 2 * shape[0] * shape[1]
        try:
            if not self._is_of(key):
                self.remove()
                write_text(self._note, json.dumps({"key": key}))
            with open(self._data, "ab") as stream:
                stream.truncate(self.done * self._bytes)  # a line cut short by a kill goes
        except OSError as error:
            raise write_error(target, error) from error

    def _is_of(self, key: str) -> bool:
        try:
            return json.loads(self._note.read_text(encoding="utf-8"))["key"] == key
        except (OSError, ValueError, KeyError, TypeError):
            return False

    @property
    def done(self) -> int:
        """How many whole lines are kept."""
        return self._data.stat().st_size // self._bytes if self._data.exists() else 0

    def cut(self, lines: int) -> None:
        """Keep the first lines only."""
        with open(self._data, "rb+") as stream:
            stream.truncate(lines * self._bytes)

    def append(self, counts: UInt16[np.ndarray, "line pixel band"]) -> None:
        """Keep lines, on the disk when this returns.

        Raises:
            LogError: They cannot be written, such as on a full disk.
        """
        try:
            with open(self._data, "ab") as stream:
                stream.write(np.ascontiguousarray(counts).data)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise write_error(self._target, error) from error

    def blocks(self) -> Iterator[UInt16[np.ndarray, "line pixel band"]]:
        """All that is kept, in order."""
        with open(self._data, "rb") as stream:
            while data := stream.read(_AT_ONCE * self._bytes):
                yield np.frombuffer(data, np.uint16).reshape(-1, *self._shape)

    def remove(self) -> None:
        """Keep nothing any more."""
        for path in (self._data, self._note):
            path.unlink(missing_ok=True)
