"""rovtwin tune: gains and beliefs of the model-based autopilot from the vehicle and what is not known of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, figure, table
from rovtwin.cli.scenarios import Overrides, ScenarioName

if TYPE_CHECKING:
    from rovtwin.campaign.tuning.result import Tuned, TuningRequest


def tune(
    scenario: ScenarioName,
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="Folder; default runs/tune-<scenario>. Replaced.")] = None,
    sea: Annotated[
        list[str] | None,
        typer.Option(help="calm, waves, sea, own, or a scenario with waves. Repeatable; default calm and waves."),
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="PARAMETER", help="Search this one. Repeatable; default the usual nine.")
    ] = None,
    weight: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TERM=VALUE", help="path 0.5, depth 0.15, heading 0.1, attitude 0.1, effort 0.05, activity 0.2."
        ),
    ] = None,
    budget_s: Annotated[float, typer.Option(help="Wall time of everything [s].")] = 170.0,
    evaluations: Annotated[int, typer.Option(help="Most autopilots that the search tries.")] = 150,
    plants: Annotated[int, typer.Option(help="Vehicles that each is flown on, and as many to choose on.")] = 4,
    held_out: Annotated[int, typer.Option(help="Vehicles that judge, seen by nobody before.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Master seed.")] = 1,
    own_mission: Annotated[
        bool, typer.Option("--own-mission", help="Search on the scenario's mission, not on a short one.")
    ] = False,
    workers: Annotated[int | None, typer.Option(min=1, help="Threads; default one for each core.")] = None,
    report: Annotated[bool, typer.Option(help="Write the HTML report and figures.")] = True,
    as_json: AsJson = False,
) -> None:
    """Tune the model_based autopilot: least expected cost over vehicles as they may truly be, and over seas.

    Vehicles are drawn from the covariance of its identification (rovtwin identify), else from the scenario's mismatch
    or a usual spread. CMA-ES searches on a short mission; the scenario's own mission judges, on vehicles and noise that
    the search has not seen. With the same seed, and time enough for all evaluations, it finds the same.

    Example: [bold]rovtwin tune lawnmower_hard[/bold]

    Then [bold]rovtwin fly lawnmower_hard --set autopilot=runs/tune-lawnmower_hard/autopilot.yaml[/bold]. Exit code 0:
    better than before on the held-out vehicles; 1: not shown to be (the file is written, too).
    """
    from rovtwin.core.extras import require
    from rovtwin.scenario.files import load_scenario

    require("cmaes", "campaign", "tuning")
    from rovtwin.campaign.tuning.cost import weights_of
    from rovtwin.campaign.tuning.parameters import chosen
    from rovtwin.campaign.tuning.result import TuningRequest

    request = TuningRequest(
        scenario=load_scenario(scenario, overrides or ()),
        tunables=chosen(only or ()),
        seas=sea or (),
        weights=weights_of(weight or ()),
        plants=plants,
        held_out=held_out,
        seed=seed,
        evaluations=evaluations,
        budget=budget_s,
        own=own_mission,
        workers=workers,
    )
    tuned = _run(request)
    from rovtwin.campaign.tuning.writing import as_data, write_tuned

    folder = out or Path("runs") / f"tune-{request.scenario.name}"
    files = {name: str(path) for name, path in write_tuned(tuned, folder, report).items()}
    if as_json:
        emit(as_data(tuned) | {"run_dir": str(folder), "files": files})
    _say(tuned, files, console(as_json))
    raise typer.Exit(DONE if tuned.held_out.better else FAILED)


def _run(request: "TuningRequest") -> "Tuned":
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console(True), transient=True) as bar:
        task = bar.add_task(f"{request.scenario.name}: loading", total=1.0)
        from rovtwin.campaign.tuning.tune import tune as tune_it

        def progress(what: str, share: float) -> None:
            bar.update(task, description=f"{request.scenario.name}: {what}", completed=share)

        return tune_it(request, progress)


def _say(tuned: "Tuned", files: dict[str, str], screen: Any) -> None:
    from rovtwin.campaign.tuning.result import terms_table
    from rovtwin.campaign.tuning.writing import sentences

    head, sentences_of = sentences(tuned)
    screen.print(head, style="bold", markup=False)
    for sentence in sentences_of:
        screen.print(f"- {sentence}", markup=False)
    rows = table("parameters", "name", "unit", "hand-tuned", "tuned", "cost of putting it back")
    for one in tuned.request.tunables:
        before, after = tuned.values()[one.name]
        rows.add_row(one.name, one.unit, figure(before), figure(after), f"{tuned.influence[one.name]:+.3f}")
    screen.print(rows)
    rows = table("held-out flights, means", "term", "hand-tuned", "tuned", "change (95 %)")
    for name, one in terms_table(tuned.held_out).items():
        mean, low, high = one["change"]
        rows.add_row(name, figure(one["before"]), figure(one["after"]), f"{mean:+.3g} ({low:+.3g} to {high:+.3g})")
    screen.print(rows)
    screen.print(f"{tuned.seconds['all']:.0f} s in all", markup=False)
    for path in files.values():
        screen.print(f"wrote {path}", markup=False, soft_wrap=True)
