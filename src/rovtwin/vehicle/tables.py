"""A vehicle's summary as tables for a terminal."""

from typing import Any

from rich.console import Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from rovtwin.vehicle.trim import AXES


def tables(found: dict[str, Any]) -> list[Any]:
    """Rich renderables of what `show.summary` returns, in reading order."""
    shown: list[Any] = [Panel(_safe(found["description"]), title=found["name"], title_align="left", expand=False)]
    shown += [_body(found), *_matrices(found), _derivatives(found), _thrusters(found), _allocation(found)]
    shown += [_floating(found)]
    if found["cameras"] or found["sensors"]:
        shown.append(_mounted(found))
    if found["sources"]:
        shown.append(_pairs("where the values come from", [(s["where"], s["source"]) for s in found["sources"]]))
    if found["findings"]:
        shown.append(_pairs("to know", [("-", line) for line in found["findings"]]))
    return shown


def _table(*heads: str) -> Table:
    table = Table(show_header=any(heads), box=None, pad_edge=False)
    for i, head in enumerate(heads):
        table.add_column(_safe(head), style="cyan" if i == 0 else None, overflow="fold")
    return table


def _titled(title: str, table: Table) -> Group:
    # A table's own title wraps at the table's width.
    return Group(Text(title, style="bold"), table, Text())


def _pairs(title: str, rows: list[tuple[str, str]]) -> Group:
    table = _table("", "")
    for name, value in rows:
        table.add_row(_safe(name), _safe(value))
    return _titled(title, table)


def _safe(text: str) -> str:
    return text.replace("[", r"\[")  # rich reads brackets as markup


def _g(value: float | None, digits: int = 4) -> str:
    if value is None:
        return "-"
    return "0" if abs(value) < 1e-9 else f"{value:.{digits}g}"


def _vector(values: list[float]) -> str:
    return "[" + ", ".join(_g(v) for v in values) + "]"


def _body(found: dict[str, Any]) -> Group:
    inertia = found["inertia_about_cg_kgm2"]
    at_co = found["inertia_about_co_kgm2"]
    rows = [
        ("mass", f"{_g(found['mass_kg'])} kg, weight W = {_g(found['weight_N'])} N"),
        ("buoyancy B", f"{_g(found['buoyancy_N'])} N, net {_g(found['net_buoyancy_N'])} N (positive floats)"),
        ("water", f"{_g(found['water_density_kgm3'])} kg/m3"),
        ("CG r_g", f"{_vector(found['center_of_gravity_m'])} m, seen from CO"),
        ("CB r_b", f"{_vector(found['center_of_buoyancy_m'])} m"),
        *((f"inertia about CG, {axis}", f"{_vector(row)} kg m2") for axis, row in zip("xyz", inertia, strict=True)),
        *((f"inertia about CO, {axis}", f"{_vector(row)} kg m2") for axis, row in zip("xyz", at_co, strict=True)),
    ]
    return _pairs("body", rows)


def _matrices(found: dict[str, Any]) -> list[Group]:
    shown = []
    for name, matrix in found["matrices"].items():
        ahead = found["matrices"].get(name.replace("astern", "ahead"))
        if name.endswith("astern") and matrix["values"] == ahead["values"]:
            continue
        (force_v, force_w), (moment_v, moment_w) = matrix["units"]
        table = _table("", *AXES)
        for column in table.columns[1:]:
            column.justify = "right"
        for axis, row in zip(AXES, matrix["values"], strict=True):
            table.add_row(axis, *(_g(v) for v in row))
        units = f"[{force_v}, {force_w}; {moment_v}, {moment_w}]"
        shown.append(_titled(f"{matrix['symbol']}, {name.replace('_', ' ')} {units}", table))
    return shown


def _derivatives(found: dict[str, Any]) -> Group:
    """One row per force and velocity: inertia, linear, quadratic."""
    rows: dict[str, list[str]] = {}
    for d in found["derivatives"]:
        force, rest = d["symbol"].split("_", 1)
        kept = rows.setdefault(f"{force} {rest[0]} {'astern' if 'astern' in rest else ''}", [])
        kept.append(f"{d['symbol'].removesuffix(' astern')} = {_g(d['value'])} {d['unit']}")
    table = _table("", "", "", "")
    for name, cells in rows.items():
        table.add_row("astern" if "astern" in name else "", *(_safe(c) for c in cells))
    return _titled("hydrodynamic derivatives, SNAME signs", table)


def _thrusters(found: dict[str, Any]) -> Group:
    heads = ("name", "position [m]", "direction", "ahead [N]", "astern [N]", "curve", "dead band", "lag [s]")
    table = _table(*heads)
    for t in found["thrusters"]:
        cells = [t["name"], _vector(t["position_m"]), _vector(t["direction"]), _g(t["force_ahead"])]
        cells += [_g(t["force_astern"]), t["curve"], _g(t["dead_band"]), _g(t["time_constant_s"])]
        table.add_row(*(_safe(c) for c in cells))
    return _titled("thrusters", table)


def _allocation(found: dict[str, Any]) -> Group:
    allocation = found["allocation"]
    missing = ", ".join(allocation["uncontrollable"]) or "none"
    table = _table("", *(t["name"] for t in found["thrusters"]), "reach [N, N m]", "top speed")
    for column in table.columns[1:]:
        column.justify = "right"
    for i, (row, axis) in enumerate(zip(allocation["matrix"], AXES, strict=True)):
        low, high = found["largest_wrench"][axis]
        speed = f"{_g(found['top_speed'][axis], 3)} {'m/s' if i < 3 else 'rad/s'}"
        table.add_row(allocation["rows"][i], *(_g(v) for v in row), f"{_g(low)} to {_g(high)}", speed)
    return _titled(f"allocation T, rank {allocation['rank']} of 6; uncontrollable: {missing}", table)


def _floating(found: dict[str, Any]) -> Group:
    trim, steady, periods = found["trim"], found["stability"], found["natural_periods_s"]
    stiffness = found["righting_stiffness_Nm_per_rad"]

    def speed(value: float | None) -> str:
        return "never" if value is None else f"above {_g(value, 3)} m/s"

    rows = [
        ("metacentric height BG", f"{_g(found['metacentric_height_m'])} m"),
        ("righting stiffness", f"roll {_g(stiffness['roll'])}, pitch {_g(stiffness['pitch'])} N m/rad"),
        ("trim at rest", f"roll {_g(trim['roll_deg'], 3)}, pitch {_g(trim['pitch_deg'], 3)} deg"),
        ("heave force to stay", f"{_g(trim['heave_force_N'])} N (down); drifts {_g(trim['drift_speed_ms'], 3)} m/s"),
        ("natural periods", f"roll {_g(periods['roll'], 3)}, pitch {_g(periods['pitch'], 3)} s; heave, yaw: none"),
        ("Munk mass", f"pitch {_g(steady['munk_pitch_kg'])}, yaw {_g(steady['munk_yaw_kg'])} kg"),
        ("pitch unstable, depth held", speed(steady["pitch_depth_held_speed_ms"])),
        ("pitch unstable, free", speed(steady["pitch_free_speed_ms"])),
        ("yaw unstable, free", speed(steady["yaw_free_speed_ms"])),
    ]
    return _pairs("in the water", rows)


def _mounted(found: dict[str, Any]) -> Group:
    table = _table("name", "kind", "position [m]", "roll, pitch, yaw [deg]")
    for item in [c | {"kind": "camera"} for c in found["cameras"]] + found["sensors"]:
        cells = [item["name"], item["kind"], _vector(item["position_m"]), _vector(item["attitude_deg"])]
        table.add_row(*(_safe(c) for c in cells))
    return _titled("cameras and sensors", table)
