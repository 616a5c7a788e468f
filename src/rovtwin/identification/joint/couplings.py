"""Couplings between two directions: where added mass and drag act, and how they lie askew.

Added mass and drag of one direction rarely act at CO: a foam block on top, a sensor below, a part bolted on at one
side. Each direction of translation has two levers across it, so two couplings; a part beside an axis also couples two
rotations. They are kept as shares: M_ij = share sqrt(M_ii M_jj) of added mass and of linear damping, D_ji = share
D_ii^(2/3) D_jj^(1/3) for what motion i does in j by quadratic damping. Their bounds keep M_A positive definite and
quadratic damping passive (Young's inequality, see `vehicle.damping.coupling_load`), couplings of linear damping give
way together (`passive_linear`): as far as elements of the file that are no parameters leave room for them.
"""

import numpy as np

from rovtwin.core.numerics import Array, jnp
from rovtwin.vehicle.model import Model

Sides = tuple[Array, Array]  # damping ahead and astern
Place = int | np.ndarray  # a direction's number, or those of several couplings at once

# Force i and moment j, by name.
COUPLINGS = {
    "surge_pitch": (0, 4),
    "surge_yaw": (0, 5),
    "sway_roll": (1, 3),
    "sway_yaw": (1, 5),
    "heave_roll": (2, 3),
    "heave_pitch": (2, 4),
}
# The other elements of added mass above its diagonal. Without them, those of a body with parts at one side would tell
# the scale of its forces.
SKEW = {
    "surge_sway": (0, 1),
    "surge_heave": (0, 2),
    "sway_heave": (1, 2),
    "surge_roll": (0, 3),
    "sway_pitch": (1, 4),
    "heave_yaw": (2, 5),
    "roll_pitch": (3, 4),
    "roll_yaw": (3, 5),
    "pitch_yaw": (4, 5),
}
# Those that damping has too: what lies beside an axis is moved by the rotation about it and brakes another one.
ROTATIONS = {name: at for name, at in SKEW.items() if min(at) > 2}
_ONE_WAY = COUPLINGS | ROTATIONS
# Quadratic damping is not symmetric: what a motion does to each response is an element of its own.
BOTH_WAYS = _ONE_WAY | {"_".join(reversed(name.split("_"))): (j, i) for name, (i, j) in _ONE_WAY.items()}
_PLACES = {f"added_mass.{name}": ij for name, ij in (COUPLINGS | SKEW).items()}
_PLACES |= {f"linear_damping.{name}": ij for name, ij in _ONE_WAY.items()}
_PLACES |= {f"quadratic_damping.{name}": ij for name, ij in BOTH_WAYS.items()}
_PLACES |= {name.replace(".", "_astern."): ij for name, ij in _PLACES.items() if "damping" in name}
# Of a share, b and s, or r of rotations. Of added mass with every element at its bound no row of three by three adds
# up to more than 2 s on the diagonal and 2 b + s beside it, so that the least eigenvalue of M_A in units of its
# diagonal is above 1 - 2 s - (2 b + s) > 0. Of quadratic damping a rotation's own must carry 2 b + 2 r < 1. Two
# directions alone could share all of their linear damping; a bound at 1 would be a wall that an estimate runs into.
_BOUND, _SKEW_BOUND, _ROTATION_BOUND, _LINEAR_BOUND = 0.37, 0.08, 0.12, 0.95


def place_of(name: str) -> tuple[int, int] | None:
    """The two directions of a coupling, `added_mass.surge_pitch`, of damping motion and response; None for others."""
    return _PLACES.get(name)


def bound_of(name: str) -> float:
    """Largest share of a coupling, either sign; infinite for what is none."""
    if name not in _PLACES:
        return np.inf
    if name.startswith("linear_damping"):
        return _LINEAR_BOUND
    if name.startswith("quadratic_damping"):
        return _ROTATION_BOUND if min(_PLACES[name]) > 2 else _BOUND
    return _SKEW_BOUND if name.partition(".")[2] in SKEW else _BOUND


def share_of(matrix: Array | np.ndarray, model: Model, name: str) -> Array:
    """Share of a coupling in what its diagonals allow, of a family's matrix (6, 6) or of a change of it."""
    i, j = _PLACES[name]
    family = name.partition(".")[0]
    sides = _sides(model, family)
    side = sides[family.endswith("_astern")]
    if family.startswith("quadratic"):
        return matrix[j, i] / _quadratic_unit(sides, side, i, j)
    return matrix[i, j] / _symmetric_unit(side, i, j)


def shares(model: Model) -> dict[str, float]:
    """By name, `added_mass.surge_pitch`, of all couplings whose diagonals are there."""
    found = {}
    for name, at in _PLACES.items():
        family = name.partition(".")[0]
        sides = _sides(model, family)
        if min(matrix[k, k] for matrix in sides for k in at) > 0:
            found[name] = float(share_of(sides[family.endswith("_astern")], model, name))
    return found


def with_added_mass(matrix: Array, i: Place, j: Place, share: Array) -> Array:
    """M_A, shape (6, 6), with another share of M_ij = M_ji."""
    element = share * _symmetric_unit(matrix, i, j)
    return matrix.at[i, j].set(element).at[j, i].set(element)


def with_quadratic(sides: Sides, i: Place, j: Place, share: Array, astern: bool = False) -> Sides:
    """Quadratic damping ahead and astern, shape (6, 6), of motion i acting farther out, by another share of response j.

    Astern it acts as much farther out; with `astern` it moves there alone.
    """
    moved = sides[astern]
    lever = (share * _quadratic_unit(sides, moved, i, j) - moved[j, i]) / moved[i, i]
    more = [matrix.at[j, i].add(lever * matrix[i, i]) for matrix in sides]
    return (sides[0] if astern else more[0]), more[1]


def with_linear(sides: Sides, i: Place, j: Place, share: Array, astern: bool = False) -> Sides:
    """The same of linear damping, for motion i and motion j alike."""
    moved = sides[astern]
    lever = (share * _symmetric_unit(moved, i, j) - moved[i, j]) / moved[i, i]
    more = [matrix.at[i, j].add(lever * matrix[i, i]).at[j, i].add(lever * matrix[i, i]) for matrix in sides]
    return (sides[0] if astern else more[0]), more[1]


def passive_linear(sides: Sides, before: Sides) -> Sides:
    """Linear damping ahead and astern whose couplings cannot drive the vehicle.

    Where those of a direction come to more than its own damping, or than they were `before` if that was more, all of
    them give way.
    """
    keep = jnp.minimum(1.0, jnp.maximum(_linear_load(before), 1.0) / jnp.maximum(_linear_load(sides), 1e-12))
    factor = jnp.where(np.eye(6) > 0, 1.0, jnp.minimum(keep[:, None], keep[None, :]))
    return factor * sides[0], factor * sides[1]


def _sides(model: Model, family: str) -> Sides:
    """Damping ahead and astern of a family's order; of added mass, which has no sides, the same twice."""
    if family == "added_mass":
        return model.added_mass, model.added_mass
    order = family.removesuffix("_astern")
    return getattr(model, f"{order}_ahead"), getattr(model, f"{order}_astern")


def _symmetric_unit(matrix: Array, i: Place, j: Place) -> Array:
    return (matrix[i, i] * matrix[j, j]) ** (1 / 2)


def _quadratic_unit(sides: Sides, side: Array, i: Place, j: Place) -> Array:
    """Of D_ji on one side of motion i; the response meets either side of motion j, of which the weaker counts."""
    return side[i, i] ** (2 / 3) * jnp.minimum(sides[0][j, j], sides[1][j, j]) ** (1 / 3)


def _linear_load(sides: Sides) -> Array:
    """How much of each direction's own damping its couplings use up, shape (6,), whichever way two of them move.

    As `damping.coupling_load`, but of each side with its own diagonal: drag ahead has nothing to do with motion astern.
    """
    worst = jnp.zeros((6, 6))
    for one in sides:
        for other in sides:
            own = jnp.outer(jnp.diagonal(one), jnp.diagonal(other))
            cross = (jnp.abs(one.T) + jnp.abs(other)) / 2  # of ij: what i does in j, and j in i
            there = (own > 0) & (np.eye(6) == 0)
            worst = jnp.maximum(worst, jnp.where(there, cross / jnp.sqrt(jnp.where(there, own, 1.0)), 0.0))
    return jnp.sum(worst, axis=1)
