"""A twin moved on by one control period from Python: compiled once, and kept between processes."""

from typing import Any

from jaxtyping import Float

from rovtwin.core.flow import Command, Measurements
from rovtwin.core.frames import euler_from_quaternion
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.programs.compiled import in_one_piece
from rovtwin.core.types import Index, PerThruster
from rovtwin.simulation.twin import Twin, TwinInput


def _moved(
    twin: Twin, memory: Any, u: PerThruster, k: Index, dt: float
) -> tuple[Any, Measurements, Float[Array, "10"]]:
    memory, moved = twin.step(memory, TwinInput(Command(u), k), dt)
    state, water = moved.state, moved.environment
    surface = jnp.zeros(1) if water.surface is None else jnp.reshape(water.surface, 1)
    truth = jnp.concatenate([state.position, euler_from_quaternion(state.attitude), water.velocity, surface])
    return memory, moved.measurements, truth


step_twin = in_one_piece(_moved, static_argnames="dt")
"""`step_twin(twin, memory, u, k, dt=)`: memory after control period k with command u, readings within it, and the truth
then: eta [m, rad], velocity of the water, n [m/s], depth of its surface above CO [m], 0 without one."""
