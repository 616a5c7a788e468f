"""Model: what the equations use. Arrays only, built once from a Vehicle, never changed."""

from typing import Any

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.numerics import Array, as_array, module_for
from rovtwin.core.types import Matrix6, Scalar, Vector3
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.discrepancy import Discrepancy
from rovtwin.vehicle.physics.hull import Hull, cube
from rovtwin.vehicle.physics.thrusters import Thrusters


class Model(eqx.Module):
    """Parameters of one vehicle, body frame b (FRD) at CO, SI.

    M_A and D are stored positive: X_udot = -added_mass[0, 0], X_u = -linear_damping_ahead[0, 0].
    Damping opposes nu_r with separate coefficients for positive (ahead) and negative (astern) velocities; column j
    multiplies velocity component j, so off-diagonal terms couple.

    Attributes:
        rigid_body_mass: M_RB, symmetric positive definite. Fossen (2021), eq. 3.49.
        added_mass: M_A.
        linear_damping_ahead: Of positive velocities [N s/m, ...].
        linear_damping_astern: Of negative ones.
        quadratic_damping_ahead: Of positive velocities [N s2/m2, ...].
        quadratic_damping_astern: Of negative ones.
        weight: W [N].
        buoyancy: B [N].
        center_of_gravity: r_g [m].
        center_of_buoyancy: r_b [m].
        displaced_mass: Mass of the displaced water [kg]; B / gravity unless B is an apparent value.
        thrusters: See `Thrusters`.
        hull: Where the buoyancy sits and how far the body reaches; at the surface and at walls.
        discrepancy: What these equations lack, learned from tests; None: nothing, and nothing is computed.
        inertia: M = M_RB + M_A; derived.
        inertia_inverse: Its inverse; derived.
        damping: The four damping matrices side by side, as `damping_wrench` uses them; derived.
    """

    rigid_body_mass: Matrix6
    added_mass: Matrix6
    linear_damping_ahead: Matrix6
    linear_damping_astern: Matrix6
    quadratic_damping_ahead: Matrix6
    quadratic_damping_astern: Matrix6
    weight: Scalar
    buoyancy: Scalar
    center_of_gravity: Vector3
    center_of_buoyancy: Vector3
    displaced_mass: Scalar
    thrusters: Thrusters
    hull: Hull
    discrepancy: Discrepancy | None
    inertia: Matrix6
    inertia_inverse: Matrix6
    damping: Float[Array, "6 24"]

    def __init__(
        self,
        *,
        rigid_body_mass: Any,
        added_mass: Any,
        linear_damping_ahead: Any,
        quadratic_damping_ahead: Any,
        weight: Any,
        buoyancy: Any,
        center_of_gravity: Any,
        center_of_buoyancy: Any,
        thrusters: Thrusters,
        linear_damping_astern: Any = None,
        quadratic_damping_astern: Any = None,
        displaced_mass: Any = None,
        hull: Hull | None = None,
        discrepancy: Discrepancy | None = None,
    ):
        """All by name; what is None astern equals ahead.

        Without more the displaced mass is buoyancy / GRAVITY, and the hull a cube of fresh water of that mass.
        """
        self.rigid_body_mass = as_array(rigid_body_mass)
        self.added_mass = as_array(added_mass)
        self.linear_damping_ahead = as_array(linear_damping_ahead)
        self.quadratic_damping_ahead = as_array(quadratic_damping_ahead)
        self.linear_damping_astern = (
            self.linear_damping_ahead if linear_damping_astern is None else as_array(linear_damping_astern)
        )
        self.quadratic_damping_astern = (
            self.quadratic_damping_ahead if quadratic_damping_astern is None else as_array(quadratic_damping_astern)
        )
        self.weight = as_array(weight)
        self.buoyancy = as_array(buoyancy)
        self.center_of_gravity = as_array(center_of_gravity)
        self.center_of_buoyancy = as_array(center_of_buoyancy)
        xp = module_for(vars(self), displaced_mass)
        self.displaced_mass = as_array(xp.divide(self.buoyancy, GRAVITY) if displaced_mass is None else displaced_mass)
        self.thrusters = thrusters
        self.hull = cube(center_of_buoyancy, self.displaced_mass) if hull is None else hull
        self.discrepancy = discrepancy
        self.inertia = as_array(xp.add(self.rigid_body_mass, self.added_mass))
        self.inertia_inverse = as_array(xp.linalg.inv(self.inertia))
        linear = [self.linear_damping_ahead, xp.negative(self.linear_damping_astern)]
        quadratic = [self.quadratic_damping_ahead, xp.negative(self.quadratic_damping_astern)]
        self.damping = as_array(xp.concatenate(linear + quadratic, axis=1))

    def replace(self, **changes: Any) -> "Model":
        """A model with some parameters changed and all derived arrays made anew."""
        given = {name: getattr(self, name) for name in _PARAMETERS}
        unknown = set(changes) - set(given)
        if unknown:
            raise TypeError(f"Model has no parameter {sorted(unknown)}; it has {sorted(given)}")
        return Model(**(given | changes))


_PARAMETERS = (
    "rigid_body_mass",
    "added_mass",
    "linear_damping_ahead",
    "linear_damping_astern",
    "quadratic_damping_ahead",
    "quadratic_damping_astern",
    "weight",
    "buoyancy",
    "center_of_gravity",
    "center_of_buoyancy",
    "displaced_mass",
    "thrusters",
    "hull",
    "discrepancy",
)


def rigid_body_matrix(mass: Any, inertia_at_cg: Any, center_of_gravity: Any) -> Matrix6:
    """M_RB at CO, from mass [kg], inertia tensor about CG (3, 3) [kg m2] and r_g (3,) [m].

    Reference: Fossen (2021), eq. 3.49, with I_b = I_g - m S(r_g)^2.
    """
    xp = module_for(mass, inertia_at_cg, center_of_gravity)
    mass, inertia, (x, y, z) = xp.asarray(mass), xp.asarray(inertia_at_cg), xp.asarray(center_of_gravity)
    S = xp.asarray([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return as_array(xp.block([[mass * xp.eye(3), -mass * S], [mass * S, inertia - mass * S @ S]]))
