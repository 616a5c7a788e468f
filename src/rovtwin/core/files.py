"""Files that a user names: what is read at all. Limits on kind and size have their home here.

A pipe or a device would be read for ever, and a large file would fill the memory before anybody says what is wrong.
"""

import errno
import os
import stat
from pathlib import Path

MOST_TEXT = 50_000_000  # bytes of a file of text
MOST_LOG = 4_000_000_000  # bytes of a log that is read at once
MOST_UPLOAD = (
    100_000  # bytes of a mission file that a page of the console sends; one of 512 way-points has up to 75,000
)


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
