"""The filter as a Block: predict with model and inertial sensors, correct with what came, say how sure it is.

    step(memory, ObserverInput(measurements, command), dt) -> (memory, Estimate)

Besides pose and velocity the estimate has the disturbance force without its waves, and the motion of wave frequency by
itself, so that a controller can leave the waves alone.
"""

from typing import NamedTuple

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.arrays.small_matrices import product, squared_norm
from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command, Estimate, Measurements, Slot
from rovtwin.core.frames import rotation_from_quaternion, skew
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.sensors import kind_of
from rovtwin.core.types import Index, PerThruster, PRNGKey, Scalar, Vector3, Vector6
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.gnc.navigation import measurements as readings
from rovtwin.gnc.navigation import prediction as motion
from rovtwin.gnc.navigation.corrections import (
    InnovationTest,
    corrected,
    covariance_inflation,
    finite,
    inflated_for_waves,
)
from rovtwin.gnc.navigation.estimate import estimate_of
from rovtwin.gnc.navigation.measurements import Innovation
from rovtwin.gnc.navigation.positions import Rejected, Trail, positions
from rovtwin.gnc.navigation.prediction import Acceleration, Turning, Waves, side_by_side
from rovtwin.gnc.navigation.state import (
    ATTITUDE,
    ERRORS,
    MOVING,
    VELOCITY,
    WAVE_VELOCITY,
    NavigationState,
    initial_covariance,
)
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.gnc.navigation.wave_estimator import SeaState
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import half_steps, static_force

CORRECTING = ("attitude", "pressure", "dvl")  # kinds that are compared with the state after the motion


class NavigationMemory(eqx.Module):
    """Memory of the filter.

    Attributes:
        x: Nominal state.
        P: Covariance of its error.
        thrust: Force of each thruster as the model predicts it [N].
        omega: Angular velocity at the end of the last tick, b [rad/s].
        ticks: So far; time is `ticks * dt`.
        trail: Where dead reckoning went.
        sea: What is assumed of the waves.
        rejected: Positions that were not accepted, by sensor.
        doubted: Ticks in a row in which a sensor's readings were not, by sensor; accelerometers count as one.
        depth_bias: Mean of the normalised innovations of pressure, by sensor; see `inflated_for_waves`.
    """

    x: NavigationState
    P: Float[Array, "31 31"]
    thrust: PerThruster
    omega: Vector3
    ticks: Index
    trail: Trail
    sea: SeaState
    rejected: dict[str, Rejected]
    doubted: dict[str, Index]
    depth_bias: dict[str, Scalar]


class Forecast(NamedTuple):
    """Accelerations of slow motion, b, and waves, n; densities of their noise in b, 1 / that of all."""

    v_dot: Acceleration
    wave_dot: Acceleration
    slow: Vector3
    quick: Vector3
    total: Vector3


class Transition(NamedTuple):
    """Of the error through a tick: state and covariance before and after the motion, and B with Phi = (I + B)^2.

    Innovations of the positions, normalised, are there as well: no number for those that were not used.
    """

    x: NavigationState
    P: Float[Array, "31 31"]
    x_after: NavigationState
    P_after: Float[Array, "31 31"]
    B: Float[Array, "15 31"]
    innovations: Float[Array, " m"]


class NavigationFilter(Block):
    """Error-state filter whose prediction is driven by the model and by the inertial sensors at once.

    Attributes:
        model: The vehicle as the filter assumes it.
        tuning: See `Tuning`.
    """

    model: Model
    tuning: Tuning

    def init(self, key: PRNGKey, start: Start) -> NavigationMemory:
        """At the start, unaware of velocity and disturbance; `key` is not used."""
        return NavigationMemory(
            x=NavigationState.at(start),
            P=initial_covariance(self.tuning.initial_std, start),
            thrust=jnp.zeros(self.model.thrusters.count),
            omega=jnp.zeros(3),
            ticks=jnp.zeros((), dtype=jnp.int32),
            trail=Trail.at(start.position),
            sea=SeaState.unknown(),
            rejected={name: Rejected.none() for name in self.tuning.named("position", self.tuning.mounts)},
            doubted={name: jnp.zeros((), dtype=jnp.int32) for name in ("accelerometer", *self._correcting)},
            depth_bias={name: jnp.zeros(()) for name in self.tuning.named("pressure", self.tuning.mounts)},
        )

    @property
    def _correcting(self) -> list[str]:
        """Names of the sensors of CORRECTING."""
        return [name for kind in CORRECTING for name in self.tuning.named(kind, self.tuning.mounts)]

    def step(self, memory: NavigationMemory, input: ObserverInput, dt: float) -> tuple[NavigationMemory, Estimate]:
        """Predict over the tick, then take in what came. The first tick is at time zero, `dt` later the second."""
        after, estimate, _ = self.passed(memory, input, dt)
        return after, estimate

    def passed(
        self, memory: NavigationMemory, input: ObserverInput, dt: float
    ) -> tuple[NavigationMemory, Estimate, Transition]:
        """`step`, and how the error came through the tick."""
        slots, now = finite(input.measurements), memory.ticks * dt
        tau, thrust = self._thrust(memory.thrust, input.command, dt)
        turning, omega, turn_variance = self._turning(memory, slots, dt)
        received: dict[str, InnovationTest] = {}

        doubted, rejected, depth_bias = dict(memory.doubted), dict(memory.rejected), dict(memory.depth_bias)
        x, P, forecast, sea, received["accelerometer"], doubted["accelerometer"] = self._accelerate(
            memory, slots, tau, turning, dt
        )
        noise = self._noise(x, forecast, turn_variance)
        before = x, P
        moved, P, B = motion.step(x, P, forecast.v_dot, forecast.wave_dot, turning, noise, dt)
        way = moved.position + moved.wave_place - x.position - x.wave_place
        trail = memory.trail.after(way, memory.ticks)
        x, tuning = moved, self.tuning

        places = {}
        for name in tuning.named("position", slots):
            mount = tuning.mounts[name]
            places[name], rejected[name], P = positions(
                x, P, slots[name], trail, rejected[name], tuning, mount, now, memory.ticks, dt
            )
        after_motion = P
        for name, found in places.items():
            x, P, received[name] = corrected(x, P, found)
        for name in filter(slots.__contains__, self._correcting):
            found = self._innovation(name, x, slots[name], omega, forecast.v_dot.value, sea, now)
            if name in depth_bias:
                P, depth_bias[name] = inflated_for_waves(
                    found, P, depth_bias[name], x, sea, self.model, self.tuning.gate["pressure"]
                )
            found, P, doubted[name] = self._gated(name, found, P, doubted[name], x)
            x, P, received[name] = corrected(x, P, found)
        after = NavigationMemory(x, P, thrust, omega, memory.ticks + 1, trail, sea, rejected, doubted, depth_bias)
        innovations = jnp.concatenate([jnp.zeros(0), *(received[name].normal for name in places)])
        transition = Transition(*before, moved, after_motion, B, innovations)
        return after, estimate_of(self.model, self.tuning, x, P, omega, received, sorted(slots)), transition

    def _thrust(self, before: PerThruster, command: Command, dt: float) -> tuple[Vector6, PerThruster]:
        """Wrench of the thrusters in the middle of the tick, and their forces at its end."""
        thrusters = self.model.thrusters
        _, halfway, after = half_steps(thrusters, before, static_force(thrusters, command.u), dt)
        return thrusters.configuration @ halfway, after

    def _turning(self, memory: NavigationMemory, slots: Measurements, dt: float) -> tuple[Turning, Vector3, Vector3]:
        """Over the tick, omega at its end, and the noise that leaves in the attitude [rad^2/s].

        The mean of readings that end with the tick is half a reading late; the last tick's end mends that.
        """
        silent = Turning(memory.omega, jnp.zeros(3)), memory.omega, jnp.full(3, 1.0) * self.tuning.turn_noise**2
        if not (names := self.tuning.named("gyro", slots)):
            return silent
        gyros, mounts = [slots[name] for name in names], [self.tuning.mounts[name] for name in names]
        means = [readings.averaged(slot, jnp.zeros(()), 0.0) for slot in gyros]
        counts = [mean.count for mean in means]
        together = readings.joined([mean.value for mean in means], counts, mounts)
        last = readings.joined([slot.newest(jnp.zeros(3)) for slot in gyros], counts, mounts)
        n = jnp.maximum(jnp.max(jnp.stack(counts)), 1)
        end = last.value - memory.x.gyro_bias
        middle = together.value - memory.x.gyro_bias + (memory.omega - end) / (2.0 * n)
        measured = Turning(middle, (end - memory.omega) / dt), end, together.variance * dt
        return jax.tree.map(lambda a, b: jnp.where(together.received, a, b), measured, silent)

    def _accelerate(
        self, memory: NavigationMemory, slots: Measurements, tau: Vector6, turning: Turning, dt: float
    ) -> tuple[NavigationState, Float[Array, "31 31"], Forecast, SeaState, InnovationTest, Index]:
        """State after model and accelerometer were compared, the forecast of both, the sea, the test, doubts."""
        x, P, tuning = memory.x, memory.P, self.tuning
        waves = self._waves(memory.sea, x)
        by_model = motion.by_model(self.model, x, tau, turning)
        doubt = (tuning.acceleration_share * by_model.value) ** 2 * tuning.acceleration_memory
        doubt = doubt + motion.learned_doubt(self.model, x, tau, turning.omega) * tuning.acceleration_memory
        slow = tuning.acceleration_noise**2 + doubt
        R_nb = rotation_from_quaternion(x.attitude)
        quick = (R_nb * R_nb).T @ waves.density
        if not (names := tuning.named("accelerometer", slots)):
            zero = jnp.zeros(3)
            forecast = Forecast(by_model, motion.by_waves(x, waves), slow, quick, zero)
            return x, P, forecast, memory.sea, InnovationTest.none(), memory.doubted["accelerometer"]
        means = [readings.averaged(slots[name], jnp.zeros(()), 0.0) for name in names]
        mounts = [tuning.mounts[name] for name in names]
        read = readings.joined([mean.value for mean in means], [mean.count for mean in means], mounts)
        received = read.received
        # n readings that end with the tick are, on average, so long after its start.
        n = jnp.maximum(jnp.max(jnp.stack([mean.count for mean in means])), 1)
        later = 0.5 * dt * (n + 1.0) / n
        # The angular acceleration is a difference of the gyro's readings: on a lever their noise is read, too.
        swing = skew(read.lever)
        variance = read.variance + (swing * swing) @ (2.0 * tuning.rate_variance / dt**2)

        def difference(x: NavigationState) -> tuple[Acceleration, Acceleration, Acceleration]:
            R_nb = rotation_from_quaternion(x.attitude)
            model, wave = motion.by_model(self.model, x, tau, turning), motion.by_waves(x, waves)
            sensed = motion.by_accelerometer(x, read.value, read.lever, turning, later)
            return model, wave, motion.less(sensed, motion.sum_of(model, wave, R_nb))

        found = readings.disagreement(difference(x)[2], slow + quick, variance, received, dt)
        unexplained = found.residual + R_nb.T @ motion.by_waves(x, waves).value
        found, P, doubts = self._gated("accelerometer", found, P, memory.doubted["accelerometer"], x)
        # What is rejected neither moves the vehicle nor makes waves.
        received = jnp.any(found.used)
        sea = memory.sea.after(unexplained, slow / dt + variance, received, dt)
        x, P, test = corrected(x, P, found)
        model, wave, rest = difference(x)
        total = jnp.where(received, 1.0 / (slow + quick + variance * dt), 0.0)
        R_nb = rotation_from_quaternion(x.attitude)
        v_dot = motion.mixed(model, rest, jnp.diag(slow * total))
        wave_dot = motion.mixed(wave, rest, R_nb * (quick * total))
        return x, P, Forecast(v_dot, wave_dot, slow, quick, total), sea, test, doubts

    def _waves(self, sea: SeaState, x: NavigationState) -> Waves:
        damping = self.tuning.wave_damping
        return Waves(sea.frequency, damping, sea.density(damping, rotation_from_quaternion(x.attitude)))

    def _gated(
        self, name: str, found: Innovation, P: Float[Array, "31 31"], doubts: Index, x: NavigationState
    ) -> tuple[Innovation, Float[Array, "31 31"], Index]:
        """What is used of an innovation: nothing beyond the gate, unless so many ticks in a row that P is opened."""
        H, tuning, kind = found.slope, self.tuning, kind_of(name)
        S = product(product(H, P), H.T) + jnp.diag(found.variance)
        there = jnp.any(found.used)
        far = there & (squared_norm(found.residual, S) > tuning.gate[kind])
        doubts = jnp.where(there, jnp.where(far, doubts + 1, 0), doubts)
        opened = covariance_inflation(kind, found.residual, x, self.model)
        lost = (doubts >= tuning.max_rejections) & jnp.any(opened > 0.0)
        P = P + jnp.where(lost, 1.0, 0.0) * opened
        used = eqx.tree_at(lambda i: i.used, found, found.used & (~far | lost))
        return used, P, jnp.where(lost, 0, doubts)

    def _noise(self, x: NavigationState, forecast: Forecast, turn_variance: Vector3) -> Float[Array, "31 31"]:
        """Intensity of the white noise on the error; what is left of it is common to v and waves."""
        R_nb, slow, quick, total = rotation_from_quaternion(x.attitude), forecast.slow, forecast.quick, forecast.total
        of_v = jnp.diag(slow - slow * slow * total)
        both = -R_nb * (slow * quick * total)
        of_waves = product(R_nb * (quick - quick * quick * total), R_nb.T)
        rows = [
            jnp.zeros((3, ERRORS)),
            side_by_side(3, (VELOCITY, of_v), (WAVE_VELOCITY, both.T)),
            side_by_side(3, (ATTITUDE, jnp.eye(3) * turn_variance)),
            jnp.zeros((3, ERRORS)),
            side_by_side(3, (VELOCITY, both), (WAVE_VELOCITY, of_waves)),
            jnp.zeros((ERRORS - MOVING, ERRORS)),
        ]
        return jnp.concatenate(rows) + jnp.diag(self.tuning.walk**2)

    def _innovation(
        self, name: str, x: NavigationState, slot: Slot, omega: Vector3, v_dot: Vector3, sea: SeaState, now: Scalar
    ) -> Innovation:
        mount, max_age, kind = self.tuning.mounts[name], self.tuning.max_age, kind_of(name)
        if kind == "attitude":
            return readings.attitude(x, slot, mount, omega, now, max_age)
        if kind == "pressure":
            R_nb = rotation_from_quaternion(x.attitude)
            blind = (self.tuning.wave_slip * sea.heave(R_nb)) ** 2
            return readings.pressure(x, slot, mount, R_nb @ x.velocity, blind, now, max_age)
        return readings.dvl(x, slot, mount, omega, self.tuning.rate_variance, v_dot, now, max_age)
