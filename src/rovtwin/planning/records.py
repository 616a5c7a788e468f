"""Tests flown by the twin, as the Records that identification takes: one, or hundreds of vehicles side by side."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Key

from rovtwin.core.arrays.batch import batched
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import ABORTED, REASONS, Slot
from rovtwin.core.log import Log
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.sensors import SENSORS
from rovtwin.core.types import Index
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.identification.logs.rotations import in_body, std_in_body
from rovtwin.runs.compose.composition import Simulation, compose, keys_of
from rovtwin.runs.compose.experiment import spans_of
from rovtwin.runs.fly import fly
from rovtwin.runs.loop import Loop, LoopMemory, stack
from rovtwin.runs.run import ticks_in
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

CHUNK = 10.0  # simulated time between looks from outside [s]


def experiment_logs(scenario: Scenario, seeds: Sequence[int] = (1,)) -> list[Log]:
    """Logs of a test flown with several seeds, in memory, compiled once; the same as `rovtwin fly` writes."""
    return [fly(scenario.model_copy(update={"seed": seed})).log for seed in seeds]


def experiment_records(
    scenario: Scenario,
    plants: Model | None = None,
    seeds: Sequence[int] = (1,),
    progress: Callable[[float], None] = lambda share: None,
) -> list[list[Record]]:
    """Fly one test with many vehicles side by side, compiled once.

    Args:
        scenario: The test; its seed does not count.
        plants: The true vehicles, a leading axis of length len(seeds) on every array; None: the scenario's own.
        seeds: Of each vehicle's sensor noise.
        progress: Called with the share of the work done, 0 to 1.

    Returns:
        For each vehicle its Records, in order: a test is cut where a hand tilts the vehicle, which no model knows of.

    Raises:
        ConfigError: The scenario is no test, or a vehicle left its limits.
    """
    if scenario.test is None:
        raise ConfigError(f"{scenario.name}: is a mission, expected a test (a section 'test' in place of 'mission')")
    first = compose(scenario)
    scenario = first.scenario
    plants = stack([_plant(scenario, first, seed) for seed in seeds]) if plants is None else plants
    found = len(jax.tree.leaves(plants)[0])
    if found != len(seeds):
        raise ConfigError(f"{scenario.name}: found {found} plants for {len(seeds)} seeds, expected one seed for each")
    loop, dt = first.loop, scenario.control_dt
    memories = _begin(loop, plants, stack([keys_of(seed)[1] for seed in seeds]), first.start, control_dt=dt)
    ticks, total = ticks_in(CHUNK, dt), int(loop.autopilot.timeline.count)  # type: ignore[attr-defined]  (an Experiment)
    kept: list[Any] = []
    for k in range(0, total, ticks):
        memories, given = _advance(loop, plants, memories, jnp.asarray(k), ticks=ticks, control_dt=dt)
        kept.append(jax.device_get(given))
        progress(min(1.0, (k + ticks) / total))
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=1)[:, :total], *kept)
    flown = [scenario.model_copy(update={"seed": seed}) for seed in seeds]
    return [records_of(first, one, jax.tree.map(lambda leaf, i=i: leaf[i], whole)) for i, one in enumerate(flown)]


def _plant(scenario: Scenario, first: Simulation, seed: int) -> Model:
    """The true vehicle of a seed; without mismatch they are all the same."""
    one = first if scenario.world.mismatch is None else compose(scenario.model_copy(update={"seed": seed}))
    return one.loop.twin.model


def _with_plant(loop: Loop, plant: Model) -> Loop:
    return eqx.tree_at(lambda one: one.twin.model, loop, plant)


@partial(jax.jit, static_argnames="control_dt")
def _begin(loop: Loop, plants: Model, keys: Key[Array, " vehicles"], start: Any, control_dt: float) -> LoopMemory:
    return jax.vmap(lambda plant, key: _with_plant(loop, plant).init(key, start, control_dt))(plants, keys)


@partial(jax.jit, static_argnames=("ticks", "control_dt"), donate_argnames="memories")
def _advance(
    loop: Loop, plants: Model, memories: LoopMemory, k: Index, ticks: int, control_dt: float
) -> tuple[LoopMemory, Any]:
    """`ticks` control ticks of all vehicles; what identification may see of them, leading axes (vehicle, tick)."""

    def fly_one(plant: Model, memory: LoopMemory) -> tuple[LoopMemory, Any]:
        own = _with_plant(loop, plant)

        def one(carry: LoopMemory, i: Index) -> tuple[LoopMemory, Any]:
            after, record = own.tick(carry, i, control_dt)
            setpoint = record.autopilot.setpoint
            return after, (record.autopilot.command.u, record.measurements, setpoint.phase, setpoint.reason)

        return jax.lax.scan(one, memory, k + jnp.arange(ticks))

    return batched(fly_one)(plants, memories)


def records_of(run: Simulation, scenario: Scenario, given: Any) -> list[Record]:
    """The Records of one vehicle.

    Args:
        run: Its sensors and what it is.
        scenario: The test that it flew.
        given: Commands, readings, phases and reasons, leading axis ticks.

    Raises:
        ConfigError: It was aborted.
    """
    command, measurements, phase, reason = given
    dt = scenario.control_dt
    if (phase == ABORTED).any():
        k = int(np.argmax(phase == ABORTED))
        raise ConfigError(
            f"{scenario.name}, seed {scenario.seed}: aborted after {k * dt:.0f} s ({REASONS[int(reason[k])]}); "
            "use smaller commands, or other limits in autopilot.supervisor"
        )
    water = scenario.world.water
    whole = Record(
        name=scenario.name,
        t_command=np.arange(len(command)) * dt,
        command=command,
        signals={
            SENSORS[name].signal: _signal(run, name, slot)
            for name, slot in measurements.items()
            if name in SENSORS and SENSORS[name].signal  # of several of a kind the first
        },
        end=len(command) * dt,
        water_density=run.vehicle.assembly.density if water is None else water.kg_per_m3,
        tether_length=run.paid_out,
        source=f"{scenario.name}, seed {scenario.seed}",
    )
    return [whole.cut(start, end) for start, end in free_spans(scenario)]


def _signal(run: Simulation, name: str, slot: Slot) -> Signal:
    """Readings as the reader of a log gives them: along the axes of b, with the noise that is declared."""
    sensor, signal = run.white_sensors[name], SENSORS[name].signal
    valid, rotation = np.asarray(slot.valid), np.asarray(sensor.rotation)
    value = in_body(signal, np.asarray(slot.value)[valid], rotation)
    sigma = std_in_body(signal, np.asarray(sensor.noise), rotation)
    return Signal(np.asarray(slot.t_valid)[valid], value, sigma, np.asarray(sensor.lever))


def free_spans(scenario: Scenario) -> list[tuple[float, float]]:
    """From and to [s] of what was flown without a hand on the vehicle, in order."""
    free: list[tuple[float, float]] = []
    for span in spans_of(scenario):
        if span["hand"]:
            continue
        if free and abs(free[-1][1] - span["start"]) < 1e-9:
            free[-1] = (free[-1][0], span["end"])
        else:
            free.append((span["start"], span["end"]))
    return free
