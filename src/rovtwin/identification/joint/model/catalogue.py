"""What can be identified of a vehicle: every parameter at the value of its file, and the choice among them."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import jnp
from rovtwin.core.user_files.config import near
from rovtwin.identification.joint.model.couplings import bound_of, shares
from rovtwin.identification.joint.model.groups import thruster_groups
from rovtwin.identification.joint.model.parameters import (
    DAMPINGS,
    DELAYS,
    DIRECTIONS,
    INFLOW,
    MOUNTING,
    THRUST_UNITS,
    Parameter,
    Parameters,
)
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.constants import COEFFICIENT_UNITS
from rovtwin.vehicle.physics.model import Model

# Linear damping that a file leaves at zero starts as this share of the quadratic, at 1 m/s or 1 rad/s.
_ROUNDING = 1e-9  # of the rigid body, below which added mass is none
_LINEAR_FLOOR = 0.03
_STARTS = {"time_constant": 0.05, "dead_band": 0.01}  # [s], [1], of a thruster whose file gives none
_WIDEST = 0.9  # of the bound of a coupling, beyond which it has no room to move


def catalogue(
    vehicle: Vehicle, groups: Mapping[str, tuple[int, ...]] | None = None, model: Model | None = None
) -> Parameters:
    """Every parameter of a vehicle that can be identified, at the values of its file.

    Damping astern has parameters of its own; without them it follows that ahead (see `identify.default_free`). A
    coupling near its bound or beyond has none, it follows the diagonal.

    Args:
        vehicle: What its parts say is the starting point.
        groups: Thrusters that share a curve; None: by name, or by orientation (see `thruster_groups`).
        model: Starting values in place of the vehicle's.
    """
    model = vehicle.model() if model is None else model
    groups = thruster_groups(vehicle) if groups is None else groups
    found = [*_hydrodynamics(model), *_restoring_parameters(model), *_thrust_parameters(model, groups)]
    found.append(Parameter("tether.drag", "N s2/m3", 0.05, True))
    found.append(Parameter("commands.delay", "s", 0.0, False))
    found += [Parameter(name, "rad", 0.0, False) for name in MOUNTING]
    found += [Parameter(name, "s", 0.0, False) for name in DELAYS]
    return Parameters(model, tuple(found), groups)


def _hydrodynamics(model: Model) -> Iterable[Parameter]:
    model = _started(model)
    added, rigid = (np.asarray(m).diagonal() for m in (model.added_mass, model.rigid_body_mass))
    for i, direction in enumerate(DIRECTIONS):
        if added[i] > _ROUNDING * rigid[i]:  # a disc has none in yaw, by formula and but for rounding
            yield Parameter(f"added_mass.{direction}", COEFFICIENT_UNITS["added_mass"][i // 3], float(added[i]), True)
    for kind in DAMPINGS:
        diagonal = np.asarray(getattr(model, f"{kind}_ahead" if "astern" not in kind else kind)).diagonal()
        for i, direction in enumerate(DIRECTIONS):
            if diagonal[i] > 0:
                yield Parameter(
                    f"{kind}.{direction}",
                    COEFFICIENT_UNITS[kind.removesuffix("_astern")][i // 3],
                    float(diagonal[i]),
                    True,
                )
    for name, share in shares(model).items():
        if abs(share) < _WIDEST * bound_of(name):
            yield Parameter.at(name, "1", share, False)


def _started(model: Model) -> Model:
    """With linear damping wherever there is a quadratic one."""
    sides = {}
    for side in ("ahead", "astern"):
        linear, quadratic = (np.asarray(getattr(model, f"{order}_damping_{side}")) for order in ("linear", "quadratic"))
        floor = np.where(linear.diagonal() > 0, 0.0, _LINEAR_FLOOR * quadratic.diagonal())
        sides[f"linear_damping_{side}"] = linear + np.diag(floor)
    return model.replace(**sides)


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
            base = base or _STARTS.get(name, 0.0)
            if base > 0:
                yield Parameter.at(f"thrusters.{group}.{name}", unit, base, True)
        lost = 0.0 if thrusters.inflow_loss is None else float(thrusters.inflow_loss[first])
        yield Parameter(f"thrusters.{group}.{INFLOW}", "s/m", lost, False)


def choose(everything: Parameters, patterns: Iterable[str]) -> Parameters:
    """Those whose names fit one of the patterns (`added_mass.*`); the rest stay at their starting values.

    What an inflow takes, how a gyro is mounted and how late sensors are has to be named: `thrusters.*.inflow_loss`,
    `sensors.gyro.*`, `sensors.*.delay`.

    Raises:
        IdentificationError: A pattern fits nothing.
    """
    patterns = list(patterns)
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in everything.names):
            families = list(dict.fromkeys(f"{name.rpartition('.')[0]}.*" for name in everything.names))
            close = near(pattern, everything.names)
            hint = close if "Did you mean" in close else ""
            raise IdentificationError(
                f"free: '{pattern}' is no parameter of this vehicle.{hint} There are: {', '.join(families)}"
            )
    kept = tuple(p for p in everything.free if any(_is_meant(pattern, p) for pattern in patterns))
    return Parameters(with_inflow(everything.model, kept), kept, everything.groups)


def _is_meant(pattern: str, parameter: Parameter) -> bool:
    """Whether a pattern frees it: `*` frees neither a loss of thrust that the file does not have nor a sensor."""
    rare = (INFLOW, "sensors") if parameter.base == 0.0 else ()
    hidden = [word for word in rare if word in parameter.name.split(".") and word not in pattern]
    return fnmatchcase(parameter.name, pattern) and not hidden


def with_inflow(model: Model, free: Iterable[Parameter]) -> Model:
    """With a loss of thrust, be it 0, where one is a parameter, and without one where it is 0 and none is."""
    thrusters = model.thrusters
    found = any(p.name.endswith(f".{INFLOW}") for p in free)
    if thrusters.inflow_loss is None:
        return model.replace(thrusters=replace(thrusters, inflow_loss=jnp.zeros(thrusters.count))) if found else model
    unused = not found and not np.any(np.asarray(thrusters.inflow_loss))
    return model.replace(thrusters=replace(thrusters, inflow_loss=None)) if unused else model
