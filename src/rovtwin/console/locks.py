"""Files that a process locks as long as it lives: how others see that it is there, however it ends."""

import fcntl
import os
import time
from pathlib import Path

TRIES = 10  # to lock a file which somebody only looks at
PAUSE = 0.05  # between two of them [s]


def is_locked(path: Path) -> bool:
    """Whether a process holds the file's lock."""
    try:
        with path.open() as lock:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # there never was one
        return False
    return False


class Lock:
    """A file's lock, which this process takes and gives back; it falls with the process."""

    def __init__(self, path: Path):
        self._path = path
        self._file: int | None = None

    @property
    def is_ours(self) -> bool:
        """Whether this process has taken it."""
        return self._file is not None

    def take(self) -> bool:
        """Take it; False where another process has it."""
        if self._file is not None:
            return True
        file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
        for _ in range(TRIES):
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:  # another's, or for a moment of somebody who looks whether it is taken
                time.sleep(PAUSE)
            else:
                self._file = file
                return True
        os.close(file)
        return False

    def give(self) -> None:
        """Give it back; may be called twice."""
        file, self._file = self._file, None
        if file is not None:
            os.close(file)
