"""Blocks of somebody else in an autopilot: what is no number goes no further, and aborts.

Our own blocks are not looked at: theirs is a contract that tests hold. An estimate that is no number needs no guard:
the supervisor aborts on it, as it does on `failed`. With `failed` None nothing is compiled.
"""

from typing import TypeVar

from rovtwin.core.flow import ARM, Command
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.gnc.interfaces import Mode

Tree = TypeVar("Tree")


def checked(failed: Array | None, given: Tree) -> tuple[Array | None, Tree]:
    """What blocks gave with zeros for all that is no number, and whether it has failed until now.

    Args:
        failed: Whether a block has failed before, bool; None: nothing is watched.
        given: Output of a block.
    """
    if failed is None:
        return None, given
    floats = [leaf for leaf in jax.tree.leaves(given) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    fine = jnp.all(jnp.array([jnp.all(jnp.isfinite(leaf)) for leaf in floats]))
    return failed | ~fine, jax.tree.map(lambda leaf: jnp.where(fine, leaf, jnp.zeros_like(leaf)), given)


def retried(failed: Array | None, request: Array) -> Array | None:
    """Whether a block counts as failed, bool: an operator who arms wants to try again those that did."""
    return None if failed is None else failed & (request != ARM)


def kept(failed: Array | None, after: Tree, before: Tree) -> Tree:
    """Memories after a tick, or those before it where a block has failed: they may be no numbers either."""
    if failed is None:
        return after
    return jax.tree.map(lambda new, old: jnp.where(failed, old, new), after, before)


def masked(failed: Array | None, mode: Mode, command: Command) -> Command:
    """The command cut at 1, and zeros where thrusters have to be off, whatever somebody else's allocation makes."""
    if failed is None:
        return command
    return Command(jnp.where(mode.active & ~failed, jnp.clip(command.u, -1.0, 1.0), 0.0))
