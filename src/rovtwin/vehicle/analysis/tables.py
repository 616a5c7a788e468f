"""A vehicle's summary as tables for a terminal, readable at 80 columns: a name or a number is never broken."""

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from rich.console import Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from rovtwin.vehicle.constants import AXES, GRAVITY

LONGEST = 45  # width that a column may keep for itself


def tables(found: dict[str, Any]) -> list[Any]:
    """Rich renderables of what `summary` returns, in reading order."""
    shown: list[Any] = [Panel(_safe(found["description"]), title=found["name"], title_align="left", expand=False)]
    shown += [_body(found), *_matrices(found), _derivatives(found)]
    shown += [*_thrusters(found), _allocation(found), _reach(found), _performance(found), _floating(found)]
    if found["cameras"] or found["sensors"]:
        shown.append(_mounted(found))
    if found["instruments"]:
        shown.append(_instruments(found))
    if found["tethers"]:
        shown.append(_tethers(found))
    if found["batteries"]:
        shown.append(_batteries(found))
    if found["learned"]:
        shown.append(_learned(found["learned"]))
    if found["sources"]:
        inside = f"{found['name']}."  # what all places have in common takes width and says nothing
        rows = [(s["where"].removeprefix(inside), s["source"]) for s in found["sources"]]
        shown.append(_pairs("where the values come from", rows))
    if found["findings"]:
        shown.append(_pairs("to know", [("-", line) for line in found["findings"]]))
    return shown


def _learned(found: dict[str, Any]) -> Any:
    """What tests have found the equations of motion to lack."""
    rows = []
    for part in found["parts"]:
        unit = "N" if part["axis"] in AXES[:3] else "N m"
        inputs = "velocity" if part["of"] == "motion" else "velocity and thrust"
        rows.append((part["axis"], f"of {inputs}, {_g(part['prior_std'])} {unit} before any test"))
    return _pairs("learned wrench beside the equations", [*rows, ("why", found["reason"])] if found["reason"] else rows)


def ballast_tables(found: dict[str, Any]) -> list[Any]:
    """Rich renderables of what `ballasted.ballast` returns: the pieces, what they change, remarks."""
    water = found["water_density_kgm3"]
    pieces = [
        (
            piece["name"],
            f"{1000 * piece['mass_kg']:.1f}",
            f"{1e6 * piece['volume_m3']:.1f}",
            f"{GRAVITY * (water * piece['volume_m3'] - piece['mass_kg']):+.2f}",
            ", ".join(f"{1000 * x:.0f}" for x in piece["position_m"]),
            " x ".join(f"{1000 * x:.0f}" for x in piece["size_m"]),
        )
        for piece in found["pieces"]
    ]
    heads = ("", "mass [g]", "volume [mL]", "lift [N]", "middle at x, y, z [mm]", "such as [mm]")
    shown: list[Any] = [_titled(f"pieces for {found['vehicle']}", _table(heads, pieces, numbers=1))]
    if not pieces:
        shown = [Text(f"{found['vehicle']} meets the target: no pieces needed\n", style="bold")]
    shown.append(_titled(f"in water of {_g(water)} kg/m3", _ballast_figures(found)))
    if found["notes"]:
        shown.append(_pairs("to know", [("-", line) for line in found["notes"]]))
    return shown


def _ballast_figures(found: dict[str, Any]) -> Table:
    rows = (
        ("net buoyancy [N]", "net_buoyancy_N", 1),
        ("roll [deg]", "roll_deg", 1),
        ("pitch [deg]", "pitch_deg", 1),
        ("BG [mm]", "metacentric_height_m", 1000),
        ("righting stiffness [N m/rad]", "righting_stiffness_Nm_per_rad", 1),
        ("mass [kg]", "mass_kg", 1),
    )
    step = f"{1000 * found['rounding_kg']:g} g"
    columns = [found["before"], found["after"]]
    heads = ["", "before", "after" if found["rounded"] else f"after, in steps of {step}"]
    if found["rounded"]:
        columns.append(found["rounded"])
        heads.append(f"in steps of {step}")

    def cell(value: float | None, scale: float) -> str:
        return "-" if value is None else f"{round(scale * value, 3) + 0.0:.3f}"

    return _table(heads, [(label, *(cell(c[key], scale) for c in columns)) for label, key, scale in rows], numbers=1)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], text: Collection[int] = (), numbers: int = 0) -> Table:
    """A table without lines.

    Args:
        heads: Of the columns; all empty: none are shown.
        rows: Plain text.
        text: Columns that may wrap between words when there is no room; others keep their width.
        numbers: From this column on to the right, 0 for none.
    """
    rows = list(rows)
    table = Table(show_header=any(heads), box=None, pad_edge=False)
    for i, head in enumerate(heads):
        # A path of parts may be longer than any terminal is wide: then it is folded, not cut off.
        kept = i not in text and max((len(row[i]) for row in rows), default=0) <= LONGEST
        right = bool(numbers) and i >= numbers and i not in text
        justify, style = ("right" if right else "left"), ("cyan" if i == 0 else None)
        table.add_column(_safe(head), style=style, overflow="fold", no_wrap=kept, justify=justify)
    for row in rows:
        table.add_row(*(_safe(cell) for cell in row))
    return table


def _titled(title: str, table: Table) -> Group:
    # A table's own title wraps at the table's width.
    return Group(Text(title, style="bold"), table, Text())


def _pairs(title: str, rows: list[tuple[str, str]]) -> Group:
    return _titled(title, _table(("", ""), rows, text=(1,)))


def _safe(text: str) -> str:
    return text.replace("[", r"\[")  # rich reads brackets as markup


def _g(value: float | None, digits: int = 4) -> str:
    if value is None:
        return "-"
    return "0" if abs(value) < 1e-9 else f"{value:.{digits}g}"


def _vector(values: list[float], digits: int = 4) -> str:
    return "[" + ", ".join(_g(v, digits) for v in values) + "]"


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
        rows = [(axis, *(_g(v) for v in row)) for axis, row in zip(AXES, matrix["values"], strict=True)]
        units = f"[{force_v}, {force_w}; {moment_v}, {moment_w}]"
        shown.append(
            _titled(f"{matrix['symbol']}, {name.replace('_', ' ')} {units}", _table(("", *AXES), rows, numbers=1))
        )
    return shown


def _derivatives(found: dict[str, Any]) -> Group:
    """One row per force and velocity: inertia, linear, quadratic; rows of what differs astern say so in front."""
    rows: dict[str, list[str]] = {}
    for d in found["derivatives"]:
        force, rest = d["symbol"].split("_", 1)
        astern = "astern" in rest
        cells = rows.setdefault(f"{force} {rest[0]} {astern}", ["astern" if astern else "", "", ""])
        column = 2 if "|" in rest else 0 if rest.endswith("dot") else 1
        cells[column] = f"{d['symbol'].removesuffix(' astern')} = {_g(d['value'])} {d['unit']}"
    return _titled("hydrodynamic derivatives, SNAME signs", _table(("", "", ""), rows.values(), text=(0, 1, 2)))


def _thrusters(found: dict[str, Any]) -> list[Group]:
    """Where they are and what they do: two tables, held together by a number."""
    thrusters = list(enumerate(found["thrusters"], start=1))
    places = [(str(i), t["name"], _vector(t["position_m"]), _vector(t["direction"], 3)) for i, t in thrusters]
    forces = [
        (str(i), _g(t["force_ahead"]), _g(t["force_astern"]), t["curve"], _g(t["dead_band"]), _g(t["time_constant_s"]))
        for i, t in thrusters
    ]
    heads = ("", "ahead [N]", "astern [N]", "curve", "dead band", "lag [s]")
    if any(t["inflow_loss_s_per_m"] for _, t in thrusters):
        forces = [(*row, _g(t["inflow_loss_s_per_m"])) for row, (_, t) in zip(forces, thrusters, strict=True)]
        heads = (*heads, "inflow loss [s/m]")
    return [
        _titled("thrusters", _table(("", "name", "position [m]", "direction"), places, text=(2, 3))),
        _titled("thrust", _table(heads, forces, numbers=1)),
    ]


def _allocation(found: dict[str, Any]) -> Group:
    """T with a row per thruster, so that any number of them fits."""
    allocation = found["allocation"]
    missing = ", ".join(allocation["uncontrollable"]) or "none"
    columns = zip(*allocation["matrix"], strict=True)
    rows = [(str(i), *(_g(v) for v in column)) for i, column in enumerate(columns, start=1)]
    title = f"allocation T', a row per thruster; rank {allocation['rank']} of 6; uncontrollable: {missing}"
    return _titled(title, _table(("", *allocation["rows"]), rows, numbers=1))


def _reach(found: dict[str, Any]) -> Group:
    rows = []
    for i, axis in enumerate(AXES):
        limits = [_g(limit) for limit in found["largest_wrench"][axis]]
        rows.append((axis, *limits, "N" if i < 3 else "N m"))
    heads = ("", "lowest", "highest", "")
    return _titled("reach of all thrusters together, each direction by itself", _table(heads, rows, numbers=1))


def _performance(found: dict[str, Any]) -> Group:
    """Top speed, stopping and coasting in each direction, and what they are worth."""
    rows = []
    for axis, directions in found["performance"].items():
        units = ("N m", "deg/s", "deg", "s", "deg", "s") if axis == "yaw" else ("N", "m/s", "m", "s", "m", "s")
        endless = ("-", "no limit", "never", "never", "drifts on", "")
        for direction, able in directions.items():
            values = [value for key, value in able.items() if key != "largest_current_ms"]
            cells = zip(values, units, endless, strict=True)
            rows.append((f"{axis} {direction}", *(f"{_g(v, 3)} {u}" if v is not None else e for v, u, e in cells)))
    heads = ("", "force", "top speed", "stops in", "after", "coasts", "for")
    notes = _table(("", ""), [("-", line) for line in _about_performance(found)], text=(1,))
    return Group(Text("one axis at a time", style="bold"), _table(heads, rows, numbers=1), notes, Text())


def _about_performance(found: dict[str, Any]) -> list[str]:
    lines = [
        "top speed: drag = thrust, with net buoyancy in heave; so also the largest steady current held on the axis",
        "each axis alone: moments that the thrusters make beside it are not balanced, which may take some of its force",
        "stops: full reverse from top speed, with the thrusters' lag; coasts: no thrust, until a tenth of it is left",
    ]
    top, limit = (
        found["performance"]["surge"]["ahead"]["top_speed_ms"],
        found["stability"]["pitch_depth_held_speed_ms"],
    )
    if limit is not None and (top is None or limit < top):
        lines.append(f"surge ahead: pitch diverges above {_g(limit, 3)} m/s when depth is held (Munk moment)")
    sway, limit = found["performance"]["sway"].values(), found["stability"]["roll_static_speed_ms"]
    aside = max((one["top_speed_ms"] or 0.0 for one in sway), default=0.0)
    if limit is not None and limit < aside:
        lines.append(f"sway: roll diverges above {_g(limit, 3)} m/s when depth is held (Munk moment)")
    return lines


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
        (
            "Munk mass",
            ", ".join(f"{axis} {_g(steady[f'munk_{axis}_kg'])}" for axis in ("roll", "pitch", "yaw")) + " kg",
        ),
        ("roll unstable in sway", speed(steady["roll_static_speed_ms"])),
        ("pitch unstable, depth held", speed(steady["pitch_depth_held_speed_ms"])),
        ("pitch unstable, free", speed(steady["pitch_free_speed_ms"])),
        ("yaw unstable, free", speed(steady["yaw_free_speed_ms"])),
    ]
    return _pairs("in the water", rows)


def _mounted(found: dict[str, Any]) -> Group:
    items = [c | {"kind": "camera"} for c in found["cameras"]] + found["sensors"]
    rows = [(i["name"], i["kind"], _vector(i["position_m"]), _vector(i["attitude_deg"])) for i in items]
    table = _table(("name", "kind", "position [m]", "roll, pitch, yaw [deg]"), rows, text=(2, 3))
    return _titled("cameras and sensors", table)


_PLAIN_FIGURES = ("name", "kind", "unit", "spare", "rate_hz", "noise", "bias")


def _instruments(found: dict[str, Any]) -> Group:
    """How well sensors measure."""

    def text(value: Any) -> str:
        if isinstance(value, str):
            return value
        return ", ".join(text(v) for v in value) if isinstance(value, list) else _g(value)

    rows = []
    for one in found["instruments"]:
        more = [f"{key} {text(value)}" for key, value in one.items() if key not in _PLAIN_FIGURES]
        unit, more = one["unit"], (["spare"] if one["spare"] else []) + more
        figures = (_g(one["rate_hz"]), text(one["noise"]), text(one["bias"]))
        rows.append((one["name"], one["kind"], unit, *figures, "; ".join(more)))
    columns = ("name", "measures", "unit", "Hz", "noise", "bias", "also")
    return _titled("how well they measure (spare: not read)", _table(columns, rows, text=(1, 2, 6)))


def _tethers(found: dict[str, Any]) -> Group:
    rows = [
        (t["name"], _vector(t["position_m"]), _g(t["length_m"]), _g(1e3 * t["diameter_m"]), _g(t["wet_weight_N_per_m"]))
        for t in found["tethers"]
    ]
    columns = ("name", "position [m]", "drum [m]", "diameter [mm]", "wet [N/m]")
    return _titled("tethers", _table(columns, rows, text=(1,)))


def _batteries(found: dict[str, Any]) -> Group:
    rows = [
        (b["name"], _g(b["capacity_Wh"]), _g(b["hotel_load_W"]), ", ".join(b["thrusters"]) or "-")
        for b in found["batteries"]
    ]
    columns = ("name", "capacity [Wh]", "hotel load [W]", "feeds")
    return _titled("batteries", _table(columns, rows, text=(3,)))
