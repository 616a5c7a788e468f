"""A view of one's own on the console's page: what it is, and how it is looked at in a process of its own.

It runs neither in the web server, which has to hand on STOP, nor as a script of the page, which has the button: it
gives text, rows or a picture, which the page shows.
"""

import traceback
from collections.abc import Sequence
from functools import cache
from io import StringIO
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.plugins import VIEWS, load

MOST_BYTES, MOST_ROWS, MOST_TEXT = 500_000, 200, 4000  # that a page is given of one look
LEAST, MOST = 0.2, 60.0  # between two looks [s]


class View:
    """A view: a class without arguments, which is made once and may remember what it saw.

    Attributes:
        title: On its tab; by default the name of the class.
        every: Time between two looks [s], from 0.2 to 60.
    """

    title: str = ""
    every: float = 1.0

    def show(self, state: dict[str, Any]) -> Any:
        """What the page shows now.

        Args:
            state: What the engine reports: `stage`, `armed`, and once there is a vehicle `t`, `phase`, `eta`, `nu`,
                `u`, `tau`, `sensors`, and what else docs/extending/view.md has.

        Returns:
            Text; rows of label, value and unit; an SVG picture as text, or a matplotlib Figure.
        """
        raise NotImplementedError(f"{type(self).__name__}.show")


def found_view(text: str, where: str = "--view") -> View:
    """The view at an address or entry point, made.

    Raises:
        ConfigError: It cannot be found, nobody consented to run it, it is none, or it cannot be made.
    """
    target = load(text, VIEWS, where)
    if not (isinstance(target, type) and issubclass(target, View)):
        found = f"the class {target.__name__}" if isinstance(target, type) else type(target).__name__
        raise ConfigError(f"{where}: {text}: found {found}, expected a class of {View.__module__}.View")
    try:
        made = target()
    except Exception as error:  # of somebody else's code: anything
        raise ConfigError(f"{where}: {text}: cannot be made without arguments: {in_words(error)}") from error
    _require_every(made.every, f"{where}: {text}")
    return made


def _require_every(every: Any, where: str) -> None:
    if not isinstance(every, int | float) or not LEAST <= every <= MOST:
        raise ConfigError(f"{where}: every: found {every!r:.40}, expected {LEAST:g} to {MOST:g} s")


def shown(view: View, state: dict[str, Any]) -> dict[str, Any]:
    """What the page is given of one look: `svg`, `rows` or `text`, and `title` and `every` of the view.

    Raises:
        ConfigError: The view fails, or gives something else; the text names what and where.
    """
    name = type(view).__name__
    try:  # what it gives runs its code too: a cell's text, a figure's drawing
        found = _content(view.show(state), f"{name}.show")
        _require_every(view.every, name)
        return found | {"title": str(view.title or name)[:40], "every": float(view.every)}
    except Exception as error:  # of somebody else's code: anything
        if type(error) is ConfigError:
            raise
        raise ConfigError(f"{name}.show failed: {in_words(error)}") from error


def _content(found: Any, where: str) -> dict[str, Any]:
    if hasattr(found, "savefig"):
        text = StringIO()
        found.savefig(text, format="svg")
        found = text.getvalue()
    if isinstance(found, str) and "<svg" in found[:2000]:
        if len(found) > MOST_BYTES:
            raise ConfigError(f"{where} gave a picture of {len(found)} bytes, expected at most {MOST_BYTES}: draw less")
        return {"svg": found[found.index("<svg") :]}
    if isinstance(found, str):
        return {"text": found[:MOST_TEXT]}
    if isinstance(found, Sequence) and all(isinstance(r, Sequence) and not isinstance(r, str) for r in found):
        rows = [[_cell(cell) for cell in row] for row in found]
        if all(1 <= len(row) <= 3 for row in rows):
            return {"rows": rows[:MOST_ROWS]}
    raise ConfigError(
        f"{where} gave {type(found).__name__} ({found!r:.60}), expected text, rows of label, value and unit, an SVG "
        "picture or a matplotlib Figure"
    )


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)[:200]


def in_words(error: BaseException) -> str:
    """What an error of somebody else's code says, and in which of its lines."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename != __file__]
    place = f" ({frames[-1].filename.rpartition('/')[2]}, line {frames[-1].lineno})" if frames else ""
    try:
        text = str(error)[:300]
    except Exception:  # of somebody else's error
        text = "(without a text)"
    return f"{type(error).__name__}: {text}{place}"


_made = cache(found_view)  # in the view's process: made once


def look(text: str, state: dict[str, Any]) -> dict[str, Any]:
    """In the view's process: one look.

    Raises:
        ConfigError: See `found_view` and `shown`.
    """
    return shown(_made(text), state)
