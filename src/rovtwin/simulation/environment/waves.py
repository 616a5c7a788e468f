"""Waves: what the sea does to the water and to the vehicle, in models chosen by name.

Every wave model is a Block with `step(memory, state, dt) -> (memory, WaveAction)`. A model may move the water (`flow`:
orbital velocity and acceleration at the vehicle's depth, which the plant turns into forces) or push the vehicle
(`force`), or both. `ThesisWaves` only pushes.

Reference: thesis secs. 2.6.2 and 5.4; Fossen (2021), sec. 10.2 (linear wave response model).
"""

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.block import Block, Start
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Index, PRNGKey, RawKey, Scalar, Vector2, Vector3
from rovtwin.simulation.checks import (
    require,
    require_direction,
    require_not_negative,
    require_positive,
    require_shape,
)
from rovtwin.simulation.environment.current import Flow
from rovtwin.simulation.noise import normals, raw_key
from rovtwin.vehicle.physics.dynamics import State
from rovtwin.vehicle.physics.model import GRAVITY

DAMPING_RATIO = 0.26  # lambda, table 5.5
SEAS = {1: (0.27, 3.0), 2: (1.5, 5.7), 3: (4.1, 8.7)}  # table 5.6: set -> (H_s [m], T_z [s])


class WaveAction(eqx.Module):
    """What waves do over one step.

    Attributes:
        flow: Of the water at CO, or None where a model only pushes.
        force: On the vehicle at CO, n [N], or None where a model only moves the water.
        elevation: Of the surface above CO, positive up [m], or None where a model knows none.
        head: Dynamic pressure at CO as a height of water [m], or None.
    """

    flow: Flow | None = None
    force: Vector3 | None = None
    elevation: Scalar | None = None
    head: Scalar | None = None


def spectrum(
    omega: Float[Array, "*axes"], height: Float[Array, "#*axes"], period: Float[Array, "#*axes"]
) -> Float[Array, "*axes"]:
    """Modified Pierson-Moskowitz spectrum S(omega) [m2 s], one-sided, of any shape like omega.

    Args:
        omega: Wave frequency [rad/s], positive.
        height: H_s, significant wave height [m].
        period: T_z, average zero-crossing period [s].

    Reference: thesis (5.3), (5.4); Fossen (2021), sec. 10.2.
    """
    A, B = _spectrum_parameters(height, period)
    return A * omega**-5 * jnp.exp(-B * omega**-4)


def _spectrum_parameters(
    height: Float[Array, "*axes"], period: Float[Array, "*axes"]
) -> tuple[Float[Array, "*axes"], Float[Array, "*axes"]]:
    return 4.0 * jnp.pi**3 * height**2 / period**4, 16.0 * jnp.pi**3 / period**4


def filter_parameters(
    height: Float[Array, "*axes"], period: Float[Array, "*axes"], as_printed: bool = False
) -> tuple[Float[Array, "*axes"], Float[Array, "*axes"]]:
    """Frequency omega_0 [rad/s] and intensity sigma [m sqrt(s)] of the shaping filter.

    The filter shall peak where the spectrum does: omega_0 is the modal frequency (4B/5)^(1/4) and sigma = sqrt(max S).
    As printed, the thesis puts omega_0 at the zero-crossing frequency 2 pi / T_z, 1.41 times the modal one, and takes
    sigma there, 32 % too low. Reference: thesis (5.5), (5.6) and Fossen (2021), sec. 10.2.
    """
    _, B = _spectrum_parameters(height, period)
    omega = 2.0 * jnp.pi / period if as_printed else (0.8 * B) ** 0.25
    # Proportional to the height, and written so: a root of S would have no gradient in a calm.
    return omega, height * jnp.sqrt(spectrum(omega, jnp.ones_like(height), period))


def encounter_frequency(omega: Float[Array, "*axes"], speed_along: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    """|omega - omega^2 U cos(beta) / g| [rad/s] in deep water. Thesis (2.16); Fossen (2021), sec. 10.2.

    Args:
        omega: Wave frequency [rad/s].
        speed_along: U cos(beta), speed over ground in the direction in which the waves run [m/s]; running with the
            waves lowers the frequency.
    """
    return jnp.abs(omega - omega**2 * speed_along / GRAVITY)


class ThesisWavesMemory(eqx.Module):
    """Key and number of draws; filter state z [N]; drift on north and east [N]."""

    key: RawKey
    draws: Index
    filter: Vector2
    drift: Vector2


class ThesisWaves(Block):
    """The thesis's wave force: white noise through a second-order filter, plus a slow random drift (2.14), (2.15).

        F(s) = K_w s / (s^2 + 2 lambda omega_e s + omega_e^2) w(s),    K_w = 2 lambda omega_0 sigma

    It acts at CO along `direction`, and the drift on north and east; there is no force down and no moment. The thesis
    takes the spectrum of the wave *height* for that of a force: 1 N per metre, whatever the depth. That is a
    disturbance to test controllers against and not the physics of a submerged body. The white noise w has unit
    intensity, which gives |F(i omega)|^2 = S at the peak; as S is one-sided, the variance of the force is the area
    under |F|^2 over pi, and its rms about 0.6 of that of the surface, H_s / 4.

    Attributes:
        height: H_s [m].
        period: T_z [s].
        direction: Of propagation, from north towards east, world frame [rad]: 0 runs towards north.
        drift_intensity: Of the random walk, on north and on east [N/sqrt(s)].
        damping_ratio: lambda.
        gain: Force per wave height [N/m].
        as_printed: Frequency and intensity as the thesis prints them, see `filter_parameters`.
    """

    height: Scalar = eqx.field(converter=as_array)
    period: Scalar = eqx.field(converter=as_array)
    direction: Scalar = eqx.field(converter=as_array, default=0.0)
    drift_intensity: Vector2 = eqx.field(converter=as_array, default=(0.0, 0.0))
    damping_ratio: Scalar = eqx.field(converter=as_array, default=DAMPING_RATIO)
    gain: Scalar = eqx.field(converter=as_array, default=1.0)
    as_printed: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        require_not_negative("ThesisWaves.height", self.height)
        require_positive("ThesisWaves.period", self.period)
        require_direction("ThesisWaves.direction", self.direction)
        require_shape("ThesisWaves.drift_intensity", self.drift_intensity, (2,))
        require_not_negative("ThesisWaves.drift_intensity", self.drift_intensity)
        ratio = self.damping_ratio
        require("ThesisWaves.damping_ratio", ratio, lambda x: (x > 0) & (x < 1), "a ratio above 0 and below 1")

    def rms(self) -> Scalar:
        """Stationary rms of the wave force on a vehicle at rest [N], drift left out: K_w / sqrt(4 lambda omega_0)."""
        omega_0, _ = filter_parameters(self.height, self.period, self.as_printed)
        return self._deviation(omega_0)

    def _deviation(self, omega_e: Scalar) -> Scalar:
        omega_0, sigma = filter_parameters(self.height, self.period, self.as_printed)
        K_w = 2.0 * self.damping_ratio * omega_0 * sigma * self.gain
        return K_w / jnp.sqrt(4.0 * self.damping_ratio * omega_e)

    def init(self, key: PRNGKey, start: Start) -> ThesisWavesMemory:
        """Waves as they are long after they began (a stationary draw), no drift yet."""
        key = raw_key(key)
        zero = jnp.zeros((), dtype=jnp.int64)
        return ThesisWavesMemory(key, zero + 1, self.rms() * normals(key, zero, 2), jnp.zeros(2))

    def step(self, memory: ThesisWavesMemory, input: State, dt: float) -> tuple[ThesisWavesMemory, WaveAction]:
        """Force over the next `dt` on a vehicle in the state `input`; its speed sets the encounter frequency."""
        along = jnp.array([jnp.cos(self.direction), jnp.sin(self.direction), 0.0])
        velocity = rotation_from_quaternion(input.attitude) @ input.nu[:3]
        omega_0, _ = filter_parameters(self.height, self.period, self.as_printed)
        # At omega_e = 0 the filter is an integrator that never forgets; only a torpedo gets near.
        omega_e = jnp.maximum(encounter_frequency(omega_0, velocity @ along), 0.05 * omega_0)

        noise = normals(memory.key, memory.draws, 4)
        Phi, L = _transition(omega_e * dt, self.damping_ratio)
        filtered = Phi @ memory.filter + self._deviation(omega_e) * (L @ noise[:2])
        drift = memory.drift + self.drift_intensity * jnp.sqrt(dt) * noise[2:]

        force = memory.filter[1] * along + jnp.array([memory.drift[0], memory.drift[1], 0.0])
        after = ThesisWavesMemory(memory.key, memory.draws + 1, filtered, drift)
        return after, WaveAction(force=force)


def _transition(angle: Scalar, damping_ratio: Scalar) -> tuple[Float[Array, "2 2"], Float[Array, "2 2"]]:
    """Exact step of the shaping filter: Phi, and L with L L' = I - Phi Phi'.

    With the state z = [omega_e x, x_dot] of the oscillator the filter is

        z_dot = omega_e [[0, 1], [-1, -2 lambda]] z + [0, K_w] w,    output z_2.

    Its stationary covariance is K_w^2 / (4 lambda omega_e) I, and the noise over a step has that times I - Phi Phi'.
    The symmetric part of the matrix is never positive: without noise |z| cannot grow, however omega_e changes.

    Args:
        angle: omega_e dt [rad].
        damping_ratio: lambda, below 1.
    """
    damped = jnp.sqrt(1.0 - damping_ratio**2)
    decay = jnp.exp(-damping_ratio * angle)
    c, s = decay * jnp.cos(damped * angle), decay * jnp.sin(damped * angle) / damped
    Phi = jnp.array([[c + damping_ratio * s, s], [-s, c - damping_ratio * s]])
    g11 = 1.0 - Phi[0, 0] ** 2 - Phi[0, 1] ** 2
    g12 = -Phi[0, 0] * Phi[1, 0] - Phi[0, 1] * Phi[1, 1]
    g22 = 1.0 - Phi[1, 0] ** 2 - Phi[1, 1] ** 2
    # Factored from the lower right: g11 is of the order angle^3, and would be lost in rounding as a pivot.
    l22 = jnp.sqrt(g22)
    # The floor keeps the root real, and its gradient finite.
    l11 = jnp.sqrt(jnp.maximum(g11 - g12**2 / g22, 1e-30))
    return Phi, jnp.array([[l11, g12 / l22], [jnp.zeros_like(l22), l22]])
