"""Heave feedback of a vehicle whose vertical thrusters sit beside CG, so that every push up or down tilts it.

One force then moves depth and tilt, and a controller of the depth alone works against itself: under way, a bow that
comes up asks for a push down, which at the stern lifts the bow further. So the heave force comes from all of them,

    Z = k_z e_z + k_w (w_d - w) - k_q (rates of the tilt) + k_theta (tilt at rest - tilt)

with the gains of a linear-quadratic regulator for the motion linearised about steady surge speeds, between which they
are interpolated. An error in depth of a length of the vehicle, of its speed, or of the tilt of STEEP costs as much as
all of the heave thrust; a bandwidth and a damping ratio other than the vehicle's own weigh thrust and speed instead.

Reference: Anderson and Moore (1990), Optimal Control: Linear Quadratic Methods (the regulator with a steady state).
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.programs.values import once_and_for_all
from rovtwin.core.types import Scalar, Vector2, Vector6
from rovtwin.gnc.scales import ANY, HEAVE, VehicleScales
from rovtwin.vehicle.analysis.stability import hang, linearised_at, tilt_of_thrust
from rovtwin.vehicle.physics.actuation import wrench_of_forces
from rovtwin.vehicle.physics.model import Model

STEEP = 0.2  # tilt that costs as much as a depth error of a length [rad]
TILTS = 0.09  # tilt by full heave thrust from which it has to be looked after [rad]
SPEEDS = 9  # at which gains are computed, astern to ahead
LEFT = 0.25  # least share of the righting moment that is counted on at speed
DECAY = 1e-3  # share of the bandwidth that is added as decay: without any drag the regulator has no solution


class HeaveFeedback(eqx.Module):
    """Gains of the heave force; the tilted axes are those of roll and pitch that only heave moves.

    Attributes:
        speeds: In surge through the water [m/s], rising.
        gains: Of depth [N/m], heave velocity [N s/m], rates of roll and pitch [N s/rad] and their angles [N/rad]; zero
            for an axis that heave does not tilt.
        lever: Moment in roll and pitch about CO that the thrusters make with forces along X, Y and Z [m].
        stiffness: What rights roll and pitch at rest [N m/rad].
        munk: What turns them, per speed squared in sway and in surge [kg].
    """

    speeds: Float[Array, " k"] = eqx.field(converter=as_array)
    gains: Float[Array, "k 6"] = eqx.field(converter=as_array)
    lever: Float[Array, "2 3"] = eqx.field(converter=as_array)
    stiffness: Vector2 = eqx.field(converter=as_array)
    munk: Vector2 = eqx.field(converter=as_array)

    @classmethod
    def of(cls, model: Model, bandwidth: float | None = None, damping_ratio: float = 1.0) -> "HeaveFeedback | None":
        """For a model; None where heave tilts it by less than TILTS: depth and tilt are then each for themselves.

        Args:
            model: The vehicle.
            bandwidth: Of depth [rad/s]; None: the vehicle's own.
            damping_ratio: Of depth.
        """
        tilted = tilt_of_thrust(model)[:, HEAVE] > TILTS
        if not tilted.any():
            return None
        scales = VehicleScales.of(model)
        most = min(float(scales.level_speed[0]), float(scales.top[0]), ANY)
        speeds = np.linspace(-most, most, SPEEDS)
        motions = zip(linearised_at(model, speeds), speeds, strict=True)
        weights = _weights(scales, bandwidth or float(scales.bandwidth[HEAVE]), damping_ratio)
        gains = np.stack([_gains(model, weights, A, speed, tilted) for A, speed in motions])
        added = np.diagonal(np.asarray(model.added_mass))
        lever = wrench_of_forces(model)[3:5]
        return cls(speeds, gains, lever, hang(model).stiffness, [added[2] - added[1], added[2] - added[0]])

    def depth_error(self, speed: Scalar) -> Scalar:
        """The error in depth [m] that asks for a speed up or down [m/s], the least over all surge speeds."""
        return speed * jnp.min(self.gains[:, 1] / self.gains[:, 0])

    def force(self, depth: Scalar, heave: Scalar, nu_r: Vector6, tilt: Vector2, wrench: Vector6) -> Scalar:
        """Heave force [N].

        Args:
            depth: Error, positive if the vehicle has to go down [m].
            heave: Desired velocity less the vehicle's own, b [m/s].
            nu_r: Slow velocity through the water, b.
            tilt: Roll and pitch, `frames.tilt_of` [rad].
            wrench: What else is asked for, inverse dynamics, b at CO [N, N m]: its forces tilt the vehicle, and so does
                what of its moments nobody makes.
        """
        gains = jnp.stack([jnp.interp(nu_r[0], self.speeds, column) for column in self.gains.T])
        turning = self.munk * jnp.stack([nu_r[1], nu_r[0]]) ** 2
        rights = jnp.maximum(self.stiffness - turning, LEFT * self.stiffness)
        at_rest = (self.lever @ wrench[:3] - wrench[3:5]) / rights
        off = jnp.clip(at_rest, -STEEP, STEEP) - tilt
        return gains[0] * depth + gains[1] * heave - gains[2:4] @ nu_r[3:5] + gains[4:] @ off


class _Weights(NamedTuple):
    """Of squared errors: depth [1/m2], heave velocity [s2/m2], tilt [1/rad2], thrust [1/N2]; and a decay [1/s]."""

    depth: float
    speed: float
    tilt: float
    thrust: float
    decay: float


def _weights(scales: VehicleScales, bandwidth: float, damping_ratio: float) -> _Weights:
    force = scales.force[HEAVE] * (bandwidth / scales.bandwidth[HEAVE]) ** 2
    speed = (damping_ratio / (scales.length * bandwidth)) ** 2
    return _Weights(scales.length**-2.0, speed, STEEP**-2.0, force**-2.0, DECAY * bandwidth)


@once_and_for_all
def _gains(
    model: Model, weights: _Weights, motion: Float[np.ndarray, "m m"], speed: float, tilted: Bool[np.ndarray, "2"]
) -> Float[np.ndarray, "6"]:
    """Of depth, heave, rates and angles of roll and pitch; `motion` is A of `linearised` at the speed."""
    from scipy.linalg import solve_continuous_are  # SciPy takes long to import: see `once_and_for_all`

    axes = np.flatnonzero(tilted)
    states = np.concatenate([[HEAVE], 3 + axes, 6 + axes])  # in `linearised`
    n, rates, angles = len(states), slice(1, 1 + len(axes)), slice(1 + len(axes), 1 + 2 * len(axes))
    A = np.zeros((n + 1, n + 1))
    A[:n, :n] = motion[np.ix_(states, states)]
    A[n, 0] = 1.0
    A[n, angles] = np.where(axes == 1, -speed, 0.0)  # z_dot = w - u theta
    B = np.zeros((n + 1, 1))
    B[: 1 + len(axes), 0] = (np.asarray(model.inertia_inverse) @ wrench_of_forces(model)[:, HEAVE])[
        states[: rates.stop]
    ]
    Q = np.zeros(n + 1)
    Q[0], Q[angles], Q[n] = weights.speed, weights.tilt, weights.depth
    P = solve_continuous_are(A - weights.decay * np.eye(n + 1), B, np.diag(Q), np.full((1, 1), weights.thrust))
    K = (B.T @ P)[0] / weights.thrust
    gains = np.zeros(6)
    gains[[0, 1]] = K[n], K[0]
    gains[2 + axes], gains[4 + axes] = K[rates], K[angles]
    return gains
