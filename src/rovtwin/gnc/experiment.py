"""Experiment: identification tests flown open loop, a time-line of thruster commands beside simple holding.

It reads sensors directly, as the thesis's scripts did (3.4.3): depth and heading are held by PIDs, the excited axes are
sent shares a of the full command in [-1, 1]. What pulls depends on the vehicle's geometry alone, because the thrust
curve is among what the test should find; only the gains of holding are placed from the vehicle as it is assumed to be.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.arrays.filters import alpha_beta, integrated
from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    ABORTED,
    FINISHED,
    NO_REASON,
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
from rovtwin.core.frames import (
    heading_of,
    level_attitude,
    quaternion_from_euler,
    rotation_from_quaternion,
    wrap,
    yaw_rotation,
)
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Index, PRNGKey, Quaternion, Scalar, Vector3, Vector6
from rovtwin.gnc.interfaces import MODE_ABORTED, MODE_PAUSED
from rovtwin.gnc.mounting import Mount, at_co
from rovtwin.gnc.safety.rules import SupervisorInput
from rovtwin.gnc.safety.supervisor import Supervisor, SupervisorMemory
from rovtwin.gnc.scales import VehicleScales
from rovtwin.gnc.thesis.allocation import weighted_pseudo_inverse
from rovtwin.vehicle.physics.actuation import pushed_axes
from rovtwin.vehicle.physics.model import Model

# Of the bandwidth that the vehicle could have: before a test its forces are known badly.
SHARE = np.array([0.7, 0.7, 0.7, 0.0, 0.0, 0.5])
DAMPING = np.array([0.7, 0.7, 0.7, 0.0, 0.0, 1.0])  # of what is placed, over critical
INTEGRAL = 0.15  # of the heading alone, over bandwidth and stiffness
LIMIT = np.array([0.5, 0.5, 1.0, 0.0, 0.0, 1.0])
SPRING = 0.8  # of the weak spring on excited axes, over what brings the vehicle home
STATION = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0])  # what is held while paused
STALE = 3.0  # without a position: its last speed leads astray, nothing is held by it until the next one [s]
LEVEL = np.array([True, True, False])  # what a position tells


class RawEstimate(eqx.Module):
    """What the readings say: position and its rate in n, attitude, and body rates.

    `quiet` is the time since a position was received [s].
    """

    position: Vector3
    velocity: Vector3
    attitude: Quaternion
    rates: Vector3
    quiet: Scalar

    @property
    def heading(self) -> Scalar:
        """See `frames.heading_of` [rad]."""
        return heading_of(self.attitude)

    @property
    def lost(self) -> Bool[Array, "3"]:
        """Which axes of n nothing is known of any more."""
        return jnp.asarray(LEVEL) & (self.quiet > STALE)


class HoldingGains(eqx.Module):
    """PIDs in shares of the full command, surge to yaw; zero where thrusters cannot push alone.

    Attributes:
        stiffness: Per metre and radian.
        damping: Per metre and radian a second.
        integral: Per radian and second, of the heading.
        reach: Distance within which a vehicle without sway no longer turns its bow or stern towards home [m]; infinite
            for one that pushes sideways.
    """

    stiffness: Vector6 = eqx.field(converter=as_array)
    damping: Vector6 = eqx.field(converter=as_array)
    integral: Scalar = eqx.field(converter=as_array)
    reach: Scalar = eqx.field(converter=as_array)

    @classmethod
    def of(cls, model: Model) -> "HoldingGains":
        """Poles at a share of the vehicle's bandwidth: K_p = w^2 M_ii / F_i, K_d = (2 zeta w M_ii - D_ii) / F_i."""
        scales = VehicleScales.of(model)
        able = np.abs(mixing(model)).max(axis=0, initial=0.0) > 0
        able &= (scales.force > 0.0) & (SHARE > 0.0)
        inertia = np.diagonal(np.asarray(model.inertia))
        over_force = np.where(able, 1.0 / np.where(able, scales.force, 1.0), 0.0)
        w = SHARE * scales.bandwidth
        drag = np.diagonal(np.asarray(model.linear_damping_ahead))
        stiffness = w**2 * inertia * over_force
        damping = np.maximum(2.0 * DAMPING * w * inertia - drag, 0.0) * over_force
        steers = able[0] and able[5] and not able[1]
        return cls(stiffness, damping, INTEGRAL * w[5] * stiffness[5], scales.length if steers else np.inf)


class ExperimentMemory(eqx.Module):
    """Readings, supervisor's mode, place and heading of home, integral of the heading [share], tick."""

    estimate: RawEstimate
    supervisor: SupervisorMemory
    home: Float[Array, "4"]
    integral: Scalar
    tick: Index


class Timeline(eqx.Module):
    """A test, tick by tick; rows beyond the last manoeuvre are padding.

    Attributes:
        share: Command asked for on each axis.
        row: Which row of the following holds.
        hold: Whether an axis is held by its PID: surge and sway on the way home, heave, yaw.
        keep: Weak spring on each axis [share per m, rad].
        on: Whether thrusters may run.
        manoeuvre: Number of the manoeuvre.
        phase: One of core.flow.PHASES.
        count: Ticks of the test.
    """

    share: Float[Array, "ticks 6"]
    row: Int[Array, " ticks"]
    hold: Float[Array, "rows 6"]
    keep: Float[Array, "rows 6"]
    on: Bool[Array, " rows"]
    manoeuvre: Int[Array, " rows"]
    phase: Int[Array, " rows"]
    count: Index


class Experiment(Block):
    """Flies a time-line; takes and gives what an autopilot does. Its estimate is the readings, hardly filtered.

    Attributes:
        mixing: Thruster commands of a full command on each axis; zero where thrusters cannot push.
        timeline: The test.
        supervisor: Depth and attitude limits.
        gains: Of what is held.
        mounts: Sensors that do not sit at CO along the axes of b, by name.
        smoothing: Share of a position's surprise that is accepted.
        tracking: Rate at which its speed is corrected [1/s].
        home: Place in n [m] and heading [rad] that it comes home to and holds; None: those it starts at.
    """

    mixing: Float[Array, "n 6"]
    timeline: Timeline
    supervisor: Supervisor
    gains: HoldingGains
    mounts: dict[str, Mount] = eqx.field(default_factory=dict)
    smoothing: Scalar = eqx.field(converter=as_array, default=0.25)
    tracking: Scalar = eqx.field(converter=as_array, default=0.5)
    home: Float[Array, "4"] | None = None

    @classmethod
    def of(
        cls,
        model: Model,
        timeline: Timeline,
        supervisor: Supervisor | None = None,
        mounts: dict[str, Mount] | None = None,
        home: Float[Array, "4"] | None = None,
    ) -> "Experiment":
        """An experiment on a vehicle; its forces are used by what is held, and by nothing else."""
        mix, gains = as_array(mixing(model)), HoldingGains.of(model)
        return cls(mix, timeline, supervisor or Supervisor(), gains, mounts or {}, home=home)

    def init(self, key: PRNGKey, start: Start) -> ExperimentMemory:
        raw = RawEstimate(start.position, jnp.zeros(3), start.attitude, start.velocity[3:], jnp.zeros(()))
        here = jnp.append(start.position, raw.heading)
        home = here if self.home is None else self.home
        return ExperimentMemory(raw, self.supervisor.init(key, start), home, jnp.zeros(()), jnp.zeros((), dtype=int))

    def step(
        self, memory: ExperimentMemory, input: AutopilotInput, dt: float
    ) -> tuple[ExperimentMemory, AutopilotOutput]:
        before, home = memory.estimate, memory.home
        R_nb = rotation_from_quaternion(before.attitude)
        raw = self._listen(before, at_co(input.measurements, self.mounts, R_nb, before.rates), dt)
        estimate = _estimate(raw, len(input.measurements))
        supervisor, mode = self.supervisor.step(
            memory.supervisor, SupervisorInput(estimate, input.request, input.measurements, input.host), dt
        )
        line, over, paused = self.timeline, memory.tick >= self.timeline.count, mode.mode == MODE_PAUSED
        now = jnp.minimum(memory.tick, line.count - 1)
        row = line.row[now]

        hold = jnp.where(paused, STATION, line.hold[row])
        away, speed = _away(home, raw)
        away = away.at[5].set(self._course(hold, home, raw, away[5]))
        integral, held = self._pid(memory.integral, hold, away, speed, dt)
        share = held + jnp.where(paused, 0.0, line.share[now] + line.keep[row] * away)
        active = mode.active & ~over & (paused | line.on[row])
        # A reading that is not a number must not reach the thrusters: `where` drops it, a product would not.
        command = jnp.where(active, jnp.clip(self.mixing @ jnp.where(active, share, 0.0), -1.0, 1.0), 0.0)

        phase = jnp.where(over, FINISHED, jnp.where(paused, PAUSED, line.phase[row]))
        # The first end counts: thrusters are off after it, and what the supervisor thinks then is of no test.
        aborted = ~over & (mode.mode == MODE_ABORTED)
        phase, reason = jnp.where(aborted, ABORTED, phase), jnp.where(over, NO_REASON, mode.reason)
        still, place, attitude = jnp.zeros(6), home[:3], level_attitude(home[3])
        number = line.manoeuvre[row]
        setpoint = Setpoint(place, attitude, still, place, place, phase < 0, number, phase, reason)
        after = ExperimentMemory(
            raw, supervisor, home, integral, memory.tick + jnp.where(paused | over | aborted, 0, 1)
        )
        path, wrench = Reference(place, attitude, *(still[:3],) * 4), Wrench(still, still > 0.0)
        return after, AutopilotOutput(Command(command), estimate, setpoint, path, wrench, jnp.ones(command.shape))

    def _course(self, hold: Vector6, home: Float[Array, "4"], raw: RawEstimate, turn: Scalar) -> Scalar:
        """Angle that the heading has to turn by [rad]: without sway, bow or stern to home until that is near."""
        way = jnp.where(raw.lost[:2], 0.0, home[:2] - raw.position[:2])
        far = jnp.clip(jnp.sqrt(jnp.sum(way**2) + 1e-12) / self.gains.reach - 0.5, 0.0, 1.0) * hold[0] * hold[1]
        bearing = wrap(jnp.arctan2(way[1], way[0] + jnp.where(far > 0.0, 0.0, 1.0)) - raw.heading)
        nearer = jnp.where(jnp.abs(bearing) > 0.5 * jnp.pi, wrap(bearing + jnp.pi), bearing)
        return far * nearer + (1.0 - far) * turn

    def _pid(self, integral: Scalar, hold: Vector6, away: Vector6, speed: Vector6, dt: float) -> tuple[Scalar, Vector6]:
        """The heading's new integral, which grows up to the limit, and the shares of what is held."""
        growth = self.gains.integral * away[5] * dt
        command = self.gains.stiffness * away - self.gains.damping * speed
        command = command + jnp.zeros(6).at[5].set(integral + growth)
        given = jnp.clip(command, -LIMIT, LIMIT)
        integral = integrated(integral, jnp.where(hold[5] > 0, growth, 0.0), (command - given)[5])
        return integral, hold * given

    def _listen(self, before: RawEstimate, measurements: Measurements, dt: float) -> RawEstimate:
        """The newest readings; positions and depths through an alpha-beta filter, which gives their rates."""
        ahead = before.position + dt * before.velocity
        places = [measurements["position"].newest(ahead[:2]), measurements["pressure"].newest(ahead[2:])]
        surprise, seen = jnp.concatenate(places) - ahead, measurements["attitude"]
        quiet = jnp.where(jnp.any(measurements["position"].valid), 0.0, before.quiet + dt)
        # The first position after a silence is accepted as it is: what was expected is worth nothing.
        alpha = jnp.where(before.lost, 1.0, self.smoothing)
        place, velocity = alpha_beta(ahead, before.velocity, surprise, alpha, self.tracking)
        return RawEstimate(
            place,
            jnp.where(LEVEL & (quiet > STALE) | before.lost, 0.0, velocity),
            jnp.where(jnp.any(seen.valid), quaternion_from_euler(seen.newest(jnp.zeros(3))), before.attitude),
            measurements["gyro"].newest(before.rates),
            quiet,
        )


def mixing(model: Model) -> Float[np.ndarray, "n 6"]:
    """Thruster commands that are a full command on each axis: pseudo-inverse, largest command 1.

    Thesis 7.1 in command space: all thrusters are taken to be alike. An axis that thrusters cannot push is zero.

    Args:
        model: Its thrusters are used.
    """
    pattern, able = weighted_pseudo_inverse(model.thrusters.configuration), pushed_axes(model)
    largest = np.abs(pattern).max(axis=0, initial=0.0)
    return np.where(able, pattern / np.where(able, largest, 1.0), 0.0)


def _away(home: Float[Array, "4"], raw: RawEstimate) -> tuple[Vector6, Vector6]:
    """Way home along level axes that turn with the heading, and the speed along them."""
    level = yaw_rotation(raw.heading).T
    turn = wrap(home[3:] - raw.heading)
    tilt = jnp.zeros(2)
    # Where nobody knows the place, it is taken to be home: no thruster looks for it blindly.
    way = jnp.where(raw.lost, 0.0, home[:3] - raw.position)
    away = jnp.concatenate([level @ way, tilt, turn])
    return away, jnp.concatenate([level @ raw.velocity, tilt, raw.rates[2:]])


def _estimate(raw: RawEstimate, sensors: int) -> Estimate:
    """The readings as an estimate that claims nothing about its error."""
    nu = jnp.concatenate([rotation_from_quaternion(raw.attitude).T @ raw.velocity, raw.rates])
    nis = jnp.zeros(sensors)
    return Estimate(raw.position, raw.attitude, nu, jnp.zeros(6), jnp.zeros((12, 12)), nis, nis)
