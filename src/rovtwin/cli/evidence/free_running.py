"""rovtwin evidence free-running: damping from logs of steady runs under known commands."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.evidence.towing import fit_data, fit_table, print_notes, save_figure
from rovtwin.cli.output import DONE, AsJson, console, emit, figure, table
from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.files import write_text

if TYPE_CHECKING:
    from rovtwin.identification.logs.record import Record
    from rovtwin.identification.steady.free_running import FreeRunning
    from rovtwin.vehicle import Vehicle

LOG_HELP = "Whole test logs, or an evidence file (.yaml) that says what is in them; of it what is for fitting."


def free_running(
    vehicle: Annotated[str, typer.Argument(metavar="VEHICLE", help="A library name or a vehicle file: thrust curves.")],
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help=LOG_HELP)],
    dof: Annotated[list[str] | None, typer.Option(help="surge, sway, heave or yaw; default all. Repeatable.")] = None,
    method: Annotated[str, typer.Option(help="steady, or thesis: plain differences and a linear thrust.")] = "steady",
    baseline: Annotated[bool, typer.Option(help="Show the thesis's own method beside it.")] = True,
    shortest: Annotated[float, typer.Option(help="Shortest steady window [s].", min=0.5)] = 4.0,
    thrust_std: Annotated[float, typer.Option(help="How well the thrust's scale is known, relative.", min=0.0)] = 0.0,
    picture: Annotated[Path | None, typer.Option("--figure", help="Write figures, one a direction.")] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Write hydrodynamics of a vehicle file.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fit linear and quadratic damping to steady speeds under known commands, from whole test logs.

    Steady windows are found automatically in velocities that a smoother makes of positions, depth and heading. The
    force is that of the vehicle's thrust curves: with a wrong curve the damping is wrong too.

    Example: [bold]rovtwin evidence free-running double_blueye runs/*/log.mcap -o damping.yaml[/bold]
    """
    from rovtwin.identification.steady.damping_yaml import damping_yaml
    from rovtwin.identification.steady.free_running import free_running as fit
    from rovtwin.vehicle import load_vehicle

    if method not in ("steady", "thesis"):
        raise IdentificationError(f"--method: found {method!r}, expected steady or thesis")
    loaded = load_vehicle(vehicle)
    with console(True).status("reading and smoothing"):
        records = [record for path in logs for record in _records(path, loaded)]
        densities = {record.water_density for record in records if record.water_density is not None}
        if len(densities) > 1:
            raise IdentificationError(f"water of {sorted(densities)} kg/m3 in one fit; give the logs of one water")
        model = (loaded.in_water(densities.pop()) if densities else loaded).model()
        options: dict[str, Any] = {"shortest": shortest} | ({"dofs": dof} if dof else {})
        result = fit(model, records, method=method, thrust_std=thrust_std, **options)
        other = _baseline(fit, model, records, options) if baseline and method == "steady" else None
    written = [out] if out else []
    if picture:
        written += _figures(result, other, picture)
    if out:
        names = ", ".join(path.name for path in logs)
        write_text(out, damping_yaml(result.fits, f"free running, {names}"))
    if as_json:
        emit(_as_data(result) | ({"thesis": _as_data(other)} if other else {}))
    else:
        _print(result, other, written)
    raise typer.Exit(DONE)


def _records(path: Path, vehicle: "Vehicle") -> "list[Record]":
    """Of a log, or of the logs that an evidence file gives for fitting."""
    from rovtwin.identification.logs.evidence_file import read_evidence
    from rovtwin.identification.logs.readers import read_records, read_tests

    if path.suffix.lower() in (".yaml", ".yml"):
        return [test.record for test in read_tests(read_evidence(path), vehicle) if test.use == "fit"]
    return read_records(path, vehicle)


def _baseline(fit: Any, model: Any, records: Any, options: dict[str, Any]) -> "FreeRunning | None":
    """The thesis's method, where these logs let it run."""
    try:
        return fit(model, records, method="thesis", **options)
    except IdentificationError:
        return None


def _figures(result: "FreeRunning", other: "FreeRunning | None", picture: Path) -> list[Path]:
    from rovtwin.report.evidence.steady import free_running_figure

    paths = []
    for name in result.fits:
        path = picture if len(result.fits) == 1 else picture.with_stem(f"{picture.stem}_{name}")
        theirs = other.fits.get(name) if other else None
        save_figure(free_running_figure(result, name, theirs), path)
        paths.append(path)
    return paths


def _as_data(result: "FreeRunning") -> dict[str, Any]:
    return {
        "method": result.method,
        "runs": [
            {
                "record": r.record,
                "dof": r.dof,
                "start": r.start,
                "end": r.end,
                "velocity": r.velocity,
                "velocity_std": r.std,
                "force": r.force,
                "force_std": r.force_std,
                "thrust": r.thrust,
            }
            for r in result.runs
        ],
        "fits": {name: fit_data(fit) for name, fit in result.fits.items()},
        "notes": list(result.notes),
    }


def _print(result: "FreeRunning", other: "FreeRunning | None", written: list[Path]) -> None:
    screen = console(False)
    rows = table("steady windows [m/s, N; yaw rad/s, N m]", "test", "", "from", "to", "velocity", "thrust", "drag")
    for r in result.runs:
        rows.add_row(
            r.record,
            r.dof,
            *(f"{x:.1f} s" for x in (r.start, r.end)),
            f"{r.velocity:.4f} ± {1.96 * r.std:.4f}",
            figure(r.thrust),
            f"{figure(r.force)} ± {figure(1.96 * r.force_std)}",
        )
    screen.print(rows)
    screen.print()
    screen.print(fit_table("F = d_l v + d_q |v| v", result.fits))
    if other:
        screen.print()
        screen.print(fit_table("the same logs by the thesis's method: plain differences, linear thrust", other.fits))
    print_notes(screen, result.notes, *written)
