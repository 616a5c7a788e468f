"""Thrust curves from bollard tests: read, joined over voltages, put on one grid of commands."""

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files import files as given
from rovtwin.core.user_files.config import near

KGF = 9.80665  # [N]
PWM_NEUTRAL, PWM_RANGE = 1500.0, 400.0


def read_bollard_csv(path: Path) -> tuple[float, Float[np.ndarray, "k 2"]]:
    """Voltage [V] and points (command, force [N]) of a bollard test as Blue Robotics publishes them.

    Columns PWM [us] (1100 to 1900 is command -1 to 1), Voltage [V] and Force [kgf], found by name.
    """
    text = _text(path)
    try:
        rows = [row for row in csv.reader(text.splitlines()) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise ConfigError(f"{path}: is no table of numbers ({error})") from None
    if len(rows) < 4:
        raise ConfigError(f"{path}: found {len(rows)} lines, expected a header and at least 3 points")
    header = [cell.split("(")[0].strip().lower() for cell in rows[0]]
    missing = [name for name in ("pwm", "voltage", "force") if name not in header]
    if missing:
        raise ConfigError(f"{path}: found columns {', '.join(header)}; expected also {', '.join(missing)}")
    columns = [header.index(name) for name in ("pwm", "voltage", "force")]
    values = []
    for line, row in enumerate(rows[1:], start=2):
        try:
            values.append([float(row[c]) for c in columns])
        except (ValueError, IndexError):
            raise ConfigError(f"{path}: line {line}: found {','.join(row)!r}, expected numbers") from None
    pwm, voltage, force = np.array(values).T
    if not np.isfinite(values).all():
        raise ConfigError(f"{path}: holds values that are not finite")
    if (np.diff(pwm) <= 0).any():
        raise ConfigError(f"{path}: PWM must increase from line to line")
    if np.median(voltage) <= 0:
        raise ConfigError(f"{path}: found a voltage of {np.median(voltage):g} V, expected more than 0")
    command = (pwm - PWM_NEUTRAL) / PWM_RANGE
    if command[0] > -1 or command[-1] < 1:
        raise ConfigError(f"{path}: PWM from {pwm[0]:g} to {pwm[-1]:g}, expected 1100 to 1900")
    within = np.concatenate([[-1.0], command[(command > -1) & (command < 1)], [1.0]])
    return float(np.median(voltage)), np.stack([within, np.interp(within, command, force * KGF)], axis=1)


def _text(path: Path) -> str:
    try:
        return given.read_text(path)
    except FileNotFoundError:
        known = [p.name for p in path.parent.glob(f"*{path.suffix}")] if path.parent.is_dir() else []
        raise ConfigError(f"{path}: no such file.{near(path.name, known)}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not text") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None


def read_points(path: Path) -> tuple[float, Float[np.ndarray, "k 2"]]:
    """Points (command, force [N]) of a text file: force [N] and normalised command, one pair a line.

    The header names the columns, `Thrust [N]   Amount of thrust [-]`; the voltage, which it doesn't say, comes as NaN.
    Commands must increase from -1 to 1. Either column may hold the command: it is the one that does.
    """
    text = _text(path)
    rows = [line.replace(",", " ").split() for line in text.splitlines()[1:] if line.strip()]
    try:
        values = np.array([[float(cell) for cell in row] for row in rows])
    except ValueError:
        raise ConfigError(f"{path}: expected a header line, then two numbers a line") from None
    if values.ndim != 2 or values.shape[1] != 2 or len(values) < 3 or not np.isfinite(values).all():
        raise ConfigError(f"{path}: found {values.shape} numbers, expected a header, then at least 3 lines of two")
    for command, force in (values.T, values.T[::-1]):
        if (np.diff(command) > 0).all() and command[0] == -1 and command[-1] == 1:
            return float("nan"), np.stack([command, force], axis=1)
    raise ConfigError(f"{path}: expected one of the columns to be commands that increase from -1 to 1")


def at_voltage(
    curves: list[tuple[float, Float[np.ndarray, "_ 2"]]], voltage: float | None, where: str
) -> Float[np.ndarray, "_ 2"]:
    """Points at a supply voltage, linear between the tested ones; never beyond them."""
    if len(curves) == 1 and (voltage is None or not np.isfinite(curves[0][0])):
        return curves[0][1]
    curves = sorted(curves, key=lambda c: c[0])
    tested = np.array([v for v, _ in curves])
    if voltage is None:
        listed = ", ".join(f"{v:g}" for v in tested)
        raise ConfigError(
            f"{where}: tables for {listed} V, but no supply voltage; write 'supply_voltage: {tested[0]:g}'"
        )
    if not tested[0] <= voltage <= tested[-1]:
        raise ConfigError(
            f"{where}: supply voltage {voltage:g} V, but the tables hold from {tested[0]:g} to {tested[-1]:g} V"
        )
    grid = np.unique(np.concatenate([points[:, 0] for _, points in curves]))
    forces = np.stack([np.interp(grid, points[:, 0], points[:, 1]) for _, points in curves])
    force = np.array([np.interp(voltage, tested, column) for column in forces.T])
    return np.stack([grid, force], axis=1)


def increasing(points: Float[np.ndarray, "k 2"], where: str) -> Float[np.ndarray, "k 2"]:
    """The same points with the noise of the test smoothed so that force never falls with command.

    Pool adjacent violators, the least-squares non-decreasing fit (Barlow et al. 1972). A curve that needs more than
    5 % of its largest force is not noise but a mistake, such as swapped columns or the sign of astern.
    """
    force = points[:, 1]
    means: list[float] = []
    counts: list[int] = []
    for value in force:
        mean, count = float(value), 1
        while means and means[-1] > mean:
            mean, count = (means[-1] * counts[-1] + mean * count) / (counts[-1] + count), counts.pop() + count
            means.pop()
        means.append(mean)
        counts.append(count)
    fitted = np.repeat(means, counts)
    if np.abs(fitted - force).max() > 0.05 * np.abs(force).max():
        at = points[np.abs(fitted - force).argmax(), 0]
        raise ConfigError(f"{where}: force falls with command near {at:.2f}; expected it to rise from -1 to 1")
    return np.stack([points[:, 0], fitted], axis=1)
