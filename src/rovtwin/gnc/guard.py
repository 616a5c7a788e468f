"""Blocks of somebody else in an autopilot: what is no number goes no further, and aborts.

Our own blocks are not looked at: theirs is a contract that tests hold. An estimate that is no number needs no guard:
the supervisor aborts on it, as it does on `failed`. With `failed` None nothing is compiled.
"""

from dataclasses import replace
from typing import Any, Literal, TypeVar, get_args

import equinox as eqx
from jaxtyping import Shaped

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import ABORTED, ARM, NOT_A_NUMBER, AutopilotInput, AutopilotOutput, Command
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Flag, Index, PRNGKey
from rovtwin.gnc.interfaces import Mode

Place = Literal["observer", "guidance", "reference", "controller", "allocation", "autopilot"]
PLACES: tuple[Place, ...] = get_args(Place)
"""Where blocks of somebody else stand: keys of a scenario's autopilot, and the whole."""
Tree = TypeVar("Tree")


def _all_finite(tree: Any) -> Flag:
    """Whether all floats of a tree are numbers."""
    floats = [leaf for leaf in jax.tree.leaves(tree) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    return jnp.all(jnp.array([jnp.all(jnp.isfinite(leaf)) for leaf in floats]))


def nothing(tree: Tree) -> Tree:
    """Zeros for all numbers of what one block gives to another, but for attitudes, which are level."""
    level = jnp.array([1.0, 0.0, 0.0, 0.0])

    def of(path: tuple[Any, ...], leaf: Shaped[Array, "*axes"]) -> Shaped[Array, "*axes"]:
        return jnp.broadcast_to(level, leaf.shape) if _named(path) == "attitude" else jnp.zeros_like(leaf)

    return jax.tree_util.tree_map_with_path(of, tree)


def _named(path: tuple[Any, ...]) -> str:
    return str(getattr(path[-1], "name", "")) if path else ""


def checked(failed: Index | None, place: Place, given: Tree) -> tuple[Index | None, Tree]:
    """What a block gave, or `nothing` if that is no number, and which block has failed until now.

    Args:
        failed: The first block that has failed before: 0 none, else 1 and its place in PLACES; None: nothing is
            watched.
        place: Of this one.
        given: Its output.
    """
    if failed is None:
        return None, given
    fine = _all_finite(given)
    failed = jnp.where((failed > 0) | fine, failed, 1 + PLACES.index(place))
    return failed, jax.tree.map(lambda leaf, none: jnp.where(fine, leaf, none), given, nothing(given))


def retried(failed: Index | None, request: Index) -> Index | None:
    """Which block counts as failed: an operator who arms wants to try again those that did."""
    return None if failed is None else jnp.where(request == ARM, 0, failed)


def kept(failed: Index | None, after: Tree, before: Tree) -> Tree:
    """Memories after a tick, or those before it where a block has failed: they may be no numbers either."""
    if failed is None:
        return after
    return jax.tree.map(lambda new, old: jnp.where(failed > 0, old, new), after, before)


def masked(failed: Index | None, mode: Mode, command: Command) -> Command:
    """The command cut at 1, and zeros where thrusters have to be off, whatever somebody else's allocation makes."""
    if failed is None:
        return command
    return Command(jnp.where(mode.active & (failed == 0), jnp.clip(command.u, -1.0, 1.0), 0.0))


class GuardedMemory(eqx.Module):
    """Memory of the autopilot, and whether it has failed, see `checked`."""

    autopilot: Any
    failed: Index


class Guarded(Block):
    """A whole autopilot of somebody else, watched as its parts would be.

    When it gives what is no number, thrusters are off in the same tick and it is aborted; its memory stays what it was
    before. Who arms again tries it again. The estimate stays what it is.
    """

    autopilot: Block

    def init(self, key: PRNGKey, start: Start) -> GuardedMemory:
        return GuardedMemory(self.autopilot.init(key, start), jnp.asarray(0))

    def step(self, memory: GuardedMemory, input: AutopilotInput, dt: float) -> tuple[GuardedMemory, AutopilotOutput]:
        after, given = self.autopilot.step(memory.autopilot, input, dt)
        failed, output = checked(retried(memory.failed, input.request), "autopilot", replace(given, failed=None))
        assert failed is not None
        off, setpoint = failed > 0, output.setpoint
        setpoint = replace(
            setpoint,
            phase=jnp.where(off, ABORTED, setpoint.phase),
            reason=jnp.where(off, NOT_A_NUMBER, setpoint.reason),
        )
        command = Command(jnp.where(off, 0.0, jnp.clip(output.command.u, -1.0, 1.0)))
        output = replace(output, command=command, estimate=given.estimate, setpoint=setpoint, failed=failed)
        return GuardedMemory(kept(failed, after, memory.autopilot), failed), output
