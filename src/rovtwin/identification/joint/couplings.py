"""Couplings between a force and the moments about the axes across it: where added mass and drag act.

Added mass and drag of one direction rarely act at CO: a foam block on top, a sensor below, a part bolted on at one
side. Each direction of translation has two levers across it, so two couplings. They are kept as shares,
M_ij = share sqrt(M_ii M_jj) for added mass and D_ji = share D_ii^(2/3) D_jj^(1/3) for what motion i does in j by
quadratic damping (of ahead and astern the larger element and the smaller diagonals). Their bounds keep M_A positive
definite and damping passive (Young's inequality, see `vehicle.damping.coupling_load`).
"""

import numpy as np

from rovtwin.core.numerics import Array, jnp
from rovtwin.vehicle.model import Model

Place = int | np.ndarray  # row or column, or those of several couplings at once

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
# Quadratic damping is not symmetric: what a motion does to each response is an element of its own.
BOTH_WAYS = COUPLINGS | {"_".join(reversed(name.split("_"))): (j, i) for name, (i, j) in COUPLINGS.items()}
_PLACES = {f"added_mass.{name}": ij for name, ij in (COUPLINGS | SKEW).items()}
_PLACES |= {f"quadratic_damping.{name}": ij for name, ij in BOTH_WAYS.items()}
# Of a share, b and s. With every element at its bound no row of three by three adds up to more than 2 s on the diagonal
# and 2 b + s beside it, so that the least eigenvalue of M_A in units of its diagonal is above 1 - 2 s - (2 b + s) > 0.
_BOUND, _SKEW_BOUND = 0.37, 0.08


def place_of(name: str) -> tuple[int, int] | None:
    """Row and column of a coupling, `added_mass.surge_pitch`; None for what is no coupling."""
    return _PLACES.get(name)


def bound_of(name: str) -> float:
    """Largest share of a coupling, either sign; infinite for what is none."""
    if name not in _PLACES:
        return np.inf
    return _SKEW_BOUND if name.partition(".")[2] in SKEW else _BOUND


def added_mass_share(matrix: Array, i: Place, j: Place) -> Array:
    """Share of M_ij in the geometric mean of both diagonals."""
    return matrix[i, j] / _added_mass_unit(matrix, i, j)


def with_added_mass(matrix: Array, i: Place, j: Place, share: Array) -> Array:
    """M_A, shape (6, 6), with another share of M_ij = M_ji."""
    element = share * _added_mass_unit(matrix, i, j)
    return matrix.at[i, j].set(element).at[j, i].set(element)


def damping_share(ahead: Array, astern: Array, i: Place, j: Place) -> Array:
    """Share of the response j to motion i by quadratic damping, on the side where it is larger."""
    return ahead[j, i] / ahead[i, i] / _longest(ahead, astern, i, j)


def drag_lever(ahead: Array, astern: Array, i: Place, j: Place, share: Array) -> Array:
    """How far drag of motion i must move for another share of its response j [m], or [1/m] of a rotation."""
    return share * _longest(ahead, astern, i, j) - ahead[j, i] / ahead[i, i]


def with_quadratic(matrix: Array, i: Place, j: Place, lever: Array) -> Array:
    """Quadratic damping, shape (6, 6), of motion i acting `lever` farther out."""
    return matrix.at[j, i].add(lever * matrix[i, i])


def with_linear(ahead: Array, astern: Array, i: Place, j: Place, lever: Array) -> tuple[Array, Array]:
    """Linear damping of both sides, shape (6, 6), acting `lever` farther out, as far as it stays passive."""
    product = jnp.minimum(ahead[i, i], astern[i, i]) * jnp.minimum(ahead[j, j], astern[j, j])
    most = _BOUND * jnp.sqrt(jnp.where(product > 0, product, 1.0))

    def moved(matrix: Array) -> Array:
        element = jnp.where(product > 0, most * jnp.tanh(lever * matrix[i, i] / most), 0.0)
        return matrix.at[i, j].add(element).at[j, i].add(element)

    return moved(ahead), moved(astern)


def shares(added_mass: Array, ahead: Array, astern: Array) -> dict[str, float]:
    """By name, `added_mass.surge_pitch`, of matrices (6, 6), damping quadratic; where the diagonals are there."""
    found = {}
    for name, (i, j) in _PLACES.items():
        of_inertia = name.startswith("added_mass")
        if min(matrix[k, k] for matrix in ([added_mass] if of_inertia else [ahead, astern]) for k in (i, j)) > 0:
            found[name] = float(
                added_mass_share(added_mass, i, j) if of_inertia else damping_share(ahead, astern, i, j)
            )
    return found


def share_of_change(change: Array | np.ndarray, model: Model, name: str) -> float:
    """What a change of a matrix (6, 6) adds to the share of a coupling, `added_mass.surge_pitch`."""
    i, j = _PLACES[name]
    if name.startswith("added_mass"):
        return float(change[i, j] / _added_mass_unit(model.added_mass, i, j))
    ahead, astern = model.quadratic_damping_ahead, model.quadratic_damping_astern
    return float(change[j, i] / ahead[i, i] / _longest(ahead, astern, i, j))


def _added_mass_unit(matrix: Array, i: Place, j: Place) -> Array:
    return (matrix[i, i] * matrix[j, j]) ** (1 / 2)


def _longest(ahead: Array, astern: Array, i: Place, j: Place) -> Array:
    """The lever of which a share is a share [m], or [1/m] of a rotation."""
    least = [jnp.minimum(ahead[k, k], astern[k, k]) for k in (i, j)]
    return least[0] ** (2 / 3) * least[1] ** (1 / 3) / jnp.maximum(ahead[i, i], astern[i, i])
