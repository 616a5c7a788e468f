"""Writing files without losing any: nothing is overwritten unasked, and no result is left half-written."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rovtwin.core.errors import LogError, exists_already
from rovtwin.core.user_files.files import FULL, whole

_FIXES = {
    errno.ENOENT: "Create the folder first",
    errno.EISDIR: "Name a file in it, such as run.mcap",
    errno.ENOTDIR: "Part of the path is a file, not a folder",
    errno.EACCES: "Choose a folder you may write to",
    errno.EROFS: "Choose a folder you may write to",
    **FULL,
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
def atomic(path: Path, overwrite: bool, kept: str = "") -> Iterator[Path]:
    """Gives a temporary path in the same folder; what is written there becomes `path` when the block ends well.

    Args:
        path: The file.
        overwrite: Whether one that is there may be replaced.
        kept: What an error says behind "Nothing of it was written".

    Raises:
        LogError: The file exists and may not be replaced, or can't be written.
    """
    if path.exists() and not overwrite:
        raise exists_error(path)
    if not path.parent.is_dir():
        raise LogError(f"{path}: cannot be written: there is no folder {path.parent}. Create it first")
    try:
        with whole(path) as temporary:
            yield temporary
    except OSError as error:
        raise LogError(f"{write_error(path, error)}. Nothing of it was written{kept}") from error


@contextmanager
def keeping(folder: Path, what: str) -> Iterator[None]:
    """A block that writes into a folder: when it can't, the error ends with what is kept all the same.

    Raises:
        LogError: Something can't be written.
    """
    try:
        yield
    except OSError as error:
        raise LogError(f"{write_error(Path(error.filename or folder), error)}. {what}") from error
