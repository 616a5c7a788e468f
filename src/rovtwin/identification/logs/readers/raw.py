"""What a reader of one format returns: tables as they lie in the file, and what the format itself says about them."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rovtwin.core.config import near
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.log_spec import Column, CommandSpec, SignalSpec


@dataclass(frozen=True, eq=False)
class Table:
    """Columns over one clock.

    Attributes:
        values: Shape (n, k).
        columns: Names, k of them; empty where the file has none.
        t: Clock [s], shape (n,), or None where a column holds it.
    """

    values: np.ndarray
    columns: tuple[str, ...] = ()
    t: np.ndarray | None = None

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

    def clock(self, column: Column | None, where: str) -> np.ndarray:
        """Times [s], shape (n,): of a column, else the table's own, else its first column."""
        if column is None and self.t is not None:
            return self.t
        return self.values[:, self.index(0 if column is None else column, where)]

    def column(self, name: str) -> np.ndarray:
        """One that is known to be there, shape (n,)."""
        return self.values[:, self.columns.index(name)]

    def pick(self, columns: list[Column], where: str) -> np.ndarray:
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
            said = "no 'from' given" if name is None else f"from: no {name!r}.{near(name, ())}"
            raise IdentificationError(f"{where}: {said}; the file has {_listed(self.tables)}")
        return self.tables[name]


def _listed(tables: dict[str, Table]) -> str:
    shown = [f"{name} ({table.values.shape[1]} columns)" for name, table in list(tables.items())[:12]]
    return ", ".join(shown) + (" .." if len(tables) > 12 else "") if shown else "nothing that can be read"


def spec(**given: object) -> SignalSpec:
    """A SignalSpec from Python; `table` stands for `from`."""
    return SignalSpec.model_validate({"from" if key == "table" else key: value for key, value in given.items()})


def require(module: str, extra: str, why: str) -> None:
    """Raise an IdentificationError with the command to run, where a package of an extra is missing."""
    from importlib.util import find_spec

    try:
        found = find_spec(module)
    except ModuleNotFoundError:
        found = None
    if found is None:
        raise IdentificationError(f"{why} needs {module}: pip install 'rovtwin[{extra}]'")
