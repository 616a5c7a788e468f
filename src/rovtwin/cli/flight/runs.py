"""rovtwin fly, demo and report: run scenarios and look at what came out."""

import math
import os
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from rovtwin.cli.flight.live import Link, Sensors, fly_link
from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, figure, progress_bar, refuse_idle, table
from rovtwin.cli.scenarios import Overrides, Seed
from rovtwin.core.errors import ConfigError

if TYPE_CHECKING:
    from rovtwin.core.log import Log
    from rovtwin.scenario.schema import Scenario
    from rovtwin.vehicle import Model


def fly(
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="SCENARIO", help="A shipped name (see `rovtwin scenario list`) or a YAML file."),
    ] = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="Tick by tick by the wall clock.")] = False,
    seed: Seed = None,
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="Folder of this run; default runs/<time>-<name>.")] = None,
    report: Annotated[bool, typer.Option(help="Write the HTML report and figures.")] = True,
    camera: Annotated[
        bool, typer.Option("--camera", help="Record the scenario's cameras: rendered pictures, <camera>.mcap.")
    ] = False,
    film: Annotated[bool, typer.Option("--film", help="Record them as MP4 too.")] = False,
    replay: Annotated[
        str | None, typer.Option(metavar="FOLDER/NUMBER", help="A mission of a campaign again, to the last bit.")
    ] = None,
    link: Link = None,
    sensor: Sensors = None,
    thrust: Annotated[bool, typer.Option("--thrust/--no-thrust", help="With --link: all but thrust.")] = True,
    arm: Annotated[bool, typer.Option("--arm", help="With --link: do not ask before thrusters may turn.")] = False,
    speed: Annotated[float, typer.Option(min=0.01, max=50.0, help="With --link: of a served twin's time.")] = 1.0,
    as_json: AsJson = False,
) -> None:
    """Fly a scenario; write log, complete scenario, report and figures to runs/<time>-<name>/.

    With --link the autopilot flies a vehicle over its protocol: [bold]rovtwin fly lawnmower_calm --link
    blueye://127.0.0.2,127.0.0.3 --sensor ugps://127.0.0.1:8080[/bold] flies what `rovtwin serve` serves, or two real
    drones. Thrusters turn only after you confirm it, and stop however this program ends. Tests fly in the same way;
    the terminal announces each step, and when a hand has to tilt the vehicle and let go.
    """
    loaded, screen = _scenario_of(scenario, replay, overrides or (), seed), console(as_json)
    if link is not None:
        given = {"--realtime": realtime, "--camera": camera, "--film": film}
        refuse_idle(given, "with --link the vehicle, its time and its cameras are not computed here")
        flight = fly_link(loaded, link, sensor or [], screen, out=out, thrust=thrust, armed=arm, speed=speed)
        if report and flight.figures.get("duration_s"):
            _report_beside(flight.log, flight.folder)
        _closing_table(flight, screen)
    elif sensor or not thrust or arm or speed != 1.0:
        raise ConfigError("fly: --sensor, --no-thrust, --arm and --speed go with --link; add one, or leave them out")
    else:
        _say_beforehand(loaded, screen)
        as_sample = {"short": 0} if replay else {}
        flight = _fly(loaded, out, realtime, report, screen, camera=camera, film=film, **as_sample)
    if as_json:
        emit(flight_object(flight))
    raise typer.Exit(DONE if flight.completed else FAILED)


def _scenario_of(
    scenario: str | None, replay: str | None, overrides: list[str] | tuple[()], seed: int | None
) -> "Scenario":
    """The scenario to fly, by its name or as a sample of a campaign."""
    if replay is None:
        if scenario is None:
            raise ConfigError("fly: found no SCENARIO, expected a name of `rovtwin scenario list`, a file, or --replay")
        from rovtwin.runs.compose.fit_experiment import fitted_test
        from rovtwin.scenario.files import load_scenario

        return fitted_test(load_scenario(scenario, overrides, seed))
    if scenario or overrides or seed is not None:
        raise ConfigError("--replay flies a sample as it was: leave out SCENARIO, --set and --seed")
    from rovtwin.campaign.replay import sample_of
    from rovtwin.campaign.samples import scenario_at

    campaign, index = sample_of(replay)
    return scenario_at(campaign, index).model_copy(update={"name": f"{campaign.name}-{index}"})


def _say_beforehand(scenario: "Scenario", screen: Console) -> None:
    """A line before a flight in moving water; on empty batteries, tuned for other parts."""
    from rovtwin.runs.compose.autopilot import tuned_for_another
    from rovtwin.runs.compose.battery import empty_at_start
    from rovtwin.runs.compose.composition import compose, vehicle_of
    from rovtwin.runs.feasibility.sea import moves, verdict

    if moves(scenario):
        screen.print(f"{scenario.name}: {verdict(compose(scenario))[1]}", markup=False, soft_wrap=True)
    noted = getattr(scenario.autopilot, "tuned", None)
    other = tuned_for_another(scenario.autopilot, vehicle_of(scenario)) if noted else None
    changed = scenario.test.notes if scenario.test else []
    for text in (empty_at_start(scenario), other, *changed):
        if text:
            screen.print(f"{scenario.name}: {text}", markup=False, soft_wrap=True)


def _fly(scenario: "Scenario", out: Path | None, realtime: bool, report: bool, screen: Console, **more: Any) -> Any:
    with progress_bar("{task.completed:.0f} s simulated") as bar:
        task = bar.add_task(f"{scenario.name}: compiling", total=scenario.duration)
        from rovtwin.runs.fly import fly as fly_it
        from rovtwin.runs.fly import run_folder

        def progress(t: float, phase: str) -> None:
            bar.update(task, completed=t, description=f"{scenario.name}: {phase}")

        folder = out or run_folder(scenario.name)

        def say(line: str) -> None:
            screen.print(f"{scenario.name}: {line}", markup=False, soft_wrap=True)

        flight = fly_it(scenario, folder, realtime=realtime, progress=progress, say=say, **more)
        if report:
            bar.update(task, description=f"{scenario.name}: writing the report")
            _report_beside(flight.log, folder)
    _closing_table(flight, screen)
    return flight


def _report_beside(log: "Log", folder: Path) -> None:
    """The report of a flight that is logged.

    Raises:
        LogError: It cannot be written; the log is whole.
    """
    from rovtwin.core.log.files import keeping
    from rovtwin.report import write_report

    with keeping(folder, f"The log is whole: {folder / 'log.mcap'}; `rovtwin report` makes the report from it"):
        write_report(log, folder)


def _closing_table(flight: Any, screen: Console) -> None:
    summary = flight.figures
    done = "test done" if summary.get("test") else "completed"
    from rovtwin.core.flow import FAIL_SAFE_PHASES
    from rovtwin.report.run.verdict import overconfident
    from rovtwin.runs.scoring import figures

    acted = "" if summary["phase"] not in FAIL_SAFE_PHASES else f"{summary['phase']}, "
    verdict = done if flight.completed else f"not completed: {acted}{summary['reason']}"
    rows = table("", "figure", "value")
    idle = ("cross_track_rms_m", "cross_track_max_m") if _stays(flight.scenario, summary) else ()
    for label, value, unit in figures.rows({key: value for key, value in summary.items() if key not in idle}):
        rows.add_row(label, figure(value, unit))
    screen.print(f"{flight.scenario.name}, seed {flight.scenario.seed}: {verdict}", style="bold", markup=False)
    if summary.get("why"):
        screen.print(f"  {summary['why']}", markup=False)
    for line in summary.get("unmet", []):
        screen.print(f"  {line}", markup=False)
    for line in summary.get("touched", []):
        screen.print(f"  {line}", markup=False, soft_wrap=True)
    for one in summary["decisions"]:
        screen.print(f"  {one['t']:7.1f} s  {one['what']}: {one['cause']}", markup=False)
    for line in summary.get("changed", []):
        screen.print(f"  {line}", style="bold red", markup=False)
    if summary.get("monitor"):
        screen.print(f"  what has changed was not watched to the end; the monitor {summary['monitor']}", markup=False)
    screen.print(rows)
    if above := overconfident(summary):
        screen.print(f"  {above}", markup=False, soft_wrap=True)
    if summary.get("judged_by"):
        screen.print(f"  judged by {summary['judged_by']}: there is no truth")
    if flight.folder:
        screen.print(f"wrote {flight.folder}", markup=False, soft_wrap=True)


def _stays(scenario: "Scenario", summary: dict[str, Any]) -> bool:
    """Whether a mission keeps one place from the start on: then there is no path to be off, but for rounding."""
    points, here, origin = scenario.waypoints, scenario.start.position[:2], scenario.origin
    still = all(math.dist(point.placed(origin)[:2], here) <= (point.acceptance or 0.0) for point in points)
    return summary.get("station_rms_m") is not None and bool(points) and still


def flight_object(flight: Any) -> dict[str, Any]:
    """What `--json` says of a flight."""
    files = {path.name: str(path) for path in sorted(flight.folder.iterdir()) if path.is_file()}
    return {
        "scenario": flight.scenario.name,
        "seed": flight.scenario.seed,
        **flight.figures,
        "run_dir": str(flight.folder),
        "files": files,
    }


def report(
    log: Annotated[Path, typer.Argument(help="A log, such as runs/<run>/log.mcap.")],
    out: Annotated[Path | None, typer.Option(help="Folder to write to; default the log's.")] = None,
    as_json: AsJson = False,
) -> None:
    """Make the HTML report and figures of a log again."""
    from rovtwin.core.log import Log
    from rovtwin.report import write_report

    path = write_report(Log.read(log), out or log.parent)
    if as_json:
        emit({"report": str(path)})
    else:
        console(False).print(f"wrote {path}", markup=False)


def demo(
    what: Annotated[
        str, typer.Argument(help="flight, or map: a survey planned, flown, scanned with an imager, and its mosaic.")
    ] = "flight",
    out: Annotated[Path | None, typer.Option(help="Folder; default runs/<time>-demo.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fly the Double Blueye's lawn-mower in waves, then with a payload bolted on, and identify it from its own camera.

    The page that comes out holds the flights beside the thesis's published behaviour. [bold]rovtwin demo map[/bold]
    ends in a mosaic of reflectance of the sea floor instead.
    """
    if what not in ("flight", "map"):
        raise ConfigError(f"demo: found '{what}', expected flight or map")
    # Each program runs once: to optimise it takes longer than it saves. XLA reads this when JAX is imported.
    flags, option = os.environ.get("XLA_FLAGS", ""), "xla_backend_optimization_level"
    if option not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{option}=0".strip()
    from rovtwin.demo.demo import run_demo
    from rovtwin.runs.fly import run_folder

    screen = console(as_json)
    if what == "map":
        _demo_map(out or run_folder("demo-map"), screen, as_json)
        raise typer.Exit(DONE)
    screen.print(
        "The lawn-mower in waves, by the thesis's gains (the baseline) and by the model-based autopilot (the default); "
        "then a Doppler log and a sonar are bolted on, the vehicle is tested, identified and flown again; then a short "
        "test filmed by the vehicle's own camera, and its parameters from that."
    )
    screen.print("The thesis's gains are expected to fail: they have no integral against the drift (see the page).\n")
    folder = out or run_folder("demo")
    with ExitStack() as stack:

        def say(what: str) -> None:
            stack.pop_all().close()
            bar = stack.enter_context(progress_bar(""))
            bar.add_task(what, total=None)

        def fly(scenario: "Scenario", where: Path, truth: "Model | None") -> Any:
            stack.pop_all().close()
            return _fly(scenario, where, False, True, screen, truth=truth)

        result = run_demo(folder, fly, say)
    if result["camera"].get("left_out"):
        screen.print(f"left out: {result['camera']['left_out']}", markup=False, soft_wrap=True)
    screen.print(f"\nOpen [bold]{result['report']}[/bold] in a browser.", soft_wrap=True)
    if as_json:
        emit(result)
    raise typer.Exit(DONE if result["completed"] else FAILED)


def _demo_map(folder: Path, screen: Any, as_json: bool) -> None:
    from rovtwin.demo.mapping import run_map_demo

    screen.print("Five by three metres of a coastal bottom: a survey is planned, flown, scanned and mapped.\n")
    with ExitStack() as stack:

        def say(what: str) -> None:
            stack.pop_all().close()
            stack.enter_context(progress_bar("")).add_task(what, total=None)

        def fly(scenario: "Scenario", where: Path) -> Any:
            stack.pop_all().close()
            return _fly(scenario, where, False, True, screen)

        result = run_map_demo(folder, fly, say)
    for remark in result["remarks"]:
        screen.print(f"- {remark}", markup=False, soft_wrap=True)
    screen.print(f"\nOpen [bold]{result['report']}[/bold] in a browser.", soft_wrap=True)
    if as_json:
        emit(result)
