"""The filter as a Block: predict with model and inertial sensors, correct with what came, say how sure it is.

    step(memory, ObserverInput(measurements, command), dt) -> (memory, Estimate)

Besides pose and velocity the estimate has the disturbance force without its waves, and the motion of wave frequency by
itself, so that a controller can leave the waves alone.
"""

from typing import NamedTuple

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command, Estimate, Measurements, Slot
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.gnc.ekf_model import product
from rovtwin.gnc.navigation import motion, readings
from rovtwin.gnc.navigation.belief import estimate_of
from rovtwin.gnc.navigation.corrections import corrected, finite, opening
from rovtwin.gnc.navigation.motion import Acceleration, Turning, Waves, side_by_side
from rovtwin.gnc.navigation.positions import Rejected, Trail, positions
from rovtwin.gnc.navigation.readings import Innovation
from rovtwin.gnc.navigation.sea import SeaState
from rovtwin.gnc.navigation.state import (
    ATTITUDE,
    ERRORS,
    MOVING,
    VELOCITY,
    WAVE_VELOCITY,
    NavigationState,
)
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.gnc.observer import ObserverInput, squared_norm
from rovtwin.vehicle.model import Model
from rovtwin.vehicle.thrusters import force_just_after, lag, static_force

DOUBTED = ("accelerometer", "attitude", "pressure", "dvl")


class NavigationMemory(eqx.Module):
    """Memory of the filter.

    Attributes:
        x: Nominal state.
        P: Covariance of its error, shape (31, 31).
        thrust: Force of each thruster as the model predicts it [N], shape (n,).
        omega: Angular velocity at the end of the last tick, b [rad/s], shape (3,).
        ticks: So far, int; time is `ticks * dt`.
        trail: Where dead reckoning went.
        sea: What is believed of the waves.
        rejected: Positions that were not believed.
        doubted: Ticks in a row in which a sensor's readings were not, in the order of DOUBTED, shape (4,), int.
    """

    x: NavigationState
    P: Array
    thrust: Array
    omega: Array
    ticks: Array
    trail: Trail
    sea: SeaState
    rejected: Rejected
    doubted: Array


class Forecast(NamedTuple):
    """Accelerations of slow motion, b, and waves, n; densities of their noise in b, 1 / that of all; shapes (3,)."""

    v_dot: Acceleration
    wave_dot: Acceleration
    slow: Array
    quick: Array
    total: Array


class Transition(NamedTuple):
    """Of the error through a tick: state and covariance before and after the motion, and B with Phi = (I + B)^2."""

    x: NavigationState
    P: Array
    x_after: NavigationState
    P_after: Array
    B: Array


class NavigationFilter(Block):
    """Error-state filter whose prediction is driven by the model and by the inertial sensors at once.

    Attributes:
        model: What the filter believes the vehicle to be.
        tuning: See `Tuning`.
    """

    model: Model
    tuning: Tuning

    def init(self, key: Array, start: Start) -> NavigationMemory:
        """At the start, unaware of velocity and disturbance; `key` is not used."""
        return NavigationMemory(
            x=NavigationState.at(start),
            P=jnp.diag(self.tuning.initial_std**2),
            thrust=jnp.zeros(self.model.thrusters.count),
            omega=jnp.zeros(3),
            ticks=jnp.zeros((), dtype=jnp.int32),
            trail=Trail.at(start.position),
            sea=SeaState.unknown(),
            rejected=Rejected.none(),
            doubted=jnp.zeros(len(DOUBTED), dtype=jnp.int32),
        )

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
        heard: dict[str, tuple[Array, Array]] = {}

        doubted = dict(zip(DOUBTED, memory.doubted, strict=True))
        x, P, forecast, sea, heard["accelerometer"], doubted["accelerometer"] = self._accelerate(
            memory, slots, tau, turning, dt
        )
        noise = self._noise(x, forecast, turn_variance)
        before = x, P
        moved, P, B = motion.step(x, P, forecast.v_dot, forecast.wave_dot, turning, noise, dt)
        way = moved.position + moved.wave_place - x.position - x.wave_place
        trail = memory.trail.after(way, memory.ticks)
        x, rejected = moved, memory.rejected

        found = None
        if self._listens("position", slots):
            found, rejected, P = positions(x, P, slots["position"], trail, rejected, self.tuning, now, memory.ticks, dt)
        transition = Transition(*before, moved, P, B)
        if found is not None:
            x, P, heard["position"] = corrected(x, P, found)
        for name in ("attitude", "pressure", "dvl"):
            if self._listens(name, slots):
                found = self._innovation(name, x, slots[name], omega, forecast.v_dot.value, sea, now)
                found, P, doubted[name] = self._believed(name, found, P, doubted[name], x)
                x, P, heard[name] = corrected(x, P, found)
        counts = jnp.stack([doubted[name] for name in DOUBTED])
        after = NavigationMemory(x, P, thrust, omega, memory.ticks + 1, trail, sea, rejected, counts)
        return after, estimate_of(self.model, self.tuning, x, P, omega, heard, sorted(slots)), transition

    def _listens(self, name: str, slots: Measurements) -> bool:
        return name in slots and name in self.tuning.mounts

    def _thrust(self, before: Array, command: Command, dt: float) -> tuple[Array, Array]:
        """Wrench of the thrusters in the middle of the tick, shape (6,), and their forces at its end, shape (n,)."""
        thrusters = self.model.thrusters
        target = static_force(thrusters, command.u)
        halfway = lag(thrusters, force_just_after(thrusters, before, target), target, 0.5 * dt)
        return thrusters.configuration @ halfway, lag(thrusters, halfway, target, 0.5 * dt)

    def _turning(self, memory: NavigationMemory, slots: Measurements, dt: float) -> tuple[Turning, Array, Array]:
        """Over the tick, omega at its end, and the noise that leaves in the attitude [rad^2/s].

        The mean of readings that end with the tick is half a reading late; the last tick's end mends that.
        """
        silent = Turning(memory.omega, jnp.zeros(3)), memory.omega, self.tuning.turn_noise**2
        if not self._listens("gyro", slots):
            return silent
        mount, slot = self.tuning.mounts["gyro"], slots["gyro"]
        count = jnp.sum(slot.valid)
        n = jnp.maximum(count, 1)
        mean = mount.rotation @ ((slot.valid / n) @ slot.value) - memory.x.gyro_bias
        last = jnp.zeros(3)
        for row in range(slot.valid.shape[0]):
            last = jnp.where(slot.valid[row], slot.value[row], last)
        end = mount.rotation @ last - memory.x.gyro_bias
        middle = mean + (memory.omega - end) / (2.0 * n)
        told = Turning(middle, (end - memory.omega) / dt), end, mount.std**2 * dt / n
        return jax.tree.map(lambda a, b: jnp.where(count > 0, a, b), told, silent)

    def _accelerate(
        self, memory: NavigationMemory, slots: Measurements, tau: Array, turning: Turning, dt: float
    ) -> tuple[NavigationState, Array, Forecast, SeaState, tuple[Array, Array], Array]:
        """State after model and accelerometer were compared, the forecast of both, the sea, what was heard, doubts."""
        x, P, tuning = memory.x, memory.P, self.tuning
        waves = self._waves(memory.sea, x)
        by_model = motion.by_model(self.model, x, tau, turning)
        doubt = (tuning.acceleration_share * by_model.value) ** 2 * tuning.acceleration_memory
        slow = tuning.acceleration_noise**2 + doubt
        R_nb = rotation_from_quaternion(x.attitude)
        quick = (R_nb * R_nb).T @ waves.density
        if not self._listens("accelerometer", slots):
            nothing = (jnp.zeros(()), jnp.zeros(()))
            zero = jnp.zeros(3)
            forecast = Forecast(by_model, motion.by_waves(x, waves), slow, quick, zero)
            return x, P, forecast, memory.sea, nothing, memory.doubted[0]
        mount = tuning.mounts["accelerometer"]
        mean = readings.averaged(slots["accelerometer"], jnp.zeros(()), 0.0)
        heard = mean.count > 0
        variance = mount.std**2 / jnp.maximum(mean.count, 1)
        read = mount.rotation @ mean.value

        def difference(x: NavigationState) -> tuple[Acceleration, Acceleration, Acceleration]:
            R_nb = rotation_from_quaternion(x.attitude)
            model, wave = motion.by_model(self.model, x, tau, turning), motion.by_waves(x, waves)
            sensed = motion.by_accelerometer(x, read, mount.lever, turning)
            return model, wave, motion.less(sensed, motion.sum_of(model, wave, R_nb))

        found = readings.disagreement(difference(x)[2], slow + quick, variance, heard, dt)
        unexplained = found.residual + R_nb.T @ motion.by_waves(x, waves).value
        found, P, doubts = self._believed("accelerometer", found, P, memory.doubted[0], x)
        # What is rejected neither moves the vehicle nor makes waves.
        heard = jnp.any(found.used)
        sea = memory.sea.after(unexplained, slow / dt + variance, heard, dt)
        x, P, told = corrected(x, P, found)
        model, wave, rest = difference(x)
        total = jnp.where(heard, 1.0 / (slow + quick + variance * dt), 0.0)
        R_nb = rotation_from_quaternion(x.attitude)
        v_dot = motion.mixed(model, rest, jnp.diag(slow * total))
        wave_dot = motion.mixed(wave, rest, R_nb * (quick * total))
        return x, P, Forecast(v_dot, wave_dot, slow, quick, total), sea, told, doubts

    def _waves(self, sea: SeaState, x: NavigationState) -> Waves:
        damping = self.tuning.wave_damping
        return Waves(sea.frequency, damping, sea.density(damping, rotation_from_quaternion(x.attitude)))

    def _believed(
        self, name: str, found: Innovation, P: Array, doubts: Array, x: NavigationState
    ) -> tuple[Innovation, Array, Array]:
        """What is used of an innovation: nothing beyond the gate, unless so many ticks in a row that P is opened."""
        H, tuning = found.slope, self.tuning
        S = product(product(H, P), H.T) + jnp.diag(found.variance)
        there = jnp.any(found.used)
        far = there & (squared_norm(found.residual, S) > tuning.gate[name])
        doubts = jnp.where(there, jnp.where(far, doubts + 1, 0), doubts)
        opened = opening(name, found.residual, rotation_from_quaternion(x.attitude), self.model)
        lost = (doubts >= tuning.stubbornness) & jnp.any(opened > 0.0)
        P = P + jnp.where(lost, 1.0, 0.0) * jnp.diag(opened)
        used = eqx.tree_at(lambda i: i.used, found, found.used & (~far | lost))
        return used, P, jnp.where(lost, 0, doubts)

    def _noise(self, x: NavigationState, forecast: Forecast, turn_variance: Array) -> Array:
        """Intensity of the white noise on the error, shape (31, 31); what is left of it is common to v and waves."""
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
        self, name: str, x: NavigationState, slot: Slot, omega: Array, v_dot: Array, sea: SeaState, now: Array
    ) -> Innovation:
        mount, max_age = self.tuning.mounts[name], self.tuning.max_age
        if name == "attitude":
            return readings.attitude(x, slot, mount, omega, now, max_age)
        if name == "pressure":
            R_nb = rotation_from_quaternion(x.attitude)
            blind = (self.tuning.wave_slip * sea.heave(R_nb)) ** 2
            return readings.pressure(x, slot, mount, R_nb @ x.velocity, blind, now, max_age)
        return readings.dvl(x, slot, mount, omega, v_dot, now, max_age)
