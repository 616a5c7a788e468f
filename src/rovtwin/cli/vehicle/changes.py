"""rovtwin vehicle add, remove, diff: what a change of a vehicle's parts changes."""

import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit, table
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import write_text

if TYPE_CHECKING:
    from rovtwin.vehicle.outfitting.ballast import Piece
    from rovtwin.vehicle.outfitting.refit import Refit

Out = Annotated[Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write the new vehicle; else only look.")]
Ballast = Annotated[bool, typer.Option("--ballast", help="Put the foam and lead that trim it again into the file too.")]
Buoyancy = Annotated[
    str | None,
    typer.Option(metavar="FORCE", help="With --ballast: net buoyancy, positive floats: 1.5N, 200g; default as before."),
]


def add(
    vehicle: Annotated[str, typer.Argument(metavar="VEHICLE", help="A library name or a YAML file.")],
    device: Annotated[
        str, typer.Argument(metavar="DEVICE", help="A device or vehicle of the library (vehicle list), or a YAML file.")
    ],
    at: Annotated[
        str, typer.Option(metavar="X,Y,Z", help="Its place in the body frame: -0.2,0,0.16 (m) or -200mm,0,160mm.")
    ],
    attitude_deg: Annotated[
        str, typer.Option(metavar="R,P,Y", help="Its roll, pitch, yaw: 0,-90,0 turns its x axis down.")
    ] = "0,0,0",
    name: Annotated[str | None, typer.Option(help="Name of the part; default the device's.")] = None,
    ballast: Ballast = False,
    buoyancy: Buoyancy = None,
    out: Out = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Bolt a device onto a vehicle: write the new file and say what that changes.

    For example: rovtwin vehicle add double_blueye dvl_a50 --at -0.2,0,0.16 --name dvl -o my.yaml

    Then fly it: rovtwin fly lawnmower_calm --set vehicle=my.yaml. Body frame: x forward, y to starboard, z down.
    A file of your own keeps its comments; a vehicle of the library, or a file with totals of the whole (hydrodynamics,
    restoring, rigid_body), is held as a part beside the device.
    """
    from rovtwin.core.user_files.quantity import point
    from rovtwin.vehicle.outfitting.refit import add as refit

    _check_out(out, overwrite)
    attitude = _angles(attitude_deg)
    net_buoyancy = _net_buoyancy(buoyancy, ballast)
    _report(
        refit(vehicle, device, point(at, "--at"), attitude, name, out), vehicle, ballast, net_buoyancy, out, as_json
    )


def remove(
    vehicle: Annotated[str, typer.Argument(metavar="VEHICLE", help="A library name or a YAML file.")],
    part: Annotated[str, typer.Argument(metavar="PART", help="Name of the part in the file's list.")],
    ballast: Ballast = False,
    buoyancy: Buoyancy = None,
    out: Out = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Take a part off a vehicle: write the new file and say what that changes.

    For example: rovtwin vehicle remove my.yaml dvl -o bare.yaml
    """
    from rovtwin.vehicle.outfitting.refit import remove as refit

    _check_out(out, overwrite)
    net_buoyancy = _net_buoyancy(buoyancy, ballast)
    _report(refit(vehicle, part, out), vehicle, ballast, net_buoyancy, out, as_json)


def diff(
    first: Annotated[str, typer.Argument(metavar="A", help="A library name or a YAML file.")],
    second: Annotated[str, typer.Argument(metavar="B", help="A library name or a YAML file.")],
    every: Annotated[bool, typer.Option("--all", help="Also the figures in which they agree.")] = False,
    as_json: AsJson = False,
) -> None:
    """Two vehicles side by side: mass, balance, added mass, top speeds, power, what a filter can know of their place.

    Of identified files the identified parameters count; to compare parameters with their errors see rovtwin compare.
    """
    from rovtwin.runs.vehicle_figures import compared
    from rovtwin.vehicle import load_vehicle

    a, b = load_vehicle(first), load_vehicle(second)
    rows = compared(a, b)
    if as_json:
        identified = [one.file.identified is not None for one in (a, b)]
        emit({"vehicles": [first, second], "identified": identified, "figures": rows})
        return
    # A changed copy of a file keeps the name in it: the file says which one it is.
    left, right = (
        Path(given).name if Path(given).suffix in (".yaml", ".yml") else one.name
        for given, one in ((first, a), (second, b))
    )
    names = (left, right) if left != right else (a.where, b.where)
    titled = f"{names[0]} and {names[1]}"
    if a.file.identified or b.file.identified:  # what tests found stands beside what formulas and publications give
        names = tuple(
            f"{n}\n{IDENTIFIED if v.file.identified else PREDICTED}" for n, v in zip(names, (a, b), strict=True)
        )
    _print_figures(titled, rows, names, every)


def _net_buoyancy(text: str | None, ballast: bool) -> float | None:
    """Net buoyancy that is asked for [N]; None: that of before."""
    from rovtwin.core.user_files.quantity import quantity
    from rovtwin.vehicle.outfitting.ballast import LIFT

    if text is not None and not ballast:
        raise ConfigError(f"--buoyancy {text}: found without --ballast, expected with it: foam and lead bring it about")
    return None if text is None else quantity(text, LIFT, "--buoyancy")


def _report(
    change: "Refit", given: str, ballast: bool, net_buoyancy: float | None, out: Path | None, as_json: bool
) -> None:
    """Write the file, and print or emit what changed of the `given` vehicle and what would trim it again."""
    from rovtwin.runs.vehicle_figures import compared, devices_load
    from rovtwin.vehicle.analysis.lint import reservations
    from rovtwin.vehicle.outfitting.refit import signed, trimming, with_ballast

    pieces, without = [], ""
    try:
        pieces = trimming(change.before, change.after, net_buoyancy)
    except ConfigError as error:
        if ballast:
            raise
        without = f"ballast: none found. {error}"
    trimmed = with_ballast(change, pieces, out)
    shown = trimmed if ballast else change
    rows = compared(change.before, shown.after)
    notes = [*shown.notes, *_about_pieces(change, given if out is None else str(out), pieces)]
    notes += [f"in still water {line}" for line in reservations(shown.after.model())]
    notes += [] if without or net_buoyancy is not None else _about_sinking(change, ballast)
    notes += sorted({f"no bound of the position: {row['why']}" for row in rows if row["why"]})
    drawn = devices_load(shown.after)
    if drawn and not shown.after.power_sources:
        notes.append(f"it draws {drawn:.3g} W; the vehicle's file has no battery")
    if out is not None:
        command = shlex.join(["rovtwin", *sys.argv[1:]])
        write_text(out, signed(shown, command, out, pieces if ballast else ()).text)
    if as_json:
        notes += [without] if without else []
        ballasting = [{"material": p.material, "mass_kg": p.mass, "position_m": list(p.position)} for p in pieces]
        file = None if out is None else str(out)
        emit({"vehicle": change.before.name, "figures": rows, "ballast": ballasting, "ballasted": ballast}
             | {"predicted": change.predicted, "notes": notes, "file": file})  # fmt: skip
        return
    titled = f"{Path(given).name}, before and after" if out is None else f"{Path(given).name} and {out.name}"
    heads = (f"before\n{PREDICTED}", f"after\n{PREDICTED}") if change.predicted else ("before", "after")
    _print_figures(titled, rows, heads, every=False)
    screen = console(False)
    screen.print(without or _about_ballast(pieces, trimmed, ballast, net_buoyancy), markup=False, soft_wrap=True)
    for note in notes:
        screen.print(f"- {note}", markup=False, soft_wrap=True)
    screen.print(
        f"wrote {out}" if out is not None else "nothing written; -o FILE writes it", markup=False, soft_wrap=True
    )


def _about_sinking(change: "Refit", on_board: bool) -> list[str]:
    """That the ballast would make the vehicle sink as before, and how to ask for another net buoyancy."""
    from rovtwin.vehicle.analysis.hydrostatics import floating_of
    from rovtwin.vehicle.constants import GRAVITY

    net, weight = floating_of(change.before.assembly).net_buoyancy, GRAVITY * change.after.assembly.solid.mass
    if net >= -UNNOTICED * weight:
        return []
    made = "makes" if on_board else "would make"
    return [
        f"before, it sank with {-net:.3g} N, and ballast {made} it do so again: --ballast --buoyancy "
        f"{BUOYANT * weight:.2g}N makes it float, with {BUOYANT:.0%} of its weight"
    ]


def _about_pieces(change: "Refit", file: str, pieces: "list[Piece]") -> list[str]:
    """That it floats or sinks by more than before, and which pieces of earlier ballast could come off for that."""
    from rovtwin.vehicle.analysis.hydrostatics import floating_of
    from rovtwin.vehicle.constants import GRAVITY

    was, total = floating_of(change.before.assembly).net_buoyancy, change.after.assembly
    net, little = floating_of(total).net_buoyancy, UNNOTICED * GRAVITY * total.solid.mass
    if abs(net - was) <= little:
        return []
    rises = net > was
    notes = (
        [f"without more ballast it floats with {net:.3g} N (before: {was:+.3g} N)"] if rises and net > little else []
    )
    kind, against = ("foam", "lead") if rises else ("lead", "foam")
    # What a part lifts it with, or pulls it down with.
    forces = {
        part.name: GRAVITY * abs(total.density * (part.volume or 0.0) - part.mass)
        for part in change.after.file.parts
        if re.fullmatch(rf"{kind}_\d+", part.name) and part.mass is not None
    }
    nearest = min(forces, key=lambda name: abs(forces[name] - abs(net - was)), default="")
    if forces and any(piece.material == against for piece in pieces):
        listed = ", ".join(f"{name} ({force:.2g} N)" for name, force in forces.items())
        does = "lifts it" if kind == "foam" else "pulls it down"
        notes.append(
            f"{kind} of earlier ballast {does}: {listed}. Taking it off may do in place of more {against}: rovtwin "
            f"vehicle remove {file} {nearest} -o FILE"
        )
    return notes


def _about_ballast(pieces: "list[Piece]", trimmed: "Refit", on_board: bool, net_buoyancy: float | None) -> str:
    """Which pieces give the vehicle its net buoyancy back, or that asked for, and hang it level."""
    from rovtwin.vehicle.analysis.hydrostatics import floating_of

    if not pieces:
        return "ballast: it needs none"
    listed = "; ".join(
        f"{1000 * p.mass:.0f} g of {p.material} at {', '.join(f'{1000 * x:.0f}' for x in p.position)} mm"
        for p in pieces
    )
    net = floating_of(trimmed.after.assembly).net_buoyancy
    done = "on it now" if on_board else "--ballast puts it on"
    aim = "the net buoyancy of before" if net_buoyancy is None else f"{net_buoyancy:+.3g} N of net buoyancy"
    return f"ballast for {aim} and level trim ({done}): {listed}; {net:+.2f} N then"


def _print_figures(title: str, rows: list[dict[str, Any]], heads: Sequence[str], every: bool) -> None:
    """Figures side by side; those that stay are left out unless asked for."""
    shown = table(title, "", "unit", *heads, "change")
    for row in rows:
        if every or not _alike(row["before"], row["after"]):
            shown.add_row(row["label"], row["unit"], _cell(row["before"]), _cell(row["after"]), _change(row["change"]))
    screen = console(False)
    screen.print(shown)
    if not every:
        screen.print(f"what is not listed changes by less than {UNNOTICED:.1%}", style="dim")


IDENTIFIED, PREDICTED = "identified", "predicted, not identified"
UNNOTICED = 1e-3  # relative
BUOYANT = 0.01  # net buoyancy over weight that is proposed to one that sinks: it comes up when thrust fails


def _alike(before: Any, after: Any) -> bool:
    """Whether two figures differ by little more than rounding."""
    if isinstance(before, float) and isinstance(after, float):
        return abs(after - before) <= max(UNNOTICED * max(abs(before), abs(after)), 1e-9)
    return before == after


def _cell(value: float | list[str] | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, list):
        return str(len(value)) if len(value) > 2 else ", ".join(value) or "-"
    return f"{round(value, 9) + 0.0:.4g}"


def _change(change: float | list[str] | None) -> str:
    if isinstance(change, list):
        return "\n".join(change)
    return "" if change is None else f"{change:+.3g}"


def _check_out(out: Path | None, overwrite: bool) -> None:
    if out is None:
        return
    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"{out}: found the ending '{out.suffix}', expected .yaml")
    if not out.parent.is_dir():
        raise ConfigError(f"{out}: there is no folder {out.parent}")
    check_free(out, overwrite)


def _angles(text: str) -> list[float]:
    try:
        angles = [float(part) for part in text.split(",")]
    except ValueError:
        angles = []
    if len(angles) != 3:
        raise ConfigError(f"--attitude-deg: found '{text}', expected roll,pitch,yaw in degrees such as 0,-90,0")
    return angles
