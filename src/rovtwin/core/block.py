"""Block: anything with memory that ticks (observer, controller, reference model, guidance, sensor, current, waves).

A Block's fields are parameters and never change. What changes is its memory, a pytree whose structure, shapes and types
stay the same from tick to tick, so that the same block runs in a compiled roll-out, in the real-time loop, batched over
a thousand vehicles and under a gradient. One contract test, `tests/test_block_contract.py`, holds them all.
"""

import abc
from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.numerics import as_array, module_for
from rovtwin.core.types import PRNGKey, Quaternion, Scalar, Vector3, Vector6


class Start(eqx.Module):
    """Where a run begins: what a block may know before its first tick.

    Attributes:
        position: CO in n [m].
        attitude: Quaternion R_nb.
        velocity: nu, body frame at CO [m/s, rad/s].
        position_std: Standard deviation of north and of east [m]; 0 where the place is known exactly, as in the twin.
    """

    position: Vector3
    attitude: Quaternion
    velocity: Vector6
    position_std: Scalar = eqx.field(converter=as_array, default=0.0)

    @classmethod
    def at(cls, position: object = (0.0, 0.0, 0.0), heading: float = 0.0) -> "Start":
        """At rest, level, at a position [m] and heading [rad]."""
        xp = module_for(heading)
        half = 0.5 * xp.asarray(heading)
        attitude = as_array(xp.stack([xp.cos(half), xp.zeros(()), xp.zeros(()), xp.sin(half)]))
        return cls(as_array(position), attitude, as_array(np.zeros(6)))


class Block(eqx.Module):
    """Immutable parameters with `init(key, start) -> memory` and `step(memory, input, dt) -> (memory, output)`."""

    @abc.abstractmethod
    def init(self, key: PRNGKey, start: Start) -> Any:
        """Memory before the first tick; `key` seeds all randomness of the block."""

    @abc.abstractmethod
    def step(self, memory: Any, input: Any, dt: float) -> tuple[Any, Any]:
        """One tick of `dt` seconds; pure: the same arguments give the same result, nothing else changes."""
