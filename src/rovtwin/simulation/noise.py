"""Keys of random numbers: how one seed serves many blocks without their draws depending on each other."""

import zlib

from jaxtyping import Float

from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Index, PRNGKey, RawKey


def raw_key(key: PRNGKey) -> RawKey:
    """The key as plain uint32 data, so that memories hold ordinary arrays only."""
    return jax.random.key_data(key) if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else key


def key_for(key: PRNGKey, name: str) -> RawKey:
    """A key of its own for the part called `name`: adding a part leaves the draws of all others as they were."""
    return jax.random.fold_in(raw_key(key), zlib.crc32(name.encode()))


def normals(key: RawKey, count: Index, size: int) -> Float[Array, " {size}"]:
    """Independent standard normal numbers, the `count`-th draw of a key."""
    return jax.random.normal(jax.random.fold_in(key, count), (size,), dtype=jnp.float64)
