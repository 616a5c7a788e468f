"""Shapes of arrays, as jaxtyping writes them: short names for those that are met everywhere.

`Float[Array, "6 n"]` has a size or a name for each axis; a name stands for one size within a call. Nothing is checked
at run time but in tests (`tests/shapes.py`). Types say shape and kind of number, docstrings frame and unit.
"""

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int, Key, UInt32

from rovtwin.core.numerics import Array

# What is made on the host and given to compiled steps, which take NumPy's arrays too: to them it is an Array.
if TYPE_CHECKING:
    HostArray: TypeAlias = Array
else:
    HostArray = Array | np.ndarray

Scalar: TypeAlias = Float[Array, ""]
ScalarLike: TypeAlias = Scalar | float
Flag: TypeAlias = Bool[Array, ""]
Index: TypeAlias = Int[Array, ""]

Vector2: TypeAlias = Float[Array, "2"]
Vector3: TypeAlias = Float[Array, "3"]
Vector6: TypeAlias = Float[Array, "6"]
Quaternion: TypeAlias = Float[Array, "4"]
Matrix3: TypeAlias = Float[Array, "3 3"]
Matrix6: TypeAlias = Float[Array, "6 6"]

PerThruster: TypeAlias = Float[Array, " n"]
Configuration: TypeAlias = Float[Array, "6 n"]

RawKey: TypeAlias = UInt32[Array, "2"]
PRNGKey: TypeAlias = Key[Array, ""] | RawKey
