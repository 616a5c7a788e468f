"""Stretches of samples in which something holds."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool


def stretches(holds: Bool[np.ndarray, " n"] | Sequence[bool]) -> list[tuple[int, int]]:
    """First sample and last + 1 of each stretch in which it holds, in order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.asarray(holds, bool), [False]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
