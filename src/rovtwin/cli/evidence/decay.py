"""rovtwin evidence decay: inertia, damping and stiffness in roll or pitch from a release."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, table
from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.files import write_text

if TYPE_CHECKING:
    from rovtwin.identification.decay.scale import Decay

UNITS = ("kg m2", "N m/rad", "N m s/rad", "N m s2/rad2")
NAMES = ("inertia with added mass", "stiffness W BG", "linear damping", "quadratic damping")
RATIO_UNITS = ("1/s2", "1/s", "1/rad")


def decay(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="CSV with time and angle, or a log.")],
    axis: Annotated[str, typer.Option(help="roll or pitch.")] = "roll",
    column: Annotated[
        str | None, typer.Option(help="Column of the angle in a CSV; one ending in deg is in degrees.")
    ] = None,
    stiffness: Annotated[str | None, typer.Option(metavar="K[:SD]", help="Known W BG [N m/rad].")] = None,
    inertia: Annotated[
        str | None, typer.Option(metavar="J[:SD]", help="Known inertia with added mass [kg m2].")
    ] = None,
    ballasted: Annotated[Path | None, typer.Option(help="A decay with a known weight fixed on.")] = None,
    weight: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="DK DJ", help="What that weight adds: stiffness [N m/rad], inertia [kg m2]."),
    ] = None,
    vehicle: Annotated[
        str | None, typer.Option(help="The vehicle tested: its rigid-body inertia is subtracted.")
    ] = None,
    trust_bg: Annotated[bool, typer.Option("--trust-bg", help="Take W BG from the vehicle file.")] = False,
    linear: Annotated[bool, typer.Option("--linear", help="Linear damping only.")] = False,
    picture: Annotated[Path | None, typer.Option("--figure", help="Write a figure, .png, .svg or .pdf.")] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Write hydrodynamics of a vehicle file.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fit roll or pitch after a release: inertia, linear and quadratic damping, stiffness.

    Incline the vehicle in still water, let go, record until it is still. The release is found automatically. Motion
    alone gives ratios only; the scale comes from a known stiffness (--stiffness, --trust-bg), a known inertia
    (--inertia), or a second decay with a known weight (--ballasted).

    Examples: [bold]rovtwin evidence decay roll_1.csv roll_2.csv[/bold],
    [bold]rovtwin evidence decay roll.csv --vehicle double_blueye --stiffness 7.4:0.7 -o roll.yaml[/bold],
    [bold]rovtwin evidence decay roll.csv --ballasted roll_1kg.csv --weight 2.1 0.06[/bold]
    """
    from rovtwin.identification.decay.motion import releases
    from rovtwin.identification.decay.nonlinear import fit_decay
    from rovtwin.identification.decay.read import read_angle
    from rovtwin.identification.decay.scale import together
    from rovtwin.vehicle import load_vehicle

    loaded = load_vehicle(vehicle) if vehicle else None
    scale = {"stiffness": known(stiffness, "--stiffness"), "inertia": known(inertia, "--inertia")}
    if trust_bg:
        scale["stiffness"] = _stiffness_of(loaded, axis, stiffness)
    if sum([scale["stiffness"] is not None, scale["inertia"] is not None, ballasted is not None]) > 1:
        raise IdentificationError("decay: give one scale of --stiffness, --trust-bg, --inertia, --ballasted")
    if (ballasted is None) != (weight is None):
        raise IdentificationError("decay: --ballasted FILE and --weight DK DJ go together")

    def fitted(path: Path) -> "dict[str, Decay]":
        t, angle = read_angle(path, axis, column=column, vehicle=loaded)
        parts = releases(t, angle)
        names = [path.name] if len(parts) == 1 else [f"{path.name}, release {k + 1}" for k in range(len(parts))]
        return {
            name: fit_decay(t[part], angle[part], quadratic=not linear, source=str(path.with_name(name)))
            for name, part in zip(names, parts, strict=True)
        }

    runs = {name: one for path in files for name, one in fitted(path).items()}
    heavy = together(list(fitted(ballasted).values())) if ballasted else None
    result = together(list(runs.values()), ballasted=heavy, weight=weight, **scale)
    rigid = None if loaded is None else float(loaded.assembly.solid.inertia[_place(axis), _place(axis)])
    if picture:
        from rovtwin.cli.evidence.towing import save_figure
        from rovtwin.report.evidence.decay import decay_figure

        save_figure(decay_figure(list(runs.values()), list(runs), axis), picture)
    if out:
        write_text(out, _block(result, axis, rigid, ", ".join(path.name for path in files)))
    if as_json:
        emit(_as_data(result, runs, axis, rigid))
    else:
        _print(result, runs, axis, rigid, (picture, out))
    raise typer.Exit(DONE)


def _place(axis: str) -> int:
    return 0 if axis == "roll" else 1


def known(text: str | None, option: str) -> Any:
    """K or K:SD."""
    from rovtwin.identification.known import Known

    if text is None:
        return None
    try:
        value, _, sd = text.partition(":")
        return Known(float(value), float(sd or 0.0))
    except ValueError:
        raise IdentificationError(f"{option}: found {text!r}, expected a number, or value:standard_deviation") from None


def _stiffness_of(vehicle: Any, axis: str, given: str | None) -> Any:
    from rovtwin.identification.known import Known
    from rovtwin.vehicle.analysis.hydrostatics import floating_of

    if vehicle is None or given is not None:
        raise IdentificationError("--trust-bg: takes W BG from the vehicle: give --vehicle NAME, and no --stiffness")
    return Known(float(floating_of(vehicle.assembly).stiffness[_place(axis)]))


def _block(result: "Decay", axis: str, rigid: float | None, names: str) -> str:
    """hydrodynamics: of a vehicle file."""
    if result.moments is None:
        raise IdentificationError(f"-o: {result.verdict}; give --stiffness, --trust-bg, --inertia or --ballasted")
    (J, _, D_L, D_Q), sd, i = result.moments.values, result.moments.sd, 3 + _place(axis)
    rows = {"linear_damping": D_L, "quadratic_damping": D_Q}
    if rigid is not None:
        if J <= rigid:
            raise IdentificationError(
                f"-o: the inertia of the decay, {J:.3g} kg m2, is not above the vehicle's own, {rigid:.3g} kg m2; the "
                "scale, the vehicle's inertia or the axis is wrong"
            )
        rows = {"added_mass": J - rigid, **rows}
    values = [f"  {key}: [{', '.join(f'{v:.6g}' if k == i else '~' for k in range(6))}]" for key, v in rows.items()]
    note = (
        f"  # {axis}: inertia +- {sd[0]:.2g}, linear +- {sd[2]:.2g}, quadratic +- {sd[3]:.2g} (one standard deviation)"
    )
    lines = [f"    {key}: decay, {names}; {result.verdict}" for key in rows]
    return "\n".join(["hydrodynamics:", note, *values, "  sources:", *lines]) + "\n"


def _as_data(result: "Decay", runs: "dict[str, Decay]", axis: str, rigid: float | None) -> dict[str, Any]:
    moments = result.moments
    return {
        "method": "decay",
        "axis": axis,
        "verdict": result.verdict,
        "ratios": {
            "stiffness_over_inertia": result.ratios[0],
            "linear_over_inertia": result.ratios[1],
            "quadratic_over_inertia": result.ratios[2],
            "covariance": result.covariance.tolist(),
        },
        "coefficients": None
        if moments is None
        else {
            "inertia_kgm2": moments.values[0],
            "added_inertia_kgm2": None if rigid is None else moments.values[0] - rigid,
            "stiffness_Nm_per_rad": moments.values[1],
            "linear_damping": moments.values[2],
            "quadratic_damping": moments.values[3],
            "covariance": moments.covariance.tolist(),
        },
        "runs": [
            {"name": name, "start": d.start, "end": d.end, "offset_rad": d.offset, "rms_rad": d.rms,
             "whiteness": d.whiteness, "notes": list(d.notes)}
            for name, d in runs.items()
        ],
        "notes": list(result.notes),
    }  # fmt: skip


def _print(result: "Decay", runs: "dict[str, Decay]", axis: str, rigid: float | None, written: Any) -> None:
    from math import degrees

    from rovtwin.cli.evidence.towing import print_notes

    screen = console(False)
    rows = table(f"{axis} decays", "test", "released before", "from", "offset", "left over (rms)")
    for name, d in runs.items():
        rows.add_row(name, f"{d.start:.2f} s", f"{degrees(d.state[0]):.1f} deg", f"{degrees(d.offset):.2f} deg",
                     f"{degrees(d.rms):.2g} deg")  # fmt: skip
    screen.print(rows)
    screen.print()
    rows = table("what motion tells", "", "", "+- (95 %)", "unit")
    for name, value, sd, unit in zip(NAMES[1:], result.ratios, result.sd, RATIO_UNITS, strict=True):
        rows.add_row(f"{name} / inertia", figure(float(value)), figure(float(1.96 * sd)), unit)
    screen.print(rows)
    screen.print()
    if result.moments is not None:
        rows = table("with units", "", "", "+- (95 %)", "unit")
        for name, value, sd, unit in zip(NAMES, result.moments.values, result.moments.sd, UNITS, strict=True):
            rows.add_row(name, figure(float(value)), figure(float(1.96 * sd)), unit)
        if rigid is not None:
            rows.add_row("added inertia", figure(float(result.moments.values[0] - rigid)),
                         figure(float(1.96 * result.moments.sd[0])), UNITS[0])  # fmt: skip
        screen.print(rows)
        screen.print()
    screen.print(result.verdict, markup=False)
    named = tuple(f"{name}: {note}" for name, d in runs.items() for note in d.notes)
    print_notes(screen, (*result.notes, *named) if len(runs) > 1 else result.notes, *written)
