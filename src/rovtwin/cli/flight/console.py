"""rovtwin console: the operator console in the browser."""

import secrets
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import console as screen_of
from rovtwin.cli.output import refuse_idle
from rovtwin.cli.scenarios import Overrides, Seed
from rovtwin.core.errors import ConfigError
from rovtwin.links.registry import forms

if TYPE_CHECKING:
    from rovtwin.scenario.schema import Scenario

PORT = 8800
SCENARIO = "lawnmower_calm"
MOST_VIEWS = 6  # of one's own: each is a process


def console(
    scenario: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", help="Vehicle, autopilot, world; see `scenario list`.")
    ] = SCENARIO,
    link: Annotated[str, typer.Option(metavar="URL", help=f"The vehicle: twin://, {forms('link')}")] = "twin://",
    sensor: Annotated[
        list[str] | None,
        typer.Option("--sensor", metavar="URL", help=f"An instrument beside it: {forms('source')}"),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Stream of a real camera, rtsp://.. ; that of a Blueye is known."),
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the web page.")] = PORT,
    host: Annotated[str, typer.Option(help="Address to serve at; others than this machine need the token shown.")] = (
        "127.0.0.1"
    ),
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    speed: Annotated[
        float, typer.Option(min=0.1, max=50.0, help="Speed of simulated time; it can be changed later.")
    ] = 1.0,
    view: Annotated[
        list[str] | None,
        typer.Option(
            "--view", metavar="VIEW", help="A view of your own: package.module:Name, or an installed one; several."
        ),
    ] = None,
    chart: Annotated[
        list[Path] | None,
        typer.Option("--map", metavar="FILE", help="A map under the chart: GeoTIFF, MBTiles, GeoPackage; several."),
    ] = None,
    runs: Annotated[Path, typer.Option(help="Folder for the logs of flights.")] = Path("runs"),
    replay: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Look at a finished run instead: its folder, or its log. Nothing is flown."),
    ] = None,
    seed: Seed = None,
    overrides: Overrides = None,
) -> None:
    """Watch, plan and fly from a browser; fly identification tests where the scenario is one (`test_mixed`).

    The autopilot runs in a process of its own: closing this one by Ctrl-C ends it in order, killing it does not, and
    `rovtwin console` finds it again. Nothing is loaded from the network.
    """
    try:
        from rovtwin.console.web.app import build, build_replay
        from rovtwin.console.web.gate import LOOPBACK, Gate
    except ImportError as error:
        raise ConfigError(
            f"the console needs {error.name}, which is not installed: pip install 'rovtwin[console]'"
        ) from None
    from rovtwin.console.launch import end, require_free, running, sigterm_ends, start
    from rovtwin.console.video import camera_of, require_stream
    from rovtwin.console.wire import Place
    from rovtwin.runs.trimmed import trimmed
    from rovtwin.scenario.files import load_scenario

    views = _views(view or [])
    screen = screen_of(False)
    token = None if host in LOOPBACK else secrets.token_urlsafe(12)
    address = f"http://{host}:{port}/{f'?token={token}' if token else ''}"
    if replay is not None:
        from rovtwin.console.replays.replay import Recording

        if link != "twin://" or sensor or camera:
            raise ConfigError(f"--replay {replay}: nothing is flown; leave out --link, --sensor, --camera")
        given = {
            scenario: scenario != SCENARIO,
            "--view": bool(view),
            "--map": bool(chart),
            "--set": bool(overrides),
            "--seed": seed is not None,
        }
        refuse_idle(
            given | {"--speed": speed != 1.0}, f"--replay {replay} shows a run as it was; its speed is the page's"
        )
        build_replay(Recording.open(replay), Gate(host, token), runs)
        screen.print(f"open {address}   (Ctrl-C: end)", markup=False, soft_wrap=True)
        _serve(host, port, address if browser else "")
        return
    if camera is not None:
        require_stream(camera)
    if speed != 1.0 and link != "twin://":
        raise ConfigError(f"--speed {speed:g}: {link} may be a real vehicle, whose time runs as ours")
    loaded, place = _sized(load_scenario(scenario, overrides or (), seed)), Place.of(port)
    loaded, ballast = trimmed(loaded) if link == "twin://" else (loaded, "")
    _require_flyable(loaded, link)
    require_free(host, port)  # or a second console that cannot begin would end the autopilot of the first
    found = running(place)
    if found is not None:
        screen.print(
            f"found an autopilot that flies {found.scenario} over {found.link} since before: watching that one. "
            "To start another, end it: Ctrl-C here, then start again",
            style="yellow",
            markup=False,
        )
        loaded, link = load_scenario(str(place.folder / "scenario.yaml"), (), None), found.link  # as it was given it
    maps = _maps(chart or [], loaded)
    with sigterm_ends():
        if found is None:
            start(place, loaded, link, sensor or [], speed, runs)
        try:
            if found is None:
                screen.print(f"autopilot started: {loaded.name} over {link}", markup=False)
            if found is None and ballast:
                screen.print(ballast, markup=False, soft_wrap=True)
            if token:
                screen.print(
                    f"{host}: who has this address and token can fly the vehicle", style="yellow", markup=False
                )
            screen.print(f"open {address}   (Ctrl-C: thrusters off, end)", markup=False, soft_wrap=True)
            films = camera or camera_of(link)
            build(place, Gate(host, token), loaded, runs, link == "twin://", films, views, link, sensor or (), maps)
            _serve(host, port, address if browser else "")
        finally:
            end(place)


def _views(views: list[str]) -> list[str]:
    """Views of one's own, seen to be there; what the command line names may be run.

    Raises:
        ConfigError: One is not there, or there are too many.
    """
    from rovtwin.core.plugins import VIEWS, require_there
    from rovtwin.core.trust import consent_to_addresses

    if len(views) > MOST_VIEWS:
        raise ConfigError(f"--view: found {len(views)}, expected at most {MOST_VIEWS}")
    consent_to_addresses(views)
    for one in views:
        require_there(one, VIEWS, "--view")
    return views


def _maps(paths: list[Path], scenario: "Scenario") -> list[Any]:
    """Maps under the chart, seen to lie where the vehicle is.

    Raises:
        ConfigError: One cannot be read or lies somewhere else, or nobody has given where the metres lie on the map.
    """
    if not paths:
        return []
    from rovtwin.console.chart.maps import describe
    from rovtwin.planning.exchange.missions import NO_DATUM

    if not scenario.datum.is_given:
        raise ConfigError(f"--map {paths[0]}: {NO_DATUM}")
    return [describe(path, scenario.origin) for path in paths]


def _sized(loaded: "Scenario") -> "Scenario":
    """With what its mission leaves out, from the vehicle; with the test as the vehicle flies it."""
    from rovtwin.runs.compose.composition import vehicle_of
    from rovtwin.runs.compose.fit_experiment import fitted_test
    from rovtwin.runs.compose.fitting import fitted

    return fitted(fitted_test(loaded), vehicle_of(loaded).model())


def _require_flyable(scenario: "Scenario", link: str) -> None:
    """Raise ConfigError for what the page could only say much later: no such link or code, a mission in a wall.

    Nor is one begun that the vehicle cannot fly at all; the water of a real one is not the scenario's.
    """
    from rovtwin.live.connect import opener
    from rovtwin.runs.compose.composition import keys_of, vehicle_of
    from rovtwin.runs.compose.inside import require_inside
    from rovtwin.runs.compose.own_blocks import require_own_code
    from rovtwin.runs.compose.world import plant_of
    from rovtwin.runs.feasibility.mission import require_feasible
    from rovtwin.runs.pace import Clock

    require_own_code(scenario)
    vehicle, twin = vehicle_of(scenario), link == "twin://"
    model = vehicle.model()
    require_inside(scenario, model)
    truth = plant_of(scenario.world, vehicle, model, keys_of(scenario.seed)[0]) if twin else model
    require_feasible(scenario, truth, known_world=twin)
    if not twin:
        opener(link, scenario, Clock())


def _serve(host: str, port: int, address: str) -> None:
    """Until Ctrl-C; opens the browser at an address, if one is given."""
    import threading

    from rovtwin.console.web.app import run

    if address:
        threading.Timer(1.5, webbrowser.open, args=(address,)).start()
    run(host, port)
