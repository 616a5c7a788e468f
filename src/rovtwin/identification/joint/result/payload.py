"""When the parts change: the old identification plus the predicted change of the parts, widened.

The change is what formulas, and published totals of parts that come or go, say of the new parts less what they say of
the old ones; what tests found of the old vehicle stays under it. This is what makes the swap of a payload an
afternoon's work.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.identification.joint.model.couplings import place_of, share_of
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import DAMPINGS, DIRECTIONS, MOUNTING, Parameters
from rovtwin.identification.joint.result.interaction import added_mass_std
from rovtwin.identification.joint.result.published import trees_to_compare
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.description.identified import fingerprint
from rovtwin.vehicle.description.totals.assembly import Assembly, assemble, bodies, with_restoring, with_rigid_body
from rovtwin.vehicle.description.totals.drag import Damping
from rovtwin.vehicle.description.totals.rigid_body import MassProperties
from rovtwin.vehicle.description.totals.validation import require_sound
from rovtwin.vehicle.description.vehicle import body_arrays
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.solids.placement import Placement

# How far the formulas for the drag of a part may be off, relative to what they say of it, and what a part changes in
# the flow past the others, relative to the total. Judgement: no panel method tells drag (added mass: `interaction`).
_RELATIVE = {"linear_damping": 0.8, "quadratic_damping": 0.5}
_INTERACTION = {"linear_damping": 0.05, "quadratic_damping": 0.05}
# What thrusters do on another day, each for itself and relative: voltage, wear, weed, water. Judgement. Without it a
# fit that tells the ratio of two thrusters to a part in 100,000 takes the next difference between them for the scale
# of all forces and masses.
_ANOTHER_DAY = {"force_ahead": 0.01, "force_astern": 0.01, "exponent": 0.01, "dead_band": 0.03, "time_constant": 0.03}
_ANOTHER_DAY |= {"delay": 0.005}  # [s], of the commands
_COUPLED = 0.5  # error of an element of M_A beside the diagonal, of the mean of those of its two diagonals
# Volume of a part that comes or goes, relative, and its place [m].
_VOLUME, _PLACE = 0.1, 0.01
_LEAST = 0.05  # of a diagonal: what parts that go leave of it by difference, below which the share they leave is taken


@dataclass(frozen=True, eq=False)
class Change:
    """What new parts change, by formula.

    Attributes:
        model: The new vehicle as predicted: the old identification plus the change.
        hydrodynamics: Change of the matrices, arrays of shape (6, 6), by `added_mass` and the names in DAMPINGS.
        added_mass_std: Standard deviation of the change of M_A's diagonal.
        displaced: Buoyancy of all parts that come or go [N]: what an error of their volumes is relative to.
        moments: Of these forces about CO, by axis, and for each part as much as its place may be off [N m].
    """

    model: Model
    hydrodynamics: dict[str, Float[np.ndarray, "6 6"]]
    added_mass_std: Float[np.ndarray, "6"]
    displaced: float
    moments: Float[np.ndarray, "3"]


def predicted_change(old: Vehicle, new: Vehicle) -> Change | None:
    """What the new parts change; None where the parts are the same.

    The change is what formulas say of the whole tree of parts, new less old, and of parts that come or go what their
    files state in its place. Totals that were published or measured of the vehicle, and of any body in it of which
    something stays, are left out of both: those of the old one stay under the change. Only what the new file states
    anew of the whole's mass and buoyancy takes their place.

    Raises:
        IdentificationError: The vehicles have different thrusters or origins, so that nothing of the old one holds, or
            what goes leaves no vehicle that can move.
    """
    if fingerprint(old.file) == fingerprint(new.file):
        return None
    _require_same_vehicle(old, new)
    density = new.assembly.density
    trees = trees_to_compare(old.file, new.file)
    before, after = (assemble(tree, v.where).in_water(density) for tree, v in zip(trees, (old, new), strict=True))
    found = old.assembly.in_water(density)
    had, was, now = found.damping(), before.damping(), after.damping()
    solid = _changed_solid(found.solid, before.solid, after.solid)
    volume = found.volume + after.volume - before.volume
    if volume <= 0 or solid.mass <= 0:
        raise IdentificationError(f"{new.where}: what is left of {old.where} without the parts that went has no mass")
    moved = after.volume * after.center_of_buoyancy - before.volume * before.center_of_buoyancy
    la, lb, qa, qb = map(_changed, had.matrices(), was.matrices(), now.matrices())
    total = replace(
        found,
        solid=solid,
        volume=volume,
        center_of_buoyancy=(found.volume * found.center_of_buoyancy + moved) / volume,
        added_mass=_positive(_changed(found.added_mass, before.added_mass, after.added_mass)),
        measured=Damping(_positive(la), _positive(lb), qa, qb),
        elements=(),
        as_given=False,
        boxes=new.assembly.boxes,
    )
    total = with_rigid_body(total, _stated_anew(old, new, "rigid_body"))
    total = with_restoring(total, _stated_anew(old, new, "restoring"), new.where)
    differences = {
        "added_mass": after.added_mass - before.added_mass,
        **{name: getattr(now, field) - getattr(was, field) for name, field in zip(DAMPINGS, _MATRICES, strict=True)},
    }
    std = added_mass_std(*trees, density)
    return Change(_model(total, old, new), differences, std, *_swapped(before, after))


_MATRICES = ("linear_ahead", "quadratic_ahead", "linear_astern", "quadratic_astern")  # of Damping, as in DAMPINGS


def _require_same_vehicle(old: Vehicle, new: Vehicle) -> None:
    """One may hold the other as a part, even under longer names (`rov.port.surge`), but where its origin was."""
    pairs = list(zip(old.assembly.thrusters, new.assembly.thrusters, strict=False))
    alike = all(f".{a.name}".endswith(f".{b.name}") or f".{b.name}".endswith(f".{a.name}") for a, b in pairs)
    if len(old.thruster_names) != len(new.thruster_names) or not alike:
        raise IdentificationError(
            f"{new.where}: has thrusters {', '.join(new.thruster_names)}, but the prior's vehicle {old.where} has "
            f"{', '.join(old.thruster_names)}; a prior must come from the same vehicle with other parts"
        )
    for a, b in pairs:
        for vehicle, path, inner in ((new, b.path, a.path), (old, a.path, b.path)):
            around = path[: len(path) - len(inner)]
            if around + inner == path:
                _require_same_origin(vehicle, around)


def _require_same_origin(vehicle: Vehicle, path: tuple[str, ...]) -> None:
    """That a part in a part, and so on, has the vehicle's own frame."""
    body = vehicle.file
    for name in path:
        body = next(part for part in body.parts if part.name == name)
        held = Placement.of(body.pose.position, body.pose.attitude_deg)
        if not (np.allclose(held.position, 0.0) and np.allclose(held.rotation, np.eye(3))):
            raise IdentificationError(
                f"{vehicle.where}: part '{name}' holds the vehicle, found its pose {body.pose.position} m and "
                f"{body.pose.attitude_deg} deg, expected zeros: what is identified holds about the vehicle's own "
                "origin. Leave out this pose and move the other parts instead"
            )


def _stated_anew(old: Vehicle, new: Vehicle, key: str) -> Any:
    """What the new file says of the whole and the old one of nothing: any other statement was of the old parts."""
    given = getattr(new.file, key)
    plain = {"source", "sources"}
    known = [getattr(body, key).model_dump(exclude=plain) for _, body in bodies(old.file, "") if getattr(body, key)]
    return None if given is None or given.model_dump(exclude=plain) in known else given


def _changed_solid(found: MassProperties, before: MassProperties, after: MassProperties) -> MassProperties:
    """Mass properties that add up about CO: found + after - before."""
    signed = ((1.0, found), (1.0, after), (-1.0, before))
    mass = sum(sign * b.mass for sign, b in signed)
    center = sum((sign * b.mass * b.center_of_gravity for sign, b in signed), np.zeros(3)) / max(mass, 1e-9)
    about_co = sum((sign * b.inertia_about(np.zeros(3)) for sign, b in signed), np.zeros((3, 3)))
    at_co = MassProperties(mass, center, np.zeros((3, 3))).inertia_about(np.zeros(3))
    return MassProperties(mass, center, about_co - at_co)


def _changed(
    found: Float[np.ndarray, "6 6"], before: Float[np.ndarray, "6 6"], after: Float[np.ndarray, "6 6"]
) -> Float[np.ndarray, "6 6"]:
    """found + after - before.

    Where the formulas say that more goes than was found of the whole, they were wrong of the whole as of the part: the
    share that stays is taken, with the couplings as they were.
    """
    new = found + after - before
    own = found.diagonal()
    gone = new.diagonal() < _LEAST * own
    share = np.where(gone, after.diagonal() / np.where(gone, before.diagonal(), 1.0), 1.0)
    kept = np.sqrt(np.outer(share, share)) * found
    return np.where(np.logical_or.outer(gone, gone), kept, new)


def _positive(matrix: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """M_A or linear damping with couplings reduced until no motion has a negative share of it.

    A published diagonal has none of the couplings of a part that goes, so that they would stay with the other sign.
    """
    own = matrix.diagonal()
    unit = np.sqrt(np.where(own > 0, own, np.inf))
    share = (matrix + matrix.T) / (2 * np.outer(unit, unit)) * (1 - np.eye(6))
    least = -float(np.linalg.eigvalsh(share)[0])
    return matrix if least < 1 else np.diag(own) + 0.99 / least * (matrix - np.diag(own))


def _model(total: Assembly, old: Vehicle, new: Vehicle) -> Model:
    """Arrays of the predicted totals; thrusters as they were found, where they are now."""
    body = body_arrays(total)
    try:
        require_sound(total, np.asarray(body["rigid_body_mass"]), new.where)
    except ConfigError as error:
        raise IdentificationError(f"{error}. So it is predicted from {old.where} and the change of the parts") from None
    base = new.model()
    thrusters = replace(old.model().thrusters, configuration=base.thrusters.configuration)
    if thrusters.inflow_loss is None:  # nobody looked for one: the new file's
        thrusters = replace(thrusters, inflow_loss=base.thrusters.inflow_loss)
    return base.replace(**body, thrusters=thrusters)


def _swapped(before: Assembly, after: Assembly) -> tuple[float, Float[np.ndarray, "3"]]:
    """Buoyancy of the parts that only one of both has [N], and their moments, errors of place included [N m]."""

    def known(total: Assembly) -> set[tuple[float, ...]]:
        return {tuple(np.round([b.volume, *b.placement.position, *b.size], 9)) for b in total.boxes}

    swapped = known(before) ^ known(after)
    lift = np.array([after.density * GRAVITY * part[0] for part in swapped])
    place = np.array([part[1:4] for part in swapped]).reshape(-1, 3)
    return float(lift.sum()), lift @ (_VOLUME * np.abs(place) + _PLACE)


def without_shape(vehicle: Vehicle) -> list[str]:
    """Names of parts with neither a shape nor hydrodynamics: their drag and added mass are predicted as nothing."""
    return [
        name
        for name, body in bodies(vehicle.file, vehicle.name)
        if (body.mass or body.rigid_body) and body.shape is None and not body.hydrodynamics and not body.parts
    ]


def prior_from(
    old: Vehicle,
    parameters: Parameters,
    prior: Gaussian,
    change: Change | None,
    given: Iterable[str] = (),
    later: bool = False,
) -> Gaussian:
    """The prior of a new identification from an old one.

    What the old file estimated comes with its covariance, widened where the parts changed and by what thrusters do on
    another day; parameters that it lacks keep the given prior.

    Args:
        old: With an `identified` block.
        parameters: The new ones, their starting values those of `change`, or of the old file.
        prior: The default one.
        change: Of the parts, None where they are the same.
        given: Patterns of names of which somebody stated something: they keep the given prior too.
        later: Whether there are tests of another day. A change of parts is another day, too.
    """
    found = old.file.identified
    if found is None:
        raise IdentificationError(f"{old.where}: has no 'identified:' block; give a file that rovtwin identify wrote")
    known = {p.name: j for j, p in enumerate(found.estimate.parameters)}
    stated = [p.name for p in parameters.free if any(fnmatchcase(p.name, pattern) for pattern in given)]
    # How a gyro is mounted belongs to a log: the remark about it asks to straighten it.
    anew = {*stated, *MOUNTING}
    rows = [i for i, p in enumerate(parameters.free) if p.name in known and p.name not in anew]
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
    for i in rows if later or change is not None else ():
        C[i, i] += _ANOTHER_DAY.get(parameters.free[i].name.rpartition(".")[2], 0.0) ** 2
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
    """Whether it starts at the predicted value; thrusters, tether, link and sensors stay as they were found."""
    return not name.startswith(("commands.", "sensors.", "tether.", "thrusters."))


def _widening(parameters: Parameters, i: int, change: Change, before: float) -> float:
    """Standard deviation of the predicted change of one parameter, in theta; `before` is that of the default prior."""
    p = parameters.free[i]
    family, _, where = p.name.partition(".")
    if family == "added_mass":
        std, M = change.added_mass_std, np.asarray(change.model.added_mass).diagonal()
        if where in DIRECTIONS:
            at = DIRECTIONS.index(where)
            return float(std[at]) / p.base
        i, j = place_of(p.name) or (0, 0)
        return min(_COUPLED * float(np.sqrt(std[i] * std[j] / (M[i] * M[j]))), before) / p.slope(p.base)
    if where in DIRECTIONS:
        kind = family.removesuffix("_astern")
        delta = abs(change.hydrodynamics[family][DIRECTIONS.index(where), DIRECTIONS.index(where)])
        return min(float(np.hypot(_RELATIVE[kind] * delta / p.base, _INTERACTION[kind])), before)
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
