"""The parameters that can be identified: their names, where each sits in the Model, and how it is kept sensible.

Names say the place: `added_mass.surge`, `quadratic_damping_astern.heave`, `restoring.metacentric_height`,
`thrusters.surge.exponent`. What must be positive is estimated as the logarithm of its ratio to a starting value, the
rest as the difference from it; couplings (off-diagonal elements) follow the diagonal so that M_A stays positive
definite and damping passive. `theta` is the vector of these coordinates, zero at the starting values.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.config import near
from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.identification.joint.groups import thruster_groups
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.model import Model

DIRECTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
DAMPINGS = ("linear_damping", "quadratic_damping", "linear_damping_astern", "quadratic_damping_astern")
UNITS = {
    "added": ("kg",) * 3 + ("kg m2",) * 3,
    "linear": ("N s/m",) * 3 + ("N m s/rad",) * 3,
    "quadratic": ("N s2/m2",) * 3 + ("N m s2/rad2",) * 3,
}
THRUST_UNITS = {"force_ahead": "N", "force_astern": "N", "exponent": "1", "dead_band": "1", "time_constant": "s"}
# Linear damping that a file leaves at zero starts as this share of the quadratic, at 1 m/s or 1 rad/s.
_LINEAR_FLOOR = 0.03
_TIME_CONSTANT_FLOOR = 0.05  # of a thruster whose file gives none [s]


@dataclass(frozen=True)
class Parameter:
    """One scalar.

    Attributes:
        name: Its place in the model.
        unit: Of its value.
        base: Value where theta = 0.
        positive: Whether theta = log(value / base), else theta = value - base.
    """

    name: str
    unit: str
    base: float
    positive: bool

    def value(self, theta: Any) -> Any:
        """In its unit, of its coordinate."""
        return self.base * np.exp(theta) if self.positive else self.base + theta

    def theta(self, value: float) -> float:
        """Coordinate of a value in its unit."""
        if not self.positive:
            return value - self.base
        if value <= 0:
            raise IdentificationError(f"{self.name}: found {value:g} {self.unit}, expected more than 0")
        return float(np.log(value / self.base))


class Extras(eqx.Module):
    """Parameters of a test rather than of the vehicle.

    Attributes:
        tether_drag: Force on the vehicle per metre paid out and square of its speed [N s2/m3].
    """

    tether_drag: Array


@dataclass(frozen=True, eq=False)
class Parameters:
    """Free parameters of one vehicle, and the way from theta to a Model.

    Attributes:
        model: Starting values of everything, free or not.
        free: In the order of theta.
        groups: Thrusters that share their curve: indices by name of the group.
    """

    model: Model
    free: tuple[Parameter, ...]
    groups: Mapping[str, tuple[int, ...]]

    @property
    def names(self) -> list[str]:
        return [p.name for p in self.free]

    def __len__(self) -> int:
        return len(self.free)

    def values(self, theta: np.ndarray) -> np.ndarray:
        """In their units, shape (n,)."""
        return np.array([p.value(t) for p, t in zip(self.free, np.asarray(theta), strict=True)])

    def thetas(self, values: Mapping[str, float]) -> np.ndarray:
        """Coordinates of values by name; what is not given stays at its starting value."""
        return np.array([p.theta(values[p.name]) if p.name in values else 0.0 for p in self.free])

    def scaled(self, theta: Any, s: Any) -> Array:
        """theta with thrust, inertia, damping and restoring times exp(s): the same motion, if all of them are free."""
        theta, base = jnp.asarray(theta), np.array([p.base for p in self.free])
        rigid = np.asarray(self.model.rigid_body_mass).diagonal()
        families = [p.name.split(".") for p in self.free]
        added = np.array([f[0] == "added_mass" for f in families])
        shape = np.array([f[0] == "thrusters" and not f[-1].startswith("force") for f in families])
        positive = np.array([p.positive for p in self.free])
        own = np.array([rigid[DIRECTIONS.index(f[1])] if f[0] == "added_mass" else 0.0 for f in families])
        # Of the inertia only the water's share can give way.
        share = np.where(added, base, 1.0)
        water = (own + share * jnp.exp(jnp.where(added, theta, 0.0))) * jnp.exp(s) - own
        water = jnp.log(jnp.maximum(water, 1e-3 * share) / share)
        rest = jnp.where(positive, theta + s, (base + theta) * jnp.exp(s) - base)
        return jnp.where(shape, theta, jnp.where(added, water, rest))

    def model_at(self, theta: Any) -> tuple[Model, Extras]:
        """The model and the test's own parameters at theta, shape (n,); differentiable."""
        theta = jnp.asarray(theta)
        at = {p.name: i for i, p in enumerate(self.free)}
        value = {p.name: p.base * jnp.exp(theta[i]) if p.positive else p.base + theta[i] for p, i in self._indexed()}
        ratio = {p.name: jnp.exp(theta[at[p.name]]) for p in self.free if p.positive}
        model = self.model
        changes: dict[str, Any] = {"added_mass": _scaled(model.added_mass, _ratios(ratio, "added_mass"), (0.5, 0.5))}
        changes |= self._damping(value)
        changes |= _restoring(model, value)
        changes["thrusters"] = self._thrusters(value)
        return model.replace(**changes), Extras(value.get("tether.drag", as_array(0.0)))

    def _indexed(self) -> Iterable[tuple[Parameter, int]]:
        return ((p, i) for i, p in enumerate(self.free))

    def _damping(self, value: Mapping[str, Array]) -> dict[str, Array]:
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

    def _thrusters(self, value: Mapping[str, Array]) -> Any:
        thrusters = self.model.thrusters
        fields = {name: getattr(thrusters, name) for name in THRUST_UNITS}
        table = thrusters.table_force
        for group, members in self.groups.items():
            rows = np.array(members)
            mine = np.isin(np.arange(thrusters.count), rows)
            for name in THRUST_UNITS:
                given = value.get(f"thrusters.{group}.{name}")
                if given is None:
                    continue
                if name in ("force_ahead", "force_astern"):
                    ratio = given / fields[name][rows[0]]
                    ahead = table > 0
                    wanted = (ahead if name == "force_ahead" else ~ahead) & mine[:, None]
                    table = jnp.where(wanted, ratio, 1.0) * table
                fields[name] = fields[name].at[rows].set(given)
        fields["table_force"] = table
        return eqx.tree_at(
            lambda t: [getattr(t, name) for name in fields], thrusters, [jnp.asarray(v) for v in fields.values()]
        )


def _ratios(ratio: Mapping[str, Array], kind: str) -> Array:
    return jnp.stack([ratio.get(f"{kind}.{d}", jnp.ones(())) for d in DIRECTIONS])


def _scaled(matrix: Array, ratio: Array, share: tuple[float, float]) -> Array:
    """Element ij times ratio_i^share[0] ratio_j^share[1]: the diagonal by its ratio, a symmetric one stays definite."""
    return matrix * (ratio ** share[0])[:, None] * (ratio ** share[1])[None, :]


def _with_diagonal(matrix: Array, diagonal: Array, share: tuple[float, float]) -> Array:
    old = jnp.diagonal(matrix)
    ratio = jnp.where(old > 0, diagonal / jnp.where(old > 0, old, 1.0), 1.0)
    # A direction without damping of its own has no couplings to scale.
    return _scaled(matrix, ratio, share) + jnp.diag(jnp.where(old > 0, 0.0, diagonal))


def _restoring(model: Model, value: Mapping[str, Array]) -> dict[str, Array]:
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


def catalogue(
    vehicle: Vehicle, groups: Mapping[str, tuple[int, ...]] | None = None, model: Model | None = None
) -> Parameters:
    """Every parameter of a vehicle that can be identified, at the values of its file.

    Damping astern has parameters of its own where the file's values differ from those ahead; ask for others by name.

    Args:
        vehicle: What its parts say is the starting point.
        groups: Thrusters that share a curve; None: by name, or by orientation (see `thruster_groups`).
        model: Starting values in place of the vehicle's.
    """
    model = vehicle.model() if model is None else model
    groups = thruster_groups(vehicle) if groups is None else groups
    found = [*_hydrodynamics(model), *_restoring_parameters(model), *_thrust_parameters(model, groups)]
    found.append(Parameter("tether.drag", "N s2/m3", 0.05, True))
    return Parameters(model, tuple(found), groups)


def _hydrodynamics(model: Model) -> Iterable[Parameter]:
    added = np.asarray(model.added_mass).diagonal()
    for i, direction in enumerate(DIRECTIONS):
        if added[i] > 0:
            yield Parameter(f"added_mass.{direction}", UNITS["added"][i], float(added[i]), True)
    diagonals = {
        kind: np.asarray(getattr(model, f"{kind}_ahead" if "astern" not in kind else kind)).diagonal()
        for kind in DAMPINGS
    }
    for kind in DAMPINGS:
        order = kind.split("_")[0]
        for i, direction in enumerate(DIRECTIONS):
            base = float(diagonals[kind][i])
            if base <= 0 and order == "linear":
                base = _LINEAR_FLOOR * float(diagonals[kind.replace("linear", "quadratic")][i])
            if base > 0:
                yield Parameter(f"{kind}.{direction}", UNITS[order][i], base, True)


def _restoring_parameters(model: Model) -> Iterable[Parameter]:
    lever = np.asarray(model.center_of_buoyancy) - np.asarray(model.center_of_gravity)
    yield Parameter("restoring.metacentric_height", "m", float(-lever[2]), bool(lever[2] < 0))
    yield Parameter("restoring.center_of_buoyancy_x", "m", float(lever[0]), False)
    yield Parameter("restoring.center_of_buoyancy_y", "m", float(lever[1]), False)
    yield Parameter("restoring.net_buoyancy", "N", float(model.buoyancy - model.weight), False)


def _thrust_parameters(model: Model, groups: Mapping[str, tuple[int, ...]]) -> Iterable[Parameter]:
    thrusters = model.thrusters
    for group, members in groups.items():
        first = members[0]
        tabulated = bool(thrusters.tabulated[first])
        for name, unit in THRUST_UNITS.items():
            if tabulated and name in ("exponent", "dead_band"):
                continue  # the table has them
            base = float(getattr(thrusters, name)[first])
            if name == "time_constant":
                base = max(base, _TIME_CONSTANT_FLOOR)
            if name == "dead_band":
                base = max(base, 0.01)
            if base > 0:
                yield Parameter(f"thrusters.{group}.{name}", unit, base, True)


def choose(everything: Parameters, patterns: Iterable[str]) -> Parameters:
    """Those whose names fit one of the patterns (`added_mass.*`); the rest stay at their starting values.

    Raises:
        IdentificationError: A pattern fits nothing.
    """
    patterns = list(patterns)
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in everything.names):
            raise IdentificationError(
                f"free: '{pattern}' is no parameter of this vehicle.{near(pattern, everything.names)} "
                f"There are: {', '.join(everything.names)}"
            )
    kept = tuple(p for p in everything.free if any(fnmatchcase(p.name, pattern) for pattern in patterns))
    return Parameters(everything.model, kept, everything.groups)
