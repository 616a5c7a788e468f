"""When the parts change: the old identification plus the predicted change of the parts, widened.

The change is what formulas say of the new parts less what they say of the old ones; what tests found of the old vehicle
stays under it. This is what makes the swap of a payload an afternoon's work.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.joint.couplings import place_of, share_of
from rovtwin.identification.joint.gaussian import Gaussian
from rovtwin.identification.joint.parameters import DAMPINGS, DIRECTIONS, Parameters
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.assembly import Assembly, assemble, bodies
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.identified import fingerprint
from rovtwin.vehicle.model import Model

# How far the formulas for a part may be off, relative to what they say of it, and what a part changes in the flow past
# the others, relative to the total.
_RELATIVE = {"added_mass": 0.35, "linear_damping": 0.8, "quadratic_damping": 0.5}
_INTERACTION = {"added_mass": 0.03, "linear_damping": 0.05, "quadratic_damping": 0.05}
# Volume of a part that comes or goes, relative, and its place [m].
_VOLUME, _PLACE = 0.1, 0.01


@dataclass(frozen=True, eq=False)
class Change:
    """What new parts change, by formula.

    Attributes:
        model: The new vehicle as predicted: the old identification plus the change.
        hydrodynamics: Change of the matrices, arrays of shape (6, 6), by `added_mass` and the names in DAMPINGS.
        displaced: Buoyancy of all parts that come or go [N]: what an error of their volumes is relative to.
        moments: Of these forces about CO, by axis, and for each part as much as its place may be off [N m], shape (3,).
    """

    model: Model
    hydrodynamics: dict[str, np.ndarray]
    displaced: float
    moments: np.ndarray


def predicted_change(old: Vehicle, new: Vehicle) -> Change | None:
    """What the new parts change; None where the parts are the same.

    Raises:
        IdentificationError: The vehicles have different thrusters, so that nothing of the old one holds.
    """
    if fingerprint(old.file) == fingerprint(new.file):
        return None
    if not _same_thrusters(old.thruster_names, new.thruster_names):
        raise IdentificationError(
            f"{new.where}: has thrusters {', '.join(new.thruster_names)}, but the prior's vehicle {old.where} has "
            f"{', '.join(old.thruster_names)}; a prior must come from the same vehicle with other parts"
        )
    before, after = _parts_only(old), _parts_only(new)
    model = old.model()
    differences = {
        "added_mass": after.added_mass - before.added_mass,
        **{
            name: getattr(after.damping(), field) - getattr(before.damping(), field)
            for name, field in zip(DAMPINGS, _MATRICES, strict=True)
        },
    }
    matrices = {_FIELDS[name]: np.asarray(getattr(model, _FIELDS[name])) + d for name, d in differences.items()}
    solid = new.assembly.solid
    weight = solid.mass * GRAVITY
    net_change = _net(after) - _net(before)
    buoyancy = weight + float(model.buoyancy - model.weight) + net_change
    moved = (
        after.density * GRAVITY * (after.volume * after.center_of_buoyancy - before.volume * before.center_of_buoyancy)
    )
    center = (float(model.buoyancy) * np.asarray(model.center_of_buoyancy) + moved) / buoyancy
    base = new.model()
    predicted = base.replace(
        **matrices,
        buoyancy=buoyancy,
        displaced_mass=buoyancy / GRAVITY,
        center_of_buoyancy=center,
        thrusters=model.thrusters,
    )
    return Change(predicted, differences, *_swapped(before, after))


_MATRICES = ("linear_ahead", "quadratic_ahead", "linear_astern", "quadratic_astern")  # of Damping, as in DAMPINGS
_FIELDS = {
    "added_mass": "added_mass",
    "linear_damping": "linear_damping_ahead",
    "quadratic_damping": "quadratic_damping_ahead",
    "linear_damping_astern": "linear_damping_astern",
    "quadratic_damping_astern": "quadratic_damping_astern",
}


def _parts_only(vehicle: Vehicle) -> Assembly:
    """Totals by formula: nothing published or measured of the whole."""
    plain = {"hydrodynamics": None, "restoring": None, "rigid_body": None, "identified": None}
    return assemble(vehicle.file.model_copy(update=plain), vehicle.where)


def _same_thrusters(old: list[str], new: list[str]) -> bool:
    """Whether they are the same ones, or all of them within one part of the new vehicle (`rov.port.surge`)."""
    if len(old) != len(new):
        return False
    prefixes = {n[: -len(o)] if n.endswith(o) else None for o, n in zip(old, new, strict=True)}
    prefix = prefixes.pop() if len(prefixes) == 1 else None
    return prefix is not None and (prefix == "" or prefix.endswith("."))


def _swapped(before: Assembly, after: Assembly) -> tuple[float, np.ndarray]:
    """Buoyancy of the parts that only one of both has [N], and their moments, errors of place included [N m]."""

    def known(total: Assembly) -> set[tuple[float, ...]]:
        return {tuple(np.round([b.volume, *b.placement.position, *b.size], 9)) for b in total.boxes}

    swapped = known(before) ^ known(after)
    lift = np.array([after.density * GRAVITY * part[0] for part in swapped])
    place = np.array([part[1:4] for part in swapped]).reshape(-1, 3)
    return float(lift.sum()), lift @ (_VOLUME * np.abs(place) + _PLACE)


def _net(total: Assembly) -> float:
    return GRAVITY * (total.density * total.volume - total.solid.mass)


def without_shape(vehicle: Vehicle) -> list[str]:
    """Names of parts whose volume and shape are not given: their drag and added mass are predicted as nothing."""
    return [
        name
        for name, body in bodies(vehicle.file, vehicle.name)
        if body.mass is not None and body.shape is None and not body.parts
    ]


def prior_from(
    old: Vehicle, parameters: Parameters, prior: Gaussian, change: Change | None, said: Iterable[str] = ()
) -> Gaussian:
    """The prior of a new identification from an old one.

    What the old file estimated comes with its covariance, widened where the parts changed; parameters that it lacks
    keep the given prior.

    Args:
        old: With an `identified` block.
        parameters: The new ones, their starting values those of `change`, or of the old file.
        prior: The default one.
        change: Of the parts, None where they are the same.
        said: Patterns of names of which somebody stated something: they keep the given prior too.
    """
    found = old.file.identified
    if found is None:
        raise IdentificationError(f"{old.where}: has no 'identified:' block; give a file that rovtwin identify wrote")
    known = {p.name: j for j, p in enumerate(found.estimate.parameters)}
    stated = [p.name for p in parameters.free if any(fnmatchcase(p.name, pattern) for pattern in said)]
    rows = [i for i, p in enumerate(parameters.free) if p.name in known and p.name not in stated]
    columns = [known[parameters.free[i].name] for i in rows]
    scale = np.array([_scale(parameters, i, found.estimate.parameters[j]) for i, j in zip(rows, columns, strict=True)])
    C = prior.covariance.copy()
    C[rows, :] = 0.0
    C[:, rows] = 0.0
    C[np.ix_(rows, rows)] = np.array(found.estimate.covariance)[np.ix_(columns, columns)] * np.outer(scale, scale)
    mean = prior.mean.copy()
    mean[rows] = 0.0
    for i in rows:
        if not _of_the_parts(parameters.free[i].name):
            mean[i] = parameters.free[i].theta(found.estimate.parameters[known[parameters.free[i].name]].value)
    if change is not None:
        for i in rows:
            C[i, i] += _widening(parameters, i, change, float(np.sqrt(prior.covariance[i, i]))) ** 2
    return Gaussian(mean, C)


def _scale(parameters: Parameters, i: int, was: object) -> float:
    """From an error of the old coordinate to one of the new: the error of the value itself stays."""
    p = parameters.free[i]
    value = float(getattr(was, "value", p.base))
    return p.slope(value) / p.slope(p.base) if _of_the_parts(p.name) else 1.0


def _of_the_parts(name: str) -> bool:
    """Whether it starts at the predicted value; thrusters and tether stay as they were found, whatever the parts."""
    return not name.startswith(("tether.", "thrusters."))


def _widening(parameters: Parameters, i: int, change: Change, before: float) -> float:
    """Standard deviation of the predicted change of one parameter, in theta; `before` is that of the default prior."""
    p = parameters.free[i]
    family, _, where = p.name.partition(".")
    if where in DIRECTIONS:
        kind = family.removesuffix("_astern")
        delta = abs(change.hydrodynamics[family][DIRECTIONS.index(where), DIRECTIONS.index(where)])
        return float(np.hypot(_RELATIVE[kind] * delta / p.base, _INTERACTION[kind]))
    if place_of(p.name) is not None:
        kind = family.removesuffix("_astern")
        share = _RELATIVE[kind] * abs(float(share_of(change.hydrodynamics[family], change.model, p.name)))
        # The others' flow couples directions no more than it would in a vehicle of which nothing is known.
        return float(np.hypot(share, min(_INTERACTION[kind], before)) / p.slope(p.base))
    if p.name == "restoring.net_buoyancy":
        return _VOLUME * change.displaced
    if family == "restoring":
        axis = {"center_of_buoyancy_x": 0, "center_of_buoyancy_y": 1, "metacentric_height": 2}[where]
        return float(change.moments[axis] / change.model.buoyancy) / (p.base if p.positive else 1.0)
    return 0.0
