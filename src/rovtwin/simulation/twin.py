"""Twin: the plant in its world, with its sensors; what a Link to a simulated vehicle talks to."""

from dataclasses import replace
from typing import Any

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command, Environment, Measurements, Slot
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.types import Flag, Index, PerThruster, PRNGKey, Vector6
from rovtwin.simulation.battery import Battery, BatteryInput, BatteryState, forces_within
from rovtwin.simulation.environment.world import World, WorldMemory
from rovtwin.simulation.events.attitude_restraint import AttitudeRestraint
from rovtwin.simulation.events.faults import FaultInput, Faults, weakened
from rovtwin.simulation.noise import key_for
from rovtwin.simulation.sensors.sensor import PHYSICS_RATE, Sensor, SensorInput, SensorMemory, put
from rovtwin.simulation.tether.tether import Pull, Tether, TetherInput, TetherMemory
from rovtwin.vehicle.physics.dynamics import State, acceleration, inflow_of, plant_step
from rovtwin.vehicle.physics.model import Model


class TwinInput(eqx.Module):
    """`command` held over the control tick, and its number `k` from 0: an int that is never batched."""

    command: Command
    k: Index | int


class TwinMemory(eqx.Module):
    """State of the plant, and the memories of world, sensors, faults and batteries (None without), and tethers."""

    state: State
    world: WorldMemory
    sensors: dict[str, SensorMemory]
    faults: PerThruster | None = None
    battery: BatteryState | None = None
    tethers: dict[str, TetherMemory] = eqx.field(default_factory=dict)


class TwinOutput(eqx.Module):
    """What happened in one control tick.

    Attributes:
        state: Truth at its end.
        nu_dot: Rate of nu there [m/s2, rad/s2].
        environment: Water and external wrench over its last physics step.
        measurements: Readings delivered within it, in order of arrival.
    """

    state: State
    nu_dot: Vector6
    environment: Environment
    measurements: Measurements


class Twin(Block):
    """A simulated vehicle. One step is one control tick: `substeps` physics steps under one command.

    Sensors see the state after each physics step, so that tick k (from 0, lasting dt) returns readings that were valid
    in (k dt, (k + 1) dt]; there is none at time zero, where the start is known. An autopilot that reads first and
    commands then uses the measurements of tick k - 1 for the command of tick k.

    For many vehicles: `jax.vmap(twin.step, in_axes=(0, TwinInput(0, None), None))`, and `eqx.filter_vmap` where the
    parameters differ too; k stays one number for all.

    Attributes:
        model: The true plant, which need not be the autopilot's model.
        world: Current and waves.
        sensors: By name; each draws random numbers of its own, whatever others there are.
        substeps: Physics steps in a control tick, int.
        faults: Of thrusters and tethers, and leaks, or None; sensors have their own.
        battery: What feeds the thrusters, or None: they never stop.
        tethers: By name.
        hand: What tilts the vehicle before a decay test, or None.
    """

    model: Model
    world: World
    sensors: dict[str, Sensor]
    substeps: int = eqx.field(static=True, default=10)
    faults: Faults | None = None
    battery: Battery | None = None
    tethers: dict[str, Tether] = eqx.field(default_factory=dict)
    hand: AttitudeRestraint | None = None

    def init(self, key: PRNGKey, start: Start) -> TwinMemory:
        """At the start, thrusters at rest."""
        world = self.world.init(key_for(key, "world"), start)
        h = 1.0 / PHYSICS_RATE  # before the first step no current depends on how long it will be
        return TwinMemory(
            State.at(self.model, start),
            world,
            {name: sensor.init(key_for(key, f"sensor {name}"), start) for name, sensor in self.sensors.items()},
            None if self.faults is None else self.faults.init(key_for(key, "faults"), start),
            None if self.battery is None else self.battery.init(key_for(key, "battery"), start),
            {
                name: tether.settled(start, lambda places: self.world.velocities(world, places, h))
                for name, tether in self.tethers.items()
            },
        )

    def empty(self) -> Measurements:
        """A slot for each sensor, without readings, of the capacity that one control tick can need."""
        return {name: Slot.empty(s.capacity(self.substeps), s.size) for name, s in self.sensors.items()}

    def step(self, memory: TwinMemory, input: TwinInput, dt: float) -> tuple[TwinMemory, TwinOutput]:
        """One control tick of `dt` seconds."""
        h = dt / self.substeps
        first = jnp.asarray(input.k, dtype=jnp.int64) * self.substeps
        faults, leak, snagged, command, model = None, None, {}, input.command, self.model
        if self.faults is not None and memory.faults is not None:
            faults, fault = self.faults.step(memory.faults, FaultInput(command, input.k), dt)
            leak, snagged, command, model = fault.leak, fault.snagged, fault.command, weakened(model, fault.share)
        battery, energy = memory.battery, None
        if self.battery is not None and battery is not None:
            model, energy = weakened(model, self.battery.alive(battery)), battery.telemetry
        tethers, pulls = self._pull(memory, snagged, dt)

        def substep(carry: tuple[TwinMemory, TwinOutput], j: Index) -> tuple[tuple[TwinMemory, TwinOutput], Any]:
            memory, output = carry
            k = first + j
            world, environment = self.world.step(memory.world, memory.state, h)
            for name, tether in self.tethers.items():
                wrench = environment.wrench + tether.wrench(pulls[name], memory.state, j * h, h)
                environment = replace(environment, wrench=wrench)
            if self.hand is not None:
                wrench = environment.wrench + self.hand.wrench(model, memory.state, k * h)
                environment = replace(environment, wrench=wrench)
            state = plant_step(model, memory.state, command, environment, h)
            nu_dot = self._nu_dot(k, j, state, environment, output.nu_dot, h)
            seen = SensorInput(state, nu_dot, k, environment, energy, leak)
            sensors, measurements = self._sense(memory, output, seen, first, h)
            after = replace(memory, state=state, world=world, sensors=sensors)
            thrust = None if battery is None else state.thrust
            return (after, TwinOutput(state, nu_dot, environment, measurements)), thrust

        # Carried through the scan so that the last one comes out; its structure is the world's.
        shape = jax.eval_shape(lambda m: self.world.step(m.world, m.state, h)[1], memory)
        environment = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shape)
        nothing = TwinOutput(memory.state, jnp.zeros(6), environment, self.empty())
        begin = replace(memory, faults=faults, tethers=tethers)
        (after, output), thrust = jax.lax.scan(jax.checkpoint(substep), (begin, nothing), jnp.arange(self.substeps))
        if self.battery is not None and battery is not None:
            forces = forces_within(model.thrusters, command, memory.state.thrust, thrust, h)
            after = replace(after, battery=self.battery.step(battery, BatteryInput(forces), dt)[0])
        return after, output

    def _pull(
        self, memory: TwinMemory, snagged: dict[str, Flag], dt: float
    ) -> tuple[dict[str, TetherMemory], dict[str, Pull]]:
        """All tethers over one control tick."""
        memories, pulls = {}, {}
        for name, tether in self.tethers.items():
            before = memory.tethers[name]
            water = self.world.velocities(memory.world, before.line.nodes, dt / self.substeps)
            seen = TetherInput(memory.state, water, snagged.get(name, jnp.asarray(False)))
            memories[name], pulls[name] = tether.step(before, seen, dt)
        return memories, pulls

    def _nu_dot(self, k: Index, j: Index, state: State, environment: Environment, last: Vector6, h: float) -> Vector6:
        """Acceleration at the end of physics step k; computed when an accelerometer reads it, or as output."""
        needed = j == self.substeps - 1
        for sensor in self.sensors.values():
            if sensor.kind == "accelerometer":
                needed = needed | sensor.ticks(k)
        tau = self.model.thrusters.configuration @ state.thrust

        def now() -> Vector6:
            inflow = inflow_of(self.model, state.thrust)
            return acceleration(self.model, state.position, state.attitude, state.nu, tau, environment, h, inflow)

        return jax.lax.cond(needed, now, lambda: last)

    def _sense(
        self, memory: TwinMemory, output: TwinOutput, seen: SensorInput, first: Index, h: float
    ) -> tuple[dict[str, SensorMemory], Measurements]:
        """All sensors over one physics step; what they deliver goes into the tick's slots, row by row."""
        memories, measurements = {}, {}
        for name, sensor in self.sensors.items():
            memories[name], reading = sensor.step(memory.sensors[name], seen, h)
            slots = output.measurements[name]
            before = sensor.delivered_before(seen.k)
            due = sensor.delivered_before(seen.k + 1) > before
            row = before - sensor.delivered_before(first)
            measurements[name] = put(slots, reading, due & (jnp.arange(slots.valid.shape[0]) == row))
        return memories, measurements
