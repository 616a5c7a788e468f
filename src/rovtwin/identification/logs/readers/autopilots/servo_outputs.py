"""What logs of autopilots have in common: servo outputs become commands, and only what is valid is used."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.identification.logs.log_spec import CommandSpec, SignalSpec
from rovtwin.identification.logs.readers.autopilots.turning import stretches
from rovtwin.identification.logs.readers.raw import Raw, Table, spec

COMMANDS = "thrusters"  # table of the commands that were made of a log's outputs

ALONE = 60.0  # [s] from all others; such a time is damaged


@dataclass(frozen=True, eq=False)
class Flight:
    """What a reader found in an autopilot's log.

    Attributes:
        path: For messages.
        tables: By the name of the message.
        signals: Where they are in the tables.
        commands: One column for each thruster of the vehicle, by name, -1 to 1; None where `why_none` says why.
        why_none: Why there are no commands.
        armed: When it was armed (True) or disarmed [s].
        water_density: [kg/m3], or None.
        notes: What was assumed or left out.
    """

    path: Path
    tables: dict[str, Table]
    signals: dict[str, SignalSpec]
    commands: Table | None
    why_none: str = ""
    armed: list[tuple[float, bool]] = field(default_factory=list)
    water_density: float | None = None
    notes: tuple[str, ...] = ()


def raw_of(flight: Flight) -> Raw:
    """The log as tables; commands are cut to when thrusters turn, what lies between is marked as not to be used.

    An output is read now and then, and holds from about half a reading before: commands are that much earlier.
    """
    tables, notes, why = dict(flight.tables), list(flight.notes), flight.why_none
    touched: tuple[tuple[float, float], ...] = ()
    commands, interval = None, None
    if flight.commands is not None:
        t, u = _increasing(flight.commands)
        found = stretches(t, u, flight.armed)
        notes.append(f"{flight.path}: {found.text}")
        if found.used:
            interval = float(np.median(np.diff(t)))
            inside = (t >= found.used[0][0]) & (t <= found.used[-1][1])
            tables[COMMANDS] = Table(u[inside], flight.commands.columns, t[inside] - 0.5 * interval)
            touched = tuple((a[1], b[0]) for a, b in zip(found.used, found.used[1:], strict=False))
            commands = CommandSpec.model_validate({"from": COMMANDS})
        else:
            why = f"thrusters never turn while armed ({found.text})"
    return Raw(
        flight.path,
        tables,
        flight.signals,
        commands,
        flight.water_density,
        notes=tuple(notes),
        touched=touched,
        command_interval=interval,
        no_commands=why,
    )


def at_a_time(t: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which times [s] lie where most do, n >= 1: a damaged message may be of any."""
    low, high = np.percentile(t, [5, 95])
    return (t >= 2 * low - high - ALONE) & (t <= 2 * high - low + ALONE)


def first_signals(
    tables: Mapping[str, Table], ways: Mapping[str, Iterable[tuple[str, Sequence[str], Mapping[str, Any]]]]
) -> dict[str, SignalSpec]:
    """Of each signal the first way, a table with its columns and their units and frame, that a log has."""
    found = {}
    for name, some in ways.items():
        for table, columns, more in some:
            if table in tables and set(columns) <= set(tables[table].columns):
                found[name] = spec(table=table, columns=columns, **more)
                break
    return found


def board_deg(parameters: dict[str, float]) -> list[float]:
    """Roll, pitch and yaw (0) of the autopilot's board in b [deg]: attitude is the vehicle's, the IMU's axes are not.

    On a vehicle at rest gravity in the IMU and the attitude differ by AHRS_TRIM_X and AHRS_TRIM_Y, to 0.01 deg.
    """
    return [*(float(np.degrees(parameters.get(f"AHRS_TRIM_{axis}", 0.0))) for axis in "XY"), 0.0]


def armed_changes(t: Float[np.ndarray, " n"], armed: Float[np.ndarray, " n"]) -> list[tuple[float, bool]]:
    """When a state that is sent again and again changed [s], as `stretches` takes it.

    Args:
        t: Times [s], n >= 1.
        armed: Whether it was armed then.
    """
    changes = np.flatnonzero(armed[1:] != armed[:-1]) + 1
    never_changed = [(float("-inf") if armed[0] else float("inf"), True)]
    return [(float(t[i]), bool(armed[i])) for i in changes] or never_changed


def _increasing(table: Table) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"]]:
    """Times and rows of finite numbers that come after all before them."""
    assert table.t is not None
    good = np.isfinite(table.t) & np.isfinite(table.values).all(axis=1)
    t, values = table.t[good], table.values[good]
    later = np.concatenate([[True], t[1:] > np.maximum.accumulate(t)[:-1]]) if len(t) else np.zeros(0, bool)
    return t[later], values[later]


def listed(names: Iterable[str], most: int = 40) -> str:
    """Names of what a log has, for messages; tables that were made of others have a space in theirs."""
    known = sorted(name for name in names if " " not in name)
    return ", ".join(known[:most]) + (f" and {len(known) - most} more" if len(known) > most else "") or "none"
