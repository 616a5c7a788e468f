"""Finished runs: those in a folder, newest first, and the way to one of them by its name."""

import json
import re
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from rovtwin.console.replays.replay import LOG
from rovtwin.core.errors import ConfigError

MOST = 300  # that are listed
BY_HAND = ("disarmed", "stopped by the operator", "operator", "interrupted")  # endings that somebody chose
_NAMED = re.compile(r"(\d{8}-\d{6})-(.+)")  # as runs.fly.run_folder names them


@dataclass(frozen=True)
class Run:
    """A run in short.

    Attributes:
        run: Its folder, from that of all runs; `Shelf.find` takes it.
        name: Of its scenario.
        date: When it began, local time, as people write it.
        verdict: `completed`, or why not; `unfinished` where nobody closed the log.
        completed: None where nobody knows.
        level: Of the verdict: ok, danger, or "" for what somebody chose or nobody knows.
        duration: [s], or None.
    """

    run: str
    name: str
    date: str
    verdict: str
    completed: bool | None
    level: str
    duration: float | None


class Shelf:
    """The runs in a folder, and in folders of it, as demos and comparisons leave them."""

    def __init__(self, folder: Path):
        self.folder = folder

    def runs(self) -> list[dict[str, Any]]:
        """Newest first."""
        logs = [*self.folder.glob(f"*/{LOG}"), *self.folder.glob(f"*/*/{LOG}")]
        dated = sorted(((_began(log), log) for log in logs), key=lambda one: one[0], reverse=True)
        return [asdict(self._short(log, began)) for began, log in dated[:MOST]]

    def find(self, run: str) -> Path:
        """The folder of a run.

        Raises:
            ConfigError: There is no such run in the folder; nothing outside of it is one.
        """
        root = self.folder.resolve()
        try:
            path = (root / run).resolve()
            known = path != root and path.is_relative_to(root) and (path / LOG).is_file()
        except (OSError, ValueError):  # a name that is too long, or holds a zero
            known = False
        if not known:
            raise ConfigError(f"{run[:80]!r}: found no such run in {self.folder}, expected a folder there with a {LOG}")
        return path

    def _short(self, log: Path, began: datetime) -> Run:
        folder = log.parent
        named = _NAMED.fullmatch(folder.name)
        try:
            summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            summary = {}
        completed = summary.get("completed")
        verdict = (
            "unfinished" if completed is None else "completed" if completed else summary.get("reason") or "stopped"
        )
        return Run(
            folder.relative_to(self.folder).as_posix(),
            named[2] if named else folder.name,
            f"{began:%Y-%m-%d %H:%M}",
            verdict,
            completed,
            "ok" if completed else "" if completed is None or verdict in BY_HAND else "danger",
            summary.get("duration_s"),
        )


def _began(log: Path) -> datetime:
    """By the folder's name, or that of the folder it is in; else by when the log was written."""
    for folder in (log.parent, log.parent.parent):
        if named := _NAMED.fullmatch(folder.name):
            try:
                return datetime.strptime(named[1], "%Y%m%d-%H%M%S")
            except ValueError:
                continue
    return datetime.fromtimestamp(log.stat().st_mtime)
