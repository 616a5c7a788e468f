"""rovtwin evidence panel: added mass of a vehicle's shapes or of a mesh by the panel method."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from rovtwin.cli.evidence.empirical import Density, Out, block, finish, own_values, plain, print_priors
from rovtwin.cli.output import DONE, AsJson, console, emit, figure, refuse_idle, table
from rovtwin.core.user_files.files import write_text

Length = str | None


def panel(
    body: Annotated[str, typer.Argument(metavar="VEHICLE_OR_MESH", help="A library name, a YAML file, an STL or OBJ.")],
    depth: Annotated[
        Length, typer.Option(help="Depth of the origin below the surface: 0.5, 50cm; default far from it.")
    ] = None,
    floor: Annotated[
        Length, typer.Option(help="Distance from the origin down to the floor; default far from it.")
    ] = None,
    panel_size: Annotated[Length, typer.Option(help="Mean side of a panel; default about 1500 panels.")] = None,
    density: Density = "fresh",
    scale: Annotated[float, typer.Option(help="Metres per unit of a mesh file; 0.001 for millimetres.")] = 1.0,
    frame: Annotated[
        str, typer.Option(help="Axes of a mesh that point forward, to starboard, down. z up and y to port: x,-y,-z.")
    ] = "x,y,z",
    origin: Annotated[str, typer.Option(help="The body's origin in a mesh, in the file's units.")] = "0,0,0",
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the panels, coloured by the water's pressure.")
    ] = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Full 6x6 added mass from potential flow, all parts together; seconds.

    Two meshes give the limit of fine panels and the numerical error, mostly 1 %. What is not in it: water caught in an
    open hull, and how well the shapes stand for the vehicle; the log sd beside each number says how much that is.

    A vehicle's shapes, far from everything; half a metre under the surface of a tank 1.5 m deep:

        rovtwin evidence panel double_blueye

        rovtwin evidence panel double_blueye --depth 0.5 --floor 1 --picture p.png

    A closed surface from CAD in millimetres, z up, as a block to paste:

        rovtwin evidence panel hull.stl --scale 0.001 --frame x,-y,-z -o hull.yaml
    """
    from rovtwin.core.user_files.quantity import LENGTH, positive, quantity
    from rovtwin.identification.priors.panel import panel_added_mass
    from rovtwin.identification.priors.widths import openness_of
    from rovtwin.vehicle.description.water import density_of

    screen = console(as_json)
    mesher, vehicle = _mesher(body, scale, frame, origin)
    with _progress(screen) as progress:
        found = panel_added_mass(
            mesher,
            density_of(density),
            depth=None if depth is None else quantity(depth, LENGTH, "--depth"),
            floor=None if floor is None else quantity(floor, LENGTH, "--floor"),
            panel_size=None if panel_size is None else positive(panel_size, LENGTH, "--panel-size"),
            progress=progress,
        )
    priors = found.priors(None if vehicle is None else openness_of(vehicle))
    own = {} if vehicle is None else own_values(vehicle.in_water(found.density))
    if out is not None:
        source = f"panel method (capytaine) of {mesher.name}, {found.surroundings}, {found.density:g} kg/m3"
        write_text(out, block(priors, source, found.matrix))
    if picture is not None:
        from rovtwin.report.evidence.surface import surface_figure

        figure_of = surface_figure(found.panels.corners, found.pressure, f"{mesher.name}, {found.surroundings}")
        figure_of.savefig(picture, dpi=150)
    if as_json:
        emit(_as_data(found, mesher.name) | {"priors": plain(priors, own)})
        raise typer.Exit(DONE)
    screen.print(f"{mesher.name}: {len(found.panels.faces)} panels, {found.surroundings}", style="bold", markup=False)
    screen.print(f"{figure(found.density)} kg/m3; the surface encloses {found.panels.volume:.4g} m3\n")
    screen.print(_matrix(found.matrix))
    screen.print("\nnumerical error of the diagonal: " + figure([f"{100 * e:.1f}" for e in found.error], "%") + "\n")
    print_priors(screen, priors, own)
    finish(screen, [*found.notes, *([f"drew {picture}"] if picture else [])], out)


def _mesher(body: str, scale: float, frame: str, origin: str) -> tuple[Any, Any]:
    """And the vehicle, None of a mesh."""
    from rovtwin.core.errors import ConfigError
    from rovtwin.identification.priors.mesh_file import SUFFIXES, mesher_of, mesher_of_file
    from rovtwin.vehicle import load_vehicle

    if Path(body).suffix.lower() not in SUFFIXES:
        given = {"--scale": scale != 1.0, "--frame": frame != "x,y,z", "--origin": origin != "0,0,0"}
        refuse_idle(given, f"{body} is a vehicle, whose file says it; they are for a mesh ({', '.join(SUFFIXES)})")
        vehicle = load_vehicle(body)
        return mesher_of(vehicle), vehicle
    axes = tuple(frame.replace(" ", "").split(","))
    if len(axes) != 3:
        raise ConfigError(f"--frame: found '{frame}', expected three axes of the file such as x,-y,-z")
    try:
        place = tuple(float(word) for word in origin.split(","))
    except ValueError:
        place = ()
    if len(place) != 3:
        raise ConfigError(f"--origin: found '{origin}', expected three numbers such as 0,0,0.1")
    return mesher_of_file(Path(body), scale, axes, place), None


@contextlib.contextmanager
def _progress(screen: Any) -> Iterator[Any]:
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("panels"), BarColumn(), TextColumn("{task.completed}/{task.total}"), TimeElapsedColumn())
    with Progress(*columns, console=screen, transient=True) as bar:
        task = bar.add_task("panels", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _as_data(found: Any, name: str) -> dict[str, Any]:
    return {
        "body": name,
        "surroundings": found.surroundings,
        "density_kgm3": found.density,
        "panels": len(found.panels.faces),
        "volume_m3": found.panels.volume,
        "added_mass": found.matrix.tolist(),
        "numerical_error": found.error.tolist(),
        "asymmetry": found.asymmetry,
        "notes": list(found.notes),
    }


def _matrix(matrix: Any) -> Any:
    rows = table("M_A [kg, kg m, kg m2]", "", "u", "v", "w", "p", "q", "r")
    for name, row in zip("XYZKMN", matrix, strict=True):
        rows.add_row(name, *(figure(float(value)) if abs(value) > 1e-4 * matrix.max() else "·" for value in row))
    return rows
