"""Supervisor: whether the vehicle may act at all, and if not, why. It knows limits and requests, not way-points.

idle ── first tick without PAUSE ──> running <── RESUME / PAUSE ──> paused
any ── a rule ──> holding < returning < surfacing < aborted (thrusters off)

A rule is a condition that lasts, and the action it asks for: see `rules`. A graver action takes over from a lesser one
and nothing goes back by itself. Only the operator's ARM leads to paused, and only once no rule applies any more.
"""

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import ARM, NO_REASON, PAUSE, RESUME
from rovtwin.core.numerics import Array, jnp
from rovtwin.gnc.ability import HEAVE_LOST
from rovtwin.gnc.rules import IGNORE, STOP, SURFACE, Rules, Watch, Watched

MODES = ("idle", "running", "paused", "holding", "returning", "surfacing", "aborted")
MODE_IDLE, MODE_RUNNING, MODE_PAUSED, MODE_HOLDING, MODE_RETURNING, MODE_SURFACING, MODE_ABORTED = range(len(MODES))


class Mode(eqx.Module):
    """One of MODES, int, and one of core.flow.REASONS, int, that says why it is not the operator's."""

    mode: Array
    reason: Array

    @property
    def active(self) -> Array:
        """Whether thrusters may be used: in every mode but idle and aborted."""
        return (self.mode != MODE_IDLE) & (self.mode != MODE_ABORTED)


class SupervisorMemory(eqx.Module):
    """The mode, and what is watched."""

    mode: Mode
    watch: Watch


class Supervisor(Block):
    """Watches what `rules` says, and the operator; gives the Mode."""

    rules: Rules = eqx.field(default_factory=Rules.of)

    def init(self, key: Array, start: Start) -> SupervisorMemory:
        zero = jnp.zeros((), dtype=int)
        return SupervisorMemory(Mode(zero + MODE_IDLE, zero + NO_REASON), Watch.at(start.position[:2]))

    def step(self, memory: SupervisorMemory, input: Watched, dt: float) -> tuple[SupervisorMemory, Mode]:
        request, before = input.request, memory.mode
        watch = memory.watch.step(self.rules, input, before.mode != MODE_IDLE, dt)
        actions = watch.triggered(self.rules)
        # Up is no way out for a vehicle that cannot push itself there: it is for buoyancy to bring it.
        stranded = (input.ability == HEAVE_LOST) & (actions == SURFACE)
        actions = jnp.where(stranded, STOP, actions)
        gravest = jnp.argmax(actions)  # the first of equals, which REASONS has in order
        action = actions[gravest]

        wanted = before.mode
        wanted = jnp.where((before.mode == MODE_IDLE) & (request != PAUSE), MODE_RUNNING, wanted)
        wanted = jnp.where((before.mode == MODE_RUNNING) & (request == PAUSE), MODE_PAUSED, wanted)
        wanted = jnp.where((before.mode == MODE_PAUSED) & (request == RESUME), MODE_RUNNING, wanted)
        rearmed = (before.mode > MODE_PAUSED) & (request == ARM) & (action == IGNORE)
        wanted = jnp.where(rearmed, MODE_PAUSED, wanted)
        reason = jnp.where(rearmed, NO_REASON, before.reason)

        takes_over = (action > IGNORE) & (MODE_PAUSED + action > wanted)
        mode = Mode(
            jnp.where(takes_over, MODE_PAUSED + action, wanted), jnp.where(takes_over, gravest, reason).astype(int)
        )
        return SupervisorMemory(mode, watch), mode
