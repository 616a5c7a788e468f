"""How results look in a notebook: a heading and a table, as HTML."""

from collections.abc import Iterable
from html import escape
from typing import Any


def html_table(title: str, rows: Iterable[tuple[str, Any, str]], notes: Iterable[str] = ()) -> str:
    """A heading, a row for each label, value and unit, and a line for each note; everything is escaped."""
    lines = "".join(
        f"<tr><th style='text-align:left'>{escape(label)}</th><td>{escape(_text(value))} {escape(unit)}</td></tr>"
        for label, value, unit in rows
    )
    below = "".join(f"<div>{escape(note)}</div>" for note in notes)
    return f"<div><b>{escape(title)}</b><table>{lines}</table>{below}</div>"


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return " / ".join(_text(one) for one in value)
    return f"{value:.3g}" if isinstance(value, float) else str(value)
