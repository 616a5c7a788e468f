"""What a reader of one format returns: tables as they lie in the file, and what the format itself says about them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.config import near
from rovtwin.identification.logs.log_spec import Column, CommandSpec, SignalSpec
from rovtwin.identification.logs.readers.clocks import increasing

_SHOWN = 12  # names in a message
_FALLS = 0.05  # share of steps in which a time may fall: clocks are set back now and then
_COMMANDING = re.compile(
    "thrust|pwm|command|cmd|motor|servo|esc|throttle|output|rcou|pilot|joystick|control|surge|heave", re.I
)


@dataclass(frozen=True, eq=False)
class Table:
    """Columns over one clock.

    Attributes:
        values: Shape (n, k).
        columns: Names, k of them; empty where the file has none.
        t: Clock [s], or None where a column holds it.
    """

    values: np.ndarray
    columns: tuple[str, ...] = ()
    t: Float[np.ndarray, " n"] | None = None

    def index(self, column: Column, where: str) -> int:
        """Number of a column given by name or number."""
        width = self.values.shape[1]
        if isinstance(column, str) and column in self.columns:
            return self.columns.index(column)
        if isinstance(column, int) and 0 <= column < width:
            return column
        if isinstance(column, str) and self.columns:
            raise IdentificationError(f"{where}: no column {column!r}.{near(column, self.columns)}")
        raise IdentificationError(f"{where}: no column {column!r}, expected a number from 0 to {width - 1}")

    def clock(self, column: Column | None, where: str) -> Float[np.ndarray, " n"]:
        """Times [s]: of a column, else the table's own, else its first column."""
        if column is None and self.t is not None:
            return self.t
        return self.values[:, self.index(0 if column is None else column, where)]

    def column(self, name: str) -> Float[np.ndarray, " n"]:
        """One that is known to be there."""
        return self.values[:, self.columns.index(name)]

    def pick(self, columns: list[Column], where: str) -> Float[np.ndarray, "n k"]:
        """Shape (n, len(columns))."""
        return self.values[:, [self.index(column, where) for column in columns]]


@dataclass(frozen=True, eq=False)
class Raw:
    """One file.

    Attributes:
        path: For messages.
        tables: By name.
        signals: What the format itself says about its signals; what the user says comes before it.
        commands: Likewise; None where the format does not know.
        water_density: Where the file says it [kg/m3].
        tether_length: Paid out, where the file says it [m].
        scale_std: Of its positions, a share: how well their scale is known.
        notes: What was left out while reading.
        touched: From and to [s], by the file's clock: somebody held the vehicle, which no model knows of, or what its
            thrusters did is not known.
        command_interval: Of commands that were read now and then, not whenever they changed [s]; else None.
        no_commands: Why the format, which otherwise knows its commands, has none here.
    """

    path: Path
    tables: dict[str, Table]
    signals: dict[str, SignalSpec] = field(default_factory=dict)
    commands: CommandSpec | None = None
    water_density: float | None = None
    tether_length: float | None = None
    scale_std: float = 0.0
    notes: tuple[str, ...] = ()
    touched: tuple[tuple[float, float], ...] = ()
    command_interval: float | None = None
    no_commands: str = ""

    def table(self, name: str | None, where: str) -> Table:
        """The table of that name; without a name the only one."""
        if name is None and len(self.tables) == 1:
            return next(iter(self.tables.values()))
        if name not in self.tables:
            text = "no 'from' given" if name is None else f"from: no {name!r}.{alike(name, self.tables)}"
            raise IdentificationError(f"{where}: {text}; the file has {listed(self.tables)}")
        return self.tables[name]

    def clock(
        self, table: Table, columns: Sequence[Column], time: Column | None, where: str
    ) -> Float[np.ndarray, " n"]:
        """Times [s] of a table's rows.

        Args:
            table: One of the file's.
            columns: Those that are read as data.
            time: What was given: a column, or another table that has nothing but the times.
            where: For messages.

        Raises:
            IdentificationError: There is no such column or table, or what is taken for the time is data.
        """
        if isinstance(time, str) and time not in table.columns:
            return self._other(table, time, where)
        t = table.clock(time, where)
        if time is not None or table.t is not None:
            return t
        both = any(table.index(column, where) == 0 for column in columns)
        falls = float(np.mean(np.diff(t) < 0)) if len(t) > 1 else 0.0
        if both or falls > _FALLS:
            why = "is read as data too" if both else f"falls in {falls:.0%} of its steps"
            raise IdentificationError(
                f"{where}: nothing says where its times are; the first column, which is taken then, {why}. "
                f"Give time: a column, or the array that has them{self._times_for(table)}; the file has "
                f"{listed(self.tables)}"
            )
        return t

    def _other(self, table: Table, time: str, where: str) -> Float[np.ndarray, " n"]:
        other, rows = self.tables.get(time), len(table.values)
        if other is None:
            among = [*self.tables, *table.columns]
            raise IdentificationError(
                f"{where}.time: no column or array {time!r}.{alike(time, among)}{self._times_for(table)}; the file has "
                f"{listed(self.tables)}"
            )
        if other.values.shape != (rows, 1):
            raise IdentificationError(
                f"{where}.time: {time!r} has {_shape(other)}, expected {rows} rows, 1 column, a time for each row"
                f"{self._times_for(table)}"
            )
        return other.values[:, 0]

    def _times_for(self, table: Table) -> str:
        """Arrays that may hold a table's times, for a message."""
        rows = len(table.values)
        fit = [n for n, o in self.tables.items() if o.values.shape == (rows, 1) and increasing(o.values[:, 0])]
        return f" (as long, and increasing: {', '.join(fit[:6])})" if fit else ""


def listed(tables: Mapping[str, Table]) -> str:
    """What a file has, with shapes, and names of the columns where there are some."""
    shown = [
        f"{name} ({_shape(table)}{': ' + ', '.join(table.columns[:_SHOWN]) if table.columns else ''}"
        f"{' ..' if len(table.columns) > _SHOWN else ''})"
        for name, table in list(tables.items())[:_SHOWN]
    ]
    return ", ".join(shown) + (" .." if len(tables) > _SHOWN else "") if shown else "nothing that can be read"


def _shape(table: Table) -> str:
    rows, columns = table.values.shape
    return f"{rows} rows, {columns} column{'s' if columns != 1 else ''}"


def alike(name: str, known: Iterable[str]) -> str:
    """` Did you mean ..?`, or nothing where no name is near."""
    text = near(name, list(known))
    return text if "Did you mean" in text else ""


def no_commands(raws: Sequence[Raw], thrusters: Sequence[str]) -> IdentificationError:
    """That files have no commands, with what they do have, and which of it may be some."""
    names = [n for raw in raws for key, table in raw.tables.items() for n in (key, *table.columns)]
    likely = [n for n in dict.fromkeys(names) if _COMMANDING.search(n)]
    hint = f" Perhaps {', '.join(repr(n) for n in likely[:_SHOWN])}." if likely else ""
    source = ", ".join(str(raw.path) for raw in raws)
    there = "; ".join(listed(raw.tables) for raw in raws)
    if why := "; ".join(raw.no_commands for raw in raws if raw.no_commands):
        return IdentificationError(
            f"{source}: found no commands ({why}); give 'commands', or list the file that has them under 'files'"
        )
    return IdentificationError(
        f"{source}: found no commands; no columns are named as the thrusters ({', '.join(thrusters)}).{hint} Give "
        "'commands', as {from: ARRAY, columns: [1, 2, ..], unit: pwm}, or list the file that has them under 'files'. "
        f"Found: {there}"
    )


def spec(**given: object) -> SignalSpec:
    """A SignalSpec from Python; `table` stands for `from`."""
    return SignalSpec.model_validate({"from" if key == "table" else key: value for key, value in given.items()})
