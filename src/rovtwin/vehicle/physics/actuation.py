"""What thrusters can push: rank, directions out of reach, largest wrenches. The one place where these are decided.

Configuration matrices T, shape (6, n), are NumPy here: this is done once, outside the loop. No thrusters, n = 0, is an
answer like any other: rank 0 and nothing in reach.
"""

from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.numerics import in_numpy, jnp, module_for
from rovtwin.core.programs.values import once_and_for_all
from rovtwin.core.types import Vector6
from rovtwin.vehicle.constants import FRESH_WATER, GRAVITY
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import Thrusters, force_limits

# Singular values below this share of the largest count as zero: geometry in files is given to a millimetre or so,
# and rounding alone leaves 1e-16.
RANK_TOLERANCE = 1e-6
YAW = 5
BY_PRODUCT = 0.5  # share of a pure force or moment below which an axis is no axis of its own


def rank(T: Any) -> int:
    """Number of independent directions in which thrusters can push."""
    return _rank_of(np.linalg.svd(np.asarray(T, dtype=float), compute_uv=False))


def _rank_of(singular_values: Float[np.ndarray, " r"]) -> int:
    return int((singular_values > RANK_TOLERANCE * singular_values.max(initial=0.0)).sum())


def uncontrollable_directions(T: Any) -> Float[np.ndarray, "directions 6"]:
    """Unit wrenches [X, Y, Z, K, M, N] that no command can make, one per row.

    They span all wrenches orthogonal to the range of T. Where a plain axis is among them, it is given as such:
    the Double Blueye's answer is the pitch axis, not a mixture. The first entry of each is positive, and rows go by it.
    """
    U, s, _ = np.linalg.svd(np.asarray(T, dtype=float))
    null = U[:, _rank_of(s) :]
    count = null.shape[1]
    # Elimination (Gauss-Jordan) brings a basis to a readable form. It starts from the projector, which is unique,
    # and not from the basis, of which any rotation would do as well.
    rows = null @ null.T
    for i in range(count):
        largest = np.abs(rows[i:]).max(axis=0)
        column = int(np.argmax(largest > 0.5 * largest.max()))
        best = i + int(np.argmax(np.abs(rows[i:, column])))
        rows[[i, best]] = rows[[best, i]]
        rows[i] /= rows[i, column]
        others = np.arange(6) != i
        rows[others] -= np.outer(rows[others, column], rows[i])
    rows = rows[:count]
    rows[np.abs(rows) < 1e-9] = 0.0
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    first = np.argmax(np.abs(rows) > 10 * RANK_TOLERANCE, axis=1)
    rows *= np.sign(rows[np.arange(count), first])[:, None]
    return rows[np.argsort(first, kind="stable")] + 0.0  # no -0.0


def reachable_share(T: Any, length: float = 1.0) -> Float[np.ndarray, "6"]:
    """How much of a pure force or moment along each axis thrusters can make, 0 to 1: diagonal of T T^+.

    Args:
        T: Configuration matrix.
        length: Lever at which moments are counted as forces [m].
    """
    scaled = np.asarray(T, dtype=float) / np.repeat([1.0, length], 3)[:, None]
    return np.diagonal(scaled @ np.linalg.pinv(scaled, rcond=RANK_TOLERANCE)).copy()


def size(model: Model) -> float:
    """Edge of a cube of the displaced water [m]; of a vehicle without a volume, of as much water as it weighs."""
    mass = float(model.displaced_mass) or float(model.weight) / GRAVITY
    return (mass / FRESH_WATER) ** (1.0 / 3.0)


def pushed_axes(model: Model) -> Bool[np.ndarray, "6"]:
    """Axes, surge to yaw, along which thrusters can be asked for a force or moment.

    Thrusters for surge that sit above or below CO make a moment in pitch as well. Without others that balance it, pitch
    is a by-product of surge: nothing controls it, and holding it at zero would take surge away, too. So an axis counts
    where sound thrusters can make more than half of a pure force or moment along it. Moments are about CG, for the
    origin may lie anywhere, and are compared with forces at the vehicle's own length.
    """
    return reachable_share(configuration_about_cg(model), size(model)) > BY_PRODUCT


def configuration_about_cg(model: Model) -> Float[np.ndarray, "6 n"]:
    """T with moments about CG in place of CO."""
    T = np.array(model.thrusters.configuration)
    T[3:] -= np.cross(np.asarray(model.center_of_gravity), T[:3], axisb=0, axisc=0)
    return T


def wrench_of_forces(model: Model) -> Float[np.ndarray, "6 3"]:
    """What thrusters make, per newton, of a force along X, Y and Z alone, about CO [-, m].

    Along axes that are not pushed it is what comes with that force; a column is zero where the force is none of theirs.
    """
    T, pushed = np.asarray(model.thrusters.configuration), pushed_axes(model)
    forces = np.linalg.pinv(T[pushed], rcond=RANK_TOLERANCE)
    made = np.zeros((6, 3))
    for column, axis in enumerate(np.flatnonzero(pushed[:3])):
        made[:, axis] = T @ forces[:, column]
    return made


def axis_limits(model: Model) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]]:
    """Lowest and highest wrench that may be asked of each axis [N, N m]: zero where it is not pushed.

    A moment in yaw is one without a force, as far as there is such a one: turning, which goes before surge, must not
    drive the vehicle ahead.
    """
    pushed = pushed_axes(model)
    lower, upper = (np.where(pushed, np.asarray(limit), 0.0) for limit in wrench_limits(model.thrusters))
    least, most = turning_limits(model.thrusters)
    if least < 0.0 < most:
        lower[YAW], upper[YAW] = max(lower[YAW], least), min(upper[YAW], most)
    return lower, upper


@once_and_for_all
def turning_limits(thrusters: Thrusters) -> tuple[float, float]:
    """Lowest and highest moment in yaw that thrusters make without any force [N m]; 0 where each brings one along.

    Two surge thrusters that give 25 N ahead and 18 N astern turn harder than that only while they push ahead.
    """
    from scipy.optimize import linprog  # SciPy takes long to import: see `once_and_for_all`

    T = np.asarray(thrusters.configuration)
    if T.shape[1] == 0:
        return 0.0, 0.0
    bounds = np.stack([np.asarray(limit) for limit in force_limits(thrusters)], axis=1)
    ends = [linprog(sign * T[YAW], A_eq=T[:3], b_eq=np.zeros(3), bounds=bounds) for sign in (1.0, -1.0)]
    return float(ends[0].fun), -float(ends[1].fun)


@once_and_for_all
def pure_force_limits(thrusters: Thrusters, axis: int) -> tuple[float, float]:
    """Lowest and highest force in surge or sway that neither turns the vehicle nor pushes it along another axis [N].

    Roll and pitch are left to the restoring moment. Of three thrusters in a Y it is three quarters of all that they
    push along one of them.
    """
    from scipy.optimize import linprog

    T, (low, high) = np.asarray(thrusters.configuration), (np.asarray(limit) for limit in force_limits(thrusters))
    others = [i for i in (0, 1, 2, YAW) if i != axis and np.any(np.abs(T[i]) > RANK_TOLERANCE)]
    found = []
    for sign in (1.0, -1.0):
        best = linprog(sign * T[axis], A_eq=T[others], b_eq=np.zeros(len(others)), bounds=np.stack([low, high], axis=1))
        found.append(sign * float(best.fun))
    return found[0], found[1]


def wrench_limits(thrusters: Thrusters) -> tuple[Vector6, Vector6]:
    """Lowest and highest wrench of each axis alone [N, N m], other axes left free."""
    T, (low, high) = in_numpy((thrusters.configuration, force_limits(thrusters)))
    xp = module_for(T, low, high)
    ends = T * low, T * high
    return jnp.asarray(xp.sum(xp.minimum(*ends), axis=1)), jnp.asarray(xp.sum(xp.maximum(*ends), axis=1))


def share_of_limits(T: Any, lowest: Any, highest: Any, tau: Any) -> Float[np.ndarray, " k"]:
    """Least share of their limits within which thrusters make each wrench; inf where they cannot at all.

    Forces within those limits make a polytope of wrenches, a zonotope, each face of which is parallel to r - 1 columns
    of T, r its rank. The share is the largest, over the normals h of all faces, of h . tau over the largest h . T f.

    Args:
        T: Wrench per force.
        lowest: Of the forces, at most zero [N].
        highest: At least zero.
        tau: Wrenches.

    Reference: Ziegler (1995), Lectures on Polytopes, ch. 7 (zonotopes).
    """
    T, tau = np.asarray(T, dtype=float), np.asarray(tau, dtype=float)
    scale = np.abs(T).max(axis=1, initial=0.0)
    scale = np.where(scale > 0.0, scale, 1.0)[:, None]
    U, s, _ = np.linalg.svd(T / scale, full_matrices=False)
    basis = U[:, : _rank_of(s)]
    columns, wrenches = basis.T @ (T / scale), basis.T @ (tau.T / scale)
    normals = _face_normals(columns)
    along = normals @ columns
    support = np.maximum(along * np.asarray(highest), along * np.asarray(lowest)).sum(axis=1)[:, None]
    asked = normals @ wrenches
    some = asked > RANK_TOLERANCE * np.abs(wrenches).max(axis=0, initial=0.0)
    bounded = support > RANK_TOLERANCE * support.max(initial=1e-300)
    share = np.where(some, np.where(bounded, asked / np.where(bounded, support, 1.0), np.inf), 0.0)
    return share.max(axis=0, initial=0.0)


def _face_normals(columns: Float[np.ndarray, "r n"]) -> Float[np.ndarray, "faces r"]:
    """Both normals of each face of the zonotope of columns, and some that bound it as well."""
    r, n = columns.shape
    if r == 0:
        return np.zeros((0, 0))
    groups = np.array(list(combinations(range(n), r - 1)), dtype=int).reshape(comb(n, r - 1), r - 1)
    spans = np.moveaxis(columns[:, groups], 0, 2)  # (faces, r - 1, r)
    normals = np.linalg.svd(spans, full_matrices=True)[2][:, -1]
    normals = np.unique(np.round(normals, 9), axis=0)
    return np.concatenate([normals, -normals])
