"""How far the formulas may be off of the added mass that bodies bring when they come or go.

The formulas take every body as alone in the water. Beside others it moves in water that they have set in motion, or
that has to squeeze past them: the panel method gives a box 1 cm beside a hull 1.5 times its own added mass in surge,
and less than nothing in sway. So the error of what a body changes is in proportion to the most that it
could do, its own added mass and that of the water it displaces, times the share of the others' momentum that is in the
water around them, and falls with its distance.
The numbers were chosen by the panel method on 400 payloads; tests/identification/payloads.py holds others against it.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.constants import FRESH_WATER
from rovtwin.vehicle.description.schema import Body, Shape
from rovtwin.vehicle.description.totals.added_mass import Solid, added_mass, move_matrix
from rovtwin.vehicle.description.totals.assembly import assemble
from rovtwin.vehicle.solids.placement import HERE, Placement

_OWN, _STANDS_IN = 0.2, 1.0  # relative errors: formula of a lone body; the sphere for one without a shape
_FLOW = 1.3  # of a body against the others: standard deviation relative to the most that it could do
_LEAST_SHARE = 0.2  # of the others' momentum in the water near them, also where they are slender
_EVER = 1e-3  # of the whole's added mass, whatever comes or goes


@dataclass(frozen=True, eq=False)
class _Lone:
    """A body alone in the water, seen from CO.

    Attributes:
        solid: Its shape; of a body without one a sphere of what it displaces or, neutrally buoyant, weighs.
        shaped: Whether it has a shape, so that formulas say something of it.
        added_mass: Diagonal of its M_A, by formula or, where that is more, as it publishes it.
        displaced: Diagonal of the mass matrix of the water that it displaces.
    """

    solid: Solid
    shaped: bool
    added_mass: Float[np.ndarray, "6"]
    displaced: Float[np.ndarray, "6"]

    @classmethod
    def of(cls, solid: Solid, shaped: bool, density: float) -> "_Lone":
        water = solid.homogeneous(density * solid.volume())
        displaced = np.concatenate([np.full(3, water.mass), np.diag(water.inertia_about(np.zeros(3)))])
        return cls(solid, shaped, np.diag(added_mass(solid, density)), displaced)

    @property
    def key(self) -> tuple[float, ...]:
        """The same of two bodies of which neither could be distinguished from the other."""
        return (float(self.shaped), *np.round([*self.solid.placement.position, *self.added_mass, *self.displaced], 9))


def added_mass_std(before: Body, after: Body, density: float) -> Float[np.ndarray, "6"]:
    """Standard deviation of what formulas say of the change of M_A's diagonal [kg, kg m2].

    Args:
        before: A vehicle.
        after: The same with other parts.
        density: Of the water [kg/m3].
    """
    old, new = (list(_lone(body, HERE, density)) for body in (before, after))
    common = Counter(b.key for b in old) & Counter(b.key for b in new)
    variance = np.zeros(6)
    for bodies in (old, new):
        left = Counter(common)
        for body in bodies:
            if left[body.key] > 0:
                left[body.key] -= 1
                continue
            variance += _variance(body, [other for other in bodies if other is not body])
    if not variance.any():
        return variance
    most = np.maximum(*(sum((b.added_mass for b in bodies), np.zeros(6)) for bodies in (old, new)))
    return np.sqrt(variance + (_EVER * most) ** 2)


def _variance(body: _Lone, others: list[_Lone]) -> Float[np.ndarray, "6"]:
    """Of what a body does to the diagonal of M_A beside others."""
    own = (_OWN if body.shaped else _STANDS_IN) * body.added_mass
    if not others:
        return own**2
    M, displaced = (sum((getattr(b, f) for b in others), np.zeros(6)) for f in ("added_mass", "displaced"))
    share = np.maximum(M / (M + displaced), _LEAST_SHARE)
    radius = np.cbrt(3 / (4 * np.pi) * sum(b.solid.volume() for b in others))
    distance = min(_distance(b.solid, body.solid.placement.position) for b in others)
    flow = _FLOW * share * (body.added_mass + body.displaced) / (1 + distance / radius)
    return own**2 + flow**2


def _distance(solid: Solid, point: Float[np.ndarray, "3"]) -> float:
    """From the box around a solid to a point [m]; 0 inside."""
    local = (point - solid.placement.position) @ solid.placement.rotation
    return float(np.linalg.norm(np.maximum(np.abs(local) - 0.5 * solid.size, 0.0)))


def _lone(body: Body, placement: Placement, density: float) -> Iterator[_Lone]:
    """The body and all its parts, each alone."""
    solid = Solid.of(body.shape) if body.shape is not None else _stand_in(body)
    if solid is not None:
        solid = replace(solid, placement=solid.placement.after(placement))
        lone = _Lone.of(solid, body.shape is not None, density)
        if body.hydrodynamics is not None and body.hydrodynamics.added_mass is not None:
            # What it publishes of itself is no surer than a formula: where that is more, more is in doubt.
            published = move_matrix(assemble(body, "", density).added_mass, placement).diagonal()
            lone = replace(lone, added_mass=np.maximum(lone.added_mass, published))
        yield lone
    for part in body.parts:
        yield from _lone(part, Placement.of(part.pose.position, part.pose.attitude_deg).after(placement), density)


def _stand_in(body: Body) -> Solid | None:
    """A sphere of what a body without a shape displaces or, neutrally buoyant, weighs; None of a group of parts."""
    mass = getattr(body.rigid_body, "mass", None) or body.mass or 0.0
    volume = body.volume or mass / FRESH_WATER
    if body.parts or volume == 0:
        return None
    center = body.center_of_gravity if body.center_of_buoyancy is None else body.center_of_buoyancy
    radius = float(np.cbrt(3 * volume / (4 * np.pi)))
    return Solid.of(Shape.model_validate({"sphere": radius, "center": center}))
