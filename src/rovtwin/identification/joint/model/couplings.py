"""Couplings between two directions: where added mass and drag act, and how they lie askew.

Added mass and drag of one direction rarely act at CO: a foam block on top, a sensor below, a part bolted on at one
side. Each direction of translation has two levers across it, so two couplings; a part beside an axis also couples two
rotations. They are kept as shares: M_ij = share sqrt(M_ii M_jj) of added mass; D_ji = share sqrt(D_ii D_jj) of linear
and share D_ii^(2/3) D_jj^(1/3) of quadratic damping, for what motion i does in j. Their bounds keep M_A positive
definite and damping passive (Young's inequality, see `drag.coupling_load`), as far as elements of the file
that are no parameters leave room for them.
"""

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import Matrix6
from rovtwin.vehicle.physics.model import Model

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
# Damping that differs astern is not symmetric: what a motion does to each response is an element of its own.
BOTH_WAYS = _ONE_WAY | {"_".join(reversed(name.split("_"))): (j, i) for name, (i, j) in _ONE_WAY.items()}
_PLACES = {f"added_mass.{name}": ij for name, ij in (COUPLINGS | SKEW).items()}
POWERS = {"linear_damping": 1, "quadratic_damping": 2}  # of the speed
_PLACES |= {
    f"{order}{side}.{name}": ij for order in POWERS for side in ("", "_astern") for name, ij in BOTH_WAYS.items()
}
# Of a share, b and s, or r of rotations. Of added mass with every element at its bound no row of three by three adds
# up to more than 2 s on the diagonal and 2 b + s beside it, so that the least eigenvalue of M_A in units of its
# diagonal is above 1 - 2 s - (2 b + s) > 0. Of damping a rotation's own must carry 2 b + 2 r < 1.
_BOUND, _SKEW_BOUND, _ROTATION_BOUND = 0.37, 0.08, 0.12


def place_of(name: str) -> tuple[int, int] | None:
    """The two directions of a coupling, `added_mass.surge_pitch`, of damping motion and response; None for others."""
    return _PLACES.get(name)


def bound_of(name: str) -> float:
    """Largest share of a coupling, either sign; infinite for what is none."""
    if name not in _PLACES:
        return np.inf
    if "damping" in name:
        return _ROTATION_BOUND if min(_PLACES[name]) > 2 else _BOUND
    return _SKEW_BOUND if name.partition(".")[2] in SKEW else _BOUND


def share_of(matrix: Float[Array | np.ndarray, "6 6"], model: Model, name: str) -> Float[Array | np.ndarray, ""]:
    """Share of a coupling in what its diagonals allow, of a family's matrix (6, 6) or of a change of it."""
    i, j = _PLACES[name]
    return matrix[j, i] / share_unit(*_sides(model, name.partition(".")[0]), i, j)


def shares(model: Model) -> dict[str, float]:
    """By name, `added_mass.surge_pitch`, of all couplings whose diagonals are there."""
    found = {}
    for name, at in _PLACES.items():
        side, other, _ = _sides(model, name.partition(".")[0])
        if min(matrix[k, k] for matrix in (side, other) for k in at) > 0:
            found[name] = float(share_of(side, model, name))
    return found


def with_added_mass(matrix: Matrix6, i: Place, j: Place, share: Float[Array, "*axes"]) -> Matrix6:
    """M_A with another share of M_ij = M_ji."""
    element = share * share_unit(matrix, matrix, 1, i, j)
    return matrix.at[i, j].set(element).at[j, i].set(element)


def with_damping(
    side: Matrix6, other: Matrix6, power: int, i: Place, j: Place, share: Float[Array, "*axes"]
) -> tuple[Matrix6, Matrix6]:
    """Damping ~ |nu|^power of a side, with motion i acting farther out, by another share of response j.

    On the other side it acts as much farther out.
    """
    lever = (share * share_unit(side, other, power, i, j) - side[j, i]) / side[i, i]
    return side.at[j, i].add(lever * side[i, i]), other.at[j, i].add(lever * other[i, i])


def _sides(model: Model, family: str) -> tuple[Matrix6, Matrix6, int]:
    """Matrix of a family, that of the other side, ahead or astern, and the power of the speed; M_A has no sides."""
    if family == "added_mass":
        return model.added_mass, model.added_mass, 1
    order = family.removesuffix("_astern")
    sides = getattr(model, f"{order}_ahead"), getattr(model, f"{order}_astern")
    side, other = reversed(sides) if family.endswith("_astern") else sides
    return side, other, POWERS[order]


def share_unit(side: Matrix6, other: Matrix6, power: int, i: Place, j: Place) -> Float[Array, "..."]:
    """Of D_ji on one side of motion i; the response meets either side of motion j, of which the weaker counts."""
    weaker = jnp.minimum(side[j, j], other[j, j])
    return side[i, i] ** (power / (power + 1)) * weaker ** (1 / (power + 1))
