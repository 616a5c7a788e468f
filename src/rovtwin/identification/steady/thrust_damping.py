"""Thrust curve and damping together, from free-running tests: command and steady speed.

At a steady speed thrust equals damping, F(u) = D_L v + D_Q |v| v. Speeds alone cannot tell a bent thrust curve from
bent damping, and have no scale: what is known of the thruster decides both. Taking the curve as linear, as the thesis
does in (3.6), is a prior of width zero on the wrong exponent, and damping pays for it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.known import Known
from rovtwin.identification.logs.readers.reading import detect
from rovtwin.identification.logs.readers.tables import read_csv
from rovtwin.identification.steady.damping_fit import fit_damping
from rovtwin.identification.steady.thrust import Bollard, shape
from rovtwin.vehicle.physics.dynamics import speed_of_drag

SMALLEST = 1e-9  # stands for a quadratic coefficient of zero in the speed's formula
PRIOR_NAMES = ("full thrust", "dead band", "exponent")


@dataclass(frozen=True)
class ThrustPrior:
    """What is known of the thrust in one direction before the test.

    Attributes:
        full: At full command [N or N m].
        exponent: Bollard tests of T200s at 10 to 20 V: 1.55 to 1.83 without a dead band.
        dead_band: Share of the command.
    """

    full: Known
    exponent: Known = Known(1.75, 0.125)
    dead_band: Known = Known(0.0)

    @classmethod
    def of(cls, curves: list[Bollard], full: Known) -> "ThrustPrior":
        """From bollard tests of the same kind of thruster: mean and spread of dead band and exponent."""
        values = np.array([one.both.values[1:] for one in curves])
        spread = values.std(axis=0, ddof=1) if len(curves) > 1 else np.array([0.02, 0.1])
        (band, exponent), (band_sd, exponent_sd) = values.mean(axis=0), spread
        return cls(full, Known(float(exponent), float(exponent_sd)), Known(float(band), float(band_sd)))


@dataclass(frozen=True, eq=False)
class JointFit:
    """Damping and thrust of one direction.

    Attributes:
        damping: D_L, D_Q [N s/m, N s2/m2 or rotational].
        thrust: Full thrust [N or N m], dead band, exponent.
        covariance: Of (damping, thrust).
        sigma: Standard deviation of the speeds, as given or as their scatter shows [m/s or rad/s].
        residual: Fitted less measured speed.
        moved: How far the test took the thrust from its prior [standard deviations].
        as_linear: D_L, D_Q if thrust were linear in command, for comparison.
        notes: What a reader must know.
    """

    damping: Float[np.ndarray, "2"]
    thrust: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "5 5"]
    sigma: float
    residual: Float[np.ndarray, " n"]
    moved: Float[np.ndarray, "3"]
    as_linear: Float[np.ndarray, "2"]
    notes: tuple[str, ...]

    @property
    def sd(self) -> Float[np.ndarray, "5"]:
        """Standard deviations of damping and thrust."""
        return np.sqrt(np.diag(self.covariance))

    def drag(self, velocity: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
        """Damping force [N or N m] at velocities of any shape."""
        return self.damping[0] * velocity + self.damping[1] * np.abs(velocity) * velocity

    def drag_sd(self, velocity: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
        """Standard deviation of `drag`, with the correlation of the coefficients."""
        velocity = np.asarray(velocity, float)
        A = np.stack([velocity, np.abs(velocity) * velocity], axis=-1)
        return np.sqrt(np.einsum("...i,ij,...j->...", A, self.covariance[:2, :2], A))

    def force(self, command: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
        """Thrust [N or N m] at commands of any shape."""
        return np.sign(command) * self.thrust[0] * shape(np.asarray(command, float), self.thrust[1], self.thrust[2])


def fit_thrust_and_damping(
    command: Float[np.ndarray, " n"],
    velocity: Float[np.ndarray, " n"],
    prior: ThrustPrior,
    *,
    sigma_velocity: float | None = None,
    source: str = "free running",
) -> JointFit:
    """Maximum a posteriori of damping and thrust curve.

    Args:
        command: Shares of full command in [-1, 1].
        velocity: Steady velocities [m/s or rad/s].
        prior: Of the thrust; damping has none but its sign.
        sigma_velocity: Standard deviation of the velocities; None takes it from their scatter.
        source: For messages.

    Raises:
        IdentificationError: Too few or bad tests, or a prior without full thrust.
    """
    u, v = np.atleast_1d(np.asarray(command, float)), np.atleast_1d(np.asarray(velocity, float))
    _check(u, v, prior, source)
    known = (prior.full, prior.dead_band, prior.exponent)
    means, widths = np.array([k.value for k in known]), np.array([k.sd for k in known])
    free = widths > 0
    linear = fit_damping(v, means[0] * u).coefficients

    def thrust_of(x: Float[np.ndarray, " x"]) -> Float[np.ndarray, "3"]:
        thrust = means.copy()
        thrust[free] = x[2:]
        return thrust

    def speed_error(x: Float[np.ndarray, " x"]) -> Float[np.ndarray, " n"]:
        F, band, exponent = thrust_of(x)
        return np.sign(u) * speed_of_drag(x[0] + 1e-12, max(x[1], SMALLEST), F * shape(u, band, exponent)) - v

    low = np.concatenate([[0.0, 0.0], np.array([0.2 * means[0], 0.0, 0.3])[free]])
    high = np.concatenate([[np.inf, np.inf], np.array([np.inf, 0.5, 4.0])[free]])
    start = fit_damping(v, np.sign(u) * means[0] * shape(u, means[1], means[2])).coefficients
    guess = np.clip(np.concatenate([start, means[free]]), low + 1e-6, high - 1e-6)
    sigma = sigma_velocity if sigma_velocity is not None else 0.02 * float(np.abs(v).max())
    rounds = 1 if sigma_velocity is not None else 8
    for _ in range(rounds):

        def error(x: Float[np.ndarray, " x"], sigma: float = sigma) -> Float[np.ndarray, " _"]:
            return np.concatenate([speed_error(x) / sigma, (x[2:] - means[free]) / widths[free]])

        found = least_squares(error, guess, bounds=(low, high), x_scale=np.maximum(np.abs(guess), 0.1))
        if sigma_velocity is None:
            # The thrust is carried by its prior, so that the speeds pay for the two coefficients of damping only.
            sigma = float(np.sqrt(np.sum(speed_error(found.x) ** 2) / max(len(v) - 2, 1))) + 1e-12
    covariance = np.zeros((5, 5))
    at = np.concatenate([[0, 1], 2 + np.flatnonzero(free)]).astype(int)
    covariance[np.ix_(at, at)] = np.linalg.pinv(found.jac.T @ found.jac)
    thrust = thrust_of(found.x)
    moved = np.divide(thrust - means, widths, out=np.zeros(3), where=free)
    notes = _remarks(found.x[:2], covariance, moved, speed_error(found.x), sigma, sigma_velocity)
    return JointFit(found.x[:2], thrust, covariance, sigma, speed_error(found.x), moved, linear, notes)


def read_speeds(path: str | Path) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Commands and steady velocities of free-running tests: CSV with columns `command`, `velocity`.

    Raises:
        IdentificationError: No such file or column, or a line without numbers.
    """
    path = Path(path)
    detect(path)
    (table,) = read_csv(path, []).tables.values()
    command, velocity = table.pick(["command", "velocity"], str(path)).T
    return command, velocity


def _check(u: Float[np.ndarray, " n"], v: Float[np.ndarray, " n"], prior: ThrustPrior, source: str) -> None:
    if u.shape != v.shape or u.ndim != 1 or len(u) < 3:
        raise IdentificationError(f"{source}: found {u.size} commands and {v.size} speeds, expected 3 or more of each")
    if not (np.isfinite(u).all() and np.isfinite(v).all()):
        raise IdentificationError(f"{source}: commands and speeds must be finite")
    if np.abs(u).max() > 1 + 1e-9:
        raise IdentificationError(f"{source}: a command of {np.abs(u).max():.3g}, expected -1 to 1")
    against = u * v < 0
    if against.any():
        i = int(np.argmax(against))
        raise IdentificationError(
            f"{source}: command {u[i]:g} goes with velocity {v[i]:g}; expected the same sign. Is an axis turned round?"
        )
    if not prior.full.value > 0:
        raise IdentificationError(
            f"{source}: full thrust is {prior.full.value:g}, expected more than 0: speeds have no scale"
        )


def _remarks(
    damping: Float[np.ndarray, "2"],
    covariance: Float[np.ndarray, "5 5"],
    moved: Float[np.ndarray, "3"],
    residual: Float[np.ndarray, " n"],
    sigma: float,
    given: float | None,
) -> tuple[str, ...]:
    notes = []
    for name, one in zip(("linear", "quadratic"), damping, strict=True):
        if one < 1e-6:
            notes.append(f"{name} damping is on its bound of 0")
    for name, by in zip(PRIOR_NAMES, moved, strict=True):
        if abs(by) > 2:
            notes.append(
                f"{name}: the speeds pull it {by:+.1f} standard deviations from what was known: one of them is wrong"
            )
    spread = np.sqrt(np.diag(covariance))[:2]
    if (spread > 0.3 * np.maximum(damping, 1e-9)).any():
        notes.append("linear and quadratic damping: their sum at the tested speeds is known better than each alone")
    if given is not None and (ratio := float(np.sqrt(np.mean(residual**2))) / sigma) > 2:
        notes.append(f"residuals {ratio:.1f} times the declared noise of the speeds: the curve is of another form")
    return tuple(notes)
