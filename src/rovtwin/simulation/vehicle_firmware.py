"""Onboard: the simple controller that a vehicle brings along, behind sticks and hold buttons.

It stands for a vendor's firmware in a served twin: a share of force along each axis, or, where something is held, a
rate at which what is held moves. Holds are PID in shares of the inertia along each axis,

    tau = I (w^2 e + 2 w (nu_ref - nu)) + integral

and forces come from the pseudo-inverse of the thrusters, all scaled back alike where one would pass its limit. What our
own autopilot does with a model is in `gnc.control` and `gnc.allocation`; this is what it replaces.
"""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.arrays.filters import alpha_beta, integrated
from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command, Measurements
from rovtwin.core.frames import heading_rotation, wrap
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Flag, PRNGKey, Scalar, Vector2, Vector3, Vector6
from rovtwin.vehicle.physics.actuation import BY_PRODUCT, reachable_share
from rovtwin.vehicle.physics.thrusters import Thrusters, command_for_force, force_limits

FREQUENCY = (0.6, 0.6, 0.8, 1.5, 1.5, 1.0)  # of holds [rad/s], where thrusters are quick enough
LAGGED = 0.3  # largest product of it and the thrusters' lag [rad]: beyond, a hold begins to swing
RATE = (0.5, 0.5, 0.3, 0.0, 0.0, 0.6)  # at which a full stick moves what is held [m/s, rad/s]
REACH = (0.5, 0.5, 0.5, 0.5, 0.5, 0.5)  # what is held stays as close to the vehicle while a stick moves it [m, rad]
INTEGRAL = 0.1  # share of the frequency
ALPHA, BETA = 0.2, 0.02  # of the tracker of depth: quick against a hold, slow against a millimetre of noise
SILENT = 0.5  # a sensor is not used any longer after this [s]
DEAD = 0.02  # a stick within this is let go
_LEVEL = (jnp.arange(6) == 3) | (jnp.arange(6) == 4)


class Order(eqx.Module):
    """The command of one drone; fields as of `links.servers.pilot_command.PilotCommand`.

    Attributes:
        armed: Bool.
        motion: Shares of what sticks can ask for.
        holds: Depth, heading, level, position.
        target: x, y, z [m] in n and heading [rad].
        aimed: Whether there is a target.
    """

    armed: Flag
    motion: Vector6
    holds: Bool[Array, "4"]
    target: Float[Array, "4"]
    aimed: Flag

    @classmethod
    def none(cls) -> "Order":
        no = jnp.asarray(False)
        return cls(no, jnp.zeros(6), jnp.zeros(4, dtype=bool), jnp.zeros(4), no)


class OnboardInput(eqx.Module):
    """The order, and where the vehicle's filter puts it.

    Attributes:
        order: The command.
        eta, nu: Pose and velocity.
        known: Which axes of them are known; others give nothing while they shall be held.
    """

    order: Order
    eta: Vector6
    nu: Vector6
    known: Bool[Array, "6"]


class OnboardMemory(eqx.Module):
    """Pose that is held, n; which of it; integral [N, N m]; target."""

    held: Vector6
    on: Bool[Array, "6"]
    integral: Vector6
    aimed: Flag


class OnboardOutput(eqx.Module):
    """Commands of its thrusters, and the wrench that they shall give, b at the drone's origin [N, N m]."""

    command: Command
    tau: Vector6


class Onboard(Block):
    """A vehicle's own controller.

    Attributes:
        thrusters: Its own, seen from its own origin.
        inverse: Pseudo-inverse of their configuration.
        largest: Wrench along each axis alone that they can give, b [N, N m].
        inertia: That a hold counts with [kg, kg m2]; zero along axes that thrusters do not reach.
        frequency: Of holds [rad/s].
    """

    thrusters: Thrusters
    inverse: Float[Array, "n 6"] = eqx.field(converter=as_array)
    largest: Vector6 = eqx.field(converter=as_array)
    inertia: Vector6 = eqx.field(converter=as_array)
    frequency: Vector6 = eqx.field(converter=as_array)

    @classmethod
    def of(cls, thrusters: Thrusters, inertia: Any) -> "Onboard":
        """For thrusters seen from the drone's origin, and the inertia along each axis that they move."""
        configuration = np.asarray(thrusters.configuration)
        able = reachable_share(configuration) > BY_PRODUCT
        inverse = np.linalg.pinv(configuration, rcond=1e-9) * able
        low, high = (np.asarray(limit) for limit in force_limits(thrusters))
        most = np.minimum(-low, high)[:, None] / np.maximum(np.abs(inverse), 1e-12)
        lag = float(np.max(np.asarray(thrusters.time_constant), initial=0.0))
        frequency = np.minimum(FREQUENCY, LAGGED / lag if lag > 0.0 else np.inf)
        return cls(thrusters, inverse, np.where(able, most.min(axis=0), 0.0), np.asarray(inertia) * able, frequency)

    def init(self, key: PRNGKey, start: Start) -> OnboardMemory:
        return OnboardMemory(jnp.zeros(6), jnp.zeros(6, dtype=bool), jnp.zeros(6), jnp.asarray(False))

    def step(self, memory: OnboardMemory, input: OnboardInput, dt: float) -> tuple[OnboardMemory, OnboardOutput]:
        order, eta = input.order, input.eta
        stick = jnp.where(jnp.abs(order.motion) > DEAD, order.motion, 0.0)
        commanded = _axes(order)
        on = commanded & input.known
        rate = stick * as_array(RATE) * on
        held = self._held(memory, order, eta, on, rate, dt)
        away = _turned(held - eta, heading_rotation(eta[5]).T)
        away = jnp.clip(away, -as_array(REACH), as_array(REACH))
        w = self.frequency
        desired = self.inertia * (w**2 * away + 2.0 * w * (rate - input.nu)) + memory.integral
        pushed = jnp.where(commanded, 0.0, stick * self.largest)
        given = jnp.clip(desired, -self.largest, self.largest)
        tau = jnp.where(on, given, pushed)
        growth = jnp.where(on, self.inertia * INTEGRAL * w**3 * away * dt, 0.0)
        integral = integrated(memory.integral, growth, desired - given)
        command, tau = self._allocated(jnp.where(order.armed, tau, 0.0))
        live = order.armed & on
        return OnboardMemory(held, live, jnp.where(live, integral, 0.0), order.aimed), OnboardOutput(command, tau)

    def _held(
        self, memory: OnboardMemory, order: Order, eta: Vector6, on: Bool[Array, "6"], rate: Vector6, dt: float
    ) -> Vector6:
        """Pose to hold: that of when the hold came on, moved by sticks, or the target."""
        moved = memory.held + _turned(rate, heading_rotation(eta[5])) * dt
        # While a stick moves what is held it does not run ahead of a vehicle that cannot follow.
        offset = _shortest(moved - eta)
        near = eta + jnp.clip(offset, -as_array(REACH), as_array(REACH))
        aside = jnp.any(rate[:2] != 0.0)  # sticks are ahead and to starboard, what is held is north and east
        moving = jnp.concatenate([jnp.stack([aside, aside]), rate[2:] != 0.0])
        # A target that is withdrawn is no place to go to any more: the vehicle holds where it is.
        kept = memory.on & ~(memory.aimed & ~order.aimed)
        held = jnp.where(kept, jnp.where(moving, near, moved), eta)
        held = jnp.where(_LEVEL, 0.0, held)
        goal = jnp.stack([*order.target[:3], jnp.zeros(()), jnp.zeros(()), order.target[3]])
        held = jnp.where(order.aimed, goal, held)
        return eta + _shortest(held - eta)

    def _allocated(self, tau: Vector6) -> tuple[Command, Vector6]:
        """Commands for a wrench, and what of it they give: all is scaled back alike."""
        force = self.inverse @ tau
        low, high = force_limits(self.thrusters)
        limit = jnp.maximum(jnp.minimum(-low, high), 1e-9)
        force = force / jnp.maximum(1.0, jnp.max(jnp.abs(force) / limit))
        return Command(command_for_force(self.thrusters, force)), self.thrusters.configuration @ force


def _axes(order: Order) -> Bool[Array, "6"]:
    """Which axes are held."""
    depth, heading, level, place = (order.holds[i] | (order.aimed & (i != 2)) for i in range(4))
    return jnp.stack([place, place, depth, level, level, heading])


def _turned(vector: Vector6, to: Float[Array, "2 2"]) -> Vector6:
    """The level part of a six-vector turned by a matrix (2, 2), the rest as it is."""
    return jnp.concatenate([to @ vector[:2], vector[2:]])


def _shortest(difference: Vector6) -> Vector6:
    """Angles of a difference of poses the short way round."""
    return jnp.concatenate([difference[:3], wrap(difference[3:])])


class SenseMemory(eqx.Module):
    """Depth and its rate; attitude and rates as last read; silence of each sensor [s]."""

    depth: Vector2
    turning: Vector6
    silence: Vector3


class Sensed(eqx.Module):
    """What a drone knows of itself: eta, nu, and which axes of them."""

    eta: Vector6
    nu: Vector6
    known: Bool[Array, "6"]


class Sense(Block):
    """What a drone without a position knows: depth, attitude and their rates; the rest is zero and not known.

    `step(memory, readings, dt) -> (memory, Sensed)`; depth and its rate by an alpha-beta tracker. An axis whose sensor
    has been silent for SILENT is not known any more: extrapolating it would drive the vehicle after a fiction.

    Attributes:
        names: Of its pressure sensor, compass and gyro among the readings.
        rate: Of the pressure sensor [Hz].
    """

    names: tuple[str, str, str] = eqx.field(static=True)
    rate: Scalar = eqx.field(converter=as_array)

    def init(self, key: PRNGKey, start: Start) -> SenseMemory:
        return SenseMemory(jnp.zeros(2), jnp.zeros(6), jnp.full(3, 2 * SILENT))

    def step(self, memory: SenseMemory, input: Measurements, dt: float) -> tuple[SenseMemory, Sensed]:
        pressure, attitude, gyro = (input[name] for name in self.names)
        received = jnp.stack([jnp.any(slot.valid) for slot in (pressure, attitude, gyro)])
        silence = jnp.where(received, 0.0, memory.silence + dt)
        depth, known = memory.depth, memory.silence[0] < SILENT
        depth = jnp.stack([depth[0] + jnp.where(known, depth[1] * dt, 0.0), depth[1]])
        for row in range(pressure.valid.shape[0]):
            depth = jnp.where(pressure.valid[row], self._tracked(depth, pressure.value[row, 0], known), depth)
            known = known | pressure.valid[row]
        angles, rates = attitude.newest(memory.turning[:3]), gyro.newest(memory.turning[3:])
        no, turns = jnp.asarray(False), jnp.all(silence[1:] < SILENT)
        eta = jnp.concatenate([jnp.zeros(2), depth[:1], angles])
        nu = jnp.concatenate([jnp.zeros(2), depth[1:], rates])
        sensed = Sensed(eta, nu, jnp.stack([no, no, silence[0] < SILENT, turns, turns, turns]))
        return SenseMemory(depth, jnp.concatenate([angles, rates]), silence), sensed

    def _tracked(self, depth: Vector2, read: Scalar, known: Flag) -> Vector2:
        """Depth and rate after a reading; the first one after a silence is accepted as it is."""
        better = alpha_beta(depth[0], depth[1], read - depth[0], ALPHA, BETA * self.rate)
        return jnp.where(known, jnp.stack(better), jnp.stack([read, jnp.zeros(())]))
