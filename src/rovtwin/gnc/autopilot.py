"""Autopilot: observer, supervisor, guidance, reference model, control and allocation as one Block."""

from typing import Any, Literal

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import AutopilotInput, AutopilotOutput, Command, Estimate, Mission, Reference, Wrench
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.gnc.allocation import Allocation, AllocationInput, Saturation
from rovtwin.gnc.control import ControlInput, Pid
from rovtwin.gnc.guidance import Guidance, GuidanceInput, GuidanceMemory
from rovtwin.gnc.observer import ObserverInput
from rovtwin.gnc.reference import ReferenceModel
from rovtwin.gnc.supervisor import Mode, Supervisor, SupervisorInput, is_finite
from rovtwin.vehicle.model import Model

NEGLIGIBLE = 1e-6  # what allocation leaves by rounding [N, N m]

Gains = Literal["table_7_1", "table_3_2", "pole_placement"]


class AutopilotMemory(eqx.Module):
    """Memories of the parts, the last command u (n_thrusters,), and what limits took of the last wrench, (6,)."""

    observer: Any
    supervisor: Mode
    guidance: GuidanceMemory
    reference: Reference
    control: Any
    allocation: Any
    command: Command
    shortfall: Array


class Autopilot(Block):
    """From measurements to thruster commands, once a tick.

    The parts are Blocks: any of them may be replaced by another that takes and gives the same. Thrusters are off
    while idle and once aborted; paused and finished hold station. A command is a number, always: whatever becomes
    of the estimate, the supervisor aborts on it and zeros go out.
    """

    observer: Block
    supervisor: Supervisor
    guidance: Block
    reference: Block
    control: Block
    allocation: Block
    mission: Mission
    health: Array

    @classmethod
    def thesis(
        cls,
        model: Model,
        observer: Block,
        mission: Mission,
        gains: Gains = "table_7_1",
        saturation: Saturation = "scale",
        obey_speed: bool = False,
        supervisor: Supervisor | None = None,
    ) -> "Autopilot":
        """The thesis's autopilot, the baseline that others must beat.

        Args:
            model: What allocation and gains are computed from.
            observer: Takes ObserverInput, gives Estimate.
            mission: Way-points.
            gains: The thesis's tables as printed, or from the model by pole placement.
            saturation: What allocation does at the thrusters' limits.
            obey_speed: Whether the reference model keeps to the way-points' speeds; the thesis's does not.
            supervisor: Limits; None is the default ones.
        """
        makers = {
            "table_7_1": lambda: Pid.table_7_1(model),
            "table_3_2": Pid.table_3_2,
            "pole_placement": lambda: Pid.pole_placement(model),
        }
        if gains not in makers:
            raise ValueError(f"gains is {gains!r}, expected one of {', '.join(makers)}")
        return cls(
            observer=observer,
            supervisor=supervisor or Supervisor(),
            guidance=Guidance(),
            reference=ReferenceModel.thesis(obey_speed),
            control=makers[gains](),
            allocation=Allocation.of(model, saturation=saturation),
            mission=mission,
            health=model.thrusters.health,
        )

    def init(self, key: Array, start: Start) -> AutopilotMemory:
        names = ("observer", "supervisor", "guidance", "reference", "control", "allocation")
        keys = jax.random.split(key, len(names))
        parts = {name: getattr(self, name).init(k, start) for name, k in zip(names, keys, strict=True)}
        return AutopilotMemory(**parts, command=Command(jnp.zeros_like(self.health)), shortfall=jnp.zeros(6))

    def step(
        self, memory: AutopilotMemory, input: AutopilotInput, dt: float
    ) -> tuple[AutopilotMemory, AutopilotOutput]:
        observer, estimate = self.observer.step(memory.observer, ObserverInput(input.measurements, memory.command), dt)
        supervisor, mode = self.supervisor.step(memory.supervisor, SupervisorInput(estimate, input.request), dt)
        guidance, setpoint = self.guidance.step(memory.guidance, GuidanceInput(estimate, self.mission, mode), dt)
        reference, path = self.reference.step(memory.reference, setpoint, dt)

        on = mode.active
        feedback = ControlInput(_usable(estimate), path, memory.shortfall)
        control, wanted = self.control.step(memory.control, feedback, dt)
        tau = jnp.where(on, wanted.tau, 0.0)
        allocation, allocated = self.allocation.step(memory.allocation, AllocationInput(tau, self.health), dt)
        # A controller that is off starts afresh: no integral survives an abort or a wait.
        control = jax.tree.map(lambda new, old: jnp.where(on, new, old), control, memory.control)

        command, shortfall = allocated.command, allocated.shortfall
        wrench = Wrench(tau, on & (wanted.saturated | (jnp.abs(shortfall) > NEGLIGIBLE)))
        after = AutopilotMemory(observer, supervisor, guidance, reference, control, allocation, command, shortfall)
        return after, AutopilotOutput(command, estimate, setpoint, path, wrench)


def _usable(estimate: Estimate) -> Estimate:
    """The estimate, or zeros where it is not a number: thrusters are off then, and no memory catches it."""
    fine = is_finite(estimate)
    return jax.tree.map(lambda leaf: jnp.where(fine, leaf, jnp.zeros_like(leaf)), estimate)
