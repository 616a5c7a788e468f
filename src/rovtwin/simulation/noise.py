"""Keys of random numbers: how one seed serves many blocks without their draws depending on each other."""

import zlib

from rovtwin.core.numerics import Array, jax, jnp


def raw_key(key: Array) -> Array:
    """The key as plain uint32 data, shape (2,), so that memories hold ordinary arrays only."""
    return jax.random.key_data(key) if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else key


def key_for(key: Array, name: str) -> Array:
    """A key of its own for the part called `name`: adding a part leaves the draws of all others as they were."""
    return jax.random.fold_in(raw_key(key), zlib.crc32(name.encode()))


def normals(key: Array, count: Array, size: int) -> Array:
    """Independent standard normal numbers, shape (size,), the `count`-th draw of a key."""
    return jax.random.normal(jax.random.fold_in(key, count), (size,), dtype=jnp.float64)
