"""rovtwin smooth: the track of a finished run, from all its readings."""

from math import degrees, radians
from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit
from rovtwin.core.errors import ConfigError


def smooth(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its log; scenario.yaml lies beside.")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Log to write; else smoothed.mcap beside.")] = None,
    heading_std: Annotated[
        float, typer.Option("--heading-std", help="How far a compass may be off all through the dive [deg].")
    ] = 1.0,
    dvl_yaw_std: Annotated[
        float, typer.Option("--dvl-yaw-std", help="How far a Doppler log may be turned from where it is stated [deg].")
    ] = 0.5,
    dvl_scale_std: Annotated[
        float, typer.Option("--dvl-scale-std", help="Share by which its speeds may be off.")
    ] = 0.005,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Smooth the track of a run: the error-state filter forwards over its log, then back.

    Where a filter knows only what came before, each instant here is judged by what came after it, too. The log written
    has pose, velocity, their standard deviations and the pose's covariance at every tick. Beside it, in a file that
    ends in _keys.nc, is how errors of different instants hang together, for maps.

    What a compass or a Doppler log is off by all through the dive is estimated too, as far as the positions know it;
    the three --...-std say how large it may be. 0: the sensor is exact.

    [bold]rovtwin smooth runs/survey -o survey_track.mcap[/bold]
    """
    from rovtwin.runs.smooth import smooth_run

    stds = {"heading": radians(heading_std), "dvl_yaw": radians(dvl_yaw_std), "dvl_scale": dvl_scale_std}
    for name, value in stds.items():
        if not 0.0 <= value < 0.5:
            raise ConfigError(f"--{name.replace('_', '-')}-std: found {value:g} (rad or share), expected 0 to 0.5")
    out = out or (run if run.is_dir() else run.parent) / "smoothed.mcap"
    keys = out.with_name(f"{out.stem}_keys.nc")
    check_free(out, overwrite)
    check_free(keys, overwrite)
    shown = console(as_json)
    with shown.status("filter and smoother"):
        found = smooth_run(run, stds)
    found.log.write(out, overwrite=overwrite)
    found.track.keys.save(keys, overwrite)
    estimated = found.track.keys
    deviations = [float(covariance[k]) ** 0.5 for k, covariance in enumerate(estimated.constants_covariance)]
    constants = list(zip(estimated.constants, estimated.constants_value.tolist(), deviations, strict=True))
    if as_json:
        errors = (None, None) if found.errors is None else found.errors.tolist()
        rms = dict(zip(("filter_rms_m", "smoothed_rms_m"), errors, strict=True))
        of_sensors = {name: {"value": value, "std": std} for name, value, std in constants}
        found_out = {"out": str(out), "keys": str(keys), "seconds": float(found.track.t[-1])}
        emit(found_out | rms | {"constants": of_sensors, "notes": found.remarks()})
        return
    if found.errors is not None:
        for name, (north, east) in zip(("filter", "smoothed"), found.errors, strict=True):
            shown.print(f"position error, rms, {name:8}: north {north:.3f} m, east {east:.3f} m")
    for name, value, std in constants:
        scale, unit = (100.0, "%") if name.endswith("scale") else (degrees(1.0), "deg")
        shown.print(f"{name}: {scale * value:+.2f} {unit}, sd {scale * std:.2f}")
    for remark in found.remarks():
        shown.print(f"note: {remark}", markup=False, soft_wrap=True)
    shown.print(f"wrote {out}: {found.track.t[-1]:.0f} s", soft_wrap=True)
