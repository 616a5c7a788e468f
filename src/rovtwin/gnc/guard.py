"""Blocks of somebody else in an autopilot: what is no number goes no further, and aborts.

Our own blocks are not looked at: theirs is a contract that tests hold. An estimate that is no number needs no guard:
the supervisor aborts on it. With `failed` None nothing is compiled.
"""

from typing import TypeVar

from rovtwin.core.flow import Estimate
from rovtwin.core.numerics import Array, jax, jnp

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

    def kept(leaf: Array) -> Array:
        return jnp.where(fine, leaf, jnp.zeros_like(leaf))

    return failed | ~fine, jax.tree.map(kept, given)


def spoilt(estimate: Estimate, failed: Array | None) -> Estimate:
    """The estimate; no number once a block has failed, which is what the supervisor aborts on."""
    if failed is None:
        return estimate
    return jax.tree.map(lambda leaf: jnp.where(failed, jnp.full_like(leaf, jnp.nan), leaf), estimate)
