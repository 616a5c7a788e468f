"""Thrust curves from bollard tests: a power law with a dead band, ahead and astern, with its uncertainty.

    force = F x^n,   x = (|u| - d) / (1 - d), 0 where |u| < d

u is the command, F the force at full command, d the dead band, n the exponent: the curve of a vehicle file's thruster.
A propeller at rest gives n = 2 in speed of rotation (Fossen 2021, sec. 9.1); speed controllers and lost speed at high
load bring n in command down to 1.4 to 1.8.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from rovtwin.core.arrays.correlation import neighbours
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.user_files import files as given
from rovtwin.vehicle.description.thrust_curve import KGF, read_bollard_csv

NAMES = ("force", "dead band", "exponent")
LARGEST_DEAD_BAND, EXPONENTS = 0.3, (0.5, 4.0)


@dataclass(frozen=True, eq=False)
class ThrustCurve:
    """A fitted curve, one way or both.

    Attributes:
        values: Force at full command [N], dead band, exponent.
        covariance: Of `values`.
        rms: Of the residuals [N].
        astern: Force at full command astern [N], positive; None where the curve is of one direction.
        notes: What a reader must know.
    """

    values: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "3 3"]
    rms: float
    astern: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def sd(self) -> Float[np.ndarray, "3"]:
        """Standard deviations of `values`."""
        return np.sqrt(np.diag(self.covariance))

    def force(self, command: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
        """Force [N] at commands in [-1, 1], any shape."""
        command = np.asarray(command, float)
        full = np.where(command < 0, self.values[0] if self.astern is None else self.astern, self.values[0])
        return np.sign(command) * full * shape(command, self.values[1], self.values[2])


@dataclass(frozen=True, eq=False)
class Bollard:
    """A bollard test and what was fitted to it.

    Attributes:
        source: File.
        voltage: [V], None where the file does not say.
        points: Command and force [N], increasing command.
        ahead, astern: Each direction by itself; None where the test has none.
        both: One dead band and exponent for both directions, as a vehicle file has them.
    """

    source: str
    voltage: float | None
    points: Float[np.ndarray, "k 2"]
    ahead: ThrustCurve | None
    astern: ThrustCurve | None
    both: ThrustCurve


def shape(command: Float[np.ndarray, "*axes"], dead_band: float, exponent: float) -> Float[np.ndarray, "*axes"]:
    """Share of the largest force, without sign, for commands of any shape."""
    return (np.maximum(np.abs(command) - dead_band, 0.0) / (1.0 - dead_band)) ** exponent


def fit_bollard(
    points: Float[np.ndarray, "k 2"],
    source: str = "bollard test",
    voltage: float | None = None,
    hold_full: bool = False,
) -> Bollard:
    """Fit the curve to a bollard test, each direction by itself and both together.

    Args:
        points: Command in [-1, 1] and force [N] with its sign.
        source: For messages.
        voltage: [V].
        hold_full: Whether the force at full command stays as measured, for a curve that is used with a full force of
            another thruster; else it is fitted too.

    Raises:
        IdentificationError: Too few points, or force against command.
    """
    points = np.asarray(points, float)
    points = points[np.argsort(points[:, 0], kind="stable")]
    _check(points, source)
    sides: dict[int, ThrustCurve | None] = {}
    for sign in (1, -1):
        side = points[points[:, 0] * sign > 0]
        sides[sign] = _fit(np.abs(side[:, 0]), side[:, 1] * sign, None, hold_full) if len(side) >= 4 else None
    command, force = points.T
    both = _fit(np.abs(command), force * np.where(command < 0, -1, 1), command < 0, hold_full)
    return Bollard(source, voltage, points, sides[1], sides[-1], both)


def _fit(
    command: Float[np.ndarray, " k"],
    force: Float[np.ndarray, " k"],
    astern: Bool[np.ndarray, " k"] | None,
    hold_full: bool,
) -> ThrustCurve:
    """Least squares on positive commands and forces; those `astern` have a full force of their own."""
    backward = np.zeros(len(command), bool) if astern is None else astern
    sides = [side for side in (~backward, backward) if side.any()]  # each with its full force
    full = [float(force[side][command[side].argmax()]) for side in sides]
    held = np.array([hold_full] * len(sides) + [False, False])
    guess = np.array([*full, 0.05, 1.5])
    low = np.array([0.0] * len(sides) + [0.0, EXPONENTS[0]])
    high = np.array([np.inf] * len(sides) + [LARGEST_DEAD_BAND, EXPONENTS[1]])

    def error(q: Float[np.ndarray, " q"]) -> Float[np.ndarray, " k"]:
        p = guess.copy()
        p[~held] = q
        return np.select(sides, list(p[: len(sides)])) * shape(command, p[-2], p[-1]) - force

    found = least_squares(error, guess[~held], bounds=(low[~held], high[~held]), x_scale=np.maximum(guess, 0.1)[~held])
    p, covariance = guess.copy(), np.zeros((len(guess),) * 2)
    p[~held] = found.x
    # A power law misses real curves in long waves: neighbouring points do not count one each.
    noise = float(found.fun @ found.fun) / max(len(command) - len(found.x), 1) * neighbours(found.fun)
    covariance[np.ix_(~held, ~held)] = np.linalg.pinv(found.jac.T @ found.jac) * noise
    rms, shown = float(np.sqrt(np.mean(found.fun**2))), np.array([0, -2, -1]) + np.array([0, len(p), len(p)])
    astern_force = float(p[1]) if len(sides) == 2 else None
    return ThrustCurve(p[shown], covariance[np.ix_(shown, shown)], rms, astern_force, _remarks(p, rms, max(full)))


def _remarks(p: Float[np.ndarray, " p"], rms: float, largest: float) -> tuple[str, ...]:
    notes = []
    if p[-2] < 1e-4:
        notes.append("dead band: none is seen; on its bound of 0")
    if p[-1] < EXPONENTS[0] + 1e-3 or p[-1] > EXPONENTS[1] - 1e-3:
        notes.append(f"exponent: on its bound of {p[-1]:.2g}; this is no thruster's curve")
    if rms > 0.03 * largest:
        notes.append(
            f"a power law misses the points by {100 * rms / largest:.1f} % of the largest force: use them as a table"
        )
    return tuple(notes)


def _check(points: Float[np.ndarray, "k 2"], source: str) -> None:
    command, force = points.T
    if len(points) < 5 or not np.isfinite(points).all():
        raise IdentificationError(f"{source}: found {len(points)} points, expected 5 or more, all finite")
    if np.abs(command).max() > 1.0 + 1e-9:
        raise IdentificationError(
            f"{source}: commands up to {np.abs(command).max():.4g}, expected -1 to 1; divide PWM - 1500 by 400, or swap"
            " the columns"
        )
    strong = np.abs(command) > 0.3
    if not strong.any() or not np.abs(force).max() > 0:
        raise IdentificationError(f"{source}: no force at commands beyond 0.3, so there is no curve to fit")
    if np.mean(np.sign(force[strong]) == np.sign(command[strong])) < 0.9:
        raise IdentificationError(
            f"{source}: force goes against the command; expected a positive command to push ahead: turn one of them"
        )


def read_thrust(path: str | Path) -> tuple[float | None, Float[np.ndarray, "k 2"]]:
    """Voltage [V] (None: not said) and points (command, force [N]) of a bollard test.

    Blue Robotics' CSV (columns PWM, Voltage, Force [kgf]), or two columns of numbers, with command and force in any
    order: the header says which (force or thrust; command, amount or u), and `kgf` converts; without a header the
    column within -1 to 1 is the command.

    Raises:
        ConfigError: What `read_bollard_csv` raises, or a file that is neither of them.
    """
    path = Path(path)
    try:
        lines = given.read_text(path).splitlines()
    except (OSError, UnicodeDecodeError):
        return read_bollard_csv(path)  # whose errors say what is wrong with the file
    head = lines[0].lower() if lines else ""
    if "pwm" in head and "volt" in head:
        return read_bollard_csv(path)
    rows = []
    for number, line in enumerate(lines, start=1):
        cells = [cell for cell in re.split(r"[,;\s]+", line.strip()) if cell]
        if not cells or (number == 1 and not _is_number(cells[0])):
            continue
        if len(cells) != 2 or not all(map(_is_number, cells)):
            raise ConfigError(f"{path}: line {number}: found {line.strip()!r}, expected a command and a force")
        rows.append([float(cell) for cell in cells])
    if len(rows) < 5:
        raise ConfigError(f"{path}: found {len(rows)} lines of numbers, expected 5 or more")
    points = np.array(rows)
    column = _command_column(head, points, path)
    unit = KGF if "kgf" in head else 1.0
    ordered = np.stack([points[:, column], unit * points[:, 1 - column]], axis=1)
    return None, ordered[np.argsort(ordered[:, 0], kind="stable")]


def _command_column(head: str, points: Float[np.ndarray, "k 2"], path: Path) -> int:
    force = [m.start() for m in re.finditer(r"force|thrust \[n|thrust\(n|thrust_n|\[n\]|kgf", head)]
    command = [m.start() for m in re.finditer(r"command|amount|normali[sz]ed|\bu\b|\[-\]", head)]
    if force and command:
        return 1 if force[0] < command[0] else 0
    small = [float(np.abs(points[:, i]).max()) <= 1.0 for i in (0, 1)]
    if small[0] == small[1]:
        raise ConfigError(
            f"{path}: which column is the command cannot be seen; begin the file with a line such as 'command,force_N'"
        )
    return small.index(True)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
