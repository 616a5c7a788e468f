"""rovtwin fly --link and record: a vehicle that is not computed here."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, progress_bar, table
from rovtwin.cli.scenarios import Overrides, Seed
from rovtwin.core.errors import ConfigError, exists_already
from rovtwin.links.registry import forms

if TYPE_CHECKING:
    from rovtwin.runs.pace import Clock
    from rovtwin.scenario.schema import Scenario

Link = Annotated[
    str | None,
    typer.Option(metavar="URL", help=f"Fly a vehicle: {forms('link')}; `rovtwin links` lists them."),
]
Sensors = Annotated[
    list[str] | None,
    typer.Option("--sensor", metavar="URL", help=f"An instrument beside it: {forms('source')}."),
]


def fly_link(
    scenario: "Scenario",
    link: str,
    sensors: list[str],
    screen: Console,
    *,
    out: Path | None,
    thrust: bool,
    armed: bool,
    speed: float,
) -> Any:
    """Connect, listen, ask, fly; the flight.

    Raises:
        ConfigError: A URL cannot be used, or nobody is there to arm.
        LinkError: The vehicle cannot be reached, is silent, or refuses.
    """
    from contextlib import ExitStack

    from rovtwin.live.connect import as_read, connect, described, source
    from rovtwin.live.flight import fly_live
    from rovtwin.runs.fly import run_folder

    if not armed and not sys.stdin.isatty():
        raise ConfigError("fly --link: found no terminal to ask on before thrusters may turn; add --arm if they may")
    clock, scenario = _clock(speed, link), as_read(link, scenario)
    with ExitStack() as stack:
        with progress_bar("") as bar:
            bar.add_task(f"connecting to {link}", total=None)
            sources = [stack.enter_context(source(url, clock)) for url in sensors]
            vehicle = stack.enter_context(connect(link, scenario, clock, observe=not thrust))
        for url in (link, *sensors):
            screen.print(described(url), markup=False, soft_wrap=True)
        bar = stack.enter_context(progress_bar("{task.completed:.0f} s flown"))
        task = bar.add_task(f"{scenario.name}: compiling, listening", total=scenario.duration)

        def ask(readiness: Any) -> bool:
            bar.stop()
            _print_readiness(readiness, screen)
            _planned(scenario, screen)
            yes = armed or typer.confirm(_question(thrust), default=False, err=True)
            bar.start()
            return yes

        return fly_live(
            scenario,
            vehicle,
            sources,
            clock,
            out or run_folder(scenario.name),
            arm=ask,
            thrust=thrust,
            progress=lambda t, phase: bar.update(task, completed=t, description=f"{scenario.name}: {phase}"),
            say=lambda text: bar.update(task, description=text),
            tell=lambda cue: _tell(cue, bar.console),
            warn=lambda line: screen.print(f"{scenario.name}: {line}", markup=False, soft_wrap=True),
        )


def _clock(speed: float, link: str) -> "Clock":
    """The clock of a vehicle's time.

    Raises:
        ConfigError: It shall run at another speed than real time, and the vehicle may be a real one.
    """
    from rovtwin.live.connect import on_this_machine
    from rovtwin.runs.pace import Clock

    if speed != 1.0 and not on_this_machine(link):
        raise ConfigError(
            f"--speed {speed:g}: {link} may be a real vehicle, whose time runs as ours; it is for a twin that is "
            "served on this machine (at an address of 127.0.0.x, or within it, as twin:// and replay:// are)"
        )
    return Clock(speed)


TOO_OFTEN = 150.0  # no vehicle that is known here tells its rates of turn more often [Hz]


def _question(thrust: bool) -> str:
    return "Arm? Thrusters will turn" if thrust else "Begin? Without thrust: zeros are sent"


def _planned(scenario: "Scenario", screen: Console) -> None:
    """What a test will do and when; what a hand has to do is for people: no vehicle can do it."""
    from rovtwin.live.manoeuvres import plan

    lines = plan(scenario)
    if not lines:
        return
    rows = table("the test", "what", "from")
    for start, what in lines:
        rows.add_row(escape(what), f"{start:.0f} s")
    screen.print(rows)
    if any(what.startswith("BY HAND") for _, what in lines):
        screen.print(
            "By hand: tilt the vehicle when asked to here (a served twin has nobody to do so). Else keep hands away."
        )


def _tell(cue: Any, screen: Console) -> None:
    """A line above the bar; with a bell where somebody has to act."""
    screen.print(f"{cue.t:7.1f} s  {cue.text}", style="bold" if cue.hand else None, markup=False, soft_wrap=True)
    if cue.hand:
        screen.bell()


def _print_readiness(readiness: Any, screen: Console) -> None:
    rows = table("received before arming", "sensor", "rate")
    for name, rate in sorted(readiness.rates.items()):
        rows.add_row(name, figure(rate, "Hz"))
    screen.print(rows)
    north, east, depth = (float(x) for x in readiness.start.position)
    screen.print(f"the vehicle is at north {north:.2f} m, east {east:.2f} m, depth {depth:.2f} m")
    if readiness.rates.get("gyro", 0.0) > TOO_OFTEN:
        rate = figure(readiness.rates["gyro"], "Hz")
        screen.print(f"the gyro comes at {rate}: if this is a served twin, is --speed that of serve?", style="yellow")
    if readiness.missing:
        screen.print(f"no readings, flying without: {', '.join(readiness.missing)}", style="yellow", markup=False)


def record(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="Scenario with the vehicle and its sensors; see `scenario list`.")
    ],
    link: Annotated[str, typer.Option(metavar="URL", help="The vehicle; see `rovtwin fly --help`.")],
    out: Annotated[Path, typer.Option(help="New MCAP file.")],
    sensor: Sensors = None,
    duration: Annotated[
        float | None, typer.Option(min=0.0, help="Seconds of the vehicle's time; else until Ctrl-C.")
    ] = None,
    speed: Annotated[float, typer.Option(min=0.01, max=50.0, help="Speed of a served twin's time.")] = 1.0,
    seed: Seed = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Log what a vehicle measures, whoever steers it: nothing is sent that moves it."""
    from contextlib import ExitStack

    from rovtwin.live.connect import as_read, connect, source
    from rovtwin.live.record import record as record_it
    from rovtwin.scenario.files import load_scenario

    screen, loaded, clock = console(as_json), load_scenario(scenario, overrides or (), seed), _clock(speed, link)
    loaded = as_read(link, loaded)  # a reader of the log finds how its readings lie
    if out.exists():
        raise ConfigError(exists_already(f"--out {out}"))
    with ExitStack() as stack:
        bar = stack.enter_context(progress_bar("{task.completed:.0f} s"))
        task = bar.add_task(f"recording {link}", total=duration)
        sources = [stack.enter_context(source(url, clock)) for url in sensor or ()]
        vehicle = stack.enter_context(connect(link, loaded, clock, observe=True))
        counts = record_it(
            loaded,
            vehicle,
            sources,
            clock,
            out,
            duration,
            lambda t: bar.update(task, completed=t),
            lambda line: screen.print(line, style="yellow", markup=False, soft_wrap=True),
        )
    rows = table("recorded", "sensor", "readings")
    for name, count in sorted(counts.items()):
        rows.add_row(name, str(count))
    screen.print(rows)
    screen.print(f"wrote {out}", markup=False, soft_wrap=True)
    if as_json:
        emit({"log": str(out), "readings": counts})
    raise typer.Exit(DONE)
