"""Rebuilding a log whose run was killed, or whose file was cut or damaged."""

from dataclasses import dataclass
from pathlib import Path

from rovtwin.core.errors import LogError
from rovtwin.core.log.files import atomic
from rovtwin.core.log.mcapfile import McapFile
from rovtwin.core.log.reader import open_file
from rovtwin.core.log.salvage import Salvage


@dataclass(frozen=True)
class Repair:
    """What a repair saved.

    Attributes:
        path: The new file.
        messages: Number of messages saved, by channel name.
        last_time: Time of the last of them [s], or None when there is none.
        finished: Whether the original was whole, so that there was nothing to repair.
        lost: Number of messages lost; None where the original has no index that counts them.
        notes: What was damaged and what was lost, one line each.
    """

    path: Path
    messages: dict[str, int]
    last_time: float | None
    finished: bool
    lost: int | None
    notes: tuple[str, ...]


def repair(path: str | Path, out: str | Path | None = None, overwrite: bool = False) -> Repair:
    """Write a whole log from an unfinished or damaged one, which is left as it is.

    Every message is kept whose chunk is whole, whatever happened to the rest of the file.

    Args:
        path: The log.
        out: The new file; by default `run.repaired.mcap` beside `run.mcap`.
        overwrite: Whether an earlier repair may be replaced.

    Raises:
        LogError: The file is missing, not MCAP, another program's, or holds nothing to save, or the new one can't be
            written.
    """
    path = Path(path)
    out = path.with_name(f"{path.stem}.repaired.mcap") if out is None else Path(out)
    if out.exists() and out.samefile(path):
        raise LogError(f"{out}: is the log itself. A repair leaves the original alone: name another file")
    salvage = _salvaged(path, out, overwrite)
    notes = tuple(salvage.notes)
    return Repair(out, salvage.saved(), salvage.last_time, not notes, salvage.lost, notes)


def _salvaged(path: Path, out: Path, overwrite: bool) -> Salvage:
    """Read one file, write the other; see `repair`."""
    with open_file(path) as stream, atomic(out, overwrite, f"; {path} is as it was") as temporary:
        with open(temporary, "wb") as target:
            salvage = Salvage(McapFile(target))
            salvage.take(stream, path)
            if not salvage.channels:
                raise LogError(f"{path}: nothing to save: no channel is declared in its {path.stat().st_size} bytes")
            if not salvage.readable:
                raise _foreign(path, salvage)
            salvage.file.finish()
    return salvage


def _foreign(path: Path, salvage: Salvage) -> LogError:
    topics = sorted(salvage.topics.values())
    some = ", ".join(topics[:3]) + (f" and {len(topics) - 3} more" if len(topics) > 3 else "")
    program = salvage.library or "it does not say which"
    return LogError(
        f"{path}: another program's log ({program}): found the channels {some}, expected one that rovtwin wrote. It is "
        "left as it is; `mcap recover` repairs such files"
    )
