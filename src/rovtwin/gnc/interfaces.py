"""What the blocks of an autopilot give to each other, so that none of them imports another one's file.

What also flows through the loop outside the autopilot (measurements, estimate, set-point, command) is in `core.flow`.
"""

from typing import Any

import equinox as eqx
from jaxtyping import Bool

from rovtwin.core.flow import Command, Estimate, Measurements, Mission, Reference, Setpoint, Wrench
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import Flag, Index, PerThruster, Vector6

MODES = ("idle", "running", "piloted", "paused", "holding", "returning", "surfacing", "aborted")


MODE_IDLE, MODE_RUNNING, MODE_PILOTED, MODE_PAUSED = range(4)


MODE_HOLDING, MODE_RETURNING, MODE_SURFACING, MODE_ABORTED = range(4, len(MODES))


class Mode(eqx.Module):
    """One of MODES, and one of core.flow.REASONS, that says why it is not the operator's."""

    mode: Index
    reason: Index

    @property
    def active(self) -> Flag:
        """Whether thrusters may be used: in every mode but idle and aborted."""
        return (self.mode != MODE_IDLE) & (self.mode != MODE_ABORTED)


class ObserverInput(eqx.Module):
    """What an observer takes in one tick: the readings since the last tick and the command that was sent over it."""

    measurements: Measurements
    command: Command


class GuidanceInput(eqx.Module):
    """Where the vehicle is assumed to be, where it should go, and whether it may."""

    estimate: Estimate
    mission: Mission
    mode: Mode


class ControlInput(eqx.Module):
    """What a controller takes.

    Attributes:
        estimate: Where the vehicle is assumed to be.
        reference: Where it should be.
        shortfall: Wrench asked for less wrench allocated in the last tick: what limits took away.
        axes: 0 along roll and pitch where the thrusters that are left cannot push alone, else 1.
    """

    estimate: Estimate
    reference: Reference
    shortfall: Vector6
    axes: Vector6 = eqx.field(default_factory=lambda: jnp.ones(6))


class AllocationInput(eqx.Module):
    """What allocation takes.

    Attributes:
        tau: Desired wrench, b at CO [N, N m].
        health: Share of its force that each thruster still gives: 1 sound, 0 lost.
        axes: 0 along roll and pitch where the thrusters that are left cannot push alone, else 1.
    """

    tau: Vector6
    health: PerThruster
    axes: Vector6 = eqx.field(default_factory=lambda: jnp.ones(6))


class Allocated(eqx.Module):
    """What allocation gives.

    Attributes:
        command: For the thrusters.
        made: Wrench that the thrusters settle at with it, b at CO [N, N m].
        residual: Desired less made.
        shortfall: The part of it that limits and lost thrusters took: what an integral must not wind up on. The rest is
            what thrusters too near to standstill keep back, which an integral has to overcome.
        limited: Whether a thruster is at a limit, of force or of rate; a lost one is not.
    """

    command: Command
    made: Vector6
    residual: Vector6
    shortfall: Vector6
    limited: Bool[Array, " n"]


def output_of(input: Any) -> Any:
    """What the block that takes such an input gives, as zeros of its shapes and types; None: no part of an autopilot.

    Args:
        input: Of one tick, arrays or `jax.ShapeDtypeStruct`s.
    """
    three, four, six = jnp.zeros(3), jnp.zeros(4), jnp.zeros(6)
    zero, no = jnp.zeros((), int), jnp.asarray(False)
    if isinstance(input, ObserverInput):
        sensors = jnp.zeros(len(input.measurements))
        return Estimate(three, four, six, six, jnp.zeros((12, 12)), sensors, sensors)
    if isinstance(input, GuidanceInput):
        return Setpoint(three, four, six, three, three, no, zero, zero, zero)
    if isinstance(input, Setpoint):
        return Reference(three, four, three, three, three, three)
    if isinstance(input, ControlInput):
        return Wrench(six, jnp.zeros(6, bool))
    if isinstance(input, AllocationInput):
        thrusters = input.health.shape
        return Allocated(Command(jnp.zeros(thrusters)), six, six, six, jnp.zeros(thrusters, bool))
    return None
