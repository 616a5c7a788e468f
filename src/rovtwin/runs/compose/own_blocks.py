"""Blocks of one's own in the model-based autopilot: by an address in the scenario, or handed over in Python.

What is named is a Block, a class of Blocks or a function that makes one. A class is made by its classmethod `of` where
it has one. `model`, `sensors` (Mounts by name) and `dt` are handed over to what has arguments of these names, beside
the scenario's `settings`.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from rovtwin.core.block import Block, Start
from rovtwin.core.contract import form_of, of_arrays, require_block, require_kind
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import NO_REQUEST, AutopilotInput, Command, Measurements
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.plugins import BLOCKS, OWN_SENSORS, load, module_of, require_there
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.guard import Guarded
from rovtwin.gnc.interfaces import AllocationInput, ControlInput, GuidanceInput, Mode, ObserverInput, output_of
from rovtwin.scenario.schema import ModelBasedSection, OwnSensorSection, Scenario
from rovtwin.scenario.schema.own_block import OwnBlock
from rovtwin.simulation.sensors.own import OwnSensorInput, seen_at
from rovtwin.simulation.sensors.sensor import Sensor, SensorInput
from rovtwin.simulation.twin import Twin
from rovtwin.vehicle import Model
from rovtwin.vehicle.physics.dynamics import State

PLACES = {"observer": "observer", "guidance": "guidance", "reference": "reference", "controller": "control",
          "allocation": "allocation"}  # fmt: skip
"""Key of the scenario's autopilot -> part of `Autopilot`."""


def with_own_blocks(
    autopilot: Autopilot,
    section: ModelBasedSection,
    given: Mapping[str, Block],
    offered: Mapping[str, Any],
    empty: Measurements,
    where: str,
) -> Autopilot:
    """The autopilot with the blocks that the section names in place of ours.

    Args:
        autopilot: Ours, complete.
        section: Of the scenario.
        given: Blocks that were handed over in Python, by key of the section.
        offered: `model`, `sensors`, `dt`.
        empty: Slots of the sensors.
        where: Of the section, for messages.

    Raises:
        ConfigError: A block cannot be found or made, or does not take and give what ours does.
    """
    named = {key: one for key, one in section.own_blocks.items() if key in PLACES}
    if not named:
        return autopilot
    inputs = _inputs(autopilot, empty)
    parts = {}
    for key, one in named.items():
        label = f"{where}.{key}"
        if one.given:
            block = _handed_over(key, one.given, given, label)
        else:
            block = made(one, offered, label)
        block = of_arrays(block, label)
        require_block(block, inputs[key], output_of(inputs[key]), offered["dt"], f"{label}: {one.label}")
        parts[PLACES[key]] = block
    return replace(autopilot, **parts, guarded=True)


def code_of(scenario: Scenario) -> dict[str, tuple[str, str]]:
    """Code of one's own that a scenario names, where: address or entry point, and group of the latter."""
    section = scenario.autopilot
    blocks = section.own_blocks if isinstance(section, ModelBasedSection) else {}
    named = {f"autopilot.{key}": (one.block, BLOCKS) for key, one in blocks.items()}
    named |= {f"world.forces[{i}]": (one.block, BLOCKS) for i, one in enumerate(scenario.world.forces)}
    named |= {f"sensors.{name}.kind": (one.kind, OWN_SENSORS) for name, one in scenario.sensors.own.items()}
    return {where: found for where, found in named.items() if found[0]}


def require_own_code(scenario: Scenario) -> None:
    """That a scenario's code of one's own may be run and is there, before anything is started that would run it.

    Raises:
        ConfigError: Nobody consented to it, or there is no such module, name or entry point.
    """
    for where, (text, group) in code_of(scenario).items():
        require_there(text, group, f"{scenario.name}: {where}")


def made(one: OwnBlock, offered: Mapping[str, Any], where: str, group: str = BLOCKS) -> Any:
    """What the class or function at an address makes of the offered things that it has arguments for, and of settings.

    Raises:
        ConfigError: It cannot be found, is nothing that makes Blocks, cannot be called so, or fails.
    """
    target, where = load(one.block, group, where), f"{where}: {one.block}"
    if isinstance(target, Block):
        if one.settings:
            raise ConfigError(f"{where}: found settings for a block that is made already, expected a class or function")
        return target
    _require_maker(target, module_of(one.block, group), where)
    maker: Callable[..., Any] = getattr(target, "of", target) if isinstance(target, type) else target
    try:
        names = inspect.signature(maker).parameters
        taken = {name: value for name, value in offered.items() if name in names and name not in one.settings}
        return maker(**taken, **one.settings)
    except ConfigError:
        raise
    except Exception as error:  # of somebody else's code: anything
        raise ConfigError(f"{where}: cannot be made: {type(error).__name__}: {error}") from error


def _require_maker(target: Any, module: str, where: str) -> None:
    """That something is a class of Blocks, or a function that the module itself defines: nothing else is called.

    What a module merely imports, such as a function of the operating system, is none of its blocks.

    Raises:
        ConfigError: It is neither.
    """
    expected = f"expected a rovtwin.Block with init and step, its class, or a function that {module} itself defines"
    if isinstance(target, type):
        if not issubclass(target, Block):
            raise ConfigError(f"{where}: found the class {target.__name__}, {expected}")
    elif not inspect.isfunction(target):
        raise ConfigError(f"{where}: found {type(target).__name__}, {expected}")
    elif target.__module__ != module:
        raise ConfigError(f"{where}: found a function of {target.__module__}, {expected}")


def forces_of(forces: Sequence[OwnBlock], plant: Model, start: Start, dt: float, where: str) -> tuple[Block, ...]:
    """Forces on the hull: each takes the State of the vehicle and gives a wrench, b at CO [N, N m], shape (6,).

    Args:
        forces: Of the scenario's world.
        plant: The vehicle as it truly is, which is handed over as `model`.
        start: Where the run begins.
        dt: Physics step [s].
        where: Of the forces, for messages.

    Raises:
        ConfigError: One cannot be found or made, or does not take and give that.
    """
    blocks = []
    for i, one in enumerate(forces):
        label = f"{where}[{i}]"
        if not one.block:
            raise ConfigError(f"{label}: found no block, expected package.module:Name, or an entry point of {BLOCKS}")
        offered = {"model": plant, "dt": dt}
        block = of_arrays(made(one, offered, label), label)
        require_block(block, State.at(plant, start), jnp.zeros(6), dt, f"{label}: {one.block}")
        blocks.append(block)
    return tuple(blocks)


def own_sensor(section: OwnSensorSection, where: str) -> Block:
    """A sensor of one's own: a Block with a `kind` that says what it reads.

    Raises:
        ConfigError: It cannot be found or made, or its kind is none.
    """
    block = of_arrays(made(OwnBlock(block=section.kind, settings=section.settings), {}, where, OWN_SENSORS), where)
    label = f"{where}: {section.kind}"
    if not isinstance(block, Block):
        raise ConfigError(f"{label}: found {type(block).__name__}, expected a rovtwin.Block with init and step")
    require_kind(getattr(block, "kind", None), label)
    return block


def require_own_sensors(scenario: Scenario, twin: Twin, start: Start, dt: float) -> None:
    """That each takes what a sensor sees and gives a reading of its kind, and keeps the form of its memory.

    Args:
        scenario: That names them.
        twin: With them on board.
        start: Where the run begins.
        dt: Physics step [s].

    Raises:
        ConfigError: One does not.
    """
    for name, sensor in twin.sensors.items():
        if sensor.own is None:
            continue

        def see(sensor: Sensor = sensor) -> OwnSensorInput:
            state = State.at(twin.model, start)
            _, environment = twin.world.step(twin.world.init(jax.random.key(0), start), state, dt)
            return seen_at(sensor, SensorInput(state, jnp.zeros(6), jnp.asarray(0), environment), dt)

        label = f"{scenario.name}: sensors.{name}: {scenario.sensors.own[name].kind}"
        require_block(sensor.own, jax.eval_shape(see), jnp.zeros(sensor.size), 1000.0 / sensor.rate, label)


def _inputs(autopilot: Autopilot, empty: Measurements) -> dict[str, Any]:
    """Form of what each place takes, in the order of the data."""
    six, of_thrusters, zero = jnp.zeros(6), jnp.zeros_like(autopilot.health), jnp.asarray(0)
    observed = ObserverInput(empty, Command(of_thrusters))
    estimate = output_of(observed)
    asked = GuidanceInput(estimate, autopilot.mission, Mode(zero, zero))
    setpoint = output_of(asked)
    return {
        "observer": observed,
        "guidance": asked,
        "reference": setpoint,
        "controller": ControlInput(estimate, output_of(setpoint), six, six),
        "allocation": AllocationInput(six, of_thrusters, six),
    }


def whole_autopilot(
    ours: Autopilot, section: ModelBasedSection, given: Mapping[str, Block], empty: Measurements, dt: float, where: str
) -> Block:
    """The autopilot, or one that was handed over in its place, which takes and gives what ours does and is watched.

    Raises:
        ConfigError: It does not.
    """
    if not section.given:
        return ours
    block = of_arrays(_handed_over("autopilot", section.given, given, where), where)
    input = AutopilotInput(empty, jnp.asarray(NO_REQUEST))
    alike = replace(ours, guarded=getattr(block, "guarded", False))  # one of ours with blocks in it says which failed
    _, _, output = form_of(alike, input, dt, where)
    require_block(block, input, output, dt, f"{where}: {section.given}")
    return Guarded(block)


def _handed_over(key: str, name: str, given: Mapping[str, Block], where: str) -> Block:
    if key not in given:
        raise ConfigError(
            f"{where}: found {name}, a block that was handed over in Python, expected it again by "
            "fly(.., autopilot=..), or the address of a class"
        )
    return given[key]


def separated(autopilot: Block | Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Block]]:
    """The section of a scenario that names what was handed over in Python, and the blocks by key of the section."""
    if isinstance(autopilot, Block):
        return {"type": "model_based", "given": _name_of(autopilot)}, {"autopilot": autopilot}
    blocks = {key: value for key, value in autopilot.items() if isinstance(value, Block)}
    return dict(autopilot) | {key: {"given": _name_of(block)} for key, block in blocks.items()}, blocks


def _name_of(block: Block) -> str:
    return f"{type(block).__module__}:{type(block).__qualname__}"
