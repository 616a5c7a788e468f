"""Many vehicles at once: side by side, but no more of them than the processor's cache holds."""

from collections.abc import Callable
from typing import Any

from rovtwin.core.numerics import jax

CHUNK = 100  # vehicles; from 32 to 200 it makes no difference, beyond a thousand it takes twice as long


def batched(function: Callable[..., Any], size: int = CHUNK) -> Callable[..., Any]:
    """`function` over the leading axis of all its arguments, as `jax.vmap` does it, `size` vehicles after `size`.

    On a graphics processor all go side by side.

    Args:
        function: Of one vehicle, to be compiled; takes and gives pytrees of arrays.
        size: Vehicles in a chunk. What a chunk works on should fit into the cache next to a core, about 1 MB.
    """

    def over(*arguments: Any) -> Any:
        count = jax.tree.leaves(arguments)[0].shape[0]
        if count <= size or jax.default_backend() != "cpu":
            return jax.vmap(function)(*arguments)
        return jax.lax.map(lambda one: function(*one), arguments, batch_size=size)

    return over
