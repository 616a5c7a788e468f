"""A Kalman filter of the motion at held factors, and what its innovations say of the factors.

The filter runs with theta held (Friedland's separated filter). What a factor would have moved, V, the derivative of
the state's error by theta, goes through the same prediction and gains, so that each scalar innovation e of variance S
is one equation,

    e = h V (theta - theta_held) + white noise of variance S

and the normal equations of all of them, A = sum V'h'hV / S and s = sum V'h'e / S, are what is gathered. They add up
over time and over flights, and are cheap to keep. How much the model errs is learnt beside it: innovations of a filter
that takes too little noise are like those just before them, so the noise of an axis grows while they are, and shrinks
while they are the opposite. Unlike their size this does not depend on what the sensors are said to be.

Reference: Friedland (1969), Treatment of bias in recursive filtering; Ljung (1979), Asymptotic behavior of the extended
Kalman filter as a parameter estimator; Mehra (1972), Approaches to adaptive filtering.
"""

import equinox as eqx
import numpy as np

from rovtwin.core.frames import (
    rotation_between,
    rotation_from_quaternion,
    skew,
)
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.monitoring.factors import changed
from rovtwin.monitoring.state import (
    ATTITUDE,
    ERRORS,
    GYRO_BIAS,
    POSITION,
    RATE,
    VELOCITY,
    Motion,
    linearised,
)
from rovtwin.vehicle.physics.measurement import velocity_of_point
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import lag

FAR = 4.0  # standard deviations beyond which an innovation counts less and less
RECENT = 0.1  # share of the newest in the mean of innovations with which they are compared
LEARNING = 0.005  # of the noise's logarithm, by innovation
LEARNING_SLOW = 0.05  # the same by a position, which comes seldom
LEAST_NOISE, MOST_NOISE = -5.0, 5.0  # logarithm of its variance against the start


class Seen(eqx.Module):
    """Readings of one step, averaged; `*_age` is how long before its end they were taken on average [s].

    Attributes:
        target: Force to which the command sends each thruster, before its factor [N], shape (n,).
        gyro, attitude, depth, velocity, horizontal: Shapes (3,), (4,) quaternion, (1,), (3,), (2,).
        variance: Of rows p q r, phi theta psi, depth, u v w, north east, shape (12,); inf where there is no reading.
        age: Of the five, shape (5,).
    """

    target: Array
    gyro: Array
    attitude: Array
    depth: Array
    velocity: Array
    horizontal: Array
    variance: Array
    age: Array


class Levers(eqx.Module):
    """Where the sensors of depth, velocity and position sit, from CO, b [m], shapes (3,)."""

    depth: Array
    velocity: Array
    horizontal: Array


class Noise(eqx.Module):
    """The filter's estimate of the motion.

    Attributes:
        initial: Standard deviation of the error at the start, shape (23,).
        walk: White noise that drives it [unit/sqrt(s)], shape (23,); that of nu is where learning starts.
    """

    initial: Array = eqx.field(converter=as_array)
    walk: Array = eqx.field(converter=as_array)


class Memory(eqx.Module):
    """Memory of the filter.

    Attributes:
        x: State.
        P: Covariance of its error, shape (23, 23).
        V: Derivative of its error by theta, shape (23, p).
        thrust: Force of each thruster before its factor [N], shape (n,).
        log_noise: Logarithm of the learnt noise's variance, surge to yaw, against the start, shape (6,).
        nu_dot: Of the last step, shape (6,).
        recent: Mean of the last normalised innovations, shape (12,).
    """

    x: Motion
    P: Array
    V: Array
    thrust: Array
    log_noise: Array
    nu_dot: Array
    recent: Array


class Gathered(eqx.Module):
    """Normal equations about theta = 0 of some time.

    Attributes:
        A: Shape (p, p).
        s: Shape (p,).
        far: How many innovations of each row were beyond FAR, shape (12,).
        count: How many there were, shape (12,).
        fit: Logarithm of the likelihood of the innovations, each no less likely than its tail beyond FAR.
    """

    A: Array
    s: Array
    far: Array
    count: Array
    fit: Array


class MotionFilter(eqx.Module):
    """The filter of one vehicle.

    Attributes:
        model: The vehicle at theta = 0.
        noise: See `Noise`.
        levers: See `Levers`.
        factors: p, how many.
        h: Step [s].
    """

    model: Model
    noise: Noise
    levers: Levers
    factors: int = eqx.field(static=True)
    h: float = eqx.field(static=True)

    def start(self, position: Array, attitude: Array) -> Memory:
        """At a place and attitude (quaternion)."""
        x, P = Motion.at(position, attitude), jnp.diag(self.noise.initial**2)
        rest = jnp.zeros(self.model.thrusters.count)
        return Memory(x, P, jnp.zeros((ERRORS, self.factors)), rest, jnp.zeros(6), jnp.zeros(6), jnp.zeros(12))

    @eqx.filter_jit
    def over(self, memory: Memory, held: Array, seen: Seen) -> tuple[Memory, Gathered]:
        """Through some steps with theta held.

        Args:
            memory: Before them.
            held: Theta, shape (p,).
            seen: Readings, leading axis steps.
        """
        inverse = jnp.linalg.inv(changed(self.model, held).inertia)

        def step(carry: tuple[Memory, Gathered], now: Seen) -> tuple[tuple[Memory, Gathered], None]:
            memory, sums = carry
            predicted = self._predicted(memory, held, inverse, now)
            after, gathered = self._corrected(predicted, held, now)
            return (after, jax.tree.map(jnp.add, sums, gathered)), None

        p = self.factors
        none = Gathered(jnp.zeros((p, p)), jnp.zeros(p), jnp.zeros(12), jnp.zeros(12), jnp.zeros(()))
        (memory, sums), _ = jax.lax.scan(step, (memory, none), seen)
        return memory, eqx.tree_at(lambda g: g.s, sums, sums.s + sums.A @ held)

    @eqx.filter_jit
    def held_at(self, memory: Memory, shift: Array) -> Memory:
        """The filter with factors that are held `shift` further on, shape (p,): the state moves as they say."""
        return eqx.tree_at(lambda m: m.x, memory, memory.x.moved(memory.V @ shift))

    def _predicted(self, memory: Memory, held: Array, inverse: Array, now: Seen) -> Memory:
        force = lag(self.model.thrusters, memory.thrust, now.target, self.h)
        middle = 0.5 * (memory.thrust + force)
        x, nu_dot, F, G = linearised(self.model, held, inverse, memory.x, middle, self.h)
        driven = self.noise.walk**2
        driven = driven.at[VELOCITY.start : RATE.stop].multiply(jnp.exp(memory.log_noise))
        P = F @ memory.P @ F.T + self.h * jnp.diag(driven)
        return Memory(x, P, F @ memory.V + G, force, memory.log_noise, nu_dot, memory.recent)

    def _corrected(self, memory: Memory, held: Array, now: Seen) -> tuple[Memory, Gathered]:
        """One scalar after the other, all about the predicted state."""
        residual, slope = self._innovations(memory, now)
        P, V, error = memory.P, memory.V, jnp.zeros(ERRORS)
        A, s = jnp.zeros((self.factors, self.factors)), jnp.zeros(self.factors)
        normalised, there, fit = [], jnp.isfinite(now.variance), jnp.zeros(())
        for i in range(12):
            h, R = slope[i], jnp.where(there[i], now.variance[i], 1.0)
            Ph, e, hV = P @ h, residual[i] - h @ error, h @ V
            own = h @ Ph
            away = e / jnp.sqrt(own + R)
            normalised.append(jnp.where(there[i], jnp.clip(away, -FAR, FAR), 0.0))
            fit = fit + jnp.where(there[i], _log_likelihood(away, own + R), 0.0)
            S = own + R * jnp.maximum(1.0, jnp.abs(away) / FAR) ** 2
            weight = jnp.where(there[i], 1.0 / S, 0.0)
            K = Ph * weight
            A, s = A + weight * jnp.outer(hV, hV), s + weight * e * hV
            P, V, error = P - jnp.outer(K, Ph), V - jnp.outer(K, hV), error + K * e
        newest = jnp.stack(normalised)
        far = (jnp.abs(newest) >= FAR).astype(float)
        log_noise = _learnt(memory.log_noise, newest * memory.recent, jnp.any(there[7:10]))
        recent = memory.recent + jnp.where(there, RECENT * (newest - memory.recent), 0.0)
        x, P = memory.x.moved(error), 0.5 * (P + P.T)
        return Memory(x, P, V, memory.thrust, log_noise, memory.nu_dot, recent), Gathered(
            A, s, far, there.astype(float), fit
        )

    def _innovations(self, memory: Memory, now: Seen) -> tuple[Array, Array]:
        """Readings less what is expected, shape (12,), and slopes of what is expected, shape (12, 23)."""
        x, nu_dot, age = memory.x, memory.nu_dot, now.age
        R_nb, omega = rotation_from_quaternion(x.attitude), x.nu[3:]
        turned = rotation_between(now.attitude, x.attitude) + age[1] * omega
        v = velocity_of_point(x.nu, self.levers.velocity)
        residuals = [
            now.gyro - (omega - age[0] * nu_dot[3:] + x.gyro_bias),
            turned,
            now.depth - self._place(x, R_nb, self.levers.depth, age[2])[2:],
            now.velocity - (v - age[3] * nu_dot[:3]),
            now.horizontal - self._place(x, R_nb, self.levers.horizontal, age[4])[:2],
        ]
        one, slope = jnp.eye(3), jnp.zeros((12, ERRORS))
        slope = slope.at[0:3, RATE].set(one).at[0:3, GYRO_BIAS].set(one).at[3:6, ATTITUDE].set(one)
        slope = slope.at[7:10, VELOCITY].set(one).at[7:10, RATE].set(-skew(self.levers.velocity))
        for rows, lever, which in ((slice(6, 7), self.levers.depth, 2), (slice(10, 12), self.levers.horizontal, 4)):
            of = slice(2, 3) if which == 2 else slice(0, 2)
            slope = slope.at[rows, POSITION].set(one[of]).at[rows, VELOCITY].set(-age[which] * R_nb[of])
            slope = slope.at[rows, ATTITUDE].set(-(R_nb @ skew(lever - age[which] * x.nu[:3]))[of])
        return jnp.concatenate(residuals), slope

    def _place(self, x: Motion, R_nb: Array, lever: Array, age: Array) -> Array:
        """Of a sensor, some time ago, n [m], shape (3,)."""
        return x.position + R_nb @ (lever - age * x.nu[:3])


def _log_likelihood(away: Array, S: Array) -> Array:
    """Of an innovation of variance S that is `away` standard deviations, but for a constant; linear beyond FAR."""
    near = jnp.minimum(jnp.abs(away), FAR)
    return -0.5 * (jnp.log(S) + near * (2.0 * jnp.abs(away) - near))


def _learnt(log_noise: Array, alike: Array, logged: Array) -> Array:
    """Logarithm of the noise's variance after a step.

    Args:
        log_noise: Before it, shape (6,).
        alike: Product of normalised innovations and the mean of those before, shape (12,); zero on average if the
            noise is right.
        logged: Whether there was a velocity, bool; else depth and position have to do.
    """
    alike = alike * np.sqrt((2.0 - RECENT) / RECENT)  # of unit variance
    level = 0.5 * (alike[10] + alike[11])
    by_places = jnp.stack([LEARNING_SLOW * level, LEARNING_SLOW * level, LEARNING * alike[6]])
    linear = jnp.where(logged, LEARNING * alike[7:10], by_places)
    return jnp.clip(log_noise + jnp.concatenate([linear, LEARNING * alike[0:3]]), LEAST_NOISE, MOST_NOISE)
