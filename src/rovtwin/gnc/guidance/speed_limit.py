"""The speed that thrusters can keep up along a path, level, at a heading and against what disturbs the vehicle.

The disturbance is read as a current: along each horizontal axis of the body the vehicle goes through the water at the
speed w whose drag is that of its speed u over ground less the disturbance, and the current is u - w. Thrusters give a
speed through the water W whose drag is their force; over ground this is W and the current. If the disturbance is no
current the answer is inexact, but as the vehicle nears the speed in question w nears W, and there it is exact.
"""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import Estimate
from rovtwin.core.frames import heading_rotation
from rovtwin.core.numerics import Array, as_array, in_numpy, jnp, module_for, traced_once
from rovtwin.core.types import Flag, Scalar, Vector2, Vector6
from rovtwin.gnc.guidance.level_speed import LevelSpeed
from rovtwin.vehicle.physics.actuation import pushed_axes, wrench_limits
from rovtwin.vehicle.physics.dynamics import speed_of_drag
from rovtwin.vehicle.physics.model import Model

ALONG = 0.05  # shares of the speed below this are across the axis
FREE = 100.0  # through the water along an axis that is not to count [m/s]: finite, for gradients
DRAGLESS = 1e-3  # least linear damping, of which a speed is asked [N s/m]


def significant(estimate: Estimate) -> Estimate:
    """The estimate with the disturbance as far as it is known: F (1 - std^2 / F^2), nothing below one std.

    To a slender vehicle without sway a tenth of a newton is a current of 0.2 m/s. What the filter does not know of the
    force must not turn the bow to and fro (positive-part estimator: James and Stein 1961).
    """
    force2 = jnp.sum(estimate.bias[:2] ** 2) + 1e-12
    known = jnp.maximum(1.0 - estimate.bias_std**2 / force2, 0.0)
    return dataclasses.replace(estimate, bias=estimate.bias.at[:2].multiply(known))


class AchievableSpeed(eqx.Module):
    """Drag and thrust of surge and sway; rows are ahead and astern, columns the axes.

    Attributes:
        linear: Damping [N s/m].
        quadratic: Damping [N s2/m2].
        push: Acceleration by all of the thrust, to starboard and to port [m/s2]; FREE without thrusters.
        mass: That sway accelerates, added mass included [kg].
        most: Speed through the water that thrust keeps up and that keeps the vehicle level [m/s]; FREE along an axis
            without thrusters.
        level: What keeps it level, both axes together.
    """

    linear: Float[Array, "2 2"] = eqx.field(converter=as_array)
    quadratic: Float[Array, "2 2"] = eqx.field(converter=as_array)
    most: Float[Array, "2 2"] = eqx.field(converter=as_array)
    push: Vector2 = eqx.field(converter=as_array)
    mass: Scalar = eqx.field(converter=as_array)
    level: LevelSpeed

    @classmethod
    def of(cls, model: Model, share: float = 0.9) -> "AchievableSpeed":
        """For a model; what `share` leaves of the thrust is the feedback's, but for corners, which are soon over."""
        ahead = [model.linear_damping_ahead, model.quadratic_damping_ahead]
        astern = [model.linear_damping_astern, model.quadratic_damping_astern]
        linear, quadratic = (np.stack([_horizontal(a), _horizontal(b)]) for a, b in zip(ahead, astern, strict=True))
        linear = np.maximum(linear, DRAGLESS)
        lower, upper = (np.asarray(limit) for limit in wrench_limits(model.thrusters))
        force = np.stack([upper[:2], -lower[:2]])
        # An axis without thrusters is free: the water carries the vehicle. One that is pushed one way only is not.
        some = pushed_axes(model)[:2] & (force.max(axis=0) > 0.0)
        force = np.maximum(force, 0.0)
        level = LevelSpeed.of(model)
        kept_up = np.minimum(np.asarray(speed_of_drag(linear, quadratic, share * force)), np.asarray(level.axes))
        speed = np.where(some, kept_up, FREE)
        mass = _horizontal(model.inertia)[1]
        push = np.where(some, force / mass, FREE)[:, 1]
        return cls(linear, quadratic, speed, push, mass, level)

    @traced_once
    def current(self, estimate: Estimate) -> Vector2:
        """The current that would disturb the vehicle as much, n [m/s]."""
        to_n = heading_rotation(estimate.heading)
        nu = estimate.slow_velocity(to_n.T)
        drag = self._drag(nu) - to_n.T @ estimate.bias[:2]
        speed = speed_of_drag(self._sided(drag, self.linear), self._sided(drag, self.quadratic), jnp.abs(drag))
        return to_n @ (nu - jnp.sign(drag) * speed)

    @traced_once
    def through_water(self, estimate: Estimate) -> Vector6:
        """Velocity through that current, b [m/s, rad/s]; rolled or pitched, some of it is along heave."""
        R_nb = estimate.R_nb
        level = heading_rotation(estimate.heading).T @ (R_nb @ estimate.nu[:3])[:2]
        current = self.current(dataclasses.replace(estimate, nu=estimate.nu.at[:2].set(level)))
        return estimate.nu.at[:3].add(-R_nb.T @ jnp.append(current, 0.0))

    def along(self, direction: Scalar, heading: Scalar, current: Vector2) -> Scalar:
        """Largest speed over ground that both axes can keep up, level [m/s]: negative where one would be swept back.

        Args:
            direction: Of the motion over ground [rad].
            heading: Of the vehicle [rad].
            current: In n [m/s].
        """
        crab = direction - heading
        part, flow = jnp.stack([jnp.cos(crab), jnp.sin(crab)]), heading_rotation(heading).T @ current
        counts = jnp.abs(part) > ALONG
        most = self._sided(part, self.most) + jnp.sign(part) * flow
        pushed = jnp.min(jnp.where(counts, most / jnp.where(counts, jnp.abs(part), 1.0), FREE))
        return jnp.minimum(pushed, self.level.along(part, flow))

    def aside(self, heading: Scalar, side: Scalar, current: Vector2) -> Scalar:
        """Acceleration to a side, starboard positive, that is left beside holding against the current [m/s2]."""
        carried = self._drag(heading_rotation(heading).T @ current)[1] / self.mass
        return jnp.where(side >= 0.0, self.push[0] + carried, self.push[1] - carried)

    def aside_speed(self) -> Scalar:
        """Speed through the water that sway thrust keeps up, the slower side [m/s]; 0 without thrusters there."""
        most = in_numpy(self.most)
        xp = module_for(most)
        slower = xp.min(most[:, 1])
        return jnp.asarray(xp.where(slower < FREE, slower, 0.0))

    @traced_once
    def level_heading(self, preferred: Scalar, way: Vector2, current: Vector2, heading: Scalar) -> Scalar:
        """Heading nearest to a preferred one at which it keeps up a way over ground and stays level [rad].

        Args:
            preferred: Heading [rad].
            way: Velocity over ground, n [m/s].
            current: In n [m/s].
            heading: That it has [rad].
        """
        return self.level.heading(preferred, way, current, heading, self.aside_speed(), self.most[1, 0])

    def drag_aside(self, speed: float) -> Scalar:
        """Acceleration by the drag of a speed through the water sideways, the weaker side [m/s2]."""
        return jnp.min(self.linear[:, 1] * speed + self.quadratic[:, 1] * speed**2) / self.mass

    def made_good(self, direction: Scalar, current: Vector2) -> Scalar:
        """Largest speed over ground by surge alone, with the bow turned as far as a course takes [m/s].

        Args:
            direction: Of the course over ground [rad].
            current: In n [m/s].
        """
        flow, most = heading_rotation(direction).T @ current, self.most[0, 0]
        left = most**2 - flow[1] ** 2
        return jnp.where(left > 0.0, flow[0] + jnp.sqrt(jnp.maximum(left, 1e-12)), -jnp.abs(flow[1]))

    def course(self, v: Vector2, current: Vector2) -> tuple[Vector2, Flag]:
        """Velocity through the water that makes good a velocity over ground, as far as surge gives it, n.

        Where it does not, the course comes before the speed, and not to be swept off it before both.

        Args:
            v: Velocity over ground, n [m/s].
            current: In n [m/s].

        Returns:
            Velocity through the water, n [m/s], and whether the current is too much for that course.
        """
        w, most = v - current, self.most[0, 0]
        speed, size = jnp.sqrt(v @ v + 1e-12), jnp.sqrt(w @ w + 1e-12)
        # Who is to stay where he is has the course of what it takes to stay.
        along = jnp.where(speed > 1e-3 * most, v / speed, w / size)
        across = w - (w @ along) * along
        aside = jnp.sqrt(across @ across + 1e-12)
        left = jnp.sqrt(jnp.maximum(most**2 - aside**2, 1e-12))
        limited = across * jnp.minimum(1.0, most / aside) + jnp.clip(w @ along, -left, left) * along
        made = limited + current
        swept = (size > most) & ((made @ along <= 0.0) | (aside > most))
        return jnp.where(size > most, limited, w), swept

    def _drag(self, nu_r: Vector2) -> Vector2:
        return self._sided(nu_r, self.linear) * nu_r + self._sided(nu_r, self.quadratic) * nu_r * jnp.abs(nu_r)

    def _sided(self, sign: Vector2, of: Float[Array, "2 2"]) -> Vector2:
        return jnp.where(sign >= 0.0, of[0], of[1])


def _horizontal(damping: Any) -> Float[np.ndarray, "2"]:
    return np.diagonal(np.asarray(damping))[:2]
