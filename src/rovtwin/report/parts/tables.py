"""A table of a report, and its words."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Table:
    """A table for the template: cells are text."""

    title: str
    head: list[str]
    rows: list[list[str]]
    note: str = ""


def words(key: str) -> str:
    """A key as people read it."""
    return key.replace("_", " ")


def text(value: Any) -> str:
    """A value in a cell."""
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value + 0.0:.5g}" if np.isfinite(value) else str(value)  # + 0.0: no negative zero
        case list() | tuple():
            return ", ".join(text(one) for one in value) or "none"
        case Mapping():
            return ", ".join(f"{words(str(k))}: {text(v)}" for k, v in value.items())
    return str(value)
