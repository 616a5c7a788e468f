"""Autopilot: observer, supervisor, guidance, reference model, control and allocation as one Block."""

from typing import Any, Literal

import equinox as eqx
from jaxtyping import Bool, Float

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    ARM,
    AutopilotInput,
    AutopilotOutput,
    Command,
    Estimate,
    Measurements,
    Mission,
    Reference,
    Setpoint,
    Wrench,
)
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Flag, Index, PerThruster, PRNGKey, Vector3, Vector6
from rovtwin.gnc.control.reference_model import ReferenceModel
from rovtwin.gnc.guard import checked, kept, masked, nothing, retried
from rovtwin.gnc.guidance.course_keeping import CourseInput, CourseKeeping, CourseMemory
from rovtwin.gnc.guidance.terrain_following import TerrainFollowing, TerrainInput, TerrainMemory
from rovtwin.gnc.interfaces import AllocationInput, ControlInput, GuidanceInput, ObserverInput
from rovtwin.gnc.safety.contingency import Contingency, ContingencyInput, ContingencyMemory
from rovtwin.gnc.safety.control_authority import FINE, ControlAuthority
from rovtwin.gnc.safety.rules import SupervisorInput, is_finite
from rovtwin.gnc.safety.supervisor import Supervisor, SupervisorMemory
from rovtwin.gnc.safety.thruster_diagnosis import HealthInput, HealthMemory, ThrusterHealth
from rovtwin.gnc.thesis.allocation import Allocation, Saturation
from rovtwin.gnc.thesis.los_guidance import Guidance
from rovtwin.gnc.thesis.pid import Pid
from rovtwin.vehicle.physics.model import Model

PILOT_COMMAND_LIFE = 0.5  # a pilot's command older than this counts no more [s]
NEGLIGIBLE = 1e-6  # what allocation leaves by rounding [N, N m]

Gains = Literal["table_7_1", "table_3_2", "pole_placement"]


class AutopilotMemory(eqx.Module):
    """Memories of the parts; the last command, what limits took of the last wrench, where they cut it, the
    place of the last set-point, and which guarded block has failed (see `guard.checked`).
    """

    observer: Any
    monitor: HealthMemory | None
    terrain: TerrainMemory | None
    supervisor: SupervisorMemory
    guidance: Any
    contingency: ContingencyMemory
    course: CourseMemory | None
    reference: Reference
    control: Any
    allocation: Any
    command: Command
    shortfall: Vector6
    saturated: Bool[Array, "6"]
    desired_position: Vector3
    failed: Index | None = None


class Autopilot(Block):
    """From measurements to thruster commands, once a tick.

    The parts are Blocks: any of them may be replaced by another that takes and gives the same. Thrusters are off
    while idle and once aborted; paused and finished hold station. Off is a wrench of zero, to which our allocation
    may go as fast as thrusters can; with somebody else's parts the command itself is zero at once. A command is a
    number, always: whatever becomes of the estimate, the supervisor aborts on it and zeros go out.

    Attributes:
        observer, supervisor, guidance, contingency, reference, control, allocation: Blocks, in the order of the data.
        mission: Way-points.
        health: Share of its force that each thruster has from the start.
        monitor: Finds thrusters that are lost on the way; without one all count as sound.
        ability: What can be done without them; None with `monitor`.
        terrain: Turns altitudes of way-points into depths; None where there are none.
        course: Makes of a set-point one that can be followed without sway; None for a vehicle that crabs.
        guarded: Whether parts are somebody else's: what they give is looked at, and what is no number aborts. The
            estimate stays what it is, and who arms again tries them again.
    """

    observer: Block
    supervisor: Supervisor
    guidance: Block
    contingency: Contingency
    reference: Block
    control: Block
    allocation: Block
    mission: Mission
    health: PerThruster
    monitor: ThrusterHealth | None = None
    ability: ControlAuthority | None = None
    terrain: TerrainFollowing | None = None
    course: CourseKeeping | None = None
    guarded: bool = eqx.field(static=True, default=False)

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
            supervisor: Rules; None is the default ones.
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
            contingency=Contingency.of(model),
            reference=ReferenceModel.thesis(obey_speed),
            control=makers[gains](),
            allocation=Allocation.of(model, saturation=saturation),
            mission=mission,
            health=model.thrusters.health,
        )

    def init(self, key: PRNGKey, start: Start) -> AutopilotMemory:
        names = (
            *("observer", "supervisor", "guidance", "reference", "control", "allocation", "contingency", "monitor"),
            *("terrain", "course"),
        )
        keys = jax.random.split(key, len(names))
        blocks = [(name, getattr(self, name), k) for name, k in zip(names, keys, strict=True)]
        parts: dict[str, Any] = {name: None if block is None else block.init(k, start) for name, block, k in blocks}
        none, free, command = jnp.zeros(6), jnp.zeros(6, dtype=bool), Command(jnp.zeros_like(self.health))
        failed = jnp.asarray(0) if self.guarded else None
        return AutopilotMemory(
            **parts,
            command=command,
            shortfall=none,
            saturated=free,
            desired_position=start.position,
            failed=failed,
        )

    def step(
        self, memory: AutopilotMemory, input: AutopilotInput, dt: float
    ) -> tuple[AutopilotMemory, AutopilotOutput]:
        observer, estimate = self.observer.step(memory.observer, ObserverInput(input.measurements, memory.command), dt)
        failed = retried(memory.failed, input.request)
        monitor, health, ability, axes = self._monitored(memory, estimate, input.request, dt)
        fell_short = memory.shortfall, ability, memory.saturated
        watched = SupervisorInput(
            estimate, input.request, input.measurements, input.host, *fell_short, memory.desired_position, _any(failed)
        )
        supervisor, mode = self.supervisor.step(memory.supervisor, watched, dt)
        known = _usable(estimate)
        terrain, mission = self._over_ground(memory.terrain, input.measurements, known, dt)
        guidance, asked = self.guidance.step(memory.guidance, GuidanceInput(known, mission, mode), dt)
        failed, asked = checked(failed, "guidance", asked)
        contingency, setpoint = self.contingency.step(
            memory.contingency, ContingencyInput(asked, known, mode, _fresh(input)), dt
        )
        place = setpoint.position  # before course keeping puts it beside the vehicle
        course, setpoint = self._steered(memory.course, setpoint, known, dt)
        reference, path = self.reference.step(memory.reference, setpoint, dt)
        failed, path = checked(failed, "reference", path)

        on = mode.active if failed is None else mode.active & (failed == 0)
        feedback = ControlInput(known, path, memory.shortfall, axes)
        control, desired = self.control.step(memory.control, feedback, dt)
        failed, desired = checked(failed, "controller", desired)
        tau = jnp.where(on, desired.tau, 0.0)
        allocation, allocated = self.allocation.step(memory.allocation, AllocationInput(tau, health, axes), dt)
        failed, allocated = checked(failed, "allocation", allocated)
        # A controller that is off starts afresh: no integral survives an abort or a wait.
        control = jax.tree.map(lambda new, old: jnp.where(on, new, old), control, memory.control)

        command, shortfall = masked(failed, mode, allocated.command), allocated.shortfall
        theirs = guidance, reference, control, allocation
        guidance, reference, control, allocation = kept(
            failed, theirs, (memory.guidance, memory.reference, memory.control, memory.allocation)
        )
        wrench = Wrench(tau, on & (desired.saturated | (jnp.abs(shortfall) > NEGLIGIBLE)))
        after = AutopilotMemory(
            observer,
            monitor,
            terrain,
            supervisor,
            guidance,
            contingency,
            course,
            reference,
            control,
            allocation,
            command,
            jnp.where(on, shortfall, 0.0),
            on & desired.saturated,
            place,
            failed,
        )
        return after, AutopilotOutput(command, estimate, setpoint, path, wrench, health, failed)

    def _over_ground(
        self, memory: TerrainMemory | None, measurements: Measurements, estimate: Estimate, dt: float
    ) -> tuple[TerrainMemory | None, Mission]:
        """The mission with depths where it asks for altitudes."""
        if self.terrain is None or memory is None:
            return None, self.mission
        return self.terrain.step(memory, TerrainInput(measurements, estimate, self.mission), dt)

    def _steered(
        self, memory: CourseMemory | None, setpoint: Setpoint, estimate: Estimate, dt: float
    ) -> tuple[CourseMemory | None, Setpoint]:
        """The set-point, with heading and surge for a vehicle that cannot push sideways."""
        if self.course is None or memory is None:
            return None, setpoint
        return self.course.step(memory, CourseInput(setpoint, estimate), dt)

    def _monitored(
        self, memory: AutopilotMemory, estimate: Estimate, request: Index, dt: float
    ) -> tuple[HealthMemory | None, PerThruster, Index, Vector6]:
        """The monitor's memory, health of each thruster, what can be done with it, and on which axes.

        An operator who arms wants to try thrusters again that were given up.
        """
        if self.monitor is None or self.ability is None or memory.monitor is None:
            return None, self.health, jnp.asarray(FINE), jnp.ones(6)
        before = memory.monitor.retried(request == ARM)
        monitor, found = self.monitor.step(before, HealthInput(estimate, memory.command), dt)
        return monitor, self.health * found, self.ability.judged(found), self.ability.axes(found)


def _any(failed: Index | None) -> Flag | None:
    """Whether a block has failed."""
    return None if failed is None else failed > 0


def _fresh(input: AutopilotInput) -> Float[Array, "4"]:
    """The pilot's command; zero where the newest one is older than PILOT_COMMAND_LIFE."""
    return jnp.where(input.host.operator_age < PILOT_COMMAND_LIFE, input.pilot, 0.0)


def _usable(estimate: Estimate) -> Estimate:
    """The estimate, or `nothing` where it is not a number: thrusters are off then, and no memory catches it."""
    fine = is_finite(estimate)
    return jax.tree.map(lambda leaf, none: jnp.where(fine, leaf, none), estimate, nothing(estimate))
