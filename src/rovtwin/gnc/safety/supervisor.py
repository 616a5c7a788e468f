"""Supervisor: whether the vehicle may act at all, and if not, why. It knows limits and requests, not way-points.

idle ── first tick without PAUSE ──> running <── RESUME / PAUSE ──> paused
running, paused ── PILOT ──> piloted ── RESUME / PAUSE ──> running / paused
any ── a rule ──> holding < returning < surfacing < aborted (thrusters off)

A rule is a condition that lasts, and the action it asks for: see `rules`. A graver action takes over from a lesser one
and nothing goes back by itself. Only the operator's ARM leads to paused; not while a rule applies that stops the
thrusters, and rules that still apply then are the operator's business until they have ceased once. While idle no rule
starts a thruster.
"""

import equinox as eqx
from jaxtyping import Bool

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import ALTITUDE_LIMIT, ARM, NO_REASON, OFF_COURSE, OFF_DEPTH, PAUSE, PILOT, RESUME
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import PRNGKey
from rovtwin.gnc.interfaces import (
    MODE_HOLDING,
    MODE_IDLE,
    MODE_PAUSED,
    MODE_PILOTED,
    MODE_RETURNING,
    MODE_RUNNING,
    Mode,
)
from rovtwin.gnc.safety.control_authority import HEAVE_LOST
from rovtwin.gnc.safety.rules import IGNORE, STOP, SURFACE, Rules, SupervisorInput, Watch


class SupervisorMemory(eqx.Module):
    """The mode, what is watched, and which rules the operator armed in spite of."""

    mode: Mode
    watch: Watch
    overruled: Bool[Array, " r"]


class Supervisor(Block):
    """Watches what `rules` says, and the operator; gives the Mode."""

    rules: Rules = eqx.field(default_factory=Rules.of)

    def init(self, key: PRNGKey, start: Start) -> SupervisorMemory:
        zero = jnp.zeros((), dtype=int)
        watch = Watch.at(start.position[:2], self.rules)
        return SupervisorMemory(Mode(zero + MODE_IDLE, zero + NO_REASON), watch, watch.lasting > 0.0)

    def step(self, memory: SupervisorMemory, input: SupervisorInput, dt: float) -> tuple[SupervisorMemory, Mode]:
        request, before = input.request, memory.mode
        returning = before.mode == MODE_RETURNING
        watch = memory.watch.step(self.rules, input, before.mode != MODE_IDLE, returning, dt)
        actions, overruled = watch.triggered(self.rules), memory.overruled
        # Up is no way out for a vehicle that cannot push itself there: it is for buoyancy to bring it.
        stranded = (input.ability == HEAVE_LOST) & (actions == SURFACE)
        actions = jnp.where(stranded, STOP, actions)
        # On its way home a vehicle that comes near the floor has to go up: to stay there would not clear it.
        rising = returning & (actions[ALTITUDE_LIMIT] > IGNORE)
        actions = actions.at[ALTITUDE_LIMIT].max(jnp.where(rising, SURFACE, IGNORE))
        # A vehicle that leaves the place, or the way home, where a fail-safe wants it has only the way up.
        leaves = (returning | (before.mode == MODE_HOLDING)) & (actions > IGNORE)
        for row in (OFF_COURSE, OFF_DEPTH):
            actions = actions.at[row].max(jnp.where(leaves[row], SURFACE, IGNORE))
        overruled = overruled & (actions > IGNORE)
        actions = jnp.where((before.mode == MODE_IDLE) & (actions < STOP) | overruled, IGNORE, actions)
        rearmed = (before.mode > MODE_PAUSED) & (request == ARM) & (jnp.max(actions) < STOP)
        overruled = overruled | (rearmed & (actions > IGNORE))
        actions = jnp.where(overruled, IGNORE, actions)
        gravest = jnp.argmax(actions)  # the first of equals, which REASONS has in order
        action = actions[gravest]

        desired = before.mode
        desired = jnp.where((before.mode == MODE_IDLE) & (request == ARM), MODE_PAUSED, desired)
        desired = jnp.where((desired == MODE_IDLE) & (request != PAUSE), MODE_RUNNING, desired)
        flies = (desired >= MODE_RUNNING) & (desired <= MODE_PAUSED) & (before.mode != MODE_IDLE)
        flies = flies | ((before.mode == MODE_IDLE) & (request == PILOT))
        for asked, mode in ((PAUSE, MODE_PAUSED), (RESUME, MODE_RUNNING), (PILOT, MODE_PILOTED)):
            desired = jnp.where(flies & (request == asked), mode, desired)
        desired = jnp.where(rearmed, MODE_PAUSED, desired)
        reason = jnp.where(rearmed, NO_REASON, before.reason)

        takes_over = (action > IGNORE) & (MODE_PAUSED + action > desired)
        mode = Mode(
            jnp.where(takes_over, MODE_PAUSED + action, desired), jnp.where(takes_over, gravest, reason).astype(int)
        )
        # What takes over wants the vehicle elsewhere: how long it has been off course begins anew.
        lasting = watch.lasting.at[OFF_COURSE : OFF_DEPTH + 1].mul(jnp.where(takes_over, 0.0, 1.0))
        watch = eqx.tree_at(lambda w: w.lasting, watch, lasting)
        return SupervisorMemory(mode, watch, overruled), mode
