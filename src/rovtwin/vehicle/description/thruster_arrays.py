"""Thrusters of a description as the arrays of `Thrusters`."""

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.description.schema import Curve, Thruster
from rovtwin.vehicle.description.thrust_curve import at_voltage, increasing
from rovtwin.vehicle.description.totals.assembly import Mounted


def direction_vector(direction: Any) -> Float[np.ndarray, "3"]:
    """Unit vector of a file's direction; azimuth turns from x to y, elevation is above the horizontal."""
    if isinstance(direction, dict):
        azimuth = np.radians(direction.get("azimuth_deg", 0.0))
        elevation = np.radians(direction.get("elevation_deg", 0.0))
        level = np.cos(elevation)
        return np.array([level * np.cos(azimuth), level * np.sin(azimuth), -np.sin(elevation)])
    vector = np.array(direction, dtype=float)
    return vector / np.linalg.norm(vector)


def configuration(thrusters: tuple[Mounted, ...]) -> Float[np.ndarray, "6 n"]:
    """T: the wrench at CO of unit forces. Fossen (2021), eq. 9.7."""
    columns = []
    for mounted in thrusters:
        assert isinstance(mounted.item, Thruster)
        force = mounted.rotation @ direction_vector(mounted.item.direction)
        point = mounted.placement.point(np.array(mounted.item.position))
        columns.append(np.concatenate([force, np.cross(point, force)]) + 0.0)  # no -0.0
    return np.stack(columns, axis=1) if columns else np.zeros((6, 0))


def pairs_apart(thrusters: tuple[Mounted, ...]) -> tuple[Mounted, ...]:
    """The thrusters, with those that stand for a pair as two of half the force, `surge_port`, `surge_starboard`."""
    apart: list[Mounted] = []
    for mounted in thrusters:
        item = mounted.item
        assert isinstance(item, Thruster)
        if item.pair_spacing is None:
            apart.append(mounted)
            continue
        across = np.cross([0.0, 0.0, 1.0], direction_vector(item.direction))  # to starboard of one that pushes ahead
        for side, way in (("port", -0.5), ("starboard", 0.5)):
            place = np.array(item.position) + way * item.pair_spacing * across
            half = _halved(item) | {"position": place.tolist(), "pair_spacing": None}
            apart.append(replace(mounted, name=f"{mounted.name}_{side}", item=item.model_copy(update=half)))
    return tuple(apart)


def _halved(item: Thruster) -> dict[str, Any]:
    """Force and power of one of the two; a thruster with a pair is described by its largest force, not by a table."""
    assert item.force is not None
    force = {k: v / 2 for k, v in item.force.items()} if isinstance(item.force, dict) else item.force / 2
    return {"force": force, "power": None if item.power is None else item.power / 2}


def thrust_points(thruster: Thruster, supply_voltage: float | None, where: str) -> Float[np.ndarray, "k 2"] | None:
    """(command, force) of a tabulated thruster, or None; `files` has read its CSV files."""
    if not isinstance(thruster.curve, Curve) or thruster.curve.table is None:
        return None
    table = thruster.curve.table
    if isinstance(table, dict):
        curves = [(float(voltage), np.array(points, dtype=float)) for voltage, points in table.items()]
    else:
        curves = [(float("nan"), np.array(table, dtype=float))]
    return increasing(at_voltage(curves, supply_voltage, where), where)


def thruster_arrays(thrusters: tuple[Mounted, ...], supply_voltage: float | None, where: str) -> dict[str, np.ndarray]:
    """The fields of `Thrusters`, by name.

    Args:
        thrusters: Of an assembly.
        supply_voltage: At which all tables are read [V]; None: each at the voltage of its part.
        where: For messages.
    """
    items = [m.item for m in thrusters if isinstance(m.item, Thruster)]
    tables = []
    for mounted, item in zip(thrusters, items, strict=True):
        voltage = mounted.supply_voltage if supply_voltage is None else supply_voltage
        tables.append(thrust_points(item, voltage, f"{where}: thruster '{mounted.name}'"))
    n = len(items)
    grid, table_force = _common_grid(tables)
    ahead, astern = np.zeros(n), np.zeros(n)
    for i, (thruster, points) in enumerate(zip(items, tables, strict=True)):
        ahead[i], astern[i] = _limits(thruster, points)
    power = [t.curve.power if isinstance(t.curve, Curve) and t.curve.power else 1.0 for t in items]
    inflow_loss = np.array([t.inflow_loss or 0.0 for t in items], dtype=float)
    return {
        "configuration": configuration(thrusters),
        "force_ahead": ahead,
        "force_astern": astern,
        "exponent": np.array(power, dtype=float),
        "dead_band": np.array([t.dead_band for t in items], dtype=float),
        "time_constant": np.array([t.time_constant for t in items], dtype=float),
        "rate_limit": np.array([np.inf if t.rate_limit is None else t.rate_limit for t in items], dtype=float),
        "quantisation": np.array([t.quantisation for t in items], dtype=float),
        "health": np.array([t.health for t in items], dtype=float),
        "table_command": grid,
        "table_force": table_force,
        "tabulated": np.array([points is not None for points in tables], dtype=float),
        **({"inflow_loss": inflow_loss} if inflow_loss.any() else {}),
    }


def thrust_limits(mounted: Mounted, supply_voltage: float | None = None) -> tuple[float, float]:
    """Largest force of one thruster ahead and astern, both positive [N]; arguments as of `thruster_arrays`."""
    assert isinstance(mounted.item, Thruster)
    voltage = mounted.supply_voltage if supply_voltage is None else supply_voltage
    return _limits(mounted.item, thrust_points(mounted.item, voltage, f"thruster '{mounted.name}'"))


def _limits(thruster: Thruster, points: Float[np.ndarray, "k 2"] | None) -> tuple[float, float]:
    if points is not None:
        return max(float(points[-1, 1]), 0.0), max(float(-points[0, 1]), 0.0)
    if isinstance(thruster.force, dict):
        return float(thruster.force["ahead"]), float(thruster.force["astern"])
    return float(thruster.force), float(thruster.force)


def _common_grid(
    tables: list[Float[np.ndarray, "_ 2"] | None],
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "n k"]]:
    """Commands of all tables together, and each table on them: linear tables lose nothing."""
    given = [t for t in tables if t is not None]
    if not given:
        return np.array([-1.0, 1.0]), np.zeros((len(tables), 2))
    grid = np.unique(np.concatenate([t[:, 0] for t in given]))
    rows = [np.zeros(grid.size) if t is None else np.interp(grid, t[:, 0], t[:, 1]) for t in tables]
    return grid, np.stack(rows)
