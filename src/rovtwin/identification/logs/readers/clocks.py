"""Which array of a file holds the times of which other: files with a time array for each signal, or one for all."""

import re
from collections.abc import Mapping

import numpy as np
from jaxtyping import Real

_WORDS = "t|ts|time|times|time_s|t_s|stamp|stamps|timestamp|timestamps|seconds"
_FIRST, _LAST = re.compile(rf"^({_WORDS})[_./ ]", re.I), re.compile(rf"[_./ ]({_WORDS})$", re.I)
_ALONE = re.compile(rf"^({_WORDS})$", re.I)


def increasing(t: Real[np.ndarray, " n"]) -> bool:
    """Whether numbers may be times: finite, never falling, and not all the same."""
    steps = np.diff(t)
    return bool(len(t) > 1 and np.isfinite(t).all() and (steps >= 0).all() and t[-1] > t[0])


def clocks(arrays: Mapping[str, np.ndarray]) -> dict[str, str]:
    """The array of times of each array that has one of its own, by name.

    `imu_t`, `t_imu` and `imu_time` are those of `imu`, and of `imu_gyro` and `imu_accel` too; `t` or `time` are those
    of every array of as many rows whose own first column is none.

    Args:
        arrays: Shapes (n, k), by name.
    """
    times = {name: a[:, 0] for name, a in arrays.items() if a.shape[1] == 1 and increasing(a[:, 0])}
    owners = {name: _owner(name) for name in times}
    found = {}
    for name, a in arrays.items():
        fitting = [c for c in times if c != name and len(times[c]) == len(a)]
        own = [c for c in fitting if owners[c] and _belongs(name, str(owners[c]))]
        if own:
            found[name] = max(own, key=lambda c: len(str(owners[c])))
            continue
        common = [c for c in fitting if _ALONE.match(c)]
        itself = bool(_ALONE.match(name) or owners.get(name)) or (a.shape[1] > 1 and increasing(a[:, 0]))
        if common and not itself:
            found[name] = common[0]
    return found


def _owner(clock: str) -> str | None:
    """Whose times an array's name says it has: `imu` of `imu_t` and `t_imu`."""
    for pattern in (_LAST, _FIRST):
        left = pattern.sub("", clock)
        if left != clock and left:
            return left
    return None


def _belongs(name: str, owner: str) -> bool:
    name, owner = name.lower(), owner.lower()
    return name == owner or (name.startswith(owner) and name[len(owner)] in "_./ ")
