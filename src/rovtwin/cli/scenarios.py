"""rovtwin scenario: look at scenarios; and the arguments of every command that takes one."""

from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, console, emit, table

ScenarioName = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A shipped name (see `rovtwin scenario list`) or a YAML file.")
]


def _there(overrides: list[str] | None) -> list[str] | None:
    """Look whether code of one's own that `--set` names is there, before anything is imported that takes seconds.

    Raises:
        ConfigError: It is not.
    """
    from rovtwin.core.plugins import BLOCKS, require_there
    from rovtwin.core.trust import consent_to, is_address

    for text in overrides or ():
        key, _, value = text.partition("=")
        if key.strip().partition(".")[0] in ("autopilot", "world") and is_address(value.strip()):
            consent_to(value.strip())  # as `scenario.files` does: whoever calls the program names this code
            require_there(value.strip(), BLOCKS, f"--set {key.strip()}")
    return overrides


Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change the scenario, e.g. world.current=[0.1,0,0]. Repeatable.",
        callback=_there,
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of all randomness; default the scenario's.")]

scenario_app = typer.Typer(no_args_is_help=True, help="Look at scenarios: list, show in full, check, schema.")


@scenario_app.command("list")
def list_all(as_json: AsJson = False) -> None:
    """Shipped scenarios and missions; each also comes with a Doppler log (NAME_dvl) and with tethers (NAME_tether)."""
    from rovtwin.scenario.files import list_missions, list_scenarios, load_scenario

    found = {name: load_scenario(name).description for name in list_scenarios()}
    if as_json:
        emit({"scenarios": found, "missions": list_missions()})
        return
    rows = table("scenarios (NAME_dvl adds a Doppler log, NAME_tether tethers)", "name", "what it is")
    rows.columns[1].justify = "left"
    for name, what in found.items():
        rows.add_row(name, what)
    out = console(False)
    out.print(rows)
    out.print(f"missions: {', '.join(list_missions())}")


@scenario_app.command("show")
def show(scenario: ScenarioName, overrides: Overrides = None, seed: Seed = None, as_json: AsJson = False) -> None:
    """Print a scenario in full, with all defaults: a file to start from. As remarks, the sensors that will fly."""
    from rovtwin.runs.compose.composition import vehicle_of
    from rovtwin.runs.compose.fit_experiment import fitted_test
    from rovtwin.runs.compose.sensors import listed
    from rovtwin.scenario.files import dump_scenario, load_scenario

    found = fitted_test(load_scenario(scenario, overrides or (), seed))
    if as_json:
        emit(found.model_dump(mode="json"))
        return
    typer.echo(dump_scenario(found), nl=False)
    typer.echo("".join(f"# {line}\n" for line in listed(found, vehicle_of(found))), nl=False)


@scenario_app.command("check")
def check(scenario: ScenarioName, overrides: Overrides = None, as_json: AsJson = False) -> None:
    """Check a scenario, its vehicle and its mission for mistakes (exit code 2), without flying.

    Lists, too, what the vehicle cannot do of the mission and what it does instead, in waves or current whether it can
    hold its place (`rovtwin sea` has the figures), and whether a battery is empty from the start.
    """
    from rovtwin.runs.compose.battery import empty_at_start
    from rovtwin.runs.compose.composition import compose
    from rovtwin.runs.compose.fitting import assumptions
    from rovtwin.runs.compose.sensors import assumed_sensors
    from rovtwin.runs.feasibility.mission import foreseen
    from rovtwin.runs.feasibility.sea import moves, verdict
    from rovtwin.scenario.files import load_scenario

    found = load_scenario(scenario, overrides or ())
    simulation = compose(found)
    lines = foreseen(simulation.scenario, simulation.vehicle, simulation.loop.twin.model)
    lines += assumptions(found, simulation.scenario)
    holds, line = verdict(simulation) if moves(found) else (None, None)
    empty, assumed = empty_at_start(found), assumed_sensors(found, simulation.vehicle)
    if as_json:
        emit(
            {
                "scenario": found.name,
                "valid": True,
                "foreseen": lines,
                "holds_place": holds,
                "holds_place_line": line,
                "battery_line": empty,
                "sensors_line": assumed,
            }
        )
        return
    screen = console(False)
    screen.print(f"{scenario}: usable", markup=False)
    for text in (*lines, line, empty, assumed):
        if text:
            screen.print(f"- {text}", markup=False, soft_wrap=True)


@scenario_app.command("schema")
def schema(as_json: AsJson = True) -> None:
    """The JSON Schema of scenario files, for editors to complete and check them."""
    from rovtwin.scenario.schema import Scenario

    emit(Scenario.model_json_schema())
