"""rovtwin campaign: many flights of one scenario with what varies drawn."""

import math
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, figure, table
from rovtwin.core.errors import ConfigError

if TYPE_CHECKING:
    from rovtwin.campaign.run import Progress
    from rovtwin.campaign.schema import Campaign
    from rovtwin.campaign.session import CampaignSession
    from rovtwin.campaign.workers import Workers

SHOWN = 20
QUIET = 15.0  # between lines about progress where there is no terminal [s]


def campaign(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="CAMPAIGN.yaml", help="Campaign file; or a folder of results, to go on with it."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results; default runs/campaign-<name>. What is there is kept.")
    ] = None,
    samples: Annotated[int | None, typer.Option(min=1, help="How many missions; default the file's.")] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one for each core.")
    ] = None,
    scheduler: Annotated[str | None, typer.Option(metavar="tcp://HOST:PORT", help="A running dask scheduler.")] = None,
    slurm: Annotated[int | None, typer.Option(min=1, metavar="JOBS", help="SLURM jobs, by dask-jobqueue.")] = None,
    lanes: Annotated[
        int | None,
        typer.Option(min=1, max=4096, help="Missions side by side under vmap in each process; default 1, GPU 256."),
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write the table as CSV too.")] = False,
    report: Annotated[bool, typer.Option(help="Write the HTML report and figures.")] = True,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check everything, print what is drawn, fly nothing.")
    ] = False,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of campaign files.")] = False,
    as_json: AsJson = False,
) -> None:
    """Fly a scenario many times, with what varies drawn for each mission, and judge all of them.

    Killed or interrupted, the same command goes on where it was. Any mission of it flies again with log and report by
    [bold]rovtwin fly --replay FOLDER/NUMBER[/bold]. Exit code 0: all are flown, completed or not; 1: some are left.

    Example: [bold]rovtwin campaign examples/campaign.yaml --samples 20[/bold]
    """
    if schema:
        from rovtwin.campaign.schema import Campaign

        emit({"$schema": "https://json-schema.org/draft/2020-12/schema"} | Campaign.model_json_schema())
        return
    if file is None:
        raise ConfigError("campaign: found no file, expected one such as examples/campaign.yaml, or --schema")
    from rovtwin.core.extras import require

    require("pyarrow", "campaign", "a campaign")
    from rovtwin.campaign.schema import load_campaign

    plan = load_campaign(file, samples)
    if dry_run:
        _show_draws(plan, as_json)
        return
    crew = _workers(workers, scheduler, slurm, plan.samples)
    folder = out or (file if file.is_dir() else Path("runs") / f"campaign-{plan.name}")
    session = _run(plan, folder, crew, lanes)
    files = _write(session, csv, report)
    _say(session, files, as_json)
    raise typer.Exit(DONE if session.whole and _some_flew(session) else FAILED)


def _some_flew(session: "CampaignSession") -> bool:
    from rovtwin.campaign.summary import refused

    return refused(session.table) < session.table.num_rows


def _workers(
    workers: int | None, scheduler: str | None, slurm: int | None, samples: int
) -> "AbstractContextManager[Workers]":
    from rovtwin.campaign.workers import at_scheduler, on_slurm, on_this_machine
    from rovtwin.core.processes.cores import cores_here

    given = {"--workers": workers, "--scheduler": scheduler, "--slurm": slurm}
    if len(names := [name for name, value in given.items() if value is not None]) > 1:
        raise ConfigError(f"found {' and '.join(names)}, expected one of them: they all say who flies")
    if scheduler:
        return at_scheduler(scheduler)
    if slurm:
        return on_slurm(slurm)
    return on_this_machine(workers or min(cores_here(), samples))


def _run(
    plan: "Campaign", folder: Path, crew: "AbstractContextManager[Workers]", lanes: int | None
) -> "CampaignSession":
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[pace]}"))
    with Bar(*columns, console=console(True), transient=True) as bar:
        task = bar.add_task(f"{plan.name}: checking the samples", total=plan.samples, pace="")
        from rovtwin.campaign.run import run_campaign

        last = -math.inf

        def progress(now: "Progress") -> None:
            nonlocal last
            who = "1 core" if now.cores == 1 else f"{now.cores} cores" if now.cores else "waiting for workers"
            pace = "compiling" if now.left_s is None else f"{now.per_minute:.3g}/min, {_duration(now.left_s)} left"
            bar.update(task, description=f"{plan.name}: {who}", completed=now.done, pace=pace)
            # A bar draws nothing into a file or a pipe.
            if not bar.console.is_terminal and time.monotonic() - last > QUIET:
                last = time.monotonic()
                print(f"{plan.name}: {who}, {now.done} of {plan.samples}, {pace}", file=sys.stderr, flush=True)

        return run_campaign(plan, folder, crew, lanes, progress)


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _write(session: "CampaignSession", csv: bool, report: bool) -> dict[str, str]:
    from rovtwin.campaign.run import write_csv
    from rovtwin.core.log.files import keeping

    files = {"samples": session.folder / "samples.parquet", "campaign": session.folder / "campaign.yaml"}
    with keeping(session.folder, f"All that was flown is kept: {files['samples']}"):
        if csv:
            files["csv"] = write_csv(session)
        if report:
            from rovtwin.campaign.reporting import write_report

            files["report"] = write_report(session)
    return {name: str(path) for name, path in files.items()}


def _say(session: "CampaignSession", files: dict[str, str], as_json: bool) -> None:
    from rovtwin.campaign.summary import failures, summarise

    summary = summarise(session.campaign, session.table)
    if as_json:
        failed = [{"index": row["index"], "reason": row["reason"], "replay": _replay(session, row["index"])}
                  for row in failures(session.table)]  # fmt: skip
        now = {"flown_now": session.flown, "wall_now_s": session.wall_s, "by": session.by}
        emit(summary | now | {"failures": failed, "run_dir": str(session.folder), "files": files})
        return
    screen = console(False)
    if not summary["flown"]:
        screen.print(f"{summary['name']}: nothing flown yet", markup=False)
        return
    low, high = summary["completed_interval"]
    screen.print(
        f"{summary['name']}: {summary['completed']} of {summary['flown']} completed "
        f"({100 * summary['completed_share']:.1f} %, 95 % interval {100 * low:.1f} to {100 * high:.1f} %)",
        style="bold", markup=False,
    )  # fmt: skip
    for row in failures(session.table)[:SHOWN]:
        screen.print(f"  {row['reason']}: {_replay(session, row['index'])}", markup=False, soft_wrap=True)
    if (more := summary["flown"] - summary["completed"] - SHOWN) > 0:
        screen.print(f"  and {more} more")
    screen.print(_score_table(summary))
    if session.flown:
        pace = f"{session.wall_s:.0f} s, {session.wall_s / session.flown:.2f} s a mission, by {session.by}"
        screen.print(f"{session.flown} samples done in {pace}", markup=False)
    if summary["refused"]:
        screen.print(f"{summary['refused']} of {summary['flown']} were refused, none of them was flown", markup=False)
    if not session.whole:
        left = summary["samples"] - summary["flown"]
        screen.print(f"{left} are left: run the same command again to go on", markup=False)
    for path in files.values():
        screen.print(f"wrote {path}", markup=False, soft_wrap=True)


def _replay(session: "CampaignSession", index: int) -> str:
    return f"rovtwin fly --replay {session.folder}/{index}"


def _score_table(summary: dict[str, Any]) -> Any:
    rows = table("scores", "score", "5 %", "median", "95 %", "missions")
    for name, one in summary["scores"].items():
        rows.add_row(name, figure(one["p5"]), figure(one["median"]), figure(one["p95"]), str(one["n"]))
    return rows


def _show_draws(plan: "Campaign", as_json: bool) -> None:
    """All that is drawn, after every sample was checked."""
    from rovtwin.campaign.run import check
    from rovtwin.campaign.samples import draws

    check(plan)
    drawn = [draws(plan, index) for index in range(plan.samples)]
    if as_json:
        emit({"name": plan.name, "samples": [{"index": i} | one for i, one in enumerate(drawn)]})
        return
    rows = table(f"{plan.name}: all {plan.samples} samples can be flown", "sample", *plan.vary)
    for index, one in enumerate(drawn[:SHOWN]):
        rows.add_row(str(index), *(figure(value) if isinstance(value, float) else str(value) for value in one.values()))
    screen = console(False)
    screen.print(rows)
    if plan.samples > SHOWN:
        screen.print(f"and {plan.samples - SHOWN} more (--json)")
