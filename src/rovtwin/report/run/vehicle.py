"""The vehicle in a report: what the summary in the metadata (`rovtwin vehicle show --json`) says of it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.report.flight import Flight
from rovtwin.report.parts.tables import Table, text, words
from rovtwin.vehicle.description.water import density

_SYMBOLS = {
    "mass": "m", "weight": "W", "buoyancy": "B", "center_of_gravity": "r_g", "center_of_buoyancy": "r_b",
    "metacentric_height": "BG", "gravity": "g", "water_density": "ρ", "volume": "∇",
    "inertia_about_cg": "I_g", "inertia_about_co": "I_b",
}  # fmt: skip
_UNITS = {
    "kgm3": "kg/m³", "kgm2": "kg m²", "ms2": "m/s²", "m3": "m³", "kg": "kg", "N": "N", "m": "m", "s": "s", "ms": "m/s",
    "deg": "deg", "Nm_per_rad": "N m/rad", "N_per_s": "N/s", "Nm": "N m", "deg_per_s": "deg/s",
    "N_per_m": "N/m", "Wh": "Wh", "W": "W",
}  # fmt: skip
_AXIS_UNITS = {
    quantity: dict.fromkeys(("surge", "sway", "heave"), linear) | dict.fromkeys(("roll", "pitch", "yaw"), angular)
    for quantity, linear, angular in (("largest_wrench", "N", "N m"),)
}


def _thrusters(flight: Flight) -> list[Mapping[str, Any]]:
    table = flight.json("vehicle_table")
    found = table.get("thrusters") if isinstance(table, Mapping) else None
    return [t for t in found if isinstance(t, Mapping)] if isinstance(found, list) else []


def thruster_names(flight: Flight, fields: Sequence[str]) -> list[str]:
    """Names of the thrusters: of the vehicle when it names as many, else of the channel's fields."""
    names = [str(t.get("name") or "") for t in _thrusters(flight)]
    return names if len(names) == len(fields) and all(names) else list(fields)


def force_limits(flight: Flight, count: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]] | None:
    """Lowest and highest force of each thruster [N]; None when the log does not say."""
    table = _thrusters(flight)
    try:
        high = np.array([float(t["force_ahead_N"] if "force_ahead_N" in t else t["force_ahead"]) for t in table])
        low = -np.array([float(t["force_astern_N"] if "force_astern_N" in t else t["force_astern"]) for t in table])
    except (KeyError, TypeError, ValueError):
        return None
    return (low, high) if len(high) == count else None


def vehicle_tables(flight: Flight) -> list[Table]:
    """Parameters, matrices, derivatives, thrusters and the rest; empty when the log has no summary of its vehicle."""
    found = flight.json("vehicle_table")
    if not isinstance(found, Mapping) or not found:
        return []
    simple: list[list[str]] = []
    tables: list[Table] = []
    for key, value in found.items():
        if key == "matrices" and isinstance(value, Mapping):
            tables += _matrices(value)
        elif key == "derivatives" and _is_records(value):
            tables.append(_derivatives(value))
        elif key == "performance" and isinstance(value, Mapping):
            tables += _performance(value)
        elif key == "findings" and isinstance(value, list):
            tables.append(Table("To know", ["Finding"], [[text(line)] for line in value]))
        elif key == "allocation" and isinstance(value, Mapping):
            _collect(key, {k: v for k, v in value.items() if k != "rows"}, simple, tables)  # X to N, as everywhere
        else:
            _collect(key, value, simple, tables)
    rows = _in_the_water(flight, found, simple)
    return [Table("Parameters", ["Parameter", "Symbol", "Value", "Unit"], rows), *tables] if rows else tables


def _in_the_water(flight: Flight, found: Mapping[str, Any], rows: list[list[str]]) -> list[list[str]]:
    """The parameters where the run was in other water than the file describes: both, and which is which."""
    water = flight.world.get("water")
    if not isinstance(water, Mapping):
        return rows
    flown = _density(water)
    if flown is None:
        return rows
    here, buoyancy, weight = (found.get(key) for key in ("water_density_kgm3", "buoyancy_N", "weight_N"))
    values = {"water density": flown}
    if here and buoyancy is not None and weight is not None:
        values |= {"buoyancy": buoyancy * flown / here, "net buoyancy": buoyancy * flown / here - weight}
    lines = []
    for label, *rest in rows:
        lines.append([f"{label}, as the file describes it" if label in values else label, *rest])
        if label in values:
            symbol, _, unit = rest
            lines.append([f"{label}, in the water flown", symbol, text(float(values[label])), unit])
    return lines


def _density(water: Mapping[str, Any]) -> float | None:
    """Of `world.water` in a scenario [kg/m3]; None when it says nothing that can be read."""
    given = [water.get(key) for key in ("density", "temperature", "salinity")]
    known, temperature, salinity = (float(v) if isinstance(v, int | float) else None for v in given)
    if known is not None or temperature is None or salinity is None:
        return known
    try:
        return density(temperature, salinity)
    except ConfigError:
        return None


def _collect(
    key: str, value: Any, simple: list[list[str]], tables: list[Table], before: str = "", unit: str = ""
) -> None:
    """One entry of the summary as a row, or as tables when it holds more than a vector."""
    name, own = split_unit(key)
    unit, label = own or unit, before + words(name)
    if isinstance(value, Mapping):
        of_axes = _AXIS_UNITS.get(name, {})
        for inner, one in value.items():
            _collect(inner, one, simple, tables, f"{label}, ", of_axes.get(inner, unit))
    elif _is_matrix(value):
        symbol = f", {_SYMBOLS[name]}" if name in _SYMBOLS else ""
        tables.append(Table(f"{_title(label)}{symbol}" + (f" [{unit}]" if unit else ""), [], _cells(value)))
    elif _is_records(value):
        heads = [
            h for h in dict.fromkeys(k for one in value for k in one) if any(one.get(h) is not None for one in value)
        ]
        rows = [[text(one.get(head)) for head in heads] for one in value]
        tables.append(Table(_title(label), [_head(head) for head in heads], rows))
    else:
        simple.append([label, _SYMBOLS.get(name, ""), text(value), unit])


def _title(label: str) -> str:
    return label[:1].upper() + label[1:]


def _cells(matrix: list[list[Any]]) -> list[list[str]]:
    return [[text(float(cell)) for cell in row] for row in matrix]


def split_unit(key: str) -> tuple[str, str]:
    """A key such as `mass_kg` as its name and its unit; the unit is empty when the key names none."""
    for suffix in sorted(_UNITS, key=len, reverse=True):
        if key.endswith(f"_{suffix}"):
            return key.removesuffix(f"_{suffix}"), _UNITS[suffix]
    return key, ""


def _head(key: str) -> str:
    name, unit = split_unit(f"{key}_N" if key in ("force_ahead", "force_astern") else key)
    return f"{words(name)} [{unit}]" if unit else words(name)


def _matrices(matrices: Mapping[str, Any]) -> list[Table]:
    """6x6 matrices with symbol and units of their four blocks; those astern only where they differ from ahead."""
    tables = []
    for name, matrix in matrices.items():
        if not isinstance(matrix, Mapping) or not _is_matrix(matrix.get("values")):
            continue
        ahead = matrices.get(name.replace("astern", "ahead"))
        if name.endswith("astern") and isinstance(ahead, Mapping) and ahead.get("values") == matrix["values"]:
            continue
        units = "; ".join(", ".join(map(text, row)) for row in matrix.get("units") or [])
        title = f"{matrix.get('symbol', '')}, {words(name)}" + (f" [{units}]" if units else "")
        tables.append(Table(title, [], _cells(matrix["values"])))
    return tables


def _performance(axes: Mapping[str, Any]) -> list[Table]:
    """What the vehicle can do on each axis alone: translation, then turning, whose units differ."""
    tables: dict[tuple[str, ...], Table] = {}
    for axis, directions in axes.items():
        for direction, able in directions.items():
            keys = tuple(able)
            head = ["Direction", *(_head(key) for key in keys)]
            table = tables.setdefault(keys, Table("One axis at a time", head, []))
            table.rows.append([f"{axis} {direction}", *(text(able[key]) for key in keys)])
    return list(tables.values())


def _derivatives(records: list[Mapping[str, Any]]) -> Table:
    """Hydrodynamic derivatives, those of one force in one row."""
    rows: dict[str, list[str]] = {}
    for one in records:
        symbol = str(one.get("symbol", ""))
        rows.setdefault(symbol.split("_")[0], []).append(f"{symbol} = {text(one.get('value'))} {one.get('unit', '')}")
    width = max(map(len, rows.values()), default=0)
    cells = [[*row, *[""] * (width - len(row))] for row in rows.values()]
    return Table("Hydrodynamic derivatives, SNAME signs", ["Inertia", "Damping", *[""] * (width - 2)][:width], cells)


def _is_records(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, Mapping) for one in value)


def _is_matrix(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) > 1
        and all(isinstance(row, list) and len(row) == len(value[0]) and row for row in value)
        and all(isinstance(cell, int | float) for row in value for cell in row)
    )
