"""The world section of a scenario as blocks: the true vehicle, and the water around it."""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Block
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import as_array
from rovtwin.core.types import PRNGKey
from rovtwin.scenario.schema import AirySection, ConstantCurrentSection, ShearedCurrentSection, WorldSection
from rovtwin.simulation.environment.airy import AirySea
from rovtwin.simulation.environment.current import ConstantCurrent, Current, GaussMarkovCurrent, ShearedCurrent
from rovtwin.simulation.environment.sea import SeaState
from rovtwin.simulation.environment.waves import ThesisWaves
from rovtwin.simulation.environment.world import World, walls_of
from rovtwin.simulation.mismatch import drawn, lifted, perturbed
from rovtwin.simulation.relief import Relief
from rovtwin.simulation.scene import Scene
from rovtwin.vehicle import Model, Vehicle


def plant_of(world: WorldSection, vehicle: Vehicle, model: Model, key: PRNGKey, truth: Model | None = None) -> Model:
    """The true vehicle: the model, put into the world's water, perturbed, lifted, with its faults.

    Water and net buoyancy are the plant's alone, as when a vehicle trimmed in a pool goes to sea. A given `truth`
    stands for the model in its water, perturbed.
    """
    plant = in_water(world, vehicle, model) if truth is None else truth
    if world.mismatch and truth is None:
        plant = perturbed(plant, key, world.mismatch.damping, world.mismatch.mass, world.mismatch.thrust)
    if world.thruster_health:
        whole = replace(vehicle, pairs_apart=False).thruster_names  # as the file has them: a pair is one
        names = [name if name in whole else name.rpartition("_")[0] for name in vehicle.thruster_names]
        for name in world.thruster_health:
            if name not in names:
                raise ConfigError(f"world.thruster_health: no thruster {name!r}; {vehicle.name} has {', '.join(names)}")
        health = as_array([world.thruster_health.get(name, 1.0) for name in names])
        plant = plant.replace(thrusters=replace(plant.thrusters, health=plant.thrusters.health * health))
    plant = lifted(plant, world.net_buoyancy)
    if float(plant.buoyancy) < 0:
        raise ConfigError(
            f"world.net_buoyancy: found {world.net_buoyancy:g} N, expected at least {-float(model.buoyancy):g} N: "
            f"{vehicle.name} has no more buoyancy to lose"
        )
    return plant


def mismatch_of(world: WorldSection, vehicle: Vehicle, model: Model, plant: Model) -> dict[str, float] | None:
    """The factors that a run's `mismatch` has put between model and plant (`drawn`); None without a mismatch."""
    return drawn(plant, in_water(world, vehicle, model)) if world.mismatch else None


def in_water(world: WorldSection, vehicle: Vehicle, model: Model) -> Model:
    """The vehicle's model in the world's water."""
    return model if world.water is None else vehicle.model(water_density=world.water.kg_per_m3)


def world_of(world: WorldSection, forces: tuple[Block, ...] = ()) -> World:
    """Current, waves, surface, floor and walls, with forces of one's own."""
    tank = world.tank
    return World(
        current=_current_of(world),
        waves=_waves_of(world),
        surface=as_array(0.0) if world.surface else None,
        walls=walls_of(tank and tank.north, tank and tank.east, world.floor),
        floor=None if world.floor is None else as_array(world.floor),
        relief=relief_of(world),
        forces=forces,
    )


def relief_of(world: WorldSection) -> Relief | None:
    """The floor's shape; None where it is level, or there is none."""
    if world.relief is None or world.floor is None:
        return None
    waves = [(one.amplitude, one.length, math.radians(one.direction_deg)) for one in world.relief.waves]
    relief, hills = Relief.of(world.floor, world.relief.slope, waves), world.relief.hills
    return relief if hills is None else relief.with_hills(hills.height, hills.length, hills.seed, hills.size)


def on_world_floor(scene: Scene, world: WorldSection) -> Scene:
    """A scene as a run has it: its bottom has depth and shape of the world's floor, where the world has one."""
    if world.floor is None:
        return scene
    return scene.on_floor(relief_of(world) or Relief.of(world.floor))


def _current_of(world: WorldSection) -> Current:
    current = world.current
    if isinstance(current, ConstantCurrentSection):
        return ConstantCurrent(current.velocity)
    if isinstance(current, ShearedCurrentSection):
        return ShearedCurrent(current.depths, current.velocities)
    return GaussMarkovCurrent(current.mean, current.sigma, current.time_constant)


def _waves_of(world: WorldSection) -> Block | None:
    waves = world.waves
    if waves is None:
        return None
    if isinstance(waves, AirySection):
        return airy_of(waves, world.floor)
    return ThesisWaves(
        waves.significant_height,
        waves.zero_crossing_period,
        direction=math.radians(waves.direction_deg),
        drift_intensity=(waves.drift, waves.drift),
        as_printed=waves.as_printed,
    )


def airy_of(waves: AirySection, floor: float | None) -> AirySea:
    """The sea of a section; it is as deep as the floor unless the section says otherwise.

    Raises:
        ConfigError: A sea that cannot be: too steep, or too high for the water.
    """
    sea = SeaState.of(
        waves.significant_height,
        zero_crossing_period=waves.zero_crossing_period,
        peak_period=waves.peak_period,
        gamma=waves.peak_enhancement,
        where="world.waves",
    )
    return AirySea.of(
        sea,
        direction=math.radians(waves.direction_deg),
        depth=waves.depth or floor,
        spreading=waves.spreading,
        count=waves.components,
        where="world.waves",
    )


def current_at(world: WorldSection, depth: float) -> Float[np.ndarray, "2"]:
    """Mean horizontal current at a depth [m], n [m/s]."""
    current = world.current
    if isinstance(current, ConstantCurrentSection):
        return np.asarray(current.velocity[:2], dtype=float)
    if isinstance(current, ShearedCurrentSection):
        velocities = np.asarray(current.velocities, dtype=float)
        return np.array([np.interp(depth, current.depths, velocities[:, i]) for i in (0, 1)])
    return np.asarray(current.mean[:2], dtype=float)
