"""Folders whose making is under way, with a mark beside them, so that none that is half done is taken for complete."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rovtwin.core.user_files.files import write_text

_MARK = ".unfinished"


@contextmanager
def under_way(folder: Path) -> Iterator[None]:
    """A file `NAME.unfinished` lies beside the folder until its making is over; it stays where that fails.

    A folder that is there before is somebody's: it gets no mark.
    """
    mark = folder.with_name(folder.name + _MARK)
    if folder.exists():
        yield
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    write_text(mark, f"{folder.name} is not complete: what made it is still at it, or was stopped.\n")
    try:
        yield
    except BaseException:
        if not folder.exists():  # nothing was made that could be half done
            mark.unlink()
        raise
    mark.unlink()


def remove_unfinished(parent: Path) -> list[str]:
    """Folders with a mark are removed, and the parent where nothing is left of it; names of those that are complete."""
    for mark in parent.glob(f"*{_MARK}"):
        shutil.rmtree(mark.with_suffix(""), ignore_errors=True)
        mark.unlink()
    kept = sorted(path.name for path in parent.iterdir() if path.is_dir()) if parent.is_dir() else []
    if parent.is_dir() and not any(parent.iterdir()):
        parent.rmdir()
    return kept
