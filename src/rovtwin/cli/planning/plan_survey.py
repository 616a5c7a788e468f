"""rovtwin plan-survey: parallel lines over an area, as a scenario to fly."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, refuse_idle, table
from rovtwin.cli.scenarios import Overrides
from rovtwin.core.errors import ConfigError

if TYPE_CHECKING:
    from rovtwin.planning.survey import Survey


def plan_survey(
    area: Annotated[Path, typer.Option(help="GeoJSON with polygons (WGS-84), or YAML with outline and holes [m].")],
    swath: Annotated[
        float | None, typer.Option(help="Width that is seen at once [m]; with --imager it follows from the imager.")
    ] = None,
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
    imager: Annotated[
        str | None,
        typer.Option(help="Hyperspectral imager (uhi, or a file) whose swath it is, at --altitude, through its port."),
    ] = None,
    roll: Annotated[float, typer.Option(help="Roll that the imager's swath allows for, either way [deg].")] = 2.0,
    square: Annotated[bool, typer.Option("--square", help="As slowly as makes the imager's pixels square.")] = False,
    crosshatch: Annotated[
        bool, typer.Option("--crosshatch", help="Fly the area a second time, across: for maps without a Doppler log.")
    ] = False,
    error: Annotated[
        float | None,
        typer.Option(help="Error within the registered mosaic [m, rms]: overlap and crosshatch follow from it."),
    ] = None,
    assume: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="How far off what nobody measures is: heading, boresight, dvl_yaw [deg], dvl_scale, clock [s], "
            "floor, tie [m]; or ideal.",
        ),
    ] = None,
    fill_gaps: Annotated[
        Path | None, typer.Option(help="Fly only what a map lacks: its folder, or its gaps.geojson.")
    ] = None,
    overrides: Overrides = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Scenario to write.")] = Path("survey.yaml"),
    picture: Annotated[Path | None, typer.Option("--figure", help="Write a picture, .png, .svg or .pdf.")] = None,
    sigma_picture: Annotated[
        Path | None, typer.Option("--sigma-figure", help="Write a picture of the mosaic's predicted error.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Lay parallel lines over an area so that a swath sees all of it, and write them as a scenario.

    Holes are kept clear of, and one lap is flown round each; the rest is mown back and forth, cell by cell. Says how
    long it takes and what it draws from the battery.

    With an imager it also says how fast pixels are square, how much will be recorded, and how far each place of the
    mosaic will be off, before the dive.

    Example: [bold]rovtwin plan-survey --area area.geojson --swath 1.2 --overlap 0.2 --figure survey.png[/bold]

    For a map: [bold]rovtwin plan-survey --area area.geojson --imager uhi --altitude 1.5 --floor 12 --overlap 0.3
    --sigma-figure sigma.png[/bold]

    Then [bold]rovtwin fly survey.yaml[/bold] flies it on the twin.
    """
    from rovtwin.planning.survey import SurveyRequest, survey_picture, write_survey
    from rovtwin.planning.survey_prediction import mosaic_picture
    from rovtwin.survey.room import Swath

    for path, option in ((picture, "--figure"), (sigma_picture, "--sigma-figure")):
        _check_ending(path, option)
    mapping = _mapping(imager, overlap, roll, square, crosshatch, error, assume, sigma_picture)
    request = SurveyRequest(
        area, None if swath is None else Swath(swath, overlap), _heading(heading), scenario, vehicle, depth, altitude,
        floor, speed, clearance, inside, datum, sees, tuple(overrides or ()), mapping, fill_gaps,
    )  # fmt: skip
    survey, sigma = _laid_out(request)
    write_survey(survey, out)
    for path, draw in ((picture, survey_picture), (sigma_picture, lambda s: mosaic_picture(s, sigma))):
        if path is not None:
            draw(survey).savefig(path, dpi=150)
    if as_json:
        emit(_report(survey, sigma) | {"scenario": str(out), "figure": None if picture is None else str(picture)})
        raise typer.Exit(DONE)
    _print(survey, console(False))
    if sigma is not None:
        _print_sigma(sigma, console(False))
    console(False).print(f"wrote {out}: rovtwin fly {out}", markup=False, soft_wrap=True)


def _mapping(imager: str | None, overlap: float, roll: float, square: bool, crosshatch: bool, error: float | None,
             assume: list[str] | None, sigma_picture: Path | None) -> Any:  # fmt: skip
    """What the map is to be like; None without an imager."""
    from rovtwin.planning.survey_assumptions import Assumptions
    from rovtwin.planning.survey_request import MapRequest

    if imager is None:
        idle = {"--roll": roll != 2.0, "--square": square, "--crosshatch": crosshatch, "--error": error is not None,
                "--assume": bool(assume), "--sigma-figure": sigma_picture is not None}  # fmt: skip
        refuse_idle(idle, "no --imager says what is mapped")
        return None
    return MapRequest(imager, overlap, roll, square, crosshatch, error, Assumptions.of(assume or ()))


def _laid_out(request: Any) -> tuple["Survey", Any]:
    """The survey, and the sigma of its mosaic if it has an imager."""
    from rovtwin.planning.survey import lay_out
    from rovtwin.planning.survey_prediction import lay_out_for_error

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console(True), transient=True) as bar:
        task = bar.add_task("trying headings", total=1.0)
        if request.mapping is None:
            return lay_out(request, lambda share: bar.update(task, completed=share)), None
        return lay_out_for_error(request, lambda share: bar.update(task, completed=share))


def _report(survey: "Survey", sigma: Any) -> dict[str, Any]:
    """Plain figures, those of the mosaic too."""
    if sigma is None:
        return survey.figures()
    causes = {name: {"absolute_m": a, "within_m": w} for name, (a, w) in sigma.causes.items()}
    rms = {f"{name}_m": value for name, value in sigma.rms().items()}
    return survey.figures() | {"mosaic_sigma": rms | {"ties": sigma.ties, "causes": causes}}


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


def _check_ending(path: Path | None, option: str) -> None:
    if path is not None and path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ConfigError(f"{option}: found {str(path)!r}, expected a name that ends in .png, .svg or .pdf")


def _print(survey: "Survey", screen: Any) -> None:
    figures = survey.figures()
    rows = table(f"survey of {survey.request.area}, {survey.scenario.vehicle}", "", "")
    rows.add_row("area", f"{figure(figures['area_m2'])} m2")
    rows.add_row("seen", f"{figures['coverage']:.2%} ({figures['coverage_of_reachable']:.2%} of what can be reached)")
    spacing = "" if figures["lines"] < 2 else f", {figure(figures['line_spacing_m'])} m apart"
    rows.add_row(
        "lines",
        f"{figures['lines']} at {figures['heading_deg']:.0f} deg{spacing}, "
        f"{figures['cells']} cell{'' if figures['cells'] == 1 else 's'}, "
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
    if survey.imaging is not None:
        rows.add_row("swath", f"{figures['swath_m']:.2f} m of {figures['imager']} at {figures['altitude_m']:g} m, "
                     f"{figures['swath_level_m']:.2f} m without roll")  # fmt: skip
        rows.add_row("pixels", f"{1e3 * figures['pixel_across_m']:.2g} mm across, "
                     f"{1e3 * figures['pixel_along_m']:.2g} mm along")  # fmt: skip
        rows.add_row("records", f"{figures['scan_lines']:,} lines, {figures['file_bytes'] / 1e9:.2g} GB")
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


CAUSES = {
    "readings": "noise of sensors, disturbances",
    "heading": "compass bias",
    "dvl": "Doppler log: yaw, scale",
    "boresight": "boresight of the imager",
    "lever": "place of the imager on the vehicle",
    "clock": "clock of the imager",
    "floor": "height of the floor",
}


def _print_sigma(sigma: Any, screen: Any) -> None:
    rows = table("error of the mosaic, predicted: 2D rms [mm]", "", "on Earth", "within the mosaic")
    for name, words in CAUSES.items():
        rows.add_row(words, *(f"{1e3 * value:.3g}" for value in sigma.causes[name]))
    rms = sigma.rms()
    rows.add_row("all", f"{1e3 * rms['absolute']:.3g}", f"{1e3 * rms['within']:.3g}")
    if rms["registered"] is not None:
        rows.add_row(f"all, {sigma.ties} ties of overlaps registered", "", f"{1e3 * rms['registered']:.3g}")
    screen.print(rows)
    if rms["registered"] is None:
        screen.print("- no place is seen by two lines: nothing to register", markup=False)
