"""rovtwin convert: missions from and into files of other programs."""

from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit, refuse_idle
from rovtwin.cli.scenarios import Overrides
from rovtwin.core.user_files.files import write_text


def convert(
    mission: Annotated[
        str,
        typer.Argument(metavar="MISSION", help="A mission or scenario (name or YAML), .gpx, .kml, .geojson, .plan."),
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="Its ending says the format: also .yaml.")],
    datum: Annotated[
        str | None, typer.Option(help="latitude,longitude where metres have their origin; default the scenario's.")
    ] = None,
    scenario: Annotated[
        str | None, typer.Option(help="Scenario whose datum and fence count: a name or a file.")
    ] = None,
    depth: Annotated[
        float | None, typer.Option(min=0.0, help="Of way-points whose depth the file does not give [m].")
    ] = None,
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Convert a mission: rovtwin's YAML, GPX routes, KML paths, GeoJSON, plans of QGroundControl.

    What a format does not hold, as speeds in GPX, is left out and named. Without a datum, a mission on the map stays
    there: its way-points are geodetic.

    Example: [bold]rovtwin convert route.gpx mission.yaml --depth 3 --datum 63.45,10.36[/bold]

    Then [bold]rovtwin fly square --set mission=mission.yaml[/bold] flies it.
    """
    from rovtwin.core.datum import Datum, latitude_longitude
    from rovtwin.planning.exchange.files import convert as converted
    from rovtwin.scenario.files import load_scenario

    check_free(target, overwrite)
    refuse_idle({"--set": bool(overrides) and scenario is None}, "no --scenario says what is changed")
    about = None if scenario is None else load_scenario(scenario, overrides or ())
    origin = None if datum is None else Datum(*latitude_longitude(datum, "--datum"))
    result = converted(mission, target, origin, about, depth)
    write_text(target, result.text)
    if as_json:
        emit({"written": str(target), "way_points": result.count, "notes": result.notes})
        return
    screen = console(False)
    screen.print(f"wrote {target}: {result.count} way-point{'' if result.count == 1 else 's'}", markup=False)
    for note in result.notes:
        screen.print(f"- {note}", markup=False, soft_wrap=True)
