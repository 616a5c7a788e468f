"""rovtwin evidence towing: damping from force and speed of a towing carriage."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, table
from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.files import write_text

if TYPE_CHECKING:
    from rovtwin.identification.steady.damping_fit import DampingFit
    from rovtwin.identification.steady.towing import Towing

Dof = Annotated[str, typer.Option(help="Direction of the tow: surge, sway or heave.")]


def towing(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="CSV with columns t,speed,force, perhaps run.")
    ],
    dof: Dof = "surge",
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle whose size across the motion decides whether strokes were long enough.")
    ] = None,
    across: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="A B", help="Two sizes across the motion [m], without a vehicle."),
    ] = None,
    rig: Annotated[list[Path] | None, typer.Option(help="Tows of the rig alone, to subtract. Repeatable.")] = None,
    tare: Annotated[float | None, typer.Option(help="Force at rest [N]; default from the runs' own rests.")] = None,
    cutoff: Annotated[
        float | None, typer.Option(help="Cut-off of the low-pass [Hz]; default 9 / (2 shortest).")
    ] = None,
    shortest: Annotated[float, typer.Option(help="Shortest steady window [s].", min=0.1)] = 2.0,
    density: Annotated[float, typer.Option(help="Density of the water [kg/m3].", min=900, max=1100)] = 1000.0,
    unconstrained: Annotated[bool, typer.Option("--unconstrained", help="Let coefficients be negative.")] = False,
    picture: Annotated[Path | None, typer.Option("--figure", help="Write a figure, .png, .svg or .pdf.")] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Write hydrodynamics of a vehicle file.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fit linear and quadratic damping through force and speed of a towing carriage.

    Steady windows are found automatically, tare and rig are subtracted, ahead and astern are fitted apart where both
    were towed. Strokes too short for steady drag are called out.

    Example: [bold]rovtwin evidence towing surge_*.csv --vehicle double_blueye --rig rig.csv -o surge.yaml[/bold]
    """
    from rovtwin.identification.steady.damping_yaml import damping_yaml
    from rovtwin.identification.steady.towing import towing as fit
    from rovtwin.identification.steady.towing_files import read_towing

    if dof not in ("surge", "sway", "heave"):
        raise IdentificationError(f"--dof: found {dof!r}, expected surge, sway or heave; a carriage does not turn")
    options: dict[str, Any] = {"cutoff": cutoff, "shortest": shortest, "density": density}
    alone = fit(read_towing(rig), **options) if rig else None
    sizes = across if vehicle is None else _across(vehicle, dof)
    result = fit(
        read_towing(files),
        tare=tare,
        rig=alone.fit if alone else None,
        across=sizes,
        nonnegative=not unconstrained,
        **options,
    )
    if picture:
        from rovtwin.report.evidence.steady import towing_figure

        save_figure(towing_figure(result, dof), picture)
    if out:
        names = ", ".join(path.name for path in files)
        write_text(out, damping_yaml({dof: result.fit}, f"towing, {names}"))
    if as_json:
        emit(_as_data(result, dof))
    else:
        _print(result, dof, picture, out)
    raise typer.Exit(DONE)


def save_figure(drawn: Any, path: Path) -> None:
    """A figure as its ending says."""
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise IdentificationError(f"--figure {path}: unknown ending {path.suffix!r}, expected .png, .svg or .pdf")
    drawn.savefig(path, dpi=120)


def _across(name: str, dof: str) -> tuple[float, float]:
    """Two sizes of the vehicle across the motion [m]."""
    from rovtwin.vehicle import load_vehicle
    from rovtwin.vehicle.analysis.extent import bounding_box

    loaded = load_vehicle(name)
    box = bounding_box(loaded.file)
    if box is None:
        raise IdentificationError(f"{loaded.where}: no part has a shape, so its size is unknown; give --across A B")
    sizes = [float(x) for i, x in enumerate(box[1] - box[0]) if i != ("surge", "sway", "heave").index(dof)]
    return sizes[0], sizes[1]


def fit_data(fit: "DampingFit") -> dict[str, Any]:
    """A damping fit for a machine."""
    sides = ("ahead", "astern") if len(fit.coefficients) == 4 else ("both",)
    return {
        "coefficients": {
            side: {
                "linear": float(fit.coefficients[2 * k]),
                "linear_std": float(fit.std[2 * k]),
                "quadratic": float(fit.coefficients[2 * k + 1]),
                "quadratic_std": float(fit.std[2 * k + 1]),
                "correlation": float(fit.correlation[k]),
                "slowest": float(fit.speeds[k, 0]),
                "fastest": float(fit.speeds[k, 1]),
            }
            for k, side in enumerate(sides)
        },
        "covariance": fit.covariance.tolist(),
        "rms": fit.rms,
    }


def fit_table(title: str, fits: "dict[str, DampingFit]") -> Any:
    """Coefficients with 95 % intervals, and the force with its band at the fastest speed."""
    import numpy as np

    rows = table(
        title, "", "linear", "+- (95 %)", "quadratic", "+- (95 %)", "correlation", "force at", "is", "+- (95 %)"
    )
    for name, fit in fits.items():
        wide = fit.quantile(0.95)
        for k in range(len(fit.coefficients) // 2):
            side = f"{name} {('ahead', 'astern')[k]}" if len(fit.coefficients) == 4 else name
            speed = np.array([fit.speeds[k, 1]]) * (1 - 2 * k)
            force = float(fit.force(speed)[0])
            values = (
                float(fit.coefficients[2 * k]),
                wide * float(fit.std[2 * k]),
                float(fit.coefficients[2 * k + 1]),
                wide * float(fit.std[2 * k + 1]),
            )
            band = float(fit.force_band(speed)[1][0]) - force
            rows.add_row(
                side,
                *(figure(x) for x in values),
                f"{fit.correlation[k]:.3f}",
                *(figure(x) for x in (float(speed[0]), force, band)),
            )
    return rows


def _as_data(result: "Towing", dof: str) -> dict[str, Any]:
    return {
        "method": "towing",
        "dof": dof,
        "cutoff_hz": result.cutoff,
        "windows": [
            {
                "run": p.run,
                "start": p.window.start,
                "end": p.window.end,
                "speed": p.speed,
                "force": p.force,
                "force_std": p.std,
                "tare": p.tare,
                "rig": p.rig,
                "stroke": p.stroke,
                "used": p.used,
            }
            for p in result.pulls
        ],
        **fit_data(result.fit),
        "drag_coefficient": result.drag_coefficient,
        "notes": list(result.notes),
    }


def _print(result: "Towing", dof: str, picture: Path | None, out: Path | None) -> None:
    screen = console(False)
    rows = table("steady windows", "run", "from", "to", "speed", "net force", "+- (95 %)", "tare", "rig", "stroke", "")
    for p in result.pulls:
        rows.add_row(
            p.run,
            *(f"{x:.1f} s" for x in (p.window.start, p.window.end)),
            f"{p.speed:.3f} m/s",
            *(figure(x, "N") for x in (p.force, 1.96 * p.std, p.tare, p.rig)),
            figure(p.stroke, "m"),
            "" if p.used else "left out",
        )
    screen.print(rows)
    screen.print()
    screen.print(fit_table("F = d_l v + d_q |v| v  [N s/m, N s2/m2, m/s, N]", {dof: result.fit}))
    if result.drag_coefficient is not None:
        screen.print(f"\nC_D {figure(result.drag_coefficient)} on the box across the motion, at the fastest window")
    print_notes(screen, result.notes, picture, out)


def print_notes(screen: Any, notes: tuple[str, ...], *written: Path | None) -> None:
    """Notes, then what was written."""
    if notes:
        screen.print("\nnotes", style="bold")
    for note in notes:
        screen.print(f"- {note}", markup=False)
    for path in written:
        if path:
            screen.print(f"wrote {path}", markup=False)
