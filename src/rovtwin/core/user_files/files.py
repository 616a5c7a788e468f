"""Files that a user names: what is read at all, and how results are written. Limits on kind and size are kept here.

A pipe or a device would be read for ever, and a large file would fill the memory before anybody says what is wrong. A
result is written whole or not at all: a full disk or a kill leaves what was there before.
"""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MOST_TEXT = 50_000_000  # bytes of a file of text
MOST_LOG = 4_000_000_000  # bytes of a log that is read at once
MOST_UPLOAD = 100_000  # bytes of a mission that a page of the console sends; 512 way-points have up to 75,000
FULL = {
    errno.ENOSPC: "Free some space, then try again",
    errno.EDQUOT: "Free some space, then try again",
    errno.EFBIG: "The system lets no file grow further (ulimit -f, or the file system)",
}


def checked(path: str | Path, most: float = MOST_TEXT) -> Path:
    """The path of an ordinary file of at most so many bytes; inf for one that is read piece by piece.

    Raises:
        FileNotFoundError: There is none.
        IsADirectoryError: It is a folder.
        OSError: It is a pipe, a device or a socket, or too large; `strerror` says which, as with every OSError.
    """
    path = Path(path)
    found = os.stat(path)
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is a pipe or a device, expected a file", str(path))
    if found.st_size > most:
        raise OSError(
            errno.EFBIG, f"it has {found.st_size / 1e6:,.0f} MB, expected at most {most / 1e6:,.0f} MB", str(path)
        )
    return path


def is_file(path: str | Path) -> bool:
    """Whether there is such a file; a name that is too long for any file is that of none.

    Raises:
        OSError: The system does not let it be seen.
    """
    try:
        return Path(path).is_file()
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        return False


def read_text(path: str | Path, most: int = MOST_TEXT) -> str:
    """The text of a file, with or without a byte order mark.

    Raises:
        OSError: See `checked`, or the system does not let it be read.
        UnicodeDecodeError: It is not UTF-8.
    """
    return checked(path, most).read_text(encoding="utf-8-sig")


def read_bytes(path: str | Path, most: int = MOST_LOG) -> bytes:
    """The content of a file.

    Raises:
        OSError: See `checked`, or the system does not let it be read.
    """
    return checked(path, most).read_bytes()


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """Gives a temporary path in the same folder; what is written there becomes `path` when the block ends well.

    Raises:
        OSError: It can't be written; `filename` is the path.
    """
    path = Path(os.path.realpath(path))
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        with open(temporary, "rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all; into a pipe or a device, such as /dev/stdout, directly.

    Raises:
        OSError: It can't be written; `filename` is the path.
    """
    if Path(path).exists() and not Path(path).is_file():
        Path(path).write_bytes(content)
        return
    with whole(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: str | Path, text: str) -> None:
    """The same of text, in UTF-8.

    Raises:
        OSError: It can't be written; `filename` is the path.
    """
    write_bytes(path, text.encode())


def cannot(error: OSError) -> str:
    """What an OSError says: which file, why not, and on a full disk what helps."""
    where = f"{error.filename}: " if error.filename else ""
    fix = f". {FULL[error.errno]}" if error.errno in FULL else ""
    return f"{where}{error.strerror}{fix}" if error.strerror else str(error)
