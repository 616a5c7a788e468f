"""rovtwin smooth: the track of a finished run, from all its readings."""

from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit


def smooth(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its log; scenario.yaml lies beside.")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Log to write; else smoothed.mcap beside.")] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Smooth the track of a run: the error-state filter forwards over its log, then back.

    Where a filter knows only what came before, each instant here is judged by what came after it, too. The log written
    has pose, velocity and their standard deviations at every tick.

    [bold]rovtwin smooth runs/survey -o survey_track.mcap[/bold]
    """
    from rovtwin.runs.smooth import smooth_run

    out = out or (run if run.is_dir() else run.parent) / "smoothed.mcap"
    check_free(out, overwrite)
    shown = console(as_json)
    with shown.status("filter and smoother"):
        found = smooth_run(run)
    found.log.write(out, overwrite=overwrite)
    if as_json:
        errors = (None, None) if found.errors is None else found.errors.tolist()
        rms = dict(zip(("filter_rms_m", "smoothed_rms_m"), errors, strict=True))
        emit({"out": str(out), "seconds": float(found.track.t[-1])} | rms)
        return
    if found.errors is not None:
        for name, (north, east) in zip(("filter", "smoothed"), found.errors, strict=True):
            shown.print(f"position error, rms, {name:8}: north {north:.3f} m, east {east:.3f} m")
    shown.print(f"wrote {out}: {found.track.t[-1]:.0f} s", soft_wrap=True)
