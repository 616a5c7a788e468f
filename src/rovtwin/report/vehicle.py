"""What the vehicle's table in the metadata says about thrusters."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovtwin.report.flight import Flight


def _thrusters(flight: Flight) -> list[Mapping[str, Any]]:
    table = flight.json("vehicle_table")
    found = table.get("thrusters") if isinstance(table, Mapping) else None
    return [t for t in found if isinstance(t, Mapping)] if isinstance(found, list) else []


def thruster_names(flight: Flight, fields: Sequence[str]) -> list[str]:
    """Names of the thrusters: of the vehicle when it names as many, else of the channel's fields."""
    names = [str(t.get("name") or "") for t in _thrusters(flight)]
    return names if len(names) == len(fields) and all(names) else list(fields)


def force_limits(flight: Flight, count: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Lowest and highest force of each thruster [N], shapes (n,); None when the log does not say."""
    table = _thrusters(flight)
    try:
        high = np.array([float(t["force_ahead"]) for t in table])
        low = -np.array([float(t["force_astern"]) for t in table])
    except (KeyError, TypeError, ValueError):
        return None
    return (low, high) if len(high) == count else None
