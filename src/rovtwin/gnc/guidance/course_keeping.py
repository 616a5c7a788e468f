"""Course keeping: what a vehicle that cannot push sideways, or hardly, does to follow a set-point in a current.

    v = v_point + pull(point - place),     w = v - current,     heading = atan2(w),     surge = w . (cos psi, sin psi)

The velocity over ground v brings the vehicle to the point and on with it. What it takes through the water is w: the
vehicle turns its bow along w and pushes as far as it already points there. So along a path this is line of sight, with
a crab angle from the estimated current and not from the error that it makes; at rest, where w is the current turned
round, the bow points into the current and surge alone holds the place; and a place that was missed is turned back to.
The along-path speed never starves the steering, since the current's part of w is always pushed against.

Where a heading was asked for, it is kept as long as what thrusters push sideways covers w's part there.

Reference: Fossen (2021), sec. 12.4 (line of sight, crab angle), 12.6 (path following with the course); Fossen and
Strand (2001), Nonlinear passive weather optimal positioning control, Automatica 37 (heading into the weather).
"""

import dataclasses
from typing import Any

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    ABORTED,
    DIVE,
    FINISHED,
    GO,
    HEADING_GIVEN_UP,
    HOLD,
    IDLE,
    PILOTED,
    SWEPT,
    Estimate,
    Setpoint,
)
from rovtwin.core.frames import heading_of, heading_rotation, level_attitude, wrap
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.core.types import Flag, PRNGKey, Scalar, Vector2
from rovtwin.gnc.guidance.speed_limit import AchievableSpeed, significant
from rovtwin.gnc.scales import YAW, VehicleScales
from rovtwin.vehicle.physics.model import Model

APPROACH = 5.0  # heading follows so many times as fast as the pull grows: bow first, then way
LEAD = 1.0  # of the bow over the velocity through the water that is still missing
SETTLED = 0.4  # share of the slack within which the bow is left alone again
BACK = 0.7  # share of the sway thrust that has to do before a heading that was given up is taken again
STEERS = 0.3  # share of cruise below which a bow does not steer
NO_SPEED = 1e-3  # share of cruise that is no motion at all


class CourseInput(eqx.Module):
    """The set-point as guidance, or a fail-safe, asks for it, and the estimate."""

    setpoint: Setpoint
    estimate: Estimate


class CourseMemory(eqx.Module):
    """What is remembered.

    Attributes:
        current: Smoothed, n [m/s].
        surge: Speed through the water that is asked for [m/s].
        heading: That is asked for [rad].
        turns: Whether the bow follows w; else the heading that was asked for, or the last one.
        takes: Whether the last set-point was followed so.
    """

    current: Vector2
    surge: Scalar
    heading: Scalar
    turns: Flag
    takes: Flag


class CourseKeeping(Block):
    """Gives the set-point as heading and surge, beside what the thrusters can push sideways.

    Attributes:
        sustained: Speeds through the water, and the current.
        gain: Of the pull [1/s].
        cruise: Largest pull [m/s].
        acceleration: Along the bow; half of it is planned with for coming to rest [m/s2].
        lag: Of the surge behind the desired one, and of the smoothed current [s].
        slack: How far off a place to be kept the vehicle may drift before it turns towards it [m]; what the filter does
            not know of the place, one standard deviation, comes to it.
        aside: Speed through the water that sway thrust keeps up [m/s]; 0 without.
    """

    sustained: AchievableSpeed
    gain: Scalar = eqx.field(converter=as_array)
    cruise: Scalar = eqx.field(converter=as_array)
    acceleration: Scalar = eqx.field(converter=as_array)
    lag: Scalar = eqx.field(converter=as_array)
    slack: Scalar = eqx.field(converter=as_array)
    aside: Scalar = eqx.field(converter=as_array)

    @classmethod
    def of(cls, model: Model, look_ahead: float | None = None) -> "CourseKeeping":
        """For a vehicle; the look-ahead is how far from a point it goes there at cruising speed [m]; None: from it."""
        scales, sustained = VehicleScales.of(model), AchievableSpeed.of(model)
        cruise = scales.surge_speed
        gain = float(scales.bandwidth[YAW]) / APPROACH if look_ahead is None else cruise / look_ahead
        return cls(
            sustained=sustained,
            gain=gain,
            cruise=cruise,
            acceleration=0.25 * scales.acceleration[0],
            lag=0.3 / scales.level_bandwidth,
            slack=scales.length,
            aside=sustained.aside_speed(),
        )

    def init(self, key: PRNGKey, start: Start) -> CourseMemory:
        no = jnp.asarray(False)
        return CourseMemory(jnp.zeros(2), jnp.zeros(()), heading_of(start.attitude), no, no)

    def step(self, memory: CourseMemory, input: CourseInput, dt: float) -> tuple[CourseMemory, Setpoint]:
        asked, estimate = input.setpoint, input.estimate
        phase, psi = asked.phase, estimate.heading
        takes = (phase != IDLE) & (phase != ABORTED) & (phase != PILOTED)
        memory = self._begun(memory, asked, estimate)
        to_n = heading_rotation(psi)
        bow, side = to_n[:, 0], to_n[:, 1]
        away = asked.position[:2] - estimate.slow_position[:2]

        estimated = self.sustained.current(significant(estimate))
        current = memory.current + jnp.minimum(dt / self.lag, 1.0) * (estimated - memory.current)
        along = heading_rotation(asked.heading) @ asked.nu[:2]
        v = along + self._pull(away)
        w, swept = self.sustained.course(v, current)
        w = self._steerable(w, along, bow)
        # Skidding, it points where the thrust brings its way through the water to w, and not yet along w.
        made = estimate.slow_velocity_n(to_n) - current
        aim = w + LEAD * (w - made)
        turns, given_up = self._turns(memory, asked, estimate, w, aim)
        heading = jnp.where(turns, jnp.arctan2(aim[1], jnp.where(turns, aim[0], 1.0)), memory.heading)
        heading = jnp.where(asked.fixed_heading & ~turns, asked.heading, heading)

        change = jnp.clip((w @ bow - memory.surge) / self.lag, -2.0 * self.acceleration, self.acceleration) * dt
        surge = memory.surge + change
        # Sideways the water carries the vehicle but for what its thrusters push.
        drift = current @ side
        over_ground = (surge + current @ bow) * bow + jnp.clip(v @ side, drift - self.aside, drift + self.aside) * side
        beside = jnp.where(self.aside > 0.0, away @ side, 0.0) * side
        position = asked.position.at[:2].set(estimate.slow_position[:2] + beside)
        nu = asked.nu.at[:2].set(heading_rotation(heading).T @ over_ground)

        state = jnp.where(given_up, HEADING_GIVEN_UP, asked.progress.state)
        progress = dataclasses.replace(asked.progress, state=jnp.where(swept, SWEPT, state), current=current)
        own = dataclasses.replace(asked, position=position, attitude=level_attitude(heading), nu=nu, progress=progress)
        after = CourseMemory(current, surge, wrap(heading), turns, takes)
        return after, _either(takes, own, asked)

    def _begun(self, memory: CourseMemory, asked: Setpoint, estimate: Estimate) -> CourseMemory:
        """Taken over from others the vehicle goes on as it moves."""
        current = self.sustained.current(significant(estimate))
        to_b = heading_rotation(estimate.heading).T
        nu = estimate.slow_velocity(to_b)
        surge = nu[0] - (to_b @ current)[0]
        begun = CourseMemory(current, surge, estimate.heading, jnp.asarray(False), memory.takes)
        return _either(memory.takes, memory, begun)

    def _pull(self, away: Vector2) -> Vector2:
        """Velocity towards the point [m/s]: in proportion, but so that it can be stopped there."""
        distance = jnp.sqrt(away @ away + 1e-12)
        speed = jnp.minimum(self.gain * distance, jnp.sqrt(self.acceleration * distance))
        return away / distance * jnp.minimum(speed, self.cruise)

    def _steerable(self, w: Vector2, along: Vector2, bow: Vector2) -> Vector2:
        """w, with as much way along a path that is under way as lets the bow steer, ahead or astern.

        A current that carries the vehicle as fast as it is to go would leave it without.
        """
        speed, least = jnp.sqrt(along @ along + 1e-12), STEERS * self.cruise
        course = along / speed
        own = w @ course
        slow = (speed > least) & (jnp.abs(own) < least)
        return w + jnp.where(slow, jnp.where(bow @ course >= 0.0, least, -least) - own, 0.0) * course

    def _turns(
        self, memory: CourseMemory, asked: Setpoint, estimate: Estimate, w: Vector2, aim: Vector2
    ) -> tuple[Flag, Flag]:
        """Whether the bow has to follow the aim, and whether a heading that was asked for is given up for it."""
        unknown = jnp.sqrt(0.5 * (estimate.covariance[0, 0] + estimate.covariance[1, 1]))
        least = self.gain * (self.slack + unknown) * jnp.where(memory.turns, SETTLED, 1.0)
        least = jnp.where(asked.phase == GO, NO_SPEED * self.cruise, least)  # on its way it goes for the point itself
        covered = self.aside * jnp.where(memory.turns, BACK, 1.0)  # else it would turn to and fro at the limit
        sideways = jnp.abs((heading_rotation(asked.heading).T @ w)[1]) - covered
        given_up = asked.fixed_heading & (sideways > least)
        turns = jnp.where(asked.fixed_heading, given_up, jnp.sqrt(aim @ aim + 1e-12) > least)
        held = (asked.phase == HOLD) | (asked.phase == FINISHED) | (asked.phase == DIVE)
        return turns, given_up & held


def _either(which: Flag, one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(which, a, b), one, other)
