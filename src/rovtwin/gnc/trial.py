"""Trial: identification tests flown open loop, a time-line of thruster commands beside simple holding.

It reads sensors directly, as the thesis's scripts did (3.4.3): depth and heading are held by the PIDs of table 3.2, the
excited axes are told shares a of the full command in [-1, 1]. It knows the vehicle's geometry and no force at all,
because the thrust curve is among what the test should find.
"""

from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    ABORTED,
    FINISHED,
    PAUSED,
    AutopilotInput,
    AutopilotOutput,
    Command,
    Estimate,
    Measurements,
    Reference,
    Setpoint,
    Wrench,
)
from rovtwin.core.frames import euler_from_quaternion, rotation_from_euler, wrap
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.gnc.allocation import weighted_pseudo_inverse
from rovtwin.gnc.rules import Watched
from rovtwin.gnc.supervisor import MODE_ABORTED, MODE_PAUSED, Supervisor, SupervisorMemory
from rovtwin.vehicle.model import Model
from rovtwin.vehicle.reach import RANK_TOLERANCE

# Gains in shares of the full command per metre and radian. Depth, heading: thesis table 3.2 over its limits, 22 N and
# 5.5 N m. North and east, for the way home: 0.36 rad/s on the Double Blueye.
K_P = np.array([0.4, 0.4, 30.0 / 22.0, 0.0, 0.0, 1.2 / 5.5])
K_I = 0.1 / 5.5  # of the heading alone
K_D = np.array([1.0, 1.0, 1.0 / 22.0, 0.0, 0.0, 5.0 / 5.5])
LIMIT = np.array([0.5, 0.5, 1.0, 0.0, 0.0, 1.0])
STATION = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0])  # what is held while paused
STALE = 3.0  # without a position: its last speed leads astray, nothing is held by it until the next one [s]
LEVEL = np.array([True, True, False])  # what a position tells


class Believed(eqx.Module):
    """What the readings say: position and its rate in n, shapes (3,), Euler angles and body rates, shapes (3,).

    `quiet` is the time since a position was heard [s].
    """

    position: Array
    velocity: Array
    euler: Array
    rates: Array
    quiet: Array

    @property
    def lost(self) -> Array:
        """Which axes of n nothing is known of any more, shape (3,), bool."""
        return jnp.asarray(LEVEL) & (self.quiet > STALE)


class TrialMemory(eqx.Module):
    """Readings, supervisor's mode, pose to hold and come home to (6,), integral of the heading [share], tick, int."""

    believed: Believed
    supervisor: SupervisorMemory
    home: Array
    integral: Array
    tick: Array


class Timeline(eqx.Module):
    """A test, tick by tick; rows beyond the last manoeuvre are padding.

    Attributes:
        share: Command asked for on each axis, shape (ticks, 6).
        row: Which row of the following holds, shape (ticks,), int.
        hold: Whether an axis is held by its PID, shape (rows, 6): surge and sway on the way home, heave, yaw.
        keep: Weak spring on each axis [share per m, rad], shape (rows, 6).
        on: Whether thrusters may run, shape (rows,), bool.
        manoeuvre: Number of the manoeuvre, shape (rows,), int.
        phase: One of core.flow.PHASES, shape (rows,), int.
        count: Ticks of the test, int.
    """

    share: Array
    row: Array
    hold: Array
    keep: Array
    on: Array
    manoeuvre: Array
    phase: Array
    count: Array


class Trial(Block):
    """Flies a time-line; takes and gives what an autopilot does. Its estimate is the readings, hardly filtered.

    Attributes:
        mixing: Thruster commands of a full command on each axis, shape (n, 6); zero where thrusters cannot push.
        timeline: The test.
        supervisor: Depth and attitude limits.
        smoothing: Share of a position's surprise that is believed.
        tracking: Rate at which its speed is corrected [1/s].
    """

    mixing: Array
    timeline: Timeline
    supervisor: Supervisor
    smoothing: Array = eqx.field(converter=as_array, default=0.25)
    tracking: Array = eqx.field(converter=as_array, default=0.5)

    @classmethod
    def of(cls, model: Model, timeline: Timeline, supervisor: Supervisor | None = None) -> "Trial":
        """A trial of a vehicle, of which only the places and directions of thrusters are used."""
        return cls(as_array(mixing(model.thrusters.configuration)), timeline, supervisor or Supervisor())

    def init(self, key: Array, start: Start) -> TrialMemory:
        euler = euler_from_quaternion(start.attitude)
        believed = Believed(start.position, jnp.zeros(3), euler, start.velocity[3:], jnp.zeros(()))
        home = jnp.concatenate([start.position, jnp.zeros(2), euler[2:]])
        return TrialMemory(believed, self.supervisor.init(key, start), home, jnp.zeros(()), jnp.zeros((), dtype=int))

    def step(self, memory: TrialMemory, input: AutopilotInput, dt: float) -> tuple[TrialMemory, AutopilotOutput]:
        believed = self._listen(memory.believed, input.measurements, dt)
        estimate = _estimate(believed, len(input.measurements))
        supervisor, mode = self.supervisor.step(
            memory.supervisor, Watched(estimate, input.request, input.measurements, input.host), dt
        )
        line, over, paused = self.timeline, memory.tick >= self.timeline.count, mode.mode == MODE_PAUSED
        now = jnp.minimum(memory.tick, line.count - 1)
        row = line.row[now]

        hold = jnp.where(paused, STATION, line.hold[row])
        away, speed = _away(memory.home, believed)
        integral, held = _pid(memory.integral, hold, away, speed, dt)
        share = held + jnp.where(paused, 0.0, line.share[now] + line.keep[row] * away)
        active = mode.active & ~over & (paused | line.on[row])
        # A reading that is not a number must not reach the thrusters: `where` drops it, a product would not.
        command = jnp.where(active, jnp.clip(self.mixing @ jnp.where(active, share, 0.0), -1.0, 1.0), 0.0)

        phase = jnp.where(over, FINISHED, jnp.where(paused, PAUSED, line.phase[row]))
        phase = jnp.where(mode.mode == MODE_ABORTED, ABORTED, phase)
        still, place = jnp.zeros(6), memory.home[:3]
        setpoint = Setpoint(memory.home, still, place, place, phase < 0, line.manoeuvre[row], phase, mode.reason)
        after = TrialMemory(believed, supervisor, memory.home, integral, memory.tick + jnp.where(paused | over, 0, 1))
        path, wrench = Reference(memory.home, still, still), Wrench(still, still > 0.0)
        return after, AutopilotOutput(Command(command), estimate, setpoint, path, wrench, jnp.ones(command.shape))

    def _listen(self, before: Believed, measurements: Measurements, dt: float) -> Believed:
        """The newest readings; positions and depths through an alpha-beta filter, which gives their rates."""

        def newest(name: str, old: Array) -> Array:
            slot = measurements[name]
            for row in range(slot.valid.shape[0]):
                old = jnp.where(slot.valid[row], slot.value[row], old)
            return old

        ahead = before.position + dt * before.velocity
        seen = jnp.concatenate([newest("position", ahead[:2]), newest("pressure", ahead[2:])])
        surprise = seen - ahead
        quiet = jnp.where(jnp.any(measurements["position"].valid), 0.0, before.quiet + dt)
        return Believed(
            # The first position after a silence is believed as it is: what was expected is worth nothing.
            ahead + jnp.where(before.lost, 1.0, self.smoothing) * surprise,
            jnp.where(LEVEL & (quiet > STALE) | before.lost, 0.0, before.velocity + self.tracking * surprise),
            newest("attitude", before.euler),
            newest("gyro", before.rates),
            quiet,
        )


def mixing(configuration: Any) -> np.ndarray:
    """Thruster commands that are a full command on each axis, shape (n, 6): pseudo-inverse, largest command 1.

    Thesis 7.1 in command space: all thrusters are taken to be alike. An axis that thrusters cannot push is zero.

    Args:
        configuration: T, shape (6, n).
    """
    T = np.asarray(configuration, dtype=float)
    pattern = weighted_pseudo_inverse(T)
    able = np.abs(np.diagonal(T @ pattern)) > RANK_TOLERANCE
    largest = np.abs(pattern).max(axis=0, initial=0.0)
    return np.where(able, pattern / np.where(able, largest, 1.0), 0.0)


def _away(home: Array, believed: Believed) -> tuple[Array, Array]:
    """Way home along level axes that turn with the heading, and the speed along them, shapes (6,)."""
    level = rotation_from_euler(believed.euler * jnp.asarray([0.0, 0.0, 1.0])).T
    turn = wrap(home[5:] - believed.euler[2:])
    tilt = jnp.zeros(2)
    # Where nobody knows the place, it is taken to be home: no thruster looks for it blindly.
    way = jnp.where(believed.lost, 0.0, home[:3] - believed.position)
    away = jnp.concatenate([level @ way, tilt, turn])
    return away, jnp.concatenate([level @ believed.velocity, tilt, believed.rates[2:]])


def _pid(integral: Array, hold: Array, away: Array, speed: Array, dt: float) -> tuple[Array, Array]:
    """The heading's new integral, which rests at the limit, and the shares of what is held, shape (6,)."""
    grown = integral + K_I * away[5] * dt
    wanted = K_P * away - K_D * speed + jnp.zeros(6).at[5].set(grown)
    winding = jnp.abs(wanted[5]) > LIMIT[5]
    integral = jnp.where((hold[5] > 0) & ~winding, grown, integral)
    return integral, hold * jnp.clip(wanted, -LIMIT, LIMIT)


def _estimate(believed: Believed, sensors: int) -> Estimate:
    """The readings as an estimate that claims nothing about its error."""
    R_nb = rotation_from_euler(believed.euler)
    eta = jnp.concatenate([believed.position, believed.euler])
    nu = jnp.concatenate([R_nb.T @ believed.velocity, believed.rates])
    return Estimate(eta, nu, jnp.zeros(6), jnp.zeros((12, 12)), jnp.zeros(sensors), jnp.zeros(sensors))
