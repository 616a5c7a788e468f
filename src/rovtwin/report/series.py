"""Series of samples: angles without jumps, values at other times, slow means."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import wrapped
from rovtwin.core.log import Series


def sensor_values(series: Series) -> Float[np.ndarray, "N n"]:
    """Readings without the column of the sensor's own time."""
    columns = [k for k, field in enumerate(series.channel.fields) if field not in ("t_valid", "valid")]
    return series.values[:, columns]


def at(series: Series, t: Float[np.ndarray, " M"], angles: slice = slice(0, 0)) -> Float[np.ndarray, "M n"]:
    """Values at other times by linear interpolation, NaN outside of the series.

    Args:
        series: The values.
        t: Times [s].
        angles: Columns that are unwrapped first.
    """
    values = np.array(series.values)
    values[:, angles] = unwrapped(values[:, angles])
    return np.column_stack([np.interp(t, series.t, column, left=np.nan, right=np.nan) for column in values.T])


def slow_mean(
    t: Float[np.ndarray, " N"], values: Float[np.ndarray, "N n"], window: float = 20.0
) -> Float[np.ndarray, "N n"]:
    """Mean over a window [s] around each time, shorter at the ends; shapes (N,) and (N, n)."""
    total = np.vstack([np.zeros(values.shape[1]), np.cumsum(np.nan_to_num(values), axis=0)])
    low, high = np.searchsorted(t, t - window / 2), np.searchsorted(t, t + window / 2, side="right")
    return (total[high] - total[low]) / (high - low)[:, None]


def unwrapped(angle: Float[np.ndarray, " N *axes"]) -> Float[np.ndarray, " N *axes"]:
    """Angles without jumps along the first axis; NaN stays NaN and does not spread."""
    steps = wrapped(np.diff(_filled(angle), axis=0))
    first = _filled(angle)[:1]
    result = np.concatenate([first, first + np.cumsum(steps, axis=0)])
    return np.where(np.isfinite(angle), result, np.nan)


def beside(
    angle: Float[np.ndarray, " N *axes"],
    t: Float[np.ndarray, " N"],
    base: Float[np.ndarray, " M *axes"],
    base_t: Float[np.ndarray, " M"],
) -> Float[np.ndarray, " N *axes"]:
    """Angles shifted by whole turns so that they lie within half a turn of an unwrapped base."""
    near = np.interp(t, base_t, _filled(base))
    return near + wrapped(angle - near)


def _filled(values: Float[np.ndarray, " N *axes"]) -> Float[np.ndarray, " N *axes"]:
    """NaN replaced by the last finite value before it (at the start by 0)."""
    values = np.asarray(values, float)
    known = np.isfinite(values)
    index = np.maximum.accumulate(
        np.where(known, np.arange(len(values)).reshape(-1, *[1] * (values.ndim - 1)), 0), axis=0
    )
    return np.nan_to_num(np.take_along_axis(values, index, axis=0))
