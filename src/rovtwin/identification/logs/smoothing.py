"""A rough value and slope of noisy readings at given times: enough to start an estimate from."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rovtwin.identification.logs.record import Signal


def fitted(
    signal: Signal, t: Float[np.ndarray, " m"], width: float = 1.0
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m k"]]:
    """Value and slope at times t, shapes (len(t), k): a straight line through the readings within `width` seconds.

    Where there are none, the nearest readings serve, and the slope is zero.
    """
    value, slope = np.empty((len(t), signal.value.shape[1])), np.zeros((len(t), signal.value.shape[1]))
    for i, now in enumerate(t):
        a, b = np.searchsorted(signal.t, [now - width / 2, now + width / 2])
        if b - a < 3:
            value[i] = signal.value[min(np.searchsorted(signal.t, now), len(signal.t) - 1)]
            continue
        x, y = signal.t[a:b] - now, signal.value[a:b]
        slope[i], value[i] = np.polyfit(x, y, 1)
    return value, slope


def unwrapped(signal: Signal) -> Signal:
    """The same angles without jumps of a turn."""
    return replace(signal, value=np.unwrap(signal.value, axis=0))
