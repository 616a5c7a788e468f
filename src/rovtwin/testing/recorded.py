"""Inputs of the parts of an autopilot, taken from a flight of the twin: what a block of one's own is tested on."""

from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import NO_REASON
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.interfaces import MODE_RUNNING, AllocationInput, ControlInput, GuidanceInput, Mode, ObserverInput

PARTS = ("observer", "guidance", "reference", "controller", "allocation")


def recorded_inputs(part: str, scenario: Any = "square", seconds: float = 1.0) -> Any:
    """What a part of the autopilot took, tick by tick, in a flight with our own blocks; leading axis ticks.

    Args:
        part: One of PARTS.
        scenario: As of `rovtwin.fly`.
        seconds: Of the flight, from its start [s].

    Raises:
        ConfigError: There is no such part, or the scenario cannot be flown.
    """
    from rovtwin.api import load_scenario
    from rovtwin.runs.compose.composition import compose
    from rovtwin.runs.run import chunks

    if part not in PARTS:
        raise ConfigError(f"recorded_inputs: found {part!r}, expected one of {', '.join(PARTS)}")
    composed = compose(load_scenario(scenario))
    dt = composed.scenario.control_dt
    records = list(chunks(composed.loop, composed.key, composed.start, dt, seconds))
    record = jax.tree.map(lambda *leaves: jnp.concatenate([jnp.asarray(leaf) for leaf in leaves]), *records)
    ticks = len(record.state.position)

    def always(tree: Any) -> Any:
        return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (ticks, *jnp.shape(leaf))), tree)

    flown, autopilot = record.autopilot, composed.loop.autopilot
    six = jnp.zeros((ticks, 6))
    running = always(Mode(jnp.asarray(MODE_RUNNING), jnp.asarray(NO_REASON)))
    made = {
        "observer": lambda: ObserverInput(record.measurements, flown.command),
        "guidance": lambda: GuidanceInput(flown.estimate, always(autopilot.mission), running),  # type: ignore[attr-defined]  (an Autopilot)
        "reference": lambda: flown.setpoint,
        "controller": lambda: ControlInput(flown.estimate, flown.reference, six, six + 1.0),
        "allocation": lambda: AllocationInput(flown.wrench.tau, flown.health, six + 1.0),
    }
    return made[part]()
