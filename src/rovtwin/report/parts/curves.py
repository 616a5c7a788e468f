"""Force curves of a vehicle whose parameters are known with a covariance: what it says, and its 95 % band.

Coefficients are strongly correlated, so that a band comes from models drawn from the whole distribution, never from the
intervals of single coefficients.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Vector6
from rovtwin.vehicle.physics.dynamics import damping_wrench
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force

DIRECTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
SPEED_UNITS = ("m/s",) * 3 + ("rad/s",) * 3
FORCE_UNITS = ("N",) * 3 + ("N m",) * 3
DRAWS = 2000
_TAILS = (0.025, 0.975)


@dataclass(frozen=True, eq=False)
class Subject:
    """A vehicle to draw curves of.

    Attributes:
        label: For legends.
        model_at: The model at given coordinates; differentiable.
        theta: Where it is.
        covariance: Of theta; None: nothing is said about how well it is known.
        groups: Indices of thrusters that share a curve, by name.
        tested: Ranges of speed by direction and of command by `thrusters.GROUP`; empty where nobody tested.
    """

    label: str
    model_at: Callable[[Array], Model]
    theta: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"] | None
    groups: Mapping[str, tuple[int, ...]]
    tested: Mapping[str, Sequence[float]]

    def draws(self, count: int = DRAWS, seed: int = 0) -> Float[np.ndarray, "draws n"]:
        """Theta itself, then draws in pairs about it; itself alone without a covariance."""
        if self.covariance is None:
            return self.theta[None]
        # By eigenvalues: a covariance that was rounded for a file may be a shade from positive definite.
        spread, axes = np.linalg.eigh(self.covariance)
        factor = axes * np.sqrt(np.maximum(spread, 0.0))
        half = np.random.default_rng(seed).standard_normal((count // 2, len(self.theta))) @ factor.T
        return np.concatenate([self.theta[None], self.theta + half, self.theta - half])


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve: x, y and the ends of its 95 % band; NaN where nothing is said of its width."""

    x: Float[np.ndarray, " m"]
    y: Float[np.ndarray, " m"]
    low: Float[np.ndarray, " m"]
    high: Float[np.ndarray, " m"]

    @property
    def half_width(self) -> Float[np.ndarray, " m"]:
        """Half the band over the value; NaN where the value is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.y != 0, (self.high - self.low) / 2 / np.abs(self.y), np.nan)


@dataclass(frozen=True, eq=False)
class Curves:
    """Of one subject: damping against speed by direction, thrust against command by group, added mass by direction."""

    damping: dict[str, Curve]
    thrust: dict[str, Curve]
    added_mass: dict[str, Curve]

    @property
    def estimated(self) -> list[int]:
        """Directions whose damping has a band; all of them where none has."""
        found = [i for i, name in enumerate(DIRECTIONS) if np.isfinite(self.damping[name].low).any()]
        return found or list(range(len(DIRECTIONS)))


def curves(
    subject: Subject, speeds: Mapping[str, Float[np.ndarray, " _"]], commands: Float[np.ndarray, " k"]
) -> Curves:
    """Curves of a subject.

    Args:
        subject: See `Subject`.
        speeds: By direction [m/s, rad/s], each shape (m,): motion in this direction alone.
        commands: u; thrust is that of one thruster of each group.
    """
    nu = np.zeros((6, len(next(iter(speeds.values()))), 6))
    for i, name in enumerate(DIRECTIONS):
        nu[i, :, i] = speeds[name]
    damping, thrust, added = (np.asarray(x) for x in _evaluated(subject.model_at)(subject.draws(), nu, commands))
    return Curves(
        {name: _curve(speeds[name], damping[:, i, :, i]) for i, name in enumerate(DIRECTIONS)},
        {group: _curve(commands, thrust[:, :, rows[0]]) for group, rows in subject.groups.items()},
        {name: _curve(np.zeros(1), added[:, i : i + 1]) for i, name in enumerate(DIRECTIONS)},
    )


def _evaluated(model_at: Callable[[Array], Model]) -> Any:
    """Compiled: damping (d, 6, m, 6), thrust (d, k, n) and the diagonal of M_A (d, 6) of d draws."""

    def one(
        theta: Float[Array, " n"], nu: Float[Array, "6 m 6"], commands: Float[Array, " k"]
    ) -> tuple[Float[Array, "6 m 6"], Float[Array, "k t"], Vector6]:
        model = model_at(theta)
        forces = jax.vmap(jax.vmap(lambda v: damping_wrench(model, v)))(nu)
        everywhere = jnp.broadcast_to(commands[:, None], (len(commands), model.thrusters.count))
        return forces, jax.vmap(lambda u: static_force(model.thrusters, u))(everywhere), jnp.diagonal(model.added_mass)

    return jax.jit(jax.vmap(one, in_axes=(0, None, None)))


def _curve(x: Float[np.ndarray, " m"], values: Float[np.ndarray, "draws m"]) -> Curve:
    """From the value itself in the first row and draws in the others."""
    if len(values) == 1:
        nothing = np.full(values.shape[1], np.nan)
        return Curve(x, values[0], nothing, nothing)
    low, high = np.quantile(values[1:], _TAILS, axis=0)
    if np.all(high - low <= 1e-9 * np.abs(values[0])):  # not estimated: nothing is said of its width
        low = high = np.full(values.shape[1], np.nan)
    return Curve(x, values[0], low, high)


def speed_grid(
    ranges: Sequence[Sequence[float]], otherwise: Sequence[float], points: int = 81
) -> Float[np.ndarray, " points"]:
    """Speeds from the least to the largest of some ranges, zero among them; `otherwise` where there are none."""
    given = [r for r in ranges if r] or [otherwise]
    low, high = min(0.0, *(r[0] for r in given)), max(0.0, *(r[1] for r in given))
    span = max(high - low, 1e-6)
    astern = round(points * -low / span)
    return np.concatenate([np.linspace(low, 0.0, astern + 1)[:-1], np.linspace(0.0, high, points - astern)])
