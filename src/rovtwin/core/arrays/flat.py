"""One vector for a whole pytree, and back: handing over one array takes microseconds, handing over forty a tick."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import Measurement, Measurements
from rovtwin.core.numerics import Array, in_numpy, jax, jnp, module_for
from rovtwin.core.programs.description import Described

Tree = TypeVar("Tree")

EXACT = ("float64", "float32", "int64", "int32", "uint32", "uint8", "bool")  # types whose values float64 keeps


class Layout(Described, Generic[Tree]):
    """Where each leaf of a pytree lies in one float64 vector.

    The way there and back is exact for floats (infinities and NaN too), bools, and integers up to 2**53 in size.
    Layouts of alike trees are equal, so that one may be a static argument of `jax.jit`.
    """

    def __init__(self, like: Tree):
        """The layout of trees like this one, of which only structure, shapes and types are looked at.

        Raises:
            TypeError: A leaf is of a type that float64 does not hold.
        """
        leaves, self._structure = jax.tree.flatten(like)
        self._leaves: list[tuple[slice, tuple[int, ...], np.dtype]] = []
        self.size = 0
        for leaf in leaves:
            shape, dtype = np.shape(leaf), jnp.result_type(leaf)
            if dtype.name not in EXACT:
                raise TypeError(f"found a leaf of type {dtype.name}, expected one of {', '.join(EXACT)}")
            begin, self.size = self.size, self.size + math.prod(shape)
            self._leaves.append((slice(begin, self.size), shape, dtype))
        # As a static argument it is compared and hashed with every call: once is enough.
        self._identity = (self._structure, tuple((shape, dtype) for _, shape, dtype in self._leaves))
        self._hash = hash(self._identity)

    def described(self) -> Any:
        return self._structure, [(shape, dtype) for _, shape, dtype in self._leaves]

    def __reduce__(self) -> tuple[Any, ...]:
        return _layout, self.described()  # a hash is of one process

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Layout) and self._identity == other._identity)

    def __hash__(self) -> int:
        return self._hash

    def places(self) -> Any:
        """The slice of the vector that each leaf fills, as a tree like the one laid out."""
        return self._structure.unflatten([place for place, _, _ in self._leaves])

    def flatten(self, tree: Tree) -> Float[Array, " {self.size}"]:
        """The vector of a tree; NumPy's outside compiled code, where nothing is compiled for it."""
        leaves = in_numpy(self._structure.flatten_up_to(tree))
        xp = module_for(leaves)
        return xp.concatenate([xp.zeros(0), *(xp.ravel(leaf).astype(xp.float64) for leaf in leaves)])

    def unflatten(self, vector: Any) -> Tree:
        """The tree of a vector, shape (..., size): leading axes become those of every leaf.

        A JAX vector gives JAX arrays, for compiled code; a NumPy one gives NumPy arrays, for logs.
        """
        ahead = vector.shape[:-1]
        leaves = [vector[..., place].reshape((*ahead, *shape)).astype(dtype) for place, shape, dtype in self._leaves]
        return self._structure.unflatten(leaves)


def _layout(structure: Any, leaves: list[tuple[tuple[int, ...], np.dtype]]) -> Layout[Any]:
    return Layout(structure.unflatten([jax.ShapeDtypeStruct(*leaf) for leaf in leaves]))


@partial(jax.tree_util.register_dataclass, data_fields=["vector"], meta_fields=["layout"])
@dataclass(frozen=True)
class Flat(Generic[Tree]):
    """A pytree as one vector, which says what lies where: what a compiled function may take and give.

    Attributes:
        vector: Shape (..., size).
        layout: Part of the structure of what it is in, as static as a shape.
    """

    vector: Any
    layout: Layout[Tree]

    @classmethod
    def of(cls, tree: Tree) -> "Flat[Tree]":
        """For compiled code."""
        layout = Layout(tree)
        return cls(layout.flatten(tree), layout)

    @property
    def tree(self) -> Tree:
        """See `Layout.unflatten`."""
        return self.layout.unflatten(self.vector)


class Packer:
    """Writes a link's readings into the vector of their slots: `flow.pack` and `Layout.flatten` in one go."""

    def __init__(self, layout: Layout, slots: Measurements, places: Any):
        """Into vectors of `layout`, in which `slots` lie at `places` (the part of `layout.places()` for them)."""
        self._empty = [0.0] * layout.size
        self._slots = {
            name: (*slot.value.shape, places[name].value.start, places[name].valid.start, places[name].t_valid.start)
            for name, slot in slots.items()
        }

    def __call__(self, readings: Sequence[Measurement]) -> np.ndarray:
        """The vector: readings in order of arrival, of too many the newest, zeros where there is none.

        Args:
            readings: In order of arrival; those of unknown sensors are left out.

        Raises:
            ValueError: A reading has not the number of values that its slot has.
        """
        vector = self._empty.copy()  # a list: writing single numbers into an array takes three times as long
        known: dict[str, list[Measurement]] = {}
        for reading in readings:
            known.setdefault(reading.sensor, []).append(reading)
        for name, several in known.items():
            if name in self._slots:
                capacity, n, value, valid, t_valid = self._slots[name]
                for row, reading in enumerate(several[-capacity:]):
                    numbers = reading.value.tolist()
                    if len(numbers) != n:
                        raise ValueError(f"a reading of {name!r}: found {len(numbers)} values, expected {n}")
                    vector[value + row * n : value + (row + 1) * n] = numbers
                    vector[valid + row] = 1.0
                    vector[t_valid + row] = reading.t_valid
        return np.array(vector)
