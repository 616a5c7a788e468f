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
from jaxtyping import Float

from rovtwin.core.frames import (
    rotation_between,
    rotation_from_quaternion,
    skew,
)
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Flag, HostArray, Matrix3, Matrix6, Quaternion, Scalar, Vector3, Vector6
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
    """Readings of one step, averaged, or of many, along a leading axis.

    Attributes:
        target: Force to which the command sends each thruster, before its factor [N].
        gyro, attitude, depth, velocity, horizontal: As the sensors say; the attitude as a quaternion.
        variance: Of rows p q r, phi theta psi, depth, u v w, north east; inf where there is no reading.
        age: Of the five: how long before the end of the step they were taken on average [s].
    """

    target: Float[HostArray, "*steps n"]
    gyro: Float[HostArray, "*steps 3"]
    attitude: Float[HostArray, "*steps 4"]
    depth: Float[HostArray, "*steps 1"]
    velocity: Float[HostArray, "*steps 3"]
    horizontal: Float[HostArray, "*steps 2"]
    variance: Float[HostArray, "*steps 12"]
    age: Float[HostArray, "*steps 5"]


class Levers(eqx.Module):
    """Where the sensors of depth, velocity and position sit, from CO, b [m]."""

    depth: Vector3
    velocity: Vector3
    horizontal: Vector3


class Noise(eqx.Module):
    """The filter's estimate of the motion.

    Attributes:
        initial: Standard deviation of the error at the start.
        walk: White noise that drives it [unit/sqrt(s)]; that of nu is where learning starts.
    """

    initial: Float[Array, "23"] = eqx.field(converter=as_array)
    walk: Float[Array, "23"] = eqx.field(converter=as_array)


class Memory(eqx.Module):
    """Memory of the filter.

    Attributes:
        x: State.
        P: Covariance of its error.
        V: Derivative of its error by theta.
        thrust: Force of each thruster before its factor [N].
        log_noise: Logarithm of the learnt noise's variance, surge to yaw, against the start.
        nu_dot: Of the last step.
        recent: Mean of the last normalised innovations.
    """

    x: Motion
    P: Float[Array, "23 23"]
    V: Float[Array, "23 p"]
    thrust: Float[Array, " n"]
    log_noise: Vector6
    nu_dot: Vector6
    recent: Float[Array, "12"]


class Gathered(eqx.Module):
    """Normal equations about theta = 0 of some time.

    Attributes:
        A: Information.
        s: Right-hand side, A theta = s.
        far: How many innovations of each row were beyond FAR.
        count: How many there were.
        fit: Logarithm of the likelihood of the innovations, each no less likely than its tail beyond FAR.
    """

    A: Float[Array, "p p"]
    s: Float[Array, " p"]
    far: Float[Array, "12"]
    count: Float[Array, "12"]
    fit: Scalar


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

    def start(self, position: Vector3, attitude: Quaternion) -> Memory:
        """At a place and attitude (quaternion)."""
        x, P = Motion.at(position, attitude), jnp.diag(self.noise.initial**2)
        rest = jnp.zeros(self.model.thrusters.count)
        return Memory(x, P, jnp.zeros((ERRORS, self.factors)), rest, jnp.zeros(6), jnp.zeros(6), jnp.zeros(12))

    @eqx.filter_jit
    def over(self, memory: Memory, held: Float[Array, " p"], seen: Seen) -> tuple[Memory, Gathered]:
        """Through some steps with theta held.

        Args:
            memory: Before them.
            held: Theta.
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
    def held_at(self, memory: Memory, shift: Float[Array, " p"]) -> Memory:
        """The filter with factors that are held `shift` further on: the state moves as they say."""
        return eqx.tree_at(lambda m: m.x, memory, memory.x.moved(memory.V @ shift))

    def _predicted(self, memory: Memory, held: Float[Array, " p"], inverse: Matrix6, now: Seen) -> Memory:
        force = lag(self.model.thrusters, memory.thrust, now.target, self.h)
        middle = 0.5 * (memory.thrust + force)
        x, nu_dot, F, G = linearised(self.model, held, inverse, memory.x, middle, self.h)
        driven = self.noise.walk**2
        driven = driven.at[VELOCITY.start : RATE.stop].multiply(jnp.exp(memory.log_noise))
        P = F @ memory.P @ F.T + self.h * jnp.diag(driven)
        return Memory(x, P, F @ memory.V + G, force, memory.log_noise, nu_dot, memory.recent)

    def _corrected(self, memory: Memory, held: Float[Array, " p"], now: Seen) -> tuple[Memory, Gathered]:
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

    def _innovations(self, memory: Memory, now: Seen) -> tuple[Float[Array, "12"], Float[Array, "12 23"]]:
        """Readings less what is expected, and slopes of what is expected."""
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

    def _place(self, x: Motion, R_nb: Matrix3, lever: Vector3, age: Scalar) -> Vector3:
        """Of a sensor, some time ago, n [m]."""
        return x.position + R_nb @ (lever - age * x.nu[:3])


def _log_likelihood(away: Scalar, S: Scalar) -> Scalar:
    """Of an innovation of variance S that is `away` standard deviations, but for a constant; linear beyond FAR."""
    near = jnp.minimum(jnp.abs(away), FAR)
    return -0.5 * (jnp.log(S) + near * (2.0 * jnp.abs(away) - near))


def _learnt(log_noise: Vector6, alike: Float[Array, "12"], logged: Flag) -> Vector6:
    """Logarithm of the noise's variance after a step.

    Args:
        log_noise: Before it.
        alike: Product of normalised innovations and the mean of those before; zero on average if the noise is right.
        logged: Whether there was a velocity; else depth and position have to do.
    """
    alike = alike * np.sqrt((2.0 - RECENT) / RECENT)  # of unit variance
    level = 0.5 * (alike[10] + alike[11])
    by_places = jnp.stack([LEARNING_SLOW * level, LEARNING_SLOW * level, LEARNING * alike[6]])
    linear = jnp.where(logged, LEARNING * alike[7:10], by_places)
    return jnp.clip(log_noise + jnp.concatenate([linear, LEARNING * alike[0:3]]), LEAST_NOISE, MOST_NOISE)
