"""Observer: the extended Kalman filter of the thesis (2.13), put right. The baseline that later observers must beat.

State [eta, nu, b] with zyx Euler angles, as in the thesis: singular at theta = +-90 deg. Its estimate has a quaternion,
as every other. Prediction with the full model (`ekf_model`), one scalar update in Joseph form for each component of
each reading, so that every sensor comes at its own rate and no matrix is inverted.

The accelerometer. (7.7) of the thesis adds the raw reading to the filter's own velocity and takes the sum as measured:
gravity and the rotation of the axes stay in it, its error is that of the estimate it corrects, and the same knowledge
is counted once more in every tick. `EkfTuning.as_printed` does that. The corrected filter leaves it out: the model
already says what the acceleration is, and to be worth more than that the reading would have to be freed of its bias
(0.017 m/s2, half a newton on 30 kg) and of gravity (1 mrad of tilt is another 0.01 m/s2), which takes three more
states than the thesis's filter has. What it would be worth, `navigation.accuracy_bound` says.

Reference: Thesis sec. 2.13 and 7.3; Bar-Shalom, Li and Kirubarajan (2001), Estimation with Applications to Tracking
and Navigation, sec. 5.2.3 (Joseph form), 5.4 (consistency), ch. 7 (measurements one after the other).
"""

import equinox as eqx
from jaxtyping import Bool, Float, Int

from rovtwin.core.arrays.small_matrices import product, squared_norm
from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command, Estimate, Slot
from rovtwin.core.frames import euler_from_quaternion, rotation_from_euler, wrap
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.sensors import kind_of
from rovtwin.core.types import Index, PerThruster, PRNGKey, Scalar
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.gnc.mounting import Mount, at_co
from rovtwin.gnc.thesis.ekf_model import discrete_step, state_rate
from rovtwin.gnc.thesis.ekf_tuning import STATES, EkfTuning
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import half_steps, static_force

__all__ = ["Ekf", "EkfMemory", "EkfTuning", "ObserverInput"]


class EkfMemory(eqx.Module):
    """Memory of the filter.

    Attributes:
        x: Estimate [eta, nu, b].
        P: Its covariance.
        thrust: Force of each thruster as the model predicts it [N].
        ticks: Number of ticks so far; time is `ticks * dt`.
        rejected: Readings beyond the gate in a row, by name of the sensors that the tuning knows.
    """

    x: Float[Array, "18"]
    P: Float[Array, "18 18"]
    thrust: PerThruster
    ticks: Index
    rejected: dict[str, Index]


class Ekf(Block):
    """Extended Kalman filter with the full 6-DOF model and bias states.

    Attributes:
        model: The vehicle as the filter assumes it.
        tuning: See `EkfTuning`.
        mounts: Sensors that do not sit at CO along the axes of b, by name: their readings are moved there with the
            attitude of the filter, whose error is not counted.
    """

    model: Model
    tuning: EkfTuning
    mounts: dict[str, Mount] = eqx.field(default_factory=dict)

    def init(self, key: PRNGKey, start: Start) -> EkfMemory:
        """At the start, unaware of velocity and disturbance; `key` is not used."""
        eta = jnp.concatenate([start.position, euler_from_quaternion(start.attitude)])
        return EkfMemory(
            x=jnp.concatenate([eta, jnp.zeros(12)]),
            P=jnp.diag(self.tuning.initial_variance),
            thrust=jnp.zeros(self.model.thrusters.count),
            ticks=jnp.zeros((), dtype=jnp.int32),
            rejected={name: jnp.zeros((), dtype=jnp.int32) for name in self.tuning.measurement_variance},
        )

    def step(self, memory: EkfMemory, input: ObserverInput, dt: float) -> tuple[EkfMemory, Estimate]:
        """Predict over the tick, then take in what came. The first tick is at time zero, `dt` later the second."""
        x, P, thrust = self._predict(memory, input.command, dt)
        tau = self.model.thrusters.configuration @ thrust
        rate = state_rate(self.model, x, tau, self.tuning.bias_decay)
        prior = _Prior(self.tuning, x, P, rate, memory.x, memory.ticks * dt, dt)
        measurements = at_co(input.measurements, self.mounts, rotation_from_euler(x[3:6]), x[9:12])
        names = sorted(measurements)
        batches, rejected = [], dict(memory.rejected)
        for name in filter(self.tuning.uses, names):
            known = name if name in rejected else kind_of(name)
            batch, rejected[known] = prior.innovations(name, measurements[name], rejected[known])
            batches.append((name, batch))
        x, P, nis, dof = _update(x, P, batches, names)
        x = jnp.concatenate([x[:3], wrap(x[3:6]), x[6:]])
        estimate = Estimate.from_euler(x[:6], x[6:12], x[12:], P[:12, :12], nis, dof)
        return EkfMemory(x, P, thrust, memory.ticks + 1, rejected), estimate

    def _predict(
        self, memory: EkfMemory, command: Command, dt: float
    ) -> tuple[Float[Array, "18"], Float[Array, "18 18"], PerThruster]:
        thrusters, tuning = self.model.thrusters, self.tuning
        target = static_force(thrusters, command.u)
        before = halfway = after = target
        if tuning.thruster_lag:
            before, halfway, after = half_steps(thrusters, memory.thrust, target, dt)
        T = thrusters.configuration
        x, half = discrete_step(self.model, memory.x, T @ before, T @ halfway, tuning.bias_decay, dt)
        scatter = self.model.inertia_inverse @ (T * (tuning.thrust_noise * halfway))
        noise = jnp.diag(tuning.process_variance) + jnp.pad(product(scatter, scatter.T), ((6, 6), (6, 6)))
        # The noise comes in the middle of the step: what shakes nu has moved eta by the end of it. All of it after the
        # step, as in (2.41), the compass would seem to tell moments from noise, and b would be overconfident.
        P = product(product(half, memory.P), half.T) + dt * noise
        P = product(product(half, P), half.T)
        return x, 0.5 * (P + P.T), after


class _Scalars(eqx.Module):
    """Scalar measurements in order: z of state i with a variance, `used` or not."""

    i: Int[Array, " n"]
    z: Float[Array, " n"]
    variance: Float[Array, " n"]
    used: Bool[Array, " n"]


class _Prior(eqx.Module):
    """Prediction of a tick, which its readings are compared with.

    Attributes:
        tuning: Of the filter.
        x: Predicted state.
        P: Its covariance.
        rate: Its rate of change.
        previous: Estimate of the tick before.
        now: Time [s].
        dt: Tick [s].
    """

    tuning: EkfTuning
    x: Float[Array, "18"]
    P: Float[Array, "18 18"]
    rate: Float[Array, "18"]
    previous: Float[Array, "18"]
    now: Scalar
    dt: float = eqx.field(static=True)

    def innovations(self, name: str, slot: Slot, rejected: Index) -> tuple[_Scalars, Index]:
        """Scalar measurements of all readings in a slot, and how many were rejected in a row after them."""
        kind, rows = kind_of(name), slot.valid.shape[0]
        states = STATES[kind]
        here = slice(states[0], states[-1] + 1)
        z, variance = self._now(name, slot, here)
        used = slot.valid
        if kind in self.tuning.gate:
            accepted = []
            for row in range(rows):
                S = self.P[here, here] + jnp.diag(variance[row])
                innovation = z[row] - self.x[here]
                if kind == "attitude":
                    innovation = wrap(innovation)
                outlier = squared_norm(innovation, S) > self.tuning.gate[kind]
                accepted.append(used[row] & ~(outlier & (rejected < self.tuning.patience)))
                rejected = jnp.where(used[row], jnp.where(outlier, rejected + 1, 0), rejected)
            used = jnp.stack(accepted)
        i = jnp.tile(jnp.array(states), rows)
        return _Scalars(i, z.reshape(-1), variance.reshape(-1), jnp.repeat(used, len(states))), rejected

    def _now(self, name: str, slot: Slot, here: slice) -> tuple[Float[Array, "rows n"], Float[Array, "rows n"]]:
        """Readings moved on by the state's rate from when they were taken to now, and their variance; (capacity, n)."""
        R = self.tuning.variance_of(name)
        if kind_of(name) == "accelerometer":
            return self.previous[here] + slot.value * self.dt, jnp.full(slot.value.shape, R)
        age = self.now - slot.t_valid
        age = jnp.where((age > 0.0) & (age <= self.tuning.max_age), age, 0.0)[:, None]
        return slot.value + age * self.rate[here], R + age * self.tuning.process_variance[here]


def _update(
    x: Float[Array, "18"], P: Float[Array, "18 18"], batches: list[tuple[str, _Scalars]], names: list[str]
) -> tuple[Float[Array, "18"], Float[Array, "18 18"], Float[Array, " sensors"], Float[Array, " sensors"]]:
    """x and P after all measurements; NIS and number of innovations per sensor in the order of `names`."""
    nothing = jnp.zeros(())
    nis, dof = dict.fromkeys(names, nothing), dict.fromkeys(names, nothing)
    if batches:
        scalars = jax.tree.map(lambda *parts: jnp.concatenate(parts), *[batch for _, batch in batches])
        # A loop, not 15 copies of the same code: compiles in a tenth of the time and runs twice as fast.
        (x, P), squares = jax.lax.scan(lambda carry, one: _scalar_update(*carry, one), (x, P), scalars)
        begin = 0
        for name, batch in batches:
            end = begin + batch.i.shape[0]
            nis[name], dof[name] = squares[begin:end].sum(), batch.used.sum().astype(x.dtype)
            begin = end
    return x, P, _vector([nis[name] for name in names]), _vector([dof[name] for name in names])


def _scalar_update(
    x: Float[Array, "18"], P: Float[Array, "18 18"], one: _Scalars
) -> tuple[tuple[Float[Array, "18"], Float[Array, "18 18"]], Scalar]:
    """Kalman update by one scalar measurement of one state; x, P and its squared normalised innovation.

    Joseph form (I - K h) P (I - K h)' + K R K', multiplied out for a row h that picks one state: symmetric, and
    positive for any gain K. No change where the measurement is not used.
    """
    column = jax.lax.dynamic_index_in_dim(P, one.i, keepdims=False)
    difference = one.z - jax.lax.dynamic_index_in_dim(x, one.i, keepdims=False)
    innovation = jnp.where((one.i >= 3) & (one.i < 6), wrap(difference), difference)
    S = jax.lax.dynamic_index_in_dim(column, one.i, keepdims=False) + one.variance
    K = jnp.where(one.used, column / S, 0.0)
    x = x + K * jnp.where(one.used, innovation, 0.0)
    P = P - (K[:, None] * column + column[:, None] * K) + S * (K[:, None] * K)
    return (x, P), jnp.where(one.used, innovation * innovation / S, 0.0)


def _vector(values: list[Scalar]) -> Float[Array, " sensors"]:
    return jnp.stack(values) if values else jnp.zeros(0)
