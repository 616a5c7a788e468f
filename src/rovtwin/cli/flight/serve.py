"""rovtwin serve and replay: the twin, or a log, as a vehicle that speaks its vendor's protocol."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from rovtwin.cli.output import DONE, AsJson, console, emit, progress_bar, refuse_idle
from rovtwin.cli.scenarios import Overrides, Seed
from rovtwin.core.errors import ConfigError, exists_already
from rovtwin.links.registry import built_in, names_of

if TYPE_CHECKING:
    from rovtwin.links.endpoint import Endpoint
    from rovtwin.links.servers.server import Server
    from rovtwin.scenario.schema import Scenario

SERVED, FIRMWARES = (names_of(kind, of=built_in()) for kind in ("server", "firmware"))

Protocols = Annotated[
    list[str] | None,
    typer.Option("--protocol", help=f"{', '.join([*SERVED, *FIRMWARES])}; may be given several times."),
]
Addresses = Annotated[
    list[str] | None,
    typer.Option(
        "--address",
        metavar="[PROTOCOL=]HOST[:PORT]",
        help="Where to listen, such as 127.0.0.2, one for each drone, or dvl=127.0.0.1:16171; also several.",
    ),
]
Port = Annotated[
    int | None, typer.Option(min=1, max=65535, help="Port of the first protocol, in place of its usual one.")
]
Expose = Annotated[bool, typer.Option("--expose", help="Allow addresses that others on the network reach.")]
Speed = Annotated[float, typer.Option(min=0.01, max=50.0, help=f"Simulated seconds a second; not for {FIRMWARES[0]}.")]
Duration = Annotated[float | None, typer.Option(min=0.0, help="End after so many simulated seconds; else Ctrl-C.")]


def serve(
    what: Annotated[
        str, typer.Argument(metavar="VEHICLE|SCENARIO", help="A vehicle, or a scenario for its world too.")
    ],
    protocol: Protocols = None,
    address: Addresses = None,
    port: Port = None,
    expose: Expose = False,
    speed: Speed = 1.0,
    duration: Duration = None,
    seed: Seed = None,
    overrides: Overrides = None,
    log: Annotated[Path | None, typer.Option(help="Write the truth to a new MCAP file.")] = None,
    as_json: AsJson = False,
) -> None:
    """Serve the twin in place of the vehicle, over the vehicle's own protocol, until Ctrl-C.

    [bold]rovtwin serve double_blueye --protocol blueye --protocol ugps[/bold] are two drones at 127.0.0.2 and 127.0.0.3
    for the vendor's SDK, and an Underwater GPS; [bold]rovtwin serve bluerov2_heavy --protocol mavlink[/bold] is a
    BlueROV2 for pymavlink, MAVSDK or a ground station. Without --protocol the vehicle's own is served. A vehicle that
    would sink is ballasted first; [bold]--set world.net_buoyancy=0[/bold] leaves it as described.
    """
    from rovtwin.live.serving.beforehand import command_line, stick_of, warnings
    from rovtwin.live.serving.host import ServedVehicle
    from rovtwin.live.serving.protocols import (
        firmware_of,
        is_vehicle,
        known,
        own_protocol,
        places_of,
        servers_of,
        world_for,
    )
    from rovtwin.runs.compose.composition import vehicle_of
    from rovtwin.runs.compose.sensors import assumed_sensors
    from rovtwin.runs.trimmed import trimmed

    firmware = firmware_of(known(protocol or []))
    if firmware is not None and firmware.firmware is not None:
        how = firmware.firmware().pace
        refuse_idle({"--speed": speed != 1.0}, f"with {firmware.scheme} the firmware keeps the time: {how}")
    scenario, ballast = trimmed(world_for(what, overrides or (), seed))
    screen = console(as_json)
    if ballast:
        screen.print(ballast, markup=False, soft_wrap=True)
    if firmware is not None:
        _lockstep(firmware, scenario, address or [], port, expose, duration, log, as_json)
    names = known(protocol or [own_protocol(scenario)])
    places = places_of(names, address or [], port)
    _warn([host for place in places.values() for host in place.hosts], expose, screen)
    if assumed := assumed_sensors(scenario, vehicle_of(scenario)):
        screen.print(f"{what}: {assumed}", markup=False, soft_wrap=True)
    screen.print(f"{what}: compiling, some 10 to 30 s", markup=False)
    with progress_bar("") as bar:
        bar.add_task(f"{what}: compiling", total=None)
        vehicle = ServedVehicle(scenario)
    servers = servers_of(names, scenario, vehicle, places, expose)
    for line in warnings(vehicle_of(scenario).model(), vehicle.largest, stick_of(servers.values())):
        screen.print(f"{what}: {line}", markup=False, soft_wrap=True)
    if line := command_line(what, is_vehicle(what), servers):
        screen.print(f"to fly it: {line}", markup=False, soft_wrap=True)
    _serve(vehicle, list(servers.values()), screen, speed, duration, log, as_json)


def replay(
    log: Annotated[Path, typer.Argument(help="A run's log, such as runs/<run>/log.mcap.")],
    protocol: Annotated[list[str] | None, typer.Option("--as", help=f"Protocol to speak: {', '.join(SERVED)}.")] = None,
    address: Addresses = None,
    port: Port = None,
    expose: Expose = False,
    speed: Speed = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end.")] = False,
    as_json: AsJson = False,
) -> None:
    """Serve a log as if it were the vehicle: its readings come again by the clock, commands move nothing."""
    from rovtwin.core.log import Log
    from rovtwin.live.serving.protocols import known, own_protocol, places_of, servers_of
    from rovtwin.live.serving.replayed import ReplayedVehicle

    vehicle = ReplayedVehicle(Log.read(log), loop)
    names, screen = known(protocol or [own_protocol(vehicle.scenario)]), console(as_json)
    places = places_of(names, address or [], port)
    _warn([host for place in places.values() for host in place.hosts], expose, screen)
    servers = servers_of(names, vehicle.scenario, vehicle, places, expose)
    _serve(vehicle, list(servers.values()), screen, speed, vehicle.duration, None, as_json)


def _lockstep(
    firmware: "Endpoint",
    scenario: "Scenario",
    address: list[str],
    port: int | None,
    expose: bool,
    duration: float | None,
    log: Path | None,
    as_json: bool,
) -> None:
    import math

    from rovtwin.links.endpoint import Where
    from rovtwin.live.serving.lockstep import serve_firmware
    from rovtwin.live.serving.protocols import places_of

    _require_new(log)
    screen = console(as_json)
    where = places_of([firmware.scheme], address, port).get(firmware.scheme, Where())
    _warn(where.hosts, expose, screen)
    with progress_bar("{task.completed:.0f} s") as bar:
        task = bar.add_task("vehicle's time", total=duration)
        most = math.inf if duration is None else duration
        served = serve_firmware(
            scenario,
            firmware,
            where,
            most,
            lambda text: screen.print(text, markup=False, soft_wrap=True),
            lambda t: bar.update(task, completed=t),
            log,
        )
    if as_json:
        emit({"served_s": served, "log": str(log) if log else None})
    raise typer.Exit(DONE)


def _require_new(log: Path | None) -> None:
    if log is not None and log.exists():
        raise ConfigError(exists_already(f"--log {log}"))


def _warn(hosts: list[str], expose: bool, screen: Console) -> None:
    from rovtwin.links.servers.server import loopback_only

    for exposed in loopback_only(hosts, expose) or (["it"] if expose else []):
        screen.print(f"warning: everybody who reaches {exposed} can steer this vehicle", style="yellow", markup=False)


def _serve(
    vehicle: Any,
    servers: "list[Server]",
    screen: Console,
    speed: float,
    duration: float | None,
    log: Path | None,
    as_json: bool,
) -> None:
    import math

    from rovtwin.live.serving.serve import serve as serve_it

    _require_new(log)
    printed: list[str] = []

    def say(text: str) -> None:
        screen.print(text, markup=False, soft_wrap=True)
        if not printed:
            screen.print("serving; Ctrl-C ends it")
        printed.append(text)

    with progress_bar("{task.completed:.0f} s") as bar:
        task = bar.add_task("vehicle's time", total=duration)
        pace = serve_it(
            vehicle,
            servers,
            speed=speed,
            duration=math.inf if duration is None else duration,
            log=log,
            say=say,
            progress=lambda t, _: bar.update(task, completed=t),
        )
    figures = pace.figures()
    screen.print(
        f"served {vehicle.now:.1f} s; periods began {figures['late_ms_p50']:.1f} ms late (median), "
        f"{figures['late_ms_p99']:.1f} ms (99 %), {figures['late_ms_max']:.1f} ms (worst)"
    )
    if as_json:
        emit({"served_s": vehicle.now, **figures, "log": str(log) if log else None})
    raise typer.Exit(DONE)
