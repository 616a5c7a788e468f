"""Observer: the extended Kalman filter of the thesis (2.13), put right. The baseline that later observers must beat.

State [eta, nu, b] with zyx Euler angles, as in the thesis (design.md's quaternions stay outside): singular at
theta = +-90 deg. Prediction with the full model (`ekf_model`), one scalar update in Joseph form for each component of
each reading, so that every sensor comes at its own rate and no matrix is inverted.

The accelerometer. (7.7) of the thesis adds the raw reading to the filter's own velocity and calls the sum a measurement:
gravity and the rotation of the axes stay in it, its error is that of the estimate it corrects, and the same knowledge
is counted once more in every tick. `EkfTuning.as_printed` does that. The corrected filter leaves the accelerometer out:
the model already says what the acceleration is, and to be worth more than that the reading would have to be freed of
its bias (0.017 m/s2, half a newton on 30 kg) and of gravity (1 mrad of tilt is another 0.01 m/s2), which takes three
more states than the thesis's filter has. What it would be worth, `bound.position_bound` says.

Reference: Thesis sec. 2.13 and 7.3; Bar-Shalom, Li and Kirubarajan (2001), Estimation with Applications to Tracking
and Navigation, sec. 5.4 (consistency), 7.2 (sequential updates, Joseph form).
"""

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command, Estimate, Measurements, Slot
from rovtwin.core.frames import euler_from_quaternion, wrap
from rovtwin.core.numerics import Array, jnp
from rovtwin.gnc.ekf_model import discrete_step, product, state_rate
from rovtwin.gnc.ekf_tuning import SENSORS, EkfTuning
from rovtwin.vehicle.model import Model
from rovtwin.vehicle.thrusters import force_just_after, lag, static_force

__all__ = ["Ekf", "EkfMemory", "EkfTuning", "ObserverInput"]


class ObserverInput(eqx.Module):
    """What an observer takes in one tick: the readings since the last tick and the command that was sent over it."""

    measurements: Measurements
    command: Command


class EkfMemory(eqx.Module):
    """Memory of the filter.

    Attributes:
        x: Estimate [eta, nu, b], shape (18,).
        P: Its covariance, shape (18, 18).
        thrust: Force of each thruster as the model predicts it [N], shape (n,).
        ticks: Number of ticks so far, int; time is `ticks * dt`.
        rejected: Readings rejected in a row, per sensor in the order of SENSORS, shape (6,), int.
    """

    x: Array
    P: Array
    thrust: Array
    ticks: Array
    rejected: Array


class Ekf(Block):
    """Extended Kalman filter with the full 6-DOF model and bias states.

    Attributes:
        model: What the filter believes the vehicle to be.
        tuning: See `EkfTuning`.
    """

    model: Model
    tuning: EkfTuning

    def init(self, key: Array, start: Start) -> EkfMemory:
        """At the start, unaware of velocity and disturbance; `key` is not used."""
        eta = jnp.concatenate([start.position, euler_from_quaternion(start.attitude)])
        return EkfMemory(
            x=jnp.concatenate([eta, jnp.zeros(12)]),
            P=jnp.diag(self.tuning.initial_variance),
            thrust=jnp.zeros(self.model.thrusters.count),
            ticks=jnp.zeros((), dtype=jnp.int32),
            rejected=jnp.zeros(len(SENSORS), dtype=jnp.int32),
        )

    def step(self, memory: EkfMemory, input: ObserverInput, dt: float) -> tuple[EkfMemory, Estimate]:
        """Predict over the tick, then take in what came."""
        x, P, thrust = self._predict(memory, input.command, dt)
        ticks = memory.ticks + 1
        rate = state_rate(self.model, x, self.model.thrusters.configuration @ thrust, self.tuning.bias_decay)
        update = _Update(self.tuning, ticks * dt, rate, memory.x, dt)
        nis, dof, rejected = [], [], dict(zip(SENSORS, memory.rejected, strict=True))
        for name in sorted(input.measurements):
            x, P, sensor_nis, sensor_dof, rejected = update.sensor(name, input.measurements[name], x, P, rejected)
            nis.append(sensor_nis)
            dof.append(sensor_dof)
        x = jnp.concatenate([x[:3], wrap(x[3:6]), x[6:]])
        counts = jnp.array([rejected[name] for name in SENSORS], dtype=jnp.int32)
        estimate = Estimate(x[:6], x[6:12], x[12:], P[:12, :12], _vector(nis), _vector(dof))
        return EkfMemory(x, P, thrust, ticks, counts), estimate

    def _predict(self, memory: EkfMemory, command: Command, dt: float) -> tuple[Array, Array, Array]:
        thrusters, tuning = self.model.thrusters, self.tuning
        target = static_force(thrusters, command.u)
        before = halfway = after = target
        if tuning.thruster_lag:
            before = force_just_after(thrusters, memory.thrust, target)
            halfway = lag(thrusters, before, target, 0.5 * dt)
            after = lag(thrusters, halfway, target, 0.5 * dt)
        T = thrusters.configuration
        x, Phi = discrete_step(self.model, memory.x, T @ before, T @ halfway, tuning.bias_decay, dt)
        P = product(product(Phi, memory.P), Phi.T) + dt * jnp.diag(tuning.process_variance)
        scatter = self.model.mass_inverse @ (T * (tuning.thrust_noise * halfway))
        P = P + jnp.pad(dt * product(scatter, scatter.T), ((6, 6), (6, 6)))
        return x, 0.5 * (P + P.T), after


class _Update:
    """Updates of one tick. Not a Block: it only keeps what all the updates of a tick share."""

    def __init__(self, tuning: EkfTuning, now: Array, rate: Array, previous: Array, dt: float):
        self.tuning, self.now, self.rate, self.previous, self.dt = tuning, now, rate, previous, dt

    def sensor(
        self, name: str, slot: Slot, x: Array, P: Array, rejected: dict[str, Array]
    ) -> tuple[Array, Array, Array, Array, dict[str, Array]]:
        """All readings in the slot of a sensor: x, P, sum of NIS, number of innovations, readings rejected in a row."""
        tuning = self.tuning
        nis = dof = jnp.zeros(())
        if name not in tuning.measurement_variance or name not in SENSORS:
            return x, P, nis, dof, rejected
        if name == "accelerometer" and not tuning.pseudo_velocity:
            return x, P, nis, dof, rejected
        size = len(SENSORS[name])
        for row in range(slot.valid.shape[0]):
            valid = slot.valid[row]
            new_x, new_P, reading_nis = self._reading(name, slot, row, x, P)
            if name in tuning.gate:
                outlier = valid & (reading_nis > tuning.gate[name]) & (rejected[name] < tuning.patience)
                rejected = rejected | {
                    name: jnp.where(valid, jnp.where(outlier, rejected[name] + 1, 0), rejected[name])
                }
                new_x, new_P = jnp.where(outlier, x, new_x), jnp.where(outlier, P, new_P)
                valid = valid & ~outlier
            x, P = new_x, new_P
            nis, dof = nis + jnp.where(valid, reading_nis, 0.0), dof + jnp.where(valid, float(size), 0.0)
        return x, P, nis, dof, rejected

    def _reading(self, name: str, slot: Slot, row: int, x: Array, P: Array) -> tuple[Array, Array, Array]:
        """One reading, component by component; the sum of their NIS is that of the whole reading."""
        valid, value = slot.valid[row], slot.value[row]
        variance = self.tuning.measurement_variance[name]
        age = self.now - slot.t_valid[row]
        age = jnp.where((age > 0) & (age <= self.tuning.max_age), age, 0.0)
        nis = jnp.zeros(())
        for component, i in enumerate(SENSORS[name]):
            z = value[component]
            if name == "accelerometer":
                z, age = self.previous[i] + z * self.dt, 0.0
            innovation = z - (x[i] - age * self.rate[i])
            if 3 <= i < 6:
                innovation = wrap(innovation)
            x, P, scalar_nis = scalar_update(x, P, i, innovation, variance, valid)
            nis = nis + scalar_nis
        return x, P, nis


def scalar_update(
    x: Array, P: Array, i: int, innovation: Array, variance: Array, valid: Array
) -> tuple[Array, Array, Array]:
    """Kalman update by a measurement of state i: x, P and the squared normalised innovation; no change unless valid.

    Joseph form (I - K h) P (I - K h)' + K R K', multiplied out for a row h that picks one state: stays symmetric,
    and positive for any gain K.
    """
    column = P[:, i]
    S = column[i] + variance
    K = jnp.where(valid, column / S, 0.0)
    x = x + K * jnp.where(valid, innovation, 0.0)
    cross_terms = K[:, None] * column[None, :]
    P = P - (cross_terms + cross_terms.T) + S * (K[:, None] * K[None, :])
    return x, P, jnp.where(valid, innovation * innovation / S, 0.0)


def _vector(values: list[Array]) -> Array:
    return jnp.stack(values) if values else jnp.zeros(0)
