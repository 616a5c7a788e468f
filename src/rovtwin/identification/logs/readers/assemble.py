"""From tables to a Record: columns picked, units and frames turned, what cannot be right left out and reported."""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.arrays.rotations import angle_between, rotation_from_euler
from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.config import near
from rovtwin.identification.logs.log_spec import CommandSpec, SignalSpec, SourceSpec, factor
from rovtwin.identification.logs.readers import convert
from rovtwin.identification.logs.readers.raw import Raw, Table
from rovtwin.identification.logs.record import SIGNALS, Signal
from rovtwin.identification.logs.rotations import in_body, std_in_body

PWM_NEUTRAL, PWM_RANGE = 1500.0, 400.0
FRESH_WATER = 1000.0
FLUNG = 0.8  # [rad]
Spec = TypeVar("Spec", SignalSpec, CommandSpec)


@dataclass(frozen=True, eq=False)
class Part:
    """What one file gave: commands and signals on its own clock.

    Attributes:
        t_command: [s]; None where the file has no commands.
        command: Of the thrusters.
        signals: By a name of SIGNALS.
        source: For messages.
        notes: What was left out.
        no_commands: Why there are none, where the format says it.
    """

    t_command: Float[np.ndarray, " m"] | None
    command: Float[np.ndarray, "m thrusters"] | None
    signals: dict[str, Signal]
    source: str
    notes: tuple[str, ...]
    no_commands: str = ""

    def on_clock(self, offset: float, drift: float) -> "Part":
        """The same with t (1 + drift) + offset for t."""
        signals = {name: replace(s, t=s.t * (1.0 + drift) + offset) for name, s in self.signals.items()}
        t = None if self.t_command is None else self.t_command * (1.0 + drift) + offset
        return replace(self, t_command=t, signals=signals)

    @property
    def first(self) -> float:
        """The first sample of anything [s]."""
        times = [s.t[0] for s in self.signals.values()]
        return float(min(times if self.t_command is None else [*times, self.t_command[0]]))


def part_of(raw: Raw, source: SourceSpec, thrusters: list[str], density: float | None) -> Part:
    """Commands and signals of one file, as its spec and its format say.

    Args:
        raw: The file's tables.
        source: What the user says about them; it comes before what the format says.
        thrusters: Names of the vehicle's thrusters, in their order.
        density: Of the water, to make depth of pressure [kg/m3].
    """
    notes = list(raw.notes)
    specs = dict(raw.signals)
    for name, given in source.signals.items():
        specs[name] = _merged(raw.signals.get(name), given) or given
    signals = {}
    for name, spec in specs.items():
        signal, remarks = _signal(raw, name, spec, density or raw.water_density)
        notes += remarks
        if len(signal.t):
            signals[name] = signal
    commands = _merged(raw.commands, source.commands)
    t, u = None, None
    if commands is not None:
        t, u, remarks = _commands(raw, commands, thrusters)
        notes += remarks
    return Part(t, u, signals, str(raw.path), tuple(notes), raw.no_commands)


def _merged(known: Spec | None, given: Spec | None) -> Spec | None:
    """What the format says, overridden key by key by what the user wrote."""
    if known is None or given is None:
        return known if given is None else given
    return known.model_copy(update={key: getattr(given, key) for key in given.model_fields_set})


def _signal(raw: Raw, name: str, spec: SignalSpec, density: float | None) -> tuple[Signal, list[str]]:
    where = f"{raw.path}: signals.{name}"
    table = raw.table(spec.table, where)
    columns = spec.columns or _named_after_components(table, name, where)
    _check_count(name, len(columns), where)
    t, values = raw.clock(table, columns, spec.time, where) + spec.time_offset, table.pick(columns, where)
    t, values, notes = _believable(t, values, spec, where)
    scale, kind = factor(name, spec.unit)
    # A quaternion or matrix has no unit.
    si = values if name == "attitude" and values.shape[1] > 3 else (values - spec.zero) * scale
    if name == "attitude":
        value = convert.attitude(si, spec)
        steady = ~flung(value)
        if not steady.all():
            notes.append(
                f"{where}: {np.sum(~steady)} readings that turn far and at once back left out: mean over a wrap?"
            )
        t, value = t[steady], value[steady]
    elif name == "position":
        value = convert.world_vector(si, spec)
    elif name == "horizontal":
        value = convert.world_vector(np.column_stack([si, np.zeros(len(si))]), spec)[:, :2]
    elif name == "depth":
        if kind == "pressure" and density is None:
            notes.append(f"{name}: pressure turned to depth with {FRESH_WATER:g} kg/m3; give water_density")
        value = convert.depth(si, spec, kind == "pressure", density or FRESH_WATER)
    else:
        value = in_body(name, si, convert.to_body(spec))
    return Signal(t, value, _sigma(spec, name, where), np.array(spec.lever)), notes


def flung(euler: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Readings that differ by far from both neighbours, which agree; angles averaged where they wrap do that.

    Args:
        euler: zyx Euler angles [rad].
    """
    R, out = rotation_from_euler(euler), np.zeros(len(euler), bool)
    if len(R) > 2:
        turns = angle_between(R[:-1], R[1:])
        least = np.minimum(turns[:-1], turns[1:])
        out[1:-1] = (least > FLUNG) & (angle_between(R[:-2], R[2:]) < 0.3 * least)
    return out


def _named_after_components(table: Table, name: str, where: str) -> list[int | str]:
    components = SIGNALS[name][0]
    if all(c in table.columns for c in components):
        return list(components)
    if table.t is not None and not table.columns and table.values.shape[1] == len(components):
        return list(range(len(components)))
    columns = f"; the file has {', '.join(table.columns)}" if table.columns else ""
    raise IdentificationError(f"{where}.columns: missing; expected {len(components)} of them{columns}")


def _check_count(name: str, found: int, where: str) -> None:
    expected = (3, 4, 9) if name == "attitude" else (len(SIGNALS[name][0]),)
    if found not in expected:
        needed = {"attitude": "3 angles, 4 of a quaternion or 9 of a matrix"}.get(name, ", ".join(SIGNALS[name][0]))
        raise IdentificationError(f"{where}.columns: found {found}, expected {needed}")


def _sigma(spec: SignalSpec, name: str, where: str) -> Float[np.ndarray, " k"] | None:
    if spec.sigma is None:
        return None
    sigma, size = np.atleast_1d(np.array(spec.sigma, dtype=float)), len(SIGNALS[name][0])
    if sigma.size not in (1, size):
        raise IdentificationError(f"{where}.sigma: found {sigma.size} numbers, expected 1 or {size}")
    return np.full(size, sigma[0]) if sigma.size == 1 else std_in_body(name, sigma, convert.to_body(spec))


def _believable(
    t: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"], spec: SignalSpec | None, where: str
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m k"], list[str]]:
    """Rows that are finite and later than the one before; notes on what was left out."""
    notes = []
    finite = np.isfinite(t) & np.isfinite(values).all(axis=1)
    if not finite.all():
        notes.append(f"{where}: {np.sum(~finite)} of {len(t)} rows without a number left out")
    t, values = t[finite], values[finite]
    later = np.concatenate([[True], t[1:] > np.maximum.accumulate(t)[:-1]]) if len(t) else np.zeros(0, bool)
    if not later.all():
        notes.append(f"{where}: {np.sum(~later)} rows whose time does not increase left out")
    t, values = t[later], values[later]
    if spec is not None and spec.repeats == "drop" and len(t):
        new = np.concatenate([[True], np.any(np.diff(values, axis=0) != 0, axis=1)])
        if not new.all():
            notes.append(f"{where}: {np.sum(~new)} repeated rows left out")
        t, values = t[new], values[new]
    return t, values, notes


def _commands(raw: Raw, spec: CommandSpec, thrusters: list[str]) -> tuple[np.ndarray, np.ndarray, list[str]]:
    where = f"{raw.path}: commands"
    table = raw.table(spec.table, where)
    columns = spec.columns or _thruster_columns(table, spec, thrusters, where)
    t, values = raw.clock(table, columns, spec.time, where) + spec.time_offset, table.pick(columns, where)
    t, values, notes = _believable(t, values, None, where)
    if spec.unit == "pwm":
        # No pulse at all, as before an autopilot starts its outputs, is off.
        values = np.where(values == 0.0, 0.0, (values - PWM_NEUTRAL) / PWM_RANGE)
    elif spec.unit == "percent":
        values = values / 100.0
    gains = _gains(spec, len(columns), thrusters, where)
    command = values @ gains.T
    beyond = np.abs(command) > 1.0 + 1e-9
    if spec.mix is not None and beyond.any():
        notes.append(f"{where}: mixed commands beyond +-1 in {np.mean(beyond.any(axis=1)):.1%} of the rows, clipped")
        command = np.clip(command, -1.0, 1.0)
    return t, command, notes


def _thruster_columns(table: Table, spec: CommandSpec, thrusters: list[str], where: str) -> list[int | str]:
    named = spec.thrusters or thrusters
    missing = [name for name in named if name not in table.columns]
    if missing:
        found = f"the file has {', '.join(table.columns)}" if table.columns else "the file names no columns"
        raise IdentificationError(
            f"{where}: no column for thruster {missing[0]!r}.{near(missing[0], table.columns)} "
            f"Give columns, and mix where they are the pilot's axes; {found}"
        )
    return list(named)


def _gains(spec: CommandSpec, columns: int, thrusters: list[str], where: str) -> Float[np.ndarray, "thrusters columns"]:
    """Commands of the thrusters from the columns."""
    if spec.mix is None:
        order = spec.thrusters or thrusters
        if len(order) != columns:
            raise IdentificationError(
                f"{where}.columns: found {columns}, expected {len(order)} ({', '.join(order)}). Where columns are the "
                "pilot's axes, give mix"
            )
        rows = {name: list(row) for name, row in zip(order, np.eye(columns), strict=True)}
    else:
        rows = {name: list(row) for name, row in spec.mix.items()}
    for name, row in rows.items():
        if name not in thrusters:
            raise IdentificationError(f"{where}: the vehicle has no thruster {name!r}.{near(name, thrusters)}")
        if len(row) != columns:
            raise IdentificationError(f"{where}.mix.{name}: found {len(row)} gains, expected {columns}, one per column")
    silent = [name for name in thrusters if name not in rows]
    if silent:
        raise IdentificationError(f"{where}: nothing drives thruster {silent[0]!r}; give it a column or a row of zeros")
    return np.array([rows[name] for name in thrusters], dtype=float)
