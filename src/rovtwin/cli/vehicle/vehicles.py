"""rovtwin vehicle: look at vehicle files, check them, ballast vehicles."""

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit
from rovtwin.cli.vehicle.changes import add, diff, remove
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import write_text

vehicle_app = typer.Typer(
    no_args_is_help=True,
    help="Look at vehicles: parameters, trim, performance; check files; bolt devices on; ballast.",
)

VehicleName = Annotated[str, typer.Argument(metavar="VEHICLE", help="A library name or a YAML file.")]


@vehicle_app.command("list")
def list_vehicles(as_json: AsJson = False) -> None:
    """Names of the library's vehicles, and of the devices that can be bolted onto them (`vehicle add`)."""
    from rovtwin.vehicle import list_devices, list_library, load_vehicle

    vehicles, devices = list_library(), list_devices()
    if as_json:
        emit({"vehicles": vehicles, "devices": devices})
        return
    out = console(False)
    for title, names in (("vehicles", vehicles), ("devices", devices)):
        out.print(f"{title}:")
        for name in names:
            out.print(f"  {name:<22}{load_vehicle(name).description}", markup=False, no_wrap=True, overflow="ellipsis")


Water = Annotated[
    str | None,
    typer.Option(
        "--water",
        help="Water: fresh, sea, a density [kg/m3], or temperature and salinity as '12C 34'; default the file's.",
    ),
]


@vehicle_app.command("show")
def show(vehicle: VehicleName, water: Water = None, as_json: AsJson = False) -> None:
    """Mass, CG, CB, matrices with symbols and units, thrusters, top speeds, stopping distances, trim, stability."""
    from rovtwin.vehicle import load_vehicle, render, summary
    from rovtwin.vehicle.description.water import density_of

    shown = load_vehicle(vehicle)
    found = summary(shown if water is None else shown.in_water(density_of(water)))
    if as_json:
        emit(found)
        return
    out = console(False)
    for part in render(found):
        out.print(part)


@vehicle_app.command("check")
def check(vehicle: VehicleName, as_json: AsJson = False) -> None:
    """Check a vehicle file: what is wrong with it (exit code 2), whether it sinks or capsizes and what else to know."""
    from rovtwin.vehicle import check as check_it

    try:
        found = check_it(vehicle)
    except ConfigError as error:  # a file of another folder goes by the path that was typed
        text, name = str(error), Path(vehicle).name
        raise ConfigError(vehicle + text.removeprefix(name)) if text.startswith(f"{name}:") else error from None
    if as_json:
        data = {"verdict": found.verdict, "reservations": found.reservations, "findings": found.findings}
        emit({"vehicle": vehicle, "valid": True, **data})
    else:
        out = console(False)
        out.print(f"{vehicle}: {found.verdict}", markup=False, soft_wrap=True)
        for finding in found.findings:
            out.print(f"- {finding}", markup=False)
    raise typer.Exit(DONE)


@vehicle_app.command("ballast")
def ballast(
    vehicle: VehicleName,
    buoyancy: Annotated[
        str | None, typer.Option(metavar="FORCE", help="Net buoyancy, positive floats: 2N, 200g; default as it is.")
    ] = None,
    level: Annotated[bool, typer.Option("--level", help="Roll and pitch 0 at rest.")] = False,
    bg: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="Metacentric height, CB above CG: 20mm, 0.02.")
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,Z",
            help="A place for the middle of a piece: 0.2,0,-0.1 or 200mm,0,-100mm. Repeatable; "
            "default corners, edges and centres of top and bottom of the box around the hull.",
        ),
    ] = None,
    water: Water = None,
    foam_density: Annotated[str, typer.Option(metavar="DENSITY", help="kg/m3.")] = "200",
    weight_density: Annotated[str, typer.Option(metavar="DENSITY", help="kg/m3; lead.")] = "11340",
    max_mass: Annotated[
        str | None,
        typer.Option(metavar="MASS", help="Largest mass of all pieces together; default a quarter of the vehicle's."),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option("--round", metavar="MASS", help="Round weights to this, foam to as much water: 10g; default not."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write the vehicle with the pieces on it.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find which foam or lead to put where, for a given net buoyancy, level trim and metacentric height.

    For example: rovtwin vehicle ballast my.yaml --buoyancy 2N --level --bg 20mm -o ballasted.yaml
    """
    from rovtwin.core.user_files.quantity import DENSITY, LENGTH, MASS, point, positive, quantity
    from rovtwin.vehicle.analysis.tables import ballast_tables
    from rovtwin.vehicle.description.water import density_of
    from rovtwin.vehicle.outfitting.ballast import LIFT, BallastTarget
    from rovtwin.vehicle.outfitting.ballasted import Materials
    from rovtwin.vehicle.outfitting.ballasted import ballast as ballast_it

    target = BallastTarget(
        None if buoyancy is None else quantity(buoyancy, LIFT, "--buoyancy"),
        level,
        None if bg is None else quantity(bg, LENGTH, "--bg"),
    )
    materials = Materials(
        positive(foam_density, DENSITY, "--foam-density"),
        positive(weight_density, DENSITY, "--weight-density"),
        [point(place, "--at") for place in at] if at else None,
        None if max_mass is None else positive(max_mass, MASS, "--max-mass"),
    )
    found = ballast_it(
        vehicle,
        target,
        materials,
        water_density=None if water is None else density_of(water),
        step=None if step is None else positive(step, MASS, "--round"),
        out=out,
        command=shlex.join(["rovtwin", *sys.argv[1:]]),
    )
    if as_json:
        emit(found)
        return
    screen = console(False)
    for part in ballast_tables(found):
        screen.print(part)
    if out is not None:
        screen.print(f"wrote {out}", markup=False)


vehicle_app.command("add")(add)
vehicle_app.command("remove")(remove)
vehicle_app.command("diff")(diff)


@vehicle_app.command("urdf")
def urdf(
    vehicle: VehicleName,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="URDF to write.")] = Path("vehicle.urdf"),
) -> None:
    """Write a vehicle's looks, mass, cameras and sensors as URDF, for RViz, Gazebo and others (x forward, z up)."""
    from rovtwin.vehicle import load_vehicle
    from rovtwin.vehicle.analysis.urdf import urdf as urdf_of

    write_text(out, urdf_of(load_vehicle(vehicle)))
    console(False).print(f"wrote {out}", markup=False, soft_wrap=True)


@vehicle_app.command("schema")
def schema(as_json: AsJson = True) -> None:
    """The JSON Schema of vehicle files, for editors to complete and check them."""
    from rovtwin.vehicle import vehicle_schema

    emit(vehicle_schema())
