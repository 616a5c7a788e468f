"""Line of sight: the heading that brings a vehicle back to its path when it cannot push sideways.

    los    chi = pi - atan(e / Delta)
    ilos   chi = pi - atan((e + kappa y) / Delta),       y_dot = Delta e / (Delta^2 + (e + kappa y)^2)
    alos   chi = pi - beta - atan(e / Delta),            beta_dot = gamma Delta e / sqrt(Delta^2 + e^2)

pi is the path's direction, e the cross-track error (to starboard positive), Delta the look-ahead. In a current across
the path `los` stays off by about Delta tan(beta), beta being the crab angle; the other two learn it.

Reference: Fossen (2021), sec. 12.4; Caharija et al. (2016), Integral line-of-sight guidance and control of
underactuated marine vehicles, IEEE Trans. Control Syst. Technol. 24 (`ilos`); Fossen (2023), An adaptive line-of-sight
guidance law for path following of aircraft and marine craft, IEEE Trans. Control Syst. Technol. 31 (`alos`).
"""

from typing import Any, Literal, get_args

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.frames import wrap
from rovtwin.core.numerics import Array, as_array, jnp

Kind = Literal["los", "ilos", "alos"]


class SteeringInput(eqx.Module):
    """Cross-track error [m], to starboard positive; direction of the path [rad]; whether the vehicle moves along it."""

    error: Array
    direction: Array
    going: Array


class Steering(Block):
    """Gives the heading [rad], shape (); memory is what was learnt: y of `ilos` [s], beta of `alos` [rad].

    Attributes:
        look_ahead: Delta [m].
        gain: kappa of `ilos` [m/s], gamma of `alos` [1/(m s)]; 0 for `los`.
        adaptive: Whether it is `alos`, bool.
        most: Largest crab angle that is learnt [rad].
    """

    look_ahead: Array = eqx.field(converter=as_array)
    gain: Array = eqx.field(converter=as_array)
    adaptive: Array = eqx.field(converter=jnp.asarray)
    most: Array = eqx.field(converter=as_array, default=1.0)

    @classmethod
    def of(cls, kind: Kind = "alos", look_ahead: Any = 2.0) -> "Steering":
        """By name, with gains that settle a few look-aheads' way behind the error.

        Raises:
            ValueError: There is none of that name.
        """
        if kind not in get_args(Kind):
            raise ValueError(f"kind is {kind!r}, expected one of {', '.join(get_args(Kind))}")
        return cls(look_ahead, {"los": 0.0, "ilos": 0.2, "alos": 0.05}[kind], kind == "alos")

    def init(self, key: Array, start: Start) -> Array:
        return jnp.zeros(())

    def step(self, memory: Array, input: SteeringInput, dt: float) -> tuple[Array, Array]:
        e, ahead = input.error, self.look_ahead
        seen = e + jnp.where(self.adaptive, 0.0, self.gain * memory)
        beta = jnp.where(self.adaptive, memory, 0.0)
        heading = wrap(input.direction - beta - jnp.arctan(seen / ahead))
        growth = jnp.where(
            self.adaptive,
            self.gain * ahead * e / jnp.sqrt(ahead**2 + e**2),
            jnp.where(self.gain > 0.0, ahead * e / (ahead**2 + seen**2), 0.0),
        )
        bound = jnp.where(self.adaptive, self.most, ahead * jnp.tan(self.most) / jnp.maximum(self.gain, 1e-9))
        after = jnp.clip(memory + jnp.where(input.going, growth * dt, 0.0), -bound, bound)
        return after, heading
