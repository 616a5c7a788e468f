"""World: current and waves together, as the plant wants them."""

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Environment
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, jnp
from rovtwin.simulation.current import Flow
from rovtwin.simulation.noise import key_for
from rovtwin.simulation.waves import WaveAction
from rovtwin.vehicle.dynamics import State


class WorldMemory(eqx.Module):
    """Memories of the parts; None where there is no such part."""

    current: object
    waves: object


class World(Block):
    """The sea: a current and waves, each a Block or None.

    Attributes:
        current: `step(memory, position, dt) -> (memory, Flow)`.
        waves: `step(memory, State, dt) -> (memory, WaveAction)`.
    """

    current: Block | None = None
    waves: Block | None = None

    def init(self, key: Array, start: Start) -> WorldMemory:
        """Memory of current and waves, each with random numbers of its own."""
        return WorldMemory(
            None if self.current is None else self.current.init(key_for(key, "current"), start),
            None if self.waves is None else self.waves.init(key_for(key, "waves"), start),
        )

    def step(self, memory: WorldMemory, input: State, dt: float) -> tuple[WorldMemory, Environment]:
        """Environment of a vehicle in the state `input` over one physics step of `dt`.

        A particle of water that moves down through a shear changes its velocity even in a steady current, so that
        D v_c / Dt is the local rate plus w_c d v_c / d depth; horizontal gradients are left out.
        """
        current, flow = None, Flow.still()
        waves, action = None, WaveAction(Flow.still(), jnp.zeros(3))
        if self.current is not None:
            current, flow = self.current.step(memory.current, input.position, dt)
        if self.waves is not None:
            waves, action = self.waves.step(memory.waves, input, dt)
        water = flow + action.flow
        force = action.force @ rotation_from_quaternion(input.attitude)
        environment = Environment(
            water.velocity,
            water.acceleration + water.velocity[2] * water.shear,
            water.shear,
            jnp.concatenate([force, jnp.zeros(3)]),
        )
        return WorldMemory(current, waves), environment
