"""What a sensor is given, in the shapes that it computes with: numbers per axis, spans of time, biases within them."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import Array, as_array, module_for
from rovtwin.simulation.checks import require_finite


class Offsets(eqx.Module):
    """A bias that comes and goes: `value`, within each of `spans` [s]."""

    spans: Float[Array, "m 2"]
    value: Float[Array, "m n"]


def spans_of(given: Any) -> Float[Array, "m 2"]:
    """Spans of time as an array of any number of them."""
    return as_array(module_for(given).reshape(given, (-1, 2)))


def offsets_of(where: str, given: Sequence[tuple[float, float, Any]], size: int) -> Offsets:
    """Biases, each as (from, to, bias), of a sensor with `size` axes.

    Raises:
        ConfigError: A bias that is not finite, or has another number of axes.
    """
    value = as_array([np.asarray(per_axis(where, bias, size)) for _, _, bias in given])
    require_finite(where, value)
    return Offsets(spans_of([(begin, end) for begin, end, _ in given]), value)


def per_axis(where: str, value: Any, size: int) -> Float[Array, " {size}"]:
    """One number for each axis, of one for all or one for each.

    Raises:
        ConfigError: Another number of them.
    """
    xp = module_for(value)
    value = xp.asarray(value, dtype=float)
    if value.shape not in ((), (size,)):
        raise ConfigError(f"{where}: found {value.size} numbers, expected 1 or {size}")
    return as_array(xp.broadcast_to(value, (size,)))
