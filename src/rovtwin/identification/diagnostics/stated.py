"""What a vehicle file states of its parameters: values, and where it was identified, how well each is known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.identification.joint.model.couplings import bound_of, place_of, shares
from rovtwin.identification.joint.model.groups import thruster_groups
from rovtwin.identification.joint.model.parameters import (
    DAMPINGS,
    DIRECTIONS,
    THRUST_UNITS,
    Parameter,
    Parameters,
)
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.constants import COEFFICIENT_UNITS
from rovtwin.vehicle.physics.model import Model


@dataclass(frozen=True)
class Value:
    """A parameter as a file states it.

    Attributes:
        value: In its unit.
        unit: Of the value.
        std: Standard deviation of its coordinate; NaN where nobody said.
        positive: Whether it cannot be negative, see `Parameter`.
        name: Of the parameter.
    """

    value: float
    unit: str
    std: float
    positive: bool
    name: str = ""

    @property
    def parameter(self) -> Parameter:
        """Its coordinate, zero at the value."""
        return Parameter.at(self.name, self.unit, self.value, self.positive)

    def interval(self, z: float = 1.96) -> tuple[float, float]:
        """Ends of the 95 % interval, in the unit; NaN without a standard deviation."""
        p = self.parameter
        return float(p.value(-z * self.std)), float(p.value(z * self.std))


@dataclass(frozen=True, eq=False)
class Stated:
    """A vehicle file's parameters.

    Attributes:
        label: For tables and legends.
        vehicle: The file.
        parameters: Those with a covariance, theta = 0 at the values of the file; none where it was not identified.
        covariance: Of theta, or None.
        values: By name, all that the model has.
        tested: Ranges of speed by direction and of command by `thrusters.GROUP`; empty where nobody tested.
    """

    label: str
    vehicle: Vehicle
    parameters: Parameters
    covariance: Float[np.ndarray, "n n"] | None
    values: dict[str, Value]
    tested: Mapping[str, Sequence[float]]

    def model_at(self, theta: object) -> Model:
        """The model at coordinates theta, shape (n,)."""
        return self.parameters.model_at(theta)[0]


def stated(vehicle: Vehicle, label: str) -> Stated:
    """Parameters of a vehicle, with the covariance of its `identified:` block where it has one."""
    model, found = vehicle.model(), vehicle.file.identified
    if found is None:
        groups = thruster_groups(vehicle)
        return Stated(label, vehicle, Parameters(model, (), groups), None, _values(model, groups), {})
    estimate, names = found.estimate, vehicle.thruster_names
    groups = {g: tuple(names.index(n) for n in members) for g, members in estimate.groups.items()}
    groups = groups or thruster_groups(vehicle)
    free = tuple(Parameter.at(p.name, p.unit, p.value, p.positive) for p in estimate.parameters)
    values = _values(model, groups)
    for p in estimate.parameters:
        values[p.name] = Value(p.value, p.unit, p.std, p.positive, p.name)
    covariance = np.array(estimate.covariance).reshape(len(free), len(free))
    return Stated(label, vehicle, Parameters(model, free, groups), covariance, values, estimate.tested)


def _values(model: Model, groups: Mapping[str, tuple[int, ...]]) -> dict[str, Value]:
    """Everything that the model has, as known exactly as the file says."""
    stated: dict[str, tuple[float, str]] = {}
    diagonals = {"added_mass": model.added_mass} | {
        name: getattr(model, name if "astern" in name else f"{name}_ahead") for name in DAMPINGS
    }
    for name, matrix in diagonals.items():
        units = COEFFICIENT_UNITS[name.removesuffix("_astern")]
        for i, direction in enumerate(DIRECTIONS):
            stated[f"{name}.{direction}"] = float(np.asarray(matrix)[i, i]), units[i // 3]
    for name, share in shares(model).items():
        if abs(share) < bound_of(name):
            stated[name] = share, "1"
    lever = np.asarray(model.center_of_buoyancy) - np.asarray(model.center_of_gravity)
    stated["restoring.metacentric_height"] = float(-lever[2]), "m"
    stated["restoring.center_of_buoyancy_x"] = float(lever[0]), "m"
    stated["restoring.center_of_buoyancy_y"] = float(lever[1]), "m"
    stated["restoring.net_buoyancy"] = float(model.buoyancy - model.weight), "N"
    for group, members in groups.items():
        tabulated = bool(model.thrusters.tabulated[members[0]])
        for name, unit in THRUST_UNITS.items():
            if not (tabulated and name in ("exponent", "dead_band")):  # the table has them
                stated[f"thrusters.{group}.{name}"] = float(getattr(model.thrusters, name)[members[0]]), unit
    signed = ("restoring.center", "restoring.net")
    return {
        name: Value(
            value, unit, float("nan"), value > 0 and not name.startswith(signed) and place_of(name) is None, name
        )
        for name, (value, unit) in stated.items()
    }
