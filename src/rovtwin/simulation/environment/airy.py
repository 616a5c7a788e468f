"""A real sea: linear (Airy) waves, whose orbital motion the vehicle feels at its depth.

A sum of n long-crested waves with random phases. With theta = k . x - omega t + phase, depth z and water depth h,

    elevation    a cos(theta)                        C = cosh(k (h - z)) / sinh(k h)
    along        a omega C cos(theta)                S = sinh(k (h - z)) / sinh(k h)
    down        -a omega S sin(theta)                omega^2 = g k tanh(k h)
    head         a C omega^2 / (g k) cos(theta)

and from these the rate at a fixed place and the gradient. All is taken where the vehicle is: the frequency of
encounter, and the Stokes drift of what is carried round, come by themselves. The plant makes forces of it: drag of the
orbital velocity, Froude-Krylov and added-mass force of the acceleration.

What it is not: a second-order sea. There is no set-down, no return flow under the Stokes drift, no mean drift force of
waves that a body scatters (small for a body that is small against the wave length). Above the mean surface the water
moves as at z = 0, the same at all heights: there it turns, and is not free of divergence. Waves shorter than the
vehicle, which reach no deeper than decimetres, push it too much.

Nor do the waves ride on a current. They keep their frequency at a fixed place (no Doppler shift, no change of height),
while the water that carries them runs at U: its particles gain U . grad(u) of acceleration that the pressure of the
waves does not account for, so that the Froude-Krylov force and `head` disagree by k U / omega, which is 10 % for
0.3 m/s along waves of 2 s.

Reference: Fossen (2021), sec. 10.2; Newman (1977), Marine Hydrodynamics, secs. 6.2-6.4.
"""

import math
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Index, Matrix3, PRNGKey, Scalar, ScalarLike, Vector3
from rovtwin.simulation.checks import require_finite, require_not_negative, require_positive, require_shape
from rovtwin.simulation.environment.current import Flow
from rovtwin.simulation.environment.sea import SeaState, components, wavenumber
from rovtwin.simulation.environment.waves import WaveAction
from rovtwin.simulation.noise import raw_key
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.dynamics import State

COMPONENTS = 64
BREAKING = 0.6  # Hs over the depth above which there is no such sea; single waves break at 0.78 of it
# Taylor coefficients in the squared angle, for angles up to pi/2: the last terms are below 1e-16.
_SINE = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(11))
_COSINE = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(12))


class AiryMemory(eqx.Module):
    """Phase of each component at time zero [rad]; steps since then."""

    phase: Float[Array, " n"]
    steps: Index


class Water(eqx.Module):
    """The moving water at a place, in n.

    Attributes:
        velocity: [m/s].
        rate: Of the velocity at that place [m/s2].
        gradient: d v_i / d x_j [1/s].
        elevation: Of the surface above, positive up [m].
        head: Dynamic pressure as a height of water [m].
    """

    velocity: Vector3
    rate: Vector3
    gradient: Matrix3
    elevation: Scalar
    head: Scalar


class AirySea(Block):
    """Random-phase sum of linear waves. `AirySea.of` makes one from a spectrum.

    Attributes:
        amplitude: Of each component [m].
        omega: Frequency [rad/s].
        wavenumber: k [1/m].
        direction: Where it runs to, from north towards east, world frame [rad].
        depth: Of the water [m], or None: deep.
    """

    amplitude: Float[Array, " n"] = eqx.field(converter=as_array)
    omega: Float[Array, " n"] = eqx.field(converter=as_array)
    wavenumber: Float[Array, " n"] = eqx.field(converter=as_array)
    direction: Float[Array, " n"] = eqx.field(converter=as_array)
    depth: Scalar | None = None

    def __check_init__(self):
        require_not_negative("AirySea.amplitude", self.amplitude)
        for name in ("omega", "wavenumber"):
            require_positive(f"AirySea.{name}", getattr(self, name))
            require_shape(f"AirySea.{name}", getattr(self, name), self.amplitude.shape)
        require_finite("AirySea.direction", self.direction)
        require_shape("AirySea.direction", self.direction, self.amplitude.shape)
        if self.depth is not None:
            require_positive("AirySea.depth", self.depth)

    @classmethod
    def of(cls, sea: SeaState, *, direction: float = 0.0, depth: float | None = None,
           spreading: float | None = None, count: int = COMPONENTS, where: str = "AirySea") -> "AirySea":  # fmt: skip
        """A sea of a spectrum.

        Args:
            sea: The spectrum.
            direction: Where the waves run to, from north towards east, world frame [rad]: 0 runs towards north.
            depth: Of the water [m]; None is deep.
            spreading: s of the spreading function cos^2s; None: all waves run the same way.
            count: Number of components.
            where: Begins the messages.

        Raises:
            ConfigError: A direction in degrees, too few components, waves higher than the water is deep.
        """
        if not abs(direction) <= 2 * np.pi:
            raise ConfigError(
                f"{where}.direction: found {direction:g}, expected an angle from -2 pi to 2 pi in radians "
                "(this looks like degrees)"
            )
        if count < 2:
            raise ConfigError(f"{where}.components: found {count}, expected 2 or more")
        if spreading is not None and not 0 < spreading <= 100:
            raise ConfigError(f"{where}.spreading: found {spreading:g}, expected an s of cos^2s above 0, at most 100")
        if depth is not None and not (depth > 0 and np.isfinite(depth)):
            raise ConfigError(f"{where}.depth: found {depth}, expected a depth above 0, or None for deep water")
        if depth is not None and sea.height > BREAKING * depth:
            raise ConfigError(
                f"{where}.depth: Hs {sea.height:g} m in {depth:g} m of water: such waves break. "
                f"Expected Hs of at most {BREAKING:g} of the depth"
            )
        waves = components(sea, count, direction, spreading)
        return cls(
            waves.amplitude,
            waves.omega,
            wavenumber(waves.omega, depth),
            waves.direction,
            None if depth is None else as_array(depth),
        )

    def init(self, key: PRNGKey, start: Start) -> AiryMemory:
        """Random phases."""
        phase = jax.random.uniform(raw_key(key), self.amplitude.shape, dtype=jnp.float64, maxval=2.0 * jnp.pi)
        return AiryMemory(phase, jnp.zeros((), dtype=jnp.int64))

    def step(self, memory: AiryMemory, input: State, dt: float) -> tuple[AiryMemory, WaveAction]:
        """What the sea does where the vehicle is, over the next `dt`.

        All is looked at half-way through the step, where the vehicle will be: rate and gradient are held, and those of
        the start would lag behind by half a step, which a body without drag integrates to a drift.
        """
        velocity = rotation_from_quaternion(input.attitude) @ input.nu[:3]
        half_way = input.position + 0.5 * dt * velocity
        water = self.at(memory.phase, (memory.steps + 0.5) * dt, half_way)
        at_start = water.velocity - 0.5 * dt * (water.rate + water.gradient @ velocity)
        flow = Flow(at_start, water.rate, water.gradient)
        after = AiryMemory(memory.phase, memory.steps + 1)
        return after, WaveAction(flow=flow, elevation=water.elevation, head=water.head)

    def at(self, phase: Float[Array, " n"], t: ScalarLike, place: Vector3) -> Water:
        """The sea of the phases at time t [s] and a place in n [m]."""
        a, omega, k = self.amplitude, self.omega, self.wavenumber
        north, east = jnp.cos(self.direction), jnp.sin(self.direction)
        cosine, sine = _cosine_sine(k * (north * place[0] + east * place[1]) - omega * t + phase)
        C, S = self.decay(jnp.maximum(place[2], 0.0))
        speed, acceleration, slope = a * omega, a * omega**2, a * omega * k
        # One product for all sums over the same function of time: this runs in every physics step.
        u, v, head = jnp.stack([north * speed, east * speed, acceleration / (GRAVITY * k)]) @ (C * cosine)
        rates = jnp.stack([north, east, -k / omega * north**2, -k / omega * north * east, -k / omega * east**2])
        u_dot, v_dot, xx, xy, yy = (rates * acceleration) @ (C * sine)
        w_dot, xz, yz = jnp.stack([acceleration, -north * slope, -east * slope]) @ (S * cosine)
        w = -speed @ (S * sine)
        under = place[2] > 0.0  # above, nothing changes with height
        x_z, y_z, z_z = xz * under, yz * under, -(xx + yy) * under
        return Water(
            jnp.stack([u, v, w]),
            jnp.stack([u_dot, v_dot, w_dot]),
            jnp.stack([xx, xy, x_z, xy, yy, y_z, xz, yz, z_z]).reshape(3, 3),
            a @ cosine,
            head,
        )

    def decay(self, z: Scalar) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """C and S at a depth z [m], in exponentials that cannot overflow."""
        falling = jnp.exp(-jnp.minimum(self.wavenumber * z, 300.0))
        if self.depth is None:
            return falling, falling
        bottom = jnp.exp(-2.0 * self.wavenumber * self.depth)
        rising, scale = bottom / falling, 1.0 / (1.0 - bottom)
        return (falling + rising) * scale, (falling - rising) * scale


def _cosine_sine(angle: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Both to 1e-15 of one reduced angle: a seventh of the time of the library's, which work number by number."""
    turns = angle * (0.5 / jnp.pi)
    half = jnp.pi * (turns - jnp.round(turns))
    square = half * half
    sine, cosine = _polynomial(_SINE, square) * half, _polynomial(_COSINE, square)
    return 1.0 - 2.0 * sine * sine, 2.0 * sine * cosine


def _polynomial(coefficients: tuple[float, ...], x: Float[Array, " n"]) -> Float[Array, " n"]:
    value: Any = coefficients[-1]
    for c in coefficients[-2::-1]:
        value = value * x + c
    return value
