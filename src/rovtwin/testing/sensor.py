"""The contract of a sensor of one's own: that of a Block, with a `kind` and one reading of that kind at a time."""

from typing import Any

from rovtwin.core.block import Block, Start
from rovtwin.core.contract import of_arrays, require_block, require_kind
from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.sensors.own import OwnSensorInput, kind_of_block, seen_at
from rovtwin.simulation.sensors.sensor import SensorInput, usual_sensor
from rovtwin.testing.block import check_block
from rovtwin.vehicle.physics.dynamics import State

TICKS = 40


def check_sensor(block: Block, scenario: Any = "square", *, differentiable: bool = True) -> None:
    """Hold a block to what a sensor has to keep: its kind, one reading of that kind, and the contract of all blocks.

    Args:
        block: What the scenario's `kind` makes.
        scenario: In whose world it reads, as of `rovtwin.fly`.
        differentiable: As of `check_block`.

    Raises:
        AssertionError: It breaks a clause.
    """
    assert isinstance(block, Block), f"found {type(block).__name__}, expected a rovtwin.Block"
    inputs = sensor_inputs(block, scenario)
    kind = kind_of_block(block)
    one = jax.tree.map(lambda leaf: leaf[0], inputs)
    try:
        require_block(of_arrays(block, "parameters"), one, jnp.zeros(kind.size), 1.0 / kind.rate_hz, "sensor")
    except ConfigError as error:
        raise AssertionError(str(error)) from error
    check_block(block, inputs, dt=1.0 / kind.rate_hz, differentiable=differentiable)


def sensor_inputs(block: Block, scenario: Any = "square") -> OwnSensorInput:
    """What a sensor at CO sees, reading by reading, of a vehicle on a helix from 1 m to 3 m depth; leading axis ticks.

    Raises:
        AssertionError: The block's `kind` is none.
        ConfigError: The scenario cannot be composed.
    """
    from rovtwin.api import load_scenario
    from rovtwin.runs.compose.composition import compose

    try:
        require_kind(getattr(block, "kind", None), type(block).__name__)
    except ConfigError as error:
        raise AssertionError(str(error)) from error
    composed = compose(load_scenario(scenario))
    twin, dt = composed.loop.twin, composed.scenario.control_dt / composed.scenario.substeps
    sensor = usual_sensor("own", own=block)
    memory = twin.world.init(jax.random.key(0), composed.start)

    def see(share: Any) -> OwnSensorInput:
        angle = 2.0 * jnp.pi * share
        place = jnp.stack([2.0 * jnp.cos(angle), 2.0 * jnp.sin(angle), 1.0 + 2.0 * share])
        attitude = quaternion_from_euler(jnp.stack([0.2 * jnp.sin(angle), 0.1 * jnp.cos(angle), angle]))
        start = Start(place, attitude, jnp.array([0.4, 0.1, 0.1, 0.0, 0.0, 0.2]))
        state = State.at(twin.model, start)
        _, environment = twin.world.step(memory, state, dt)
        return seen_at(sensor, SensorInput(state, jnp.zeros(6), jnp.round(5000.0 * share), environment), dt)

    return jax.vmap(see)(jnp.linspace(0.0, 1.0, TICKS))
