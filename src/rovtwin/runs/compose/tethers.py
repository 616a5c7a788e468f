"""The tethers of a scenario as blocks: the vehicle's cables, anchored and paid out as the scenario says."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import as_array
from rovtwin.scenario.schema import TetherSection, WorldSection
from rovtwin.simulation.tether.cable import Cable
from rovtwin.simulation.tether.tether import SHORTEST, Tether
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.constants import FRESH_WATER, GRAVITY
from rovtwin.vehicle.description.schema import Tether as TetherItem
from rovtwin.vehicle.description.totals.assembly import Mounted


def tethers_of(world: WorldSection, vehicle: Vehicle, start: Start) -> dict[str, Tether]:
    """Connected tethers by name, in logs' spelling.

    Raises:
        ConfigError: The vehicle has none, or one cannot reach from its anchor to the vehicle at the start.
    """
    section = world.tethers
    if section is None:
        return {}
    names = [mounted.name for mounted in vehicle.tethers]
    if not names:
        raise ConfigError(
            f"world.tethers: {vehicle.name} has no tether; add one to its file (tethers: [{{name: tether, length: 100, "
            "diameter: 0.005}]) or leave world.tethers out"
        )
    for name in section.by_name:
        if name not in names:
            raise ConfigError(f"world.tethers.by_name: no tether {name!r}; {vehicle.name} has {', '.join(names)}")
    density = vehicle.assembly.density if world.water is None else world.water.kg_per_m3
    made = {}
    for mounted in vehicle.tethers:
        how = section.of(mounted.name)
        if how.connected:
            made[mounted.name.replace(".", "_")] = _tether(mounted, how, world, start, density)
    return made


def _tether(mounted: Mounted, how: TetherSection, world: WorldSection, start: Start, density: float) -> Tether:
    item = mounted.item
    assert isinstance(item, TetherItem)
    where = f"world.tethers, '{mounted.name}'"
    attachment = mounted.placement.point(np.array(item.position))
    R_nb = np.asarray(rotation_from_quaternion(start.attitude))
    place = np.asarray(start.position) + R_nb @ attachment
    anchor = np.array(how.anchor or _above(np.asarray(start.position), world))
    if world.floor is not None and anchor[2] > world.floor:
        raise ConfigError(f"{where}: its anchor is {anchor[2]:g} m deep, below the floor at {world.floor:g} m")
    length = item.length if how.paid_out == "tended" else how.paid_out
    distance = float(np.linalg.norm(place - anchor))
    if length > item.length:
        raise ConfigError(f"{where}: paid_out is {length:g} m, but there are {item.length:g} m on the drum")
    if length < max(distance, SHORTEST):
        raise ConfigError(
            f"{where}: {length:g} m is too short: the start is {distance:.4g} m from the anchor; pay out more "
            f"(at least {SHORTEST:g} m), or move the anchor or the start"
        )
    displaced = 0.25 * np.pi * item.diameter**2 * GRAVITY
    cable = Cable(
        item.diameter,
        wet_weight=item.wet_weight - (density - FRESH_WATER) * displaced,
        normal_drag=item.normal_drag,
        tangential_drag=item.tangential_drag,
        stiffness=item.stiffness,
        density=density,
        surface=as_array(0.0) if world.surface else None,
        floor=None if world.floor is None else as_array(world.floor),
    )
    return Tether(cable, anchor, attachment, length, as_array(how.slack) if how.paid_out == "tended" else None)


def _above(place: Float[np.ndarray, "3"], world: WorldSection) -> list[float]:
    """At the surface above a place; in a tank, at the wall nearest to it."""
    north, east = float(place[0]), float(place[1])
    if world.tank is not None:
        walls = [(abs(north - wall), wall, east) for wall in world.tank.north]
        walls += [(abs(east - wall), north, wall) for wall in world.tank.east]
        _, north, east = min(walls)
    return [north, east, 0.0]
