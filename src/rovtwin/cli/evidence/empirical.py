"""rovtwin evidence empirical: Eidsvik's formulas for a box-like ROV."""

from pathlib import Path
from typing import Annotated, Any

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, table
from rovtwin.core.user_files.files import write_text

Out = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write the block `hydrodynamics:` of a vehicle file.")
]
Density = Annotated[str, typer.Option("--density", help="Water: fresh, sea, or a density [kg/m3].")]


def empirical(
    vehicle: Annotated[str, typer.Argument(metavar="VEHICLE", help="A library name or a YAML file.")],
    size: Annotated[
        str | None,
        typer.Option(
            metavar="L,W,H", help="Size of the box around it [m], or with units: 640mm,950mm,354mm; else of its shapes."
        ),
    ] = None,
    areas: Annotated[
        str | None, typer.Option(metavar="F,S,T", help="Projected from front, side, top [m2]; else of its shapes.")
    ] = None,
    density: Density = "fresh",
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Added mass and damping from size and projected areas alone: a first guess, with its width.

    Strip theory with DNV's coefficients of rectangles, scaled by prisms; drag on projected areas (Eidsvik 2015, the
    thesis's sec. 3.3). Beside each number stands what the vehicle's file says and how many standard deviations away
    that is. It is a prior, never a result: tests differ by a factor of 2, at worst of 10.

    For a vehicle whose parts have shapes:

        rovtwin evidence empirical double_blueye

    The thesis's own numbers (table 5.1) beside those it prints; 8.95 kg in sway and 3.8 kg m2 in pitch do not follow:

        rovtwin evidence empirical double_blueye_thesis --size 0.64,0.95,0.354 --areas 0.173964,0.140366,0.301998
    """
    import numpy as np

    from rovtwin.identification.priors.empirical import estimate
    from rovtwin.identification.priors.outline import Outline, full_box, outline_of
    from rovtwin.vehicle import load_vehicle
    from rovtwin.vehicle.constants import GRAVITY
    from rovtwin.vehicle.description.water import density_of

    shown = load_vehicle(vehicle).in_water(density_of(density))
    outline = outline_of(shown) if size is None else full_box(three(size, "--size"))
    if areas is not None:
        outline = Outline(outline.size, three(areas, "--areas", square=True))
    total = shown.assembly
    lever = total.solid.center_of_gravity[2] - total.center_of_buoyancy[2]
    stiffness = np.full(2, total.density * GRAVITY * total.volume * lever)
    found = estimate(outline, total.density, np.diag(total.solid.inertia)[:2], stiffness)
    priors, own = found.priors(), own_values(shown)
    notes = list(found.notes)
    if stiffness[0] <= 0:
        notes.append("no righting moment in the file: no linear damping in rotation")
    if out is not None:
        write_text(out, block(priors, "Eidsvik (2015), rovtwin evidence empirical: a prior"))
    if as_json:
        data = {"vehicle": shown.name, "size_m": outline.size.tolist(), "areas_m2": outline.areas.tolist()}
        emit(data | {"density_kgm3": total.density, "priors": plain(priors, own), "notes": notes})
        raise typer.Exit(DONE)
    screen = console(False)
    length, width, height = outline.size
    screen.print(
        f"{shown.name}: {length:.3g} x {width:.3g} x {height:.3g} m, {figure(total.density)} kg/m3", style="bold"
    )
    front, side, top = outline.areas
    screen.print(f"areas {front:.3g} front, {side:.3g} side, {top:.3g} top m2; strips scaled by {found.scaling:.3g}\n")
    print_priors(screen, priors, own)
    finish(screen, notes, out)


def three(text: str, where: str, square: bool = False) -> Any:
    """Three quantities separated by commas, lengths or areas, shape (3,)."""
    import numpy as np

    from rovtwin.core.errors import ConfigError
    from rovtwin.core.user_files.quantity import LENGTH, Kind, positive

    area = Kind("an area", "m2", {"m2": 1.0, "cm2": 1e-4, "mm2": 1e-6}, "0.174")
    words = text.split(",")
    if len(words) != 3:
        raise ConfigError(f"{where}: found '{text}', expected three numbers separated by commas")
    return np.array([positive(word, area if square else LENGTH, where) for word in words])


def own_values(vehicle: Any) -> dict[str, float]:
    """What a vehicle's file says, by name of the prior."""
    import numpy as np

    from rovtwin.vehicle.constants import AXES

    damping = vehicle.assembly.damping()
    matrices = {
        "added_mass": vehicle.assembly.added_mass,
        "linear_damping": damping.linear_ahead,
        "quadratic_damping": damping.quadratic_ahead,
    }
    return {f"{name}.{axis}": float(np.diag(m)[i]) for name, m in matrices.items() for i, axis in enumerate(AXES)}


def print_priors(screen: Any, priors: dict[str, Any], own: dict[str, float]) -> None:
    """A table for each quantity."""
    for quantity in dict.fromkeys(name.split(".")[0] for name in priors):
        rows = table(quantity.replace("_", " "), "", "median", "95 % of", "", "log sd", "in the file", "sd away")
        for name, prior in priors.items():
            if name.startswith(quantity + "."):
                low, high = prior.interval
                value = own.get(name)
                away = "" if not value else f"{prior.deviation(value):+.1f}"
                rows.add_row(
                    name.split(".")[1],
                    figure(prior.median),
                    f"{figure(low)} to {figure(high)}",
                    prior.unit,
                    f"{prior.log_sd:.2f}",
                    figure(value),
                    away,
                )
        screen.print(rows)
        screen.print()


def plain(priors: dict[str, Any], own: dict[str, float]) -> dict[str, Any]:
    """The same for a machine."""
    return {
        name: {
            "median": prior.median,
            "log_sd": prior.log_sd,
            "interval_95": list(prior.interval),
            "unit": prior.unit,
            "in_file": own.get(name),
            "source": prior.source,
        }
        for name, prior in priors.items()
    }


def finish(screen: Any, notes: Any, out: Path | None) -> None:
    """Notes, and what was written."""
    for note in notes:
        screen.print(f"- {note}", markup=False)
    if out is not None:
        screen.print(f"wrote {out}", markup=False)


def block(priors: dict[str, Any], source: str, matrix: Any = None) -> str:
    """A `hydrodynamics:` block to paste into a vehicle file; directions that are not known stay with the parts."""
    from rovtwin.vehicle.constants import AXES

    lines = ["hydrodynamics:"]
    for quantity in dict.fromkeys(name.split(".")[0] for name in priors):
        widths = ", ".join(
            f"{priors[f'{quantity}.{axis}'].log_sd:.2f}" if f"{quantity}.{axis}" in priors else "-" for axis in AXES
        )
        lines.append(f"  # log standard deviations: {widths}")
        if quantity == "added_mass" and matrix is not None:
            lines.append("  added_mass:")
            lines += ["    - [" + ", ".join(f"{value:.5g}" for value in row) + "]" for row in matrix]
        else:
            numbers = [priors.get(f"{quantity}.{axis}") for axis in AXES]
            lines.append(f"  {quantity}: [" + ", ".join("~" if n is None else f"{n.median:.4g}" for n in numbers) + "]")
    return "\n".join([*lines, f"  source: '{source}'"]) + "\n"
