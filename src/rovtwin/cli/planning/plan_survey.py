"""rovtwin plan-survey: parallel lines over an area, as a scenario to fly."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, table
from rovtwin.cli.scenarios import Overrides
from rovtwin.core.errors import ConfigError

if TYPE_CHECKING:
    from rovtwin.planning.survey import Survey


def plan_survey(
    area: Annotated[Path, typer.Option(help="GeoJSON with polygons (WGS-84), or YAML with outline and holes [m].")],
    swath: Annotated[float, typer.Option(help="Width that is seen at once [m].")],
    overlap: Annotated[float, typer.Option(help="Share of the swath that neighbouring lines both see.")] = 0.2,
    heading: Annotated[
        str, typer.Option(help="Direction of the lines [deg], or auto: the one that takes least time.")
    ] = "auto",
    vehicle: Annotated[str | None, typer.Option(help="A library name or a file; default the scenario's.")] = None,
    depth: Annotated[float | None, typer.Option(help="Depth of the lines [m]; default 3.")] = None,
    altitude: Annotated[float | None, typer.Option(help="Height over the floor [m], in place of a depth.")] = None,
    floor: Annotated[float | None, typer.Option(help="Depth of the sea floor [m]; default the scenario's.")] = None,
    speed: Annotated[float | None, typer.Option(help="Speed on the lines [m/s]; default the vehicle's own.")] = None,
    clearance: Annotated[
        float | None,
        typer.Option(help="Distance of the vehicle's origin from holes [m]; default its hull and a margin."),
    ] = None,
    inside: Annotated[bool, typer.Option("--inside", help="Never leave the outline: a tank, a quay.")] = False,
    scenario: Annotated[str, typer.Option(help="World, sensors, autopilot, datum: a name or a file.")] = (
        "lawnmower_calm"
    ),
    datum: Annotated[
        str | None, typer.Option(help="latitude,longitude of the frame's origin, or auto: the area's middle.")
    ] = None,
    sees: Annotated[
        str | None, typer.Option(help="Imager or camera whose swath it is; default the vehicle's first imager.")
    ] = None,
    overrides: Overrides = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Scenario to write.")] = Path("survey.yaml"),
    picture: Annotated[Path | None, typer.Option("--figure", help="Write a picture, .png, .svg or .pdf.")] = None,
    as_json: AsJson = False,
) -> None:
    """Lay parallel lines over an area so that a swath sees all of it, and write them as a scenario.

    Holes are kept clear of, and one lap is flown round each; the rest is mown back and forth, cell by cell. Says how
    long it takes and what it draws from the battery.

    Example: [bold]rovtwin plan-survey --area area.geojson --swath 1.2 --overlap 0.2 --figure survey.png[/bold]

    Then [bold]rovtwin fly survey.yaml[/bold] flies it on the twin.
    """
    from rovtwin.planning.survey import SurveyRequest, lay_out, survey_picture, write_survey
    from rovtwin.survey.room import Swath

    request = SurveyRequest(
        area, Swath(swath, overlap), _heading(heading), scenario, vehicle, depth, altitude, floor, speed, clearance,
        inside, datum, sees, tuple(overrides or ()),
    )  # fmt: skip
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console(True), transient=True) as bar:
        task = bar.add_task("trying headings", total=1.0)
        survey = lay_out(request, lambda share: bar.update(task, completed=share))
    write_survey(survey, out)
    if picture:
        _save(survey_picture(survey), picture)
    if as_json:
        emit(survey.figures() | {"scenario": str(out), "figure": None if picture is None else str(picture)})
        raise typer.Exit(DONE)
    _print(survey, console(False))
    console(False).print(f"wrote {out}: rovtwin fly {out}", markup=False, soft_wrap=True)


def _heading(text: str) -> float | None:
    if text == "auto":
        return None
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) <= 360:
        raise ConfigError(f"--heading: found {text!r}, expected degrees such as 45, or auto")
    return value


def _save(drawn: Any, path: Path) -> None:
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ConfigError(f"--figure: found {str(path)!r}, expected a name that ends in .png, .svg or .pdf")
    drawn.savefig(path, dpi=150)


def _print(survey: "Survey", screen: Any) -> None:
    figures = survey.figures()
    rows = table(f"survey of {survey.request.area}, {survey.scenario.vehicle}", "", "")
    rows.add_row("area", f"{figure(figures['area_m2'])} m2")
    rows.add_row("seen", f"{figures['coverage']:.2%} ({figures['coverage_of_reachable']:.2%} of what can be reached)")
    spacing = "" if figures["lines"] < 2 else f", {figure(figures['line_spacing_m'])} m apart"
    rows.add_row(
        "lines",
        f"{figures['lines']} at {figures['heading_deg']:.0f} deg{spacing}, {figures['cells']} cells, "
        f"{figures['laps']} laps",
    )
    rows.add_row(
        "way",
        f"{figures['length_m']:.0f} m, {figures['seeing_m']:.0f} m of it lines and laps, {figures['turns']} turns",
    )
    rows.add_row(
        "time", f"{figures['duration_s'] / 60:.0f} min at {figures['speed_m_s']:g} m/s, {figures['depth_m']:g} m deep"
    )
    rows.add_row("battery", _battery(survey))
    screen.print(rows)
    for remark in survey.remarks:
        screen.print(f"- {remark}", markup=False)


def _battery(survey: "Survey") -> str:
    cost = survey.budget
    if cost.share is None:
        return "the vehicle's file has none"
    return (
        f"{cost.used_wh.sum():.0f} of {cost.capacity_wh.sum():.0f} Wh, the emptiest {cost.share:.0%} used: "
        f"{cost.propulsion_w:.0f} W thrust, {cost.hotel_w:.0f} W all else"
    )
