"""A clock that another process can make jump: it adds what a file says."""

import time
from dataclasses import dataclass
from pathlib import Path


def jump_in(path: Path) -> float:
    """Seconds that a file holds, 0 where there is none."""
    try:
        return float(path.read_text() or 0.0)
    except (OSError, ValueError):
        return 0.0


@dataclass(frozen=True)
class JumpingClock:
    """Time [s] with the jump of a file; picklable, so that it goes into a link's process."""

    path: Path

    def __call__(self) -> float:
        return time.monotonic() + jump_in(self.path)
