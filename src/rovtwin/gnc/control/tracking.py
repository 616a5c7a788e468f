"""Tracking: a reference that keeps to the path, and a controller that asks the model what wrench it takes.

    tau = M nu_dot_d + C(nu_d) nu_d + D(nu_d) nu_d + g(eta) - b,     nu_dot_d = nu_ref_dot + K_d (nu_ref - nu) + K_p e

with drag and Coriolis at the reference's velocity and the estimated disturbance b cancelled. Errors are those of the
slow motion: what waves do is left to them. Moments have an integral, because the filter estimates no moment. The
restoring moment is that of a level vehicle: what rights it is not cancelled, and what a flow from the side does to turn
it further (Munk's moment), which grows with the square of the speed, sets the least stiffness. What is asked for
through the water is no more than keeps the vehicle level, and more only while it does stay level. Where heave thrust
tilts the vehicle, and nothing else rights it, depth and tilt share one feedback, made for no more than that speed.

Reference: Fossen (2021), sec. 15.2 and 16.3 (inverse dynamics with acceleration feed-forward).
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.arrays.filters import integrated
from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Estimate, Reference, Setpoint, Wrench
from rovtwin.core.frames import (
    cross,
    heading_rotation,
    rotation_error,
    rotation_from_quaternion,
    tilt_of,
)
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.types import PRNGKey, Scalar, Vector2, Vector3, Vector6
from rovtwin.gnc.allocation.shared_thrust import SharedThrust
from rovtwin.gnc.control.heave_feedback import HeaveFeedback
from rovtwin.gnc.control.reference_model import ReferenceModel
from rovtwin.gnc.guidance.level_allowance import Allowance, LevelAllowance
from rovtwin.gnc.guidance.speed_limit import AchievableSpeed
from rovtwin.gnc.interfaces import ControlInput
from rovtwin.gnc.scales import HEAVE, YAW, VehicleScales, straight
from rovtwin.vehicle.physics.actuation import pushed_axes
from rovtwin.vehicle.physics.dynamics import coriolis_wrench, damping_wrench, learned_wrench, restoring_wrench
from rovtwin.vehicle.physics.linearisation import restoring_stiffness
from rovtwin.vehicle.physics.model import Model

ROUNDING = 1e-9  # of a limit: what products of shares change
DOWN = np.array([0.0, 0.0, 1.0])


class PathReference(Block):
    """North and east as guidance has them; depth and heading through a second-order model with bounded rates.

    Attributes:
        model: For depth and heading.
    """

    model: ReferenceModel

    @classmethod
    def of(cls, model: Model, dive: float | None = None, turn: float | None = None) -> "PathReference":
        """As quick as control follows; largest rate of dives [m/s] and of turns [rad/s], None: the vehicle's own."""
        scales = VehicleScales.of(model)
        limit = np.full(6, np.inf)
        limit[HEAVE] = scales.dive_speed if dive is None else dive
        limit[YAW] = scales.turn_rate if turn is None else turn
        frequency = scales.bandwidth * np.where(np.arange(6) == HEAVE, 1.25, 1.0)
        return cls(ReferenceModel(np.ones(6), frequency, limit))  # type: ignore[arg-type]  (NumPy)

    def init(self, key: PRNGKey, start: Start) -> Reference:
        return self.model.init(key, start)

    def step(self, memory: Reference, input: Setpoint, dt: float) -> tuple[Reference, Reference]:
        _, smooth = self.model.step(memory, input, dt)
        rate = rotation_from_quaternion(input.attitude) @ input.nu[:3]
        # What guidance says of the speed is exact; its difference is the acceleration, a tick late.
        change = (rate - memory.velocity) / dt
        reference = replace(
            smooth,
            position=jnp.concatenate([input.position[:2], smooth.position[2:]]),
            velocity=jnp.concatenate([rate[:2], smooth.velocity[2:]]),
            acceleration=jnp.concatenate([change[:2], smooth.acceleration[2:]]),
        )
        return reference, reference


class TrackingMemory(eqx.Module):
    """What control remembers.

    Attributes:
        moments: Integral [N m].
        level: What it may go beyond the level speed.
    """

    moments: Vector3
    level: Allowance


class Tracking(Block):
    """Model-based tracking control.

    Attributes:
        model: What the vehicle is assumed to be.
        sustained: Tells the current.
        K_p: Of the pose error, b [1/s2].
        K_d: Of the velocity error, b [1/s].
        K_i: Of the attitude error's integral [N m/rad/s].
        reach: Largest position error that counts [m].
        limits: Of tau.
        allowance: How it comes to go faster than its level speed; guidance, which plans ways, knows nothing of it.
        tilting: Feedback of depth and tilt in place of K_p and K_d in heave; None where heave thrust does not tilt it.
    """

    model: Model
    sustained: AchievableSpeed
    K_p: Vector6 = eqx.field(converter=as_array)
    K_d: Vector6 = eqx.field(converter=as_array)
    K_i: Vector3 = eqx.field(converter=as_array)
    reach: Scalar = eqx.field(converter=as_array)
    limits: SharedThrust
    allowance: LevelAllowance
    tilting: HeaveFeedback | None = None

    @classmethod
    def of(
        cls,
        model: Model,
        bandwidth: Any = None,
        damping_ratio: Any = 1.0,
        integral: Any = 0.1,
        reach: Any = None,
    ) -> "Tracking":
        """Error dynamics of chosen frequency w [rad/s] and damping ratio along each axis that thrusters can push.

        Args:
            model: The vehicle.
            bandwidth: w, shape (6,), or None: from the vehicle; in roll, pitch and yaw at least what keeps it straight
                at its top speed.
            damping_ratio: zeta, scalar or shape (6,).
            integral: Share of w that the moments' integral's rate is.
            reach: Largest position error that counts [m]: a filter that jumps must not throw the vehicle about. None:
                1.6 lengths of the vehicle, for which control asks for about all of its thrust.
        """
        scales = VehicleScales.of(model)
        requested = scales.bandwidth if bandwidth is None else np.asarray(bandwidth, dtype=float)
        w = np.maximum(requested, straight(model))
        rights = np.maximum(restoring_stiffness(model), 0.0) / np.diagonal(np.asarray(model.inertia))
        able = pushed_axes(model)
        zeta = np.broadcast_to(damping_ratio, 6)
        tilting = HeaveFeedback.of(model, None if bandwidth is None else float(requested[HEAVE]), float(zeta[HEAVE]))
        follows = able & ((np.arange(6) != HEAVE) | (tilting is None))
        inertia = np.diagonal(np.asarray(model.inertia))[3:]
        return cls(
            model=model,
            sustained=AchievableSpeed.of(model),
            K_p=follows * w**2,
            K_d=follows * 2.0 * zeta * np.sqrt(w**2 + rights),
            K_i=(able * np.asarray(integral) * w**3)[3:] * inertia,
            reach=1.6 * scales.length if reach is None else reach,
            limits=SharedThrust.of(model),
            allowance=LevelAllowance.of(model),
            tilting=tilting,
        )

    def init(self, key: PRNGKey, start: Start) -> TrackingMemory:
        return TrackingMemory(jnp.zeros(3), Allowance.none())

    def step(self, memory: TrackingMemory, input: ControlInput, dt: float) -> tuple[TrackingMemory, Wrench]:
        # An acceleration that nobody makes must not be counted on either: by the coupled mass it asks for a force.
        axes = input.axes
        left = replace(self, K_p=axes * self.K_p, K_d=axes * self.K_d, K_i=axes[3:] * self.K_i)
        return left._step(memory, input, dt)

    def _step(self, memory: TrackingMemory, input: ControlInput, dt: float) -> tuple[TrackingMemory, Wrench]:
        estimate, reference, model = input.estimate, input.reference, self.model
        R_nb = estimate.R_nb
        R_bn, tilt = R_nb.T, tilt_of(estimate.attitude)
        slow = estimate.slow_position
        nu = jnp.concatenate([estimate.slow_velocity(R_bn), estimate.nu[3:]])
        away = reference.position - slow
        # Level and depth apart: a filter that jumps sideways must not take the depth control away.
        level = jnp.minimum(1.0, self.reach / jnp.sqrt(jnp.maximum(away[:2] @ away[:2], 1e-12)))
        away = R_bn @ jnp.concatenate([away[:2] * level, jnp.clip(away[2:], -self.reach, self.reach)])
        turned = rotation_error(reference.attitude, estimate.attitude)
        e = jnp.concatenate([away, turned])
        R_nd = rotation_from_quaternion(reference.attitude)
        nu_ref = jnp.concatenate([R_bn @ reference.velocity, R_bn @ (R_nd @ reference.angular_velocity)])
        # Components in b of velocities that are the reference's turn with b.
        ahead = jnp.concatenate(
            [
                R_bn @ reference.acceleration - cross(nu[3:], nu_ref[:3]),
                R_bn @ (R_nd @ reference.angular_acceleration) - cross(nu[3:], nu_ref[3:]),
            ]
        )
        if self.tilting is not None:  # as if level: what the tilt makes of the speed is in the feedback's model
            nu_ref = nu_ref.at[HEAVE].set(reference.velocity[HEAVE])
            ahead = ahead.at[HEAVE].set(reference.acceleration[HEAVE])
        allowed = memory.level.factor if self.tilting is None else jnp.ones(())
        nu_ref, eased, asked = self._level(estimate, nu, nu_ref, e, allowed)
        level = self.allowance.step(memory.level, asked, tilt, dt)
        nu_dot = ahead + self.K_d * (nu_ref - nu + eased) + self.K_p * e
        disturbance = jnp.concatenate([R_bn @ estimate.bias[:3], estimate.bias[3:]])
        desired = (
            model.inertia @ nu_dot
            + self._flow(estimate, nu, nu_ref)
            + jnp.concatenate([restoring_wrench(model, R_nb[2])[:3], restoring_wrench(model, jnp.asarray(DOWN))[3:]])
            - disturbance
            + jnp.concatenate([jnp.zeros(3), memory.moments])
        )
        # What is learned of thrust depends on the answer: one round of putting it in is enough for some per cent.
        desired = desired - learned_wrench(model, self._through_water(estimate, nu, nu_ref), desired)
        if self.tilting is not None:
            current = jnp.concatenate([self.sustained.current(estimate), jnp.zeros(1)])
            nu_r = nu.at[:3].add(-R_bn @ current)
            deep = reference.position[HEAVE] - slow[HEAVE]
            desired = desired.at[HEAVE].add(
                self._depth_and_tilt(self.tilting, deep, nu_ref[HEAVE], nu_r, tilt, desired)
            )
        desired = jnp.where(self.limits.upper > self.limits.lower, input.axes * desired, 0.0)
        tau = self.limits.cut(desired)
        moments = integrated(memory.moments, self.K_i * turned * dt, (desired - tau)[3:], input.shortfall[3:])
        cut = jnp.abs(desired - tau) > ROUNDING * self.limits.largest
        return TrackingMemory(moments, level), Wrench(tau, cut)

    def _depth_and_tilt(
        self, feedback: HeaveFeedback, deep: Scalar, heave: Scalar, nu_r: Vector6, tilt: Vector2, wrench: Vector6
    ) -> Scalar:
        """Heave force [N] of a depth error and a desired heave velocity: see HeaveFeedback.force."""
        most = jnp.minimum(self.reach, feedback.depth_error(self.sustained.level.dive(nu_r[:2])))
        deep = jnp.clip(deep, -most, most)
        return feedback.force(deep, heave - nu_r[HEAVE], nu_r, tilt, wrench)

    def _level(
        self, estimate: Estimate, nu: Vector6, nu_ref: Vector6, e: Vector6, allowed: Scalar
    ) -> tuple[Vector6, Vector6, Scalar]:
        """The reference's velocity, and what comes to the one that the error asks for, so that the vehicle stays level.

        Their velocities through the water are reduced to what keeps it level; nothing changes where they do. So in a
        current that tips it over it drifts. Third, what is asked for as a share of the level speed.

        Args:
            estimate: Tells the current.
            nu: Slow velocity, b.
            nu_ref: Of the reference, b.
            e: Pose error, b.
            allowed: Factor on the level speed.
        """
        level = self.sustained.level
        flow = heading_rotation(estimate.heading).T @ self.sustained.current(estimate)
        down = level.dive(nu[:2] - flow)

        def change(velocity: Vector6) -> Vector6:
            w = velocity[:2] - flow
            heave = jnp.clip(velocity[2], -down, down) - velocity[2]
            return jnp.zeros(6).at[:2].set(level.nearest(w, allowed) - w).at[2].set(heave)

        kept, follows = nu_ref + change(nu_ref), self.K_d > 0.0
        pressed = jnp.where(follows, self.K_p / jnp.where(follows, self.K_d, 1.0), 0.0) * e
        # What cannot be asked for is carried along: no water flows past an axis without thrusters.
        asked = jnp.where(follows, nu_ref + pressed, nu)[:2]
        return kept, change(kept + pressed), level.share(asked - flow)

    def _flow(self, estimate: Estimate, nu: Vector6, nu_ref: Vector6) -> Vector6:
        """Coriolis wrench and drag: forces at the reference's velocity, as b takes the current's part.

        Of moments the filter estimates none: they are those of the velocity through the water, which along an axis
        without thrusters is what it is.
        """
        model = self.model
        forces = coriolis_wrench(model.inertia, nu_ref) + damping_wrench(model, nu_ref)
        moves = jnp.where(self.K_d > 0.0, nu_ref, nu)
        nu_r = self._through_water(estimate, nu, nu_ref)
        rigid = coriolis_wrench(model.rigid_body_mass, moves)
        moments = rigid + coriolis_wrench(model.added_mass, nu_r) + damping_wrench(model, nu_r)
        return jnp.concatenate([forces[:3], moments[3:]])

    def _through_water(self, estimate: Estimate, nu: Vector6, nu_ref: Vector6) -> Vector6:
        """Velocity through the water, b: the reference's along the axes that follow it."""
        moves = jnp.where(self.K_d > 0.0, nu_ref, nu)
        return moves.at[:2].add(-heading_rotation(estimate.heading).T @ self.sustained.current(estimate))
