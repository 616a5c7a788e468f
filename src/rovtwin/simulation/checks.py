"""Parameters that no sea and no sensor can have are refused where they are given."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import Array
from rovtwin.core.types import Scalar


def require(where: str, value: Array, sound: Callable[[np.ndarray], Any], expected: str) -> None:
    """Raise ConfigError unless `sound` holds throughout and `value` is finite.

    Values under a trace (a gradient, a batch) are not known yet and pass.

    Args:
        where: Name of the parameter, as `Block.field`.
        value: What was given.
        sound: Condition on the value, which it gets as a NumPy array; gives bool of any shape.
        expected: What a sound value looks like, in words.
    """
    if isinstance(value, Tracer):
        return
    found = np.asarray(value)
    if not (np.all(sound(found)) and np.all(np.isfinite(found))):
        raise ConfigError(f"{where}: found {found.tolist()}, expected {expected}")


def require_positive(where: str, value: Array) -> None:
    """A finite number above zero."""
    require(where, value, lambda x: x > 0, "a number above 0")


def require_not_negative(where: str, value: Array) -> None:
    """Finite numbers, none below zero."""
    require(where, value, lambda x: x >= 0, "no number below 0")


def require_probability(where: str, value: Array) -> None:
    """Between 0 and 1."""
    require(where, value, lambda x: (x >= 0) & (x <= 1), "a probability from 0 to 1")


def require_finite(where: str, value: Array) -> None:
    """Neither NaN nor infinite."""
    require(where, value, np.isfinite, "finite numbers")


def require_spans(where: str, spans: Float[Array, "m 2"]) -> None:
    """Spans of time (from, to); the end may be infinite."""
    if isinstance(spans, Tracer):
        return
    found = np.asarray(spans)
    if not (np.isfinite(found[:, 0]).all() and (found[:, 0] < found[:, 1]).all()):
        raise ConfigError(f"{where}: found {found.tolist()}, expected pairs (from, to)")


def within(spans: Float[Array, "m 2"], t: Scalar, dt: float) -> Bool[Array, " m"]:
    """Whether t lies in each span, from (included) to (excluded).

    Args:
        spans: [s].
        t: [s].
        dt: Step in which t advances [s]; a thousandth of it keeps rounding from deciding on which side of an edge t is.
    """
    begin, end = spans[:, 0] - 1e-3 * dt, spans[:, 1] - 1e-3 * dt
    return (begin <= t) & (t < end)


def require_direction(where: str, value: Array) -> None:
    """An angle in radians, within a turn either way."""
    expected = "an angle from -2 pi to 2 pi in radians (this looks like degrees)"
    require(where, value, lambda x: np.abs(x) <= 2 * np.pi, expected)


def require_shape(where: str, value: Array, shape: tuple[int, ...]) -> None:
    """The given shape."""
    if value.shape != shape:
        raise ConfigError(f"{where}: found shape {value.shape}, expected {shape}")


def require_rotation(where: str, value: Array) -> None:
    """A matrix that turns and does not stretch."""
    require(where, value, _is_rotation, "a rotation matrix (R R' = I, det R = 1)")


def _is_rotation(R: Float[np.ndarray, "3 3"]) -> bool:
    return bool(np.all(np.abs(R @ R.T - np.eye(3)) < 1e-6) and np.linalg.det(R) > 0)
