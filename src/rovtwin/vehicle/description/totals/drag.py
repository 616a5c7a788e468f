"""Drag of simple solids and its move from a part's frame to the vehicle's.

Drag coefficients on the projected areas, spread over the faces, so that lever arms give roll, pitch and yaw damping and
the couplings. Flow interaction between parts is neglected. Plain NumPy: done once per vehicle, on the host.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.solids.placement import Placement

# Linear damping = quadratic coefficient x this speed [m/s]. The two quotients D_L / D_NL that towing measured on the
# Double Blueye are 0.041 (surge ahead) and 0.021 (sway), thesis (4.3) and (4.4); Eidsvik's 0.16 (thesis 3.4, 3.5) is
# several times what was measured.
CROSSOVER_SPEED = 0.03

_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(8)  # over a face


@dataclass(frozen=True)
class Damping:
    """Linear and quadratic, ahead and astern, as in `Model`."""

    linear_ahead: Float[np.ndarray, "6 6"]
    linear_astern: Float[np.ndarray, "6 6"]
    quadratic_ahead: Float[np.ndarray, "6 6"]
    quadratic_astern: Float[np.ndarray, "6 6"]

    @classmethod
    def none(cls) -> "Damping":
        return cls(*(np.zeros((6, 6)) for _ in range(4)))

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        return self.linear_ahead, self.linear_astern, self.quadratic_ahead, self.quadratic_astern

    def __add__(self, other: "Damping") -> "Damping":
        return Damping(*(a + b for a, b in zip(self.matrices(), other.matrices(), strict=True)))

    def scaled(self, factor: float) -> "Damping":
        return Damping(*(factor * m for m in self.matrices()))

    def moved(self, placement: Placement) -> "Damping":
        """As the parent's origin feels it, exact for motion in one direction at a time.

        Column j is the wrench of unit velocity in direction j: quadratic drag does not superpose, so there is no
        matrix that is right for all motions together (see `tamed`).
        """
        H = placement.twist()
        ahead, astern = np.maximum(H, 0), np.maximum(-H, 0)
        la, lb, qa, qb = self.matrices()
        return Damping(
            H.T @ (la @ ahead - lb @ astern),
            H.T @ (lb @ ahead - la @ astern),
            H.T @ (qa @ ahead**2 - qb @ astern**2),
            H.T @ (qb @ ahead**2 - qa @ astern**2),
        )


def coupling_load(
    ahead: Float[np.ndarray, "6 6"], astern: Float[np.ndarray, "6 6"], power: int
) -> Float[np.ndarray, "6"]:
    """How much of each direction's own damping its couplings use up: up to 1 they cannot add energy.

    For force ~ |nu|^power, with Young's inequality on every product |nu_i| |nu_j|^power of a coupling. Sufficient, not
    necessary.
    """
    own = np.minimum(np.diag(ahead), np.diag(astern))
    coupling = np.maximum(np.abs(ahead), np.abs(astern)) * (1 - np.eye(6))
    share = 1 / (power + 1)
    root = np.where(own > 0, own, np.inf)
    relative = coupling / np.outer(root**share, root ** (power * share))
    load = power * share * relative.sum(axis=0) + share * relative.sum(axis=1)
    undamped = (own <= 0) & ((coupling.sum(axis=0) > 0) | (coupling.sum(axis=1) > 0))
    return np.where(undamped, np.inf, load)


def tamed(damping: Damping) -> Damping:
    """The same damping with couplings reduced where they could drive the vehicle.

    A matrix that is right for each direction alone need not take energy when three or more of them act together, as
    for a lone part far off the axes; the sum over flat pieces that it stands for always does.
    """
    la, lb, qa, qb = damping.matrices()
    (qa, qb) = _reduced(qa, qb, power=2)
    # Linear damping moves exactly, as a matrix; only one that differs astern is in the same case.
    if not np.array_equal(la, lb):
        (la, lb) = _reduced(la, lb, power=1)
    return Damping(la, lb, qa, qb)


def _reduced(
    ahead: Float[np.ndarray, "6 6"], astern: Float[np.ndarray, "6 6"], power: int
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6 6"]]:
    load = coupling_load(ahead, astern, power)
    keep = np.minimum(1.0, 1.0 / np.maximum(load, 1e-12))
    factor = np.minimum.outer(keep, keep)
    np.fill_diagonal(factor, 1.0)
    return factor * ahead, factor * astern


@dataclass(frozen=True)
class DragElements:
    """Small flat pieces that only feel the flow along their normal: f = -(d |v_n| + l) v_n.

    Attributes:
        position: [m].
        normal: Unit normals.
        quadratic: 1/2 rho C_D dA [N s2/m2].
    """

    position: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"]
    quadratic: Float[np.ndarray, " n"]

    def moved(self, placement: Placement) -> "DragElements":
        R = placement.rotation
        return DragElements(placement.position + self.position @ R.T, self.normal @ R.T, self.quadratic)

    def damping(self) -> Damping:
        """Damping at the origin, exact for motion in one direction at a time (see `Damping.moved`)."""
        # Row k of A: normal velocity of piece k for unit nu_j, n . (v + omega x p).
        A = np.concatenate([self.normal, np.cross(self.position, self.normal)], axis=1)
        quadratic = A.T @ (self.quadratic[:, None] * np.abs(A) * A)
        linear = A.T @ (CROSSOVER_SPEED * self.quadratic[:, None] * A)
        return Damping(linear, linear, quadratic, quadratic)


def drag_elements(solid: Solid, density: float) -> DragElements:
    """Each projected area in small pieces: `_face` of a simple solid, the cells of its silhouette of a mesh."""
    positions, normals, drags = [], [], []
    for axis in range(3):
        points, areas = _face(solid, axis) if solid.mesh is None else solid.mesh.silhouettes[axis]
        normal = np.zeros((len(points), 3))
        normal[:, axis] = 1.0
        positions.append(points)
        normals.append(normal)
        drags.append(0.5 * density * solid.drag_coefficient[axis] * areas)
    pieces = DragElements(np.concatenate(positions), np.concatenate(normals), np.concatenate(drags))
    return pieces.moved(solid.placement)


def _face(solid: Solid, axis: int) -> tuple[Float[np.ndarray, "64 3"], Float[np.ndarray, "64"]]:
    """8 x 8 points (64, 3) over the face's rectangle, or the ellipse in it, and areas (64,) with Gauss weights."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    u, v = (g.ravel() for g in np.meshgrid(_GAUSS_X, _GAUSS_X, indexing="ij"))
    weight = np.outer(_GAUSS_W, _GAUSS_W).ravel() / 4
    points = np.zeros((u.size, 3))
    points[:, j], points[:, k] = u * solid.size[j] / 2, v * solid.size[k] / 2
    if solid.kind == "ellipsoid" or (solid.kind == "cylinder" and axis == 0):
        # Square to disc along rays: a point at distance max(|u|, |v|), its share of area 1 / (1 + tan^2).
        far, near = np.maximum(np.abs(u), np.abs(v)), np.minimum(np.abs(u), np.abs(v))
        points *= (far / np.hypot(u, v))[:, None]
        weight = weight / (1 + (near / far) ** 2)
        weight = weight / weight.sum()
    return points, solid.projected_areas()[axis] * weight
