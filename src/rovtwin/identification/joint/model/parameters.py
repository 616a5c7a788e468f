"""The parameters that can be identified: their names, where each sits in the Model, and how it is kept sensible.

Names say the place: `added_mass.surge`, `quadratic_damping_astern.heave`, `restoring.metacentric_height`,
`thrusters.surge.exponent`. What must be positive is estimated as the logarithm of its ratio to a starting value, a
coupling as a bounded share of what its diagonals allow (see `couplings`), a dead band as a share of the command, the
rest as the difference from the start.
Elements that are no parameters follow the diagonal, so that M_A stays positive definite and damping passive. `theta`
is the vector of these coordinates, zero at the starting values.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Matrix6, Scalar, Vector3, Vector6
from rovtwin.identification.joint.model.couplings import (
    POWERS,
    bound_of,
    place_of,
    share_unit,
    with_added_mass,
    with_damping,
)
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.discrepancy import with_coefficients
from rovtwin.vehicle.physics.model import Model

DIRECTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
DAMPINGS = ("linear_damping", "quadratic_damping", "linear_damping_astern", "quadratic_damping_astern")
MOUNTING = tuple(f"sensors.gyro.{axis}" for axis in ("roll", "pitch", "yaw"))  # [rad]
# Signals by how well their clock serves as that of all; the first that was logged has no delay of its own.
CLOCKS = ("gyro", "attitude", "velocity", "position", "horizontal", "depth", "accelerometer")
DELAYS = {f"sensors.{name}.delay": name for name in CLOCKS[1:]}  # [s]
INFLOW = "inflow_loss"  # of a group of thrusters [s/m]: a difference, as it may be none
THRUST_UNITS = {"force_ahead": "N", "force_astern": "N", "exponent": "1", "dead_band": "1", "time_constant": "s"}


@dataclass(frozen=True)
class Parameter:
    """One scalar.

    Attributes:
        name: Its place in the model.
        unit: Of its value.
        base: Value where theta = 0.
        positive: Whether it cannot be negative: theta = log(value / base), else theta = value - base.
        bound: That a value stays below, either sign: of a coupling theta = bound (artanh(value / bound) - artanh(base /
            bound)), of what is positive theta = logit(value / bound) - logit(base / bound).
    """

    name: str
    unit: str
    base: float
    positive: bool
    bound: float = np.inf

    @classmethod
    def at(cls, name: str, unit: str, base: float, positive: bool) -> "Parameter":
        """With the bound that its name implies."""
        return cls(name, unit, base, positive, 1.0 if name.endswith(".dead_band") else bound_of(name))

    def value(self, theta: Any) -> Any:
        """In its unit, of its coordinate."""
        xp = np if isinstance(theta, float | np.ndarray) else jnp
        if self.positive:
            grown = self.base * xp.exp(theta)
            return grown / (1.0 + (grown - self.base) / self.bound)
        if np.isfinite(self.bound):
            return self.bound * xp.tanh(np.arctanh(self.base / self.bound) + theta / self.bound)
        return self.base + theta

    def theta(self, value: float) -> float:
        """Coordinate of a value in its unit.

        Raises:
            IdentificationError: It cannot have this value.
        """
        if self.positive and value <= 0:
            raise IdentificationError(f"{self.name}: found {value:g} {self.unit}, expected more than 0")
        if abs(value) >= self.bound:
            least = 0.0 if self.positive else -self.bound
            raise IdentificationError(f"{self.name}: found {value:g}, expected between {least:g} and {self.bound:g}")
        if self.positive:
            return float(np.log(value / self.base) - np.log1p(-value / self.bound) + np.log1p(-self.base / self.bound))
        if np.isfinite(self.bound):
            return float(self.bound * (np.arctanh(value / self.bound) - np.arctanh(self.base / self.bound)))
        return value - self.base

    def slope(self, value: float) -> float:
        """Change of the value by that of its coordinate."""
        if self.positive:
            return value * (1.0 - value / self.bound)
        return 1.0 - (value / self.bound) ** 2


class Sensing(eqx.Module):
    """What the log does not say of its sensors.

    Attributes:
        mounting: By which the gyro is turned against what the file says, a small rotation in b [rad]; None:
            no parameter.
        delays: By which a signal's readings are older than the log says, against those of the first of CLOCKS that it
            has [s]; those that are parameters.
    """

    mounting: Vector3 | None = None
    delays: dict[str, Scalar] = eqx.field(default_factory=dict)


class Extras(eqx.Module):
    """Parameters of a test rather than of the vehicle.

    Attributes:
        tether_drag: Force on the vehicle per metre paid out and square of its speed [N s2/m3].
        delay: Of the commands on their way to the thrusters, beside what the log says [s]; None: no parameter.
        sensing: Of the sensors.
    """

    tether_drag: Scalar
    delay: Scalar | None = None
    sensing: Sensing = Sensing()


@dataclass(frozen=True, eq=False)
class Parameters:
    """Free parameters of one vehicle, and the way from theta to a Model.

    Attributes:
        model: Starting values of everything, free or not.
        free: In the order of theta.
        groups: Thrusters that share their curve: indices by name of the group.
        basis: Coefficients of the model's discrepancy by its weights, which are the last q of `free`;
            None where these are no parameters.
    """

    model: Model
    free: tuple[Parameter, ...]
    groups: Mapping[str, tuple[int, ...]]
    basis: Float[np.ndarray, "q P m"] | None = None

    @property
    def names(self) -> list[str]:
        return [p.name for p in self.free]

    def __len__(self) -> int:
        return len(self.free)

    def values(self, theta: Float[Array | np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """In their units."""
        return np.array([p.value(t) for p, t in zip(self.free, np.asarray(theta), strict=True)])

    def thetas(self, values: Mapping[str, float]) -> Float[np.ndarray, " n"]:
        """Coordinates of values by name; what is not given stays at its starting value."""
        return np.array([p.theta(values[p.name]) if p.name in values else 0.0 for p in self.free])

    def scaled(self, theta: Any, s: Any) -> Float[Array, " n"]:
        """theta with thrust, inertia, damping and restoring times exp(s): the same motion, if all of them are free."""
        theta = jnp.asarray(theta)
        water = self._water_scaled(theta, s)
        out = []
        for p, t in zip(self.free, theta, strict=True):
            family, where, at = p.name.split(".")[0], p.name.split(".")[-1], place_of(p.name)
            if family == "added_mass" and where in DIRECTIONS:
                i = DIRECTIONS.index(where)
                out.append(jnp.log(water[i, i] / p.base))
            elif family == "added_mass" and at is not None:
                share = water[at] / share_unit(water, water, 1, *at)
                share = jnp.clip(share / p.bound, -0.999, 0.999)
                out.append(p.bound * (jnp.arctanh(share) - np.arctanh(p.base / p.bound)))
            elif (
                at is not None
                or family in ("commands", "sensors")
                or (family == "thrusters" and not where.startswith("force"))
            ):
                out.append(t)
            else:
                out.append(t + s if p.positive else (p.base + t) * jnp.exp(s) - p.base)
        return jnp.stack(out)

    def _water_scaled(self, theta: Float[Array, " n"], s: Any) -> Matrix6:
        """M_A with which total inertia is exp(s) times what it is: of that only the water's share can give way."""
        matrix, rigid = self.model_at(theta)[0].added_mass, self.model.rigid_body_mass
        water = (rigid + matrix) * jnp.exp(s) - rigid
        # No added mass is negative, however small the scale that is tried.
        least = 1e-3 * jnp.diagonal(matrix)
        return water + jnp.diag(jnp.maximum(least - jnp.diagonal(water), 0.0))

    def model_at(self, theta: Any) -> tuple[Model, Extras]:
        """The model and the test's own parameters at theta; differentiable."""
        theta = jnp.asarray(theta)
        value = {p.name: p.value(theta[i]) for i, p in enumerate(self.free)}
        ratio = {p.name: jnp.exp(theta[i]) for i, p in enumerate(self.free) if p.positive}
        model = self.model
        changes: dict[str, Any] = {"added_mass": _scaled(model.added_mass, _ratios(ratio, "added_mass"), (0.5, 0.5))}
        changes |= self._damping(value)
        changes |= _coupled(changes, value)
        changes |= _restoring(model, value)
        changes["thrusters"] = self._thrusters(value)
        if self.basis is not None and model.discrepancy is not None:
            coefficients = jnp.tensordot(theta[-len(self.basis) :], self.basis, axes=1)
            changes["discrepancy"] = with_coefficients(model.discrepancy, coefficients)
        return model.replace(**changes), _extras(value)

    def _damping(self, value: Mapping[str, Scalar]) -> dict[str, Matrix6]:
        changes = {}
        for kind, share in (("linear_damping", (0.5, 0.5)), ("quadratic_damping", (1 / 3, 2 / 3))):
            for side in ("ahead", "astern"):
                matrix = getattr(self.model, f"{kind}_{side}")
                new = []
                for i, direction in enumerate(DIRECTIONS):
                    name, own = f"{kind}.{direction}", f"{kind}_astern.{direction}"
                    old = matrix[i, i]
                    if side == "astern" and own in value:
                        new.append(value[own])
                    elif name in value:
                        base = getattr(self.model, f"{kind}_ahead")[i, i]
                        # Astern follows ahead in proportion where it has no parameter of its own.
                        new.append(value[name] * jnp.where(base > 0, old / jnp.where(base > 0, base, 1.0), 1.0))
                    else:
                        new.append(old)
                changes[f"{kind}_{side}"] = _with_diagonal(matrix, jnp.stack(new), share)
        return changes

    def _thrusters(self, value: Mapping[str, Scalar]) -> Any:
        thrusters = self.model.thrusters
        fields = {name: getattr(thrusters, name) for name in THRUST_UNITS}
        table, inflow = thrusters.table_force, thrusters.inflow_loss
        for group, members in self.groups.items():
            rows = np.array(members)
            lost = value.get(f"thrusters.{group}.{INFLOW}")
            if lost is not None:
                inflow = (jnp.zeros(thrusters.count) if inflow is None else inflow).at[rows].set(lost)
            mine = np.isin(np.arange(thrusters.count), rows)
            for name in THRUST_UNITS:
                given = value.get(f"thrusters.{group}.{name}")
                if given is None:
                    continue
                if name in ("force_ahead", "force_astern"):
                    ratio = given / fields[name][rows[0]]
                    ahead = table > 0
                    selected = (ahead if name == "force_ahead" else ~ahead) & mine[:, None]
                    table = jnp.where(selected, ratio, 1.0) * table
                fields[name] = fields[name].at[rows].set(given)
        fields["table_force"] = table
        return replace(thrusters, inflow_loss=inflow, **{name: jnp.asarray(v) for name, v in fields.items()})


def _extras(value: Mapping[str, Scalar]) -> Extras:
    mounting = None
    if any(name in value for name in MOUNTING):
        mounting = jnp.stack([value.get(name, as_array(0.0)) for name in MOUNTING])
    delays = {signal: value[name] for name, signal in DELAYS.items() if name in value}
    return Extras(value.get("tether.drag", as_array(0.0)), value.get("commands.delay"), Sensing(mounting, delays))


def _ratios(ratio: Mapping[str, Scalar], kind: str) -> Vector6:
    return jnp.stack([ratio.get(f"{kind}.{d}", jnp.ones(())) for d in DIRECTIONS])


def _scaled(matrix: Matrix6, ratio: Vector6, share: tuple[float, float]) -> Matrix6:
    """Element ij times ratio_i^share[0] ratio_j^share[1]: the diagonal by its ratio, a symmetric one stays definite."""
    return matrix * (ratio ** share[0])[:, None] * (ratio ** share[1])[None, :]


def _with_diagonal(matrix: Matrix6, diagonal: Vector6, share: tuple[float, float]) -> Matrix6:
    old = jnp.diagonal(matrix)
    ratio = jnp.where(old > 0, diagonal / jnp.where(old > 0, old, 1.0), 1.0)
    # A direction without damping of its own has no couplings to scale.
    return _scaled(matrix, ratio, share) + jnp.diag(jnp.where(old > 0, 0.0, diagonal))


def _coupled(matrices: Mapping[str, Matrix6], value: Mapping[str, Scalar]) -> dict[str, Matrix6]:
    """Added mass and damping with the couplings that are parameters."""
    changed = dict(matrices)
    names, i, j = _couplings_of("added_mass", value)
    if names:
        changed["added_mass"] = with_added_mass(changed["added_mass"], i, j, jnp.stack([value[n] for n in names]))
    for order, power in POWERS.items():
        ahead, astern = (changed[f"{order}_{side}"] for side in ("ahead", "astern"))
        names, i, j = _couplings_of(order, value)
        if names:
            ahead, astern = with_damping(ahead, astern, power, i, j, jnp.stack([value[n] for n in names]))
        names, i, j = _couplings_of(f"{order}_astern", value)
        if names:
            astern, _ = with_damping(astern, ahead, power, i, j, jnp.stack([value[n] for n in names]))
        changed |= {f"{order}_ahead": ahead, f"{order}_astern": astern}
    return changed


def _couplings_of(family: str, names: Iterable[str]) -> tuple[list[str], Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Couplings of a family among some names, and their places."""
    found = [(n, at) for n in names if n.startswith(f"{family}.") and (at := place_of(n)) is not None]
    i, j = np.array([at for _, at in found], int).reshape(-1, 2).T
    return [n for n, _ in found], i, j


def _restoring(model: Model, value: Mapping[str, Scalar]) -> dict[str, Array]:
    lever = model.center_of_buoyancy - model.center_of_gravity
    parts = [
        value.get("restoring.center_of_buoyancy_x", lever[0]),
        value.get("restoring.center_of_buoyancy_y", lever[1]),
        -value["restoring.metacentric_height"] if "restoring.metacentric_height" in value else lever[2],
    ]
    net = value.get("restoring.net_buoyancy", model.buoyancy - model.weight)
    buoyancy = model.weight + net
    return {
        "center_of_buoyancy": model.center_of_gravity + jnp.stack(parts),
        "buoyancy": buoyancy,
        "displaced_mass": buoyancy / GRAVITY,
    }
