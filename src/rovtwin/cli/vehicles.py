"""rovtwin vehicle: look at vehicle files and check them."""

from typing import Annotated

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit

vehicle_app = typer.Typer(
    no_args_is_help=True, help="Look at vehicles: parameters, trim, controllability; check files."
)

VehicleName = Annotated[str, typer.Argument(metavar="VEHICLE", help="A library name or a YAML file.")]


@vehicle_app.command("list")
def list_vehicles(as_json: AsJson = False) -> None:
    """Names of the library's vehicles."""
    from rovtwin.vehicle import list_library

    names = list_library()
    if as_json:
        emit({"vehicles": names})
    else:
        console(False).print("\n".join(names))


Water = Annotated[
    str | None,
    typer.Option(
        "--water", help="Put it in water: fresh, sea, a density [kg/m3], or temperature and salinity as '12C 34'."
    ),
]


@vehicle_app.command("show")
def show(vehicle: VehicleName, water: Water = None, as_json: AsJson = False) -> None:
    """Mass, CG, CB, inertia, buoyancy, matrices with symbols and units, allocation, trim and stability."""
    from rovtwin.vehicle import load_vehicle, render, summary
    from rovtwin.vehicle.water import density_of

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
    """Say what is wrong with a vehicle file (exit code 2), or what to know about it."""
    from rovtwin.vehicle import check as findings_of

    findings = findings_of(vehicle)
    if as_json:
        emit({"vehicle": vehicle, "valid": True, "findings": findings})
    else:
        out = console(False)
        out.print(f"{vehicle}: usable", markup=False)
        for finding in findings:
            out.print(f"- {finding}", markup=False)
    raise typer.Exit(DONE)


@vehicle_app.command("schema")
def schema(as_json: AsJson = True) -> None:
    """The JSON Schema of vehicle files, for editors to complete and check them."""
    from rovtwin.vehicle import vehicle_schema

    emit(vehicle_schema())
