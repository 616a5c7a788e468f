"""What a named channel of a log is: its fields, unit and frame."""

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass

from rovtwin.core.errors import LogError

_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", re.ASCII)
_FIELD = re.compile(r"[A-Za-z]\w*", re.ASCII)


@dataclass(frozen=True)
class Channel:
    """A time series of float64 vectors of fixed length.

    Flags and counters are stored as float64 too, which is exact up to 2**53.

    Args:
        name: Slash-separated path, such as `truth/position`.
        fields: Name of every component, such as `("x", "y", "z")`.
        unit: One unit for all components, or one for each, in udunits notation: `m`, `m/s`, `rad`, `N m`, and `1`
            for what has none.
        frame: Frame the components are resolved in: `n`, `b`, `c`, or empty when there is none.
        description: One line for people.
        rate: Nominal sample rate [Hz], or None when samples come as they come.
    """

    name: str
    fields: tuple[str, ...]
    unit: str | tuple[str, ...]
    frame: str
    description: str = ""
    rate: float | None = None

    def __post_init__(self) -> None:
        fields = (self.fields,) if isinstance(self.fields, str) else tuple(self.fields)
        units = (self.unit,) * len(fields) if isinstance(self.unit, str) else tuple(self.unit)
        self._check(fields, units)
        object.__setattr__(self, "fields", fields)
        object.__setattr__(self, "unit", units[0] if len(set(units)) == 1 else units)
        object.__setattr__(self, "rate", None if self.rate is None else float(self.rate))

    def _check(self, fields: tuple[str, ...], units: tuple[str, ...]) -> None:
        if not _NAME.fullmatch(self.name):
            raise LogError(
                f"channel {self.name!r}: not a channel name. Use letters, digits and _ between slashes, "
                "each part starting with a letter, such as 'truth/position'"
            )
        bad = [field for field in fields if not _FIELD.fullmatch(field)]
        if bad or not fields or len(set(fields)) < len(fields):
            raise LogError(
                f"channel {self.name!r}: fields {fields!r}: expected one or more different names of letters, "
                "digits and _, each starting with a letter"
            )
        if len(units) != len(fields) or not all(unit and unit.strip() == unit for unit in units):
            raise LogError(
                f"channel {self.name!r}: unit {self.unit!r} for the fields {fields!r}: expected one unit, or one "
                "for each field; write '1' for what has none"
            )
        if self.rate is not None and not 0 < self.rate < float("inf"):
            raise LogError(f"channel {self.name!r}: rate {self.rate!r} Hz: expected a positive number, or None")

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of every component, length n."""
        return (self.unit,) * len(self.fields) if isinstance(self.unit, str) else self.unit

    def index(self, field: str) -> int:
        """Position of a component.

        Raises:
            LogError: The channel has no such field.
        """
        if field not in self.fields:
            raise LogError(f"channel {self.name!r}: no such field: {field!r}. {suggestion(field, self.fields)}")
        return self.fields.index(field)


def suggestion(found: str, known: Iterable[str]) -> str:
    """The closest known name as a question, else the list of known names."""
    known = list(known)
    close = difflib.get_close_matches(str(found), known, n=1)
    return f"Did you mean {close[0]!r}?" if close else f"There is: {', '.join(known) or 'none'}"


def channel_table(channels: Iterable[Channel]) -> dict[str, Channel]:
    """Channels by name.

    Raises:
        LogError: Two channels share a name.
    """
    table: dict[str, Channel] = {}
    for channel in channels:
        if channel.name in table:
            raise LogError(f"channel {channel.name!r}: declared twice. Give every channel a name of its own")
        table[channel.name] = channel
    return table


def unique(name: str, taken: set[str], separator: str = "_") -> str:
    """The name, with a number behind it when it is taken; adds the result to `taken`."""
    result, number = name, 2
    while result in taken:
        result, number = f"{name}{separator}{number}", number + 1
    taken.add(result)
    return result
