"""Between the engine and the web server: where they meet, and how messages look on the way.

Sockets lie in a folder that only its owner may enter, so that nobody else of this machine, and nobody of another one,
can reach the autopilot. The engine publishes JSON texts with a "kind" and answers orders, JSON texts with a "do".
"""

import contextlib
import json
import math
import os
import stat
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError

FRESH = 1.0  # an order older than this is not obeyed: it waited for an autopilot that hung [s]
DEEPEST = 16  # an order nested deeper is none; how deep JSON may be nested otherwise depends on the Python
LONGEST = 85  # path of a folder in which sockets have room; theirs may have 107 [bytes]


@dataclass(frozen=True)
class Place:
    """Where an engine and its web servers meet: a folder for each port of the console."""

    folder: Path

    @classmethod
    def of(cls, port: int) -> "Place":
        """The place of the console on a port; made where it is not there.

        Raises:
            ConfigError: It belongs to somebody else, or its path is too long for sockets.
        """
        folder = Path(tempfile.gettempdir()) / f"rovtwin-{os.getuid()}-{port}"
        if len(os.fsencode(folder)) > LONGEST:
            raise ConfigError(f"{folder}: found a path too long for sockets, expected {LONGEST} bytes: set TMPDIR=/tmp")
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        found = folder.lstat()  # others of this machine may have laid a link here, to a folder of ours
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
            raise ConfigError(f"{folder}: expected a folder that is yours alone; remove it")
        return cls(folder)

    @property
    def news(self) -> str:
        """Where the engine publishes."""
        return f"ipc://{self.folder / 'news'}"

    @property
    def orders(self) -> str:
        """Where it takes orders."""
        return f"ipc://{self.folder / 'orders'}"

    @property
    def stop(self) -> Path:
        """Socket of the link's host at which any message stops the thrusters."""
        return self.folder / "stop"

    @property
    def lock(self) -> Path:
        """File that an engine has locked as long as it lives."""
        return self.folder / "lock"

    @property
    def commissioning(self) -> Path:
        """File that a web server has locked as long as a commissioning holds the vehicle in place of the engine."""
        return self.folder / "commissioning"

    @property
    def note(self) -> Path:
        """File that says which engine is there: its process and what it flies."""
        return self.folder / "engine.json"


def encode(message: dict[str, Any]) -> bytes:
    """A message as JSON; arrays become lists of nine significant digits, what is not finite becomes null."""
    try:  # a plan of 512 way-points takes 2 ms so, and 16 ms value by value: STOP waits as long
        return _dumps(message, default=_plain).encode()
    except ValueError:  # something that is not finite
        return _dumps(_plain(message)).encode()


_dumps = partial(json.dumps, allow_nan=False, separators=(",", ":"))


def decode(text: str | bytes) -> dict[str, Any]:
    """The message that a JSON text is, by the standard library's parser, level by level checked for depth.

    Raises:
        ValueError: It is no JSON object, or nested deeper than 16 levels.
    """
    try:
        message = json.loads(text)
    except RecursionError:
        raise ValueError(f"nested deeper than {DEEPEST} levels") from None
    if not isinstance(message, dict):
        raise ValueError(f"found {type(message).__name__}, expected an object")
    level: list[Any] = [message]
    for _ in range(DEEPEST):
        level = [inner for outer in level for inner in (outer.values() if isinstance(outer, dict) else outer)]
        level = [item for item in level if isinstance(item, dict | list)]
    if level:
        raise ValueError(f"nested deeper than {DEEPEST} levels")
    return message


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool | str | int) or value is None:
        return value
    if isinstance(value, np.bool_):
        return bool(value)
    number = float(value)
    return float(f"{number:.9g}") if math.isfinite(number) else None
