"""Writing files without losing any: nothing is overwritten unasked, and no result is left half-written."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rovtwin.core.errors import LogError, exists_already

_FIXES = {
    errno.ENOENT: "Create the folder first",
    errno.EISDIR: "Name a file in it, such as run.mcap",
    errno.ENOTDIR: "Part of the path is a file, not a folder",
    errno.EACCES: "Choose a folder you may write to",
    errno.EROFS: "Choose a folder you may write to",
    errno.ENOSPC: "Free some space, then try again",
    errno.EDQUOT: "Free some space, then try again",
}


def exists_error(path: Path) -> LogError:
    """The error for a file that would be overwritten."""
    if path.is_dir():
        return LogError(f"{path}: is a folder. Name a file in it, such as {path / 'run.mcap'}")
    return LogError(exists_already(path, "overwrite=True"))


def write_error(path: Path, error: Exception) -> LogError:
    """The error for a file that can't be written."""
    what, number = getattr(error, "strerror", None) or error, getattr(error, "errno", None)
    return LogError(f"{path}: cannot be written: {what}. {_FIXES.get(number or 0, 'Check the path and the disk')}")


@contextmanager
def atomic(path: Path, overwrite: bool) -> Iterator[Path]:
    """Gives a temporary path in the same folder; what is written there becomes `path` when the block ends well.

    Raises:
        LogError: The file exists and may not be replaced, or can't be written.
    """
    if path.exists() and not overwrite:
        raise exists_error(path)
    if not path.parent.is_dir():
        raise LogError(f"{path}: cannot be written: there is no folder {path.parent}. Create it first")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        with open(temporary, "rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise write_error(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)
