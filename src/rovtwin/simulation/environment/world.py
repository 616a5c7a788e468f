"""World: current, waves, surface and walls together, as the plant wants them."""

from collections.abc import Sequence

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Environment, Walls
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Index, PRNGKey, Scalar, Vector2, Vector3
from rovtwin.simulation.environment.current import Current, Flow
from rovtwin.simulation.environment.waves import WaveAction
from rovtwin.simulation.noise import key_for
from rovtwin.simulation.relief import Relief
from rovtwin.vehicle.physics.dynamics import State


class WorldMemory(eqx.Module):
    """Memories of the parts; None where there is no such part.

    `broken` is the first force that gave what is no number: 0 none, else 1 and its index; None without forces.
    """

    current: object
    waves: object
    forces: tuple[object, ...] = ()
    broken: Index | None = None


class World(Block):
    """The sea or the tank around a vehicle; what is None is not there.

    Attributes:
        current: `step(memory, position, dt) -> (memory, Flow)`.
        waves: `step(memory, State, dt) -> (memory, WaveAction)`.
        surface: Depth z in n of the still surface [m], 0 unless tides matter; None: water without end upwards.
        walls: Floor, the last of them, and walls.
        floor: Depth z in n of a level floor [m], for altimeters; its plane is among the walls.
        relief: Of a floor that is not level; the plane among the walls is then the one that touches it below CO.
        forces: What else acts on the hull: `step(memory, State, dt) -> (memory, wrench in b at CO [N, N m])`.
    """

    current: Current | None = None
    waves: Block | None = None
    surface: Scalar | None = None
    walls: Walls | None = None
    floor: Scalar | None = None
    relief: Relief | None = None
    forces: tuple[Block, ...] = ()

    def init(self, key: PRNGKey, start: Start) -> WorldMemory:
        """Memory of current, waves and forces, each with random numbers of its own."""
        return WorldMemory(
            None if self.current is None else self.current.init(key_for(key, "current"), start),
            None if self.waves is None else self.waves.init(key_for(key, "waves"), start),
            tuple(force.init(key_for(key, f"force {i}"), start) for i, force in enumerate(self.forces)),
            jnp.asarray(0) if self.forces else None,
        )

    def step(self, memory: WorldMemory, input: State, dt: float) -> tuple[WorldMemory, Environment]:
        """Environment of a vehicle in the state `input` over one physics step of `dt`."""
        current, water = None, Flow.still()
        waves, action = None, WaveAction()
        if self.current is not None:
            current, water = self.current.step(memory.current, input.position, dt)
        if self.waves is not None:
            waves, action = self.waves.step(memory.waves, input, dt)
        if action.flow is not None:
            water = water + action.flow
        force = jnp.zeros(3)
        if action.force is not None:
            force = action.force @ rotation_from_quaternion(input.attitude)
        wrench = jnp.concatenate([force, jnp.zeros(3)])
        forces, broken = [], memory.broken
        for i, (acting, before) in enumerate(zip(self.forces, memory.forces, strict=True)):
            after, added = acting.step(before, input, dt)
            forces.append(after)
            wrench = wrench + added
            # After the first the vehicle is nowhere, and the others are no numbers either.
            assert broken is not None
            broken = jnp.where((broken == 0) & ~jnp.all(jnp.isfinite(added)), i + 1, broken)
        surface = self.surface
        if surface is not None and action.elevation is not None:
            surface = surface - action.elevation
        walls, floor, slope = self.bounds_at(input.position)
        environment = Environment(
            velocity=water.velocity,
            rate=water.rate,
            wrench=wrench,
            place=input.position,
            gradient=water.gradient,
            head=action.head,
            surface=surface,
            walls=walls,
            floor=floor,
            slope=slope,
        )
        return WorldMemory(current, waves, tuple(forces), broken), environment

    def bounds_at(self, position: Vector3) -> tuple[Walls | None, Scalar | None, Vector2 | None]:
        """Walls, depth of the floor [m] and its slope, below a place."""
        if self.relief is None or self.walls is None:
            return self.walls, self.floor, None
        depth, slope = self.relief.under(position[:2])
        upright = jnp.append(-slope, 1.0)
        normal = upright / jnp.sqrt(upright @ upright)
        offset = normal @ jnp.append(position[:2], depth)
        normals, offsets = self.walls.normals, self.walls.offsets
        walls = Walls(jnp.concatenate([normals[:-1], normal[None]]), jnp.concatenate([offsets[:-1], offset[None]]))
        return walls, depth, slope

    def velocities(self, memory: WorldMemory, positions: Float[Array, "k 3"], dt: float) -> Float[Array, "k 3"]:
        """Of the current at places in n, at the start of the next step of dt; waves do not count."""
        if self.current is None:
            return jnp.zeros_like(positions)
        return self.current.velocities(memory.current, positions, dt)


Span = Sequence[float]


def walls_of(north: Span | None = None, east: Span | None = None, floor: float | None = None) -> Walls | None:
    """Planes of a tank whose sides run north and east, and of a level floor.

    Args:
        north: Its southern and northern end, or None [m].
        east: Its western and eastern end, or None [m].
        floor: Its depth, or None [m].

    Returns:
        None where there are none.
    """
    planes: list[tuple[tuple[float, float, float], float]] = []
    if north is not None:
        planes += [((-1.0, 0.0, 0.0), -north[0]), ((1.0, 0.0, 0.0), north[1])]
    if east is not None:
        planes += [((0.0, -1.0, 0.0), -east[0]), ((0.0, 1.0, 0.0), east[1])]
    if floor is not None:
        planes.append(((0.0, 0.0, 1.0), floor))
    if not planes:
        return None
    normals, offsets = zip(*planes, strict=True)
    return Walls(as_array(normals), as_array(offsets))
