"""Missions from plain data, and their length."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Mission
from rovtwin.core.numerics import as_array

_REQUIRED = ("x", "y", "depth")
_DEFAULTS: dict[str, float | None] = {
    "speed": 0.2,
    "acceptance": 0.2,
    "hold_time": 0.0,
    "heading": None,
    "altitude": None,
}
_OPTIONAL = ("heading", "altitude")
_KEYS = (*_REQUIRED, *_DEFAULTS)


def mission(points: Sequence[Mapping[str, Any]], pad_to: int = 16, where: str = "mission") -> Mission:
    """A mission from way-points in plain numbers.

    Args:
        points: One mapping per way-point: x, y, depth in n [m], and optionally speed [m/s], acceptance radius [m],
            hold_time [s], a heading to keep [rad] (without one the vehicle looks along the leg) and an altitude, the
            distance to the floor to keep in place of the depth [m].
        pad_to: Rows are padded to a multiple of this, so that missions share one shape and one compilation.
        where: What messages call the mission, e.g. "lawnmower.yaml: waypoints".

    Returns:
        The mission; padding rows repeat the last way-point.

    Raises:
        ConfigError: No way-point, an unknown or missing key, or a value that makes no sense.
    """
    if not points:
        raise ConfigError(f"{where}: has no way-points; expected at least one with {', '.join(_REQUIRED)}")
    rows = [_row(point, f"{where}[{i}]") for i, point in enumerate(points)]
    size = -(-len(rows) // pad_to) * pad_to
    rows += [rows[-1]] * (size - len(rows))

    def column(key: str) -> Any:
        return as_array([row[key] or 0.0 for row in rows])

    position = [[row[key] for key in ("x", "y", "depth")] for row in rows]

    return Mission(
        position=as_array(position),
        speed=column("speed"),
        acceptance=column("acceptance"),
        hold_time=column("hold_time"),
        heading=column("heading"),
        fixed_heading=as_array([row["heading"] is not None for row in rows], bool),
        count=as_array(len(points), int),
        altitude=column("altitude") if any(row["altitude"] is not None for row in rows) else None,
    )


def _row(point: Mapping[str, Any], where: str) -> dict[str, float | None]:
    unknown = [key for key in point if key not in _KEYS]
    if unknown:
        raise ConfigError(f"{where}.{unknown[0]}: no such key; expected {', '.join(_KEYS)}")
    missing = [key for key in _REQUIRED if key not in point]
    if missing:
        raise ConfigError(f"{where}: {missing[0]} is missing; a way-point needs {', '.join(_REQUIRED)}")
    row = _DEFAULTS | dict(point)
    for key, value in row.items():
        if value is None and key in _OPTIONAL:
            continue
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise ConfigError(f"{where}.{key}: {value!r} is not a finite number")
        row[key] = float(value)
    _check_ranges(row, where)
    return row


def _check_ranges(row: Mapping[str, float | None], where: str) -> None:
    for key, holds, expected in (
        ("depth", lambda v: v >= 0, "at least 0 (depth counts downwards)"),
        ("speed", lambda v: v > 0, "more than 0"),
        ("acceptance", lambda v: v > 0, "more than 0"),
        ("hold_time", lambda v: v >= 0, "at least 0"),
        ("altitude", lambda v: v is None or v > 0, "more than 0"),
        ("heading", lambda v: v is None or abs(v) <= 2 * math.pi, "radians within +-2 pi; it looks like degrees"),
    ):
        if not holds(row[key]):
            raise ConfigError(f"{where}.{key}: {row[key]:g} is out of range; expected {expected}")


def waypoints(mission: Mission) -> Float[np.ndarray, "n 3"]:
    """The way-points without the padding [m]."""
    return np.asarray(mission.position)[: int(mission.count)]


def total_length(mission: Mission, start: Any = None) -> float:
    """Length of the way over all way-points [m], from `start` (3,), or else from the first one."""
    points = waypoints(mission)
    if start is not None:
        points = np.vstack([np.asarray(start, dtype=float), points])
    return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
