"""rovtwin identify: from a vehicle file and test logs to an identified.yaml with covariance, and a report."""

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, figure, refuse_idle, table
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.user_files.files import whole

if TYPE_CHECKING:
    from rovtwin.identification.identify import Identification


def identify(
    vehicle: Annotated[
        str | None, typer.Argument(metavar="[VEHICLE]", help="Library name or vehicle file; else that of the evidence.")
    ] = None,
    logs: Annotated[list[Path] | None, typer.Argument(metavar="[LOG]...", help="Test logs to fit.")] = None,
    evidence: Annotated[
        Path | None, typer.Option(help="YAML that says which logs, what is in their columns, priors, anchors.")
    ] = None,
    prior: Annotated[
        str | None, typer.Option(metavar="OLD.yaml", help="An earlier identification, of these parts or of others.")
    ] = None,
    validate: Annotated[
        list[Path] | None, typer.Option(metavar="LOG", help="A log to predict, never to fit. Repeatable.")
    ] = None,
    fit_share: Annotated[
        float | None,
        typer.Option(
            help="First share of each log that is fitted; default 0.8 without --validate, 1 for tests with --track."
        ),
    ] = None,
    free: Annotated[
        list[str] | None, typer.Option(metavar="PATTERN", help="Parameters to estimate: added_mass.*. Repeatable.")
    ] = None,
    structure: Annotated[
        str | None,
        typer.Option(
            metavar="auto|full|NAME",
            help="How many parameters: full, the default; as many as predict blocks of the logs better that are left "
            "out (auto, some three times as long); up to linear, quadratic, astern, thrusters, symmetric; or inflow: "
            "full and the thrust that an inflow takes.",
        ),
    ] = None,
    discrepancy: Annotated[
        str | None,
        typer.Option(
            metavar="auto|off",
            help="A wrench that the equations of motion lack, learned from velocity and thrust (auto): kept only where "
            "it predicts blocks of the logs better, over 5 s, that were left out; ten times as long and more. Off is "
            "the default.",
        ),
    ] = None,
    track: Annotated[
        str | None,
        typer.Option(help="aruco: positions from the markers in the pictures beside each log, not from its sensor."),
    ] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="File to write.")] = Path("identified.yaml"),
    report: Annotated[bool, typer.Option(help="Write the HTML report beside it.")] = True,
    keep: Annotated[
        bool, typer.Option("--keep", help="Write, or start from, a file that is not to be relied on; it says so.")
    ] = False,
    trust: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LOG", help="Go on where checks say that this log is wrong: its file or name. Repeatable."
        ),
    ] = None,
    trust_logs: Annotated[
        bool, typer.Option("--trust-logs", help="Trust every log; --trust names single ones and is safer.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Estimate a vehicle's parameters from its tests, with covariance, and write them as a vehicle file.

    The file flies at once: [bold]rovtwin fly lawnmower_calm --set vehicle=identified.yaml[/bold]. The report says what
    was learnt and what was not; parameters that no test could show stay at the prior and are named. A result that is
    not to be relied on is written with --keep only; exit code 1, and the report says why.

    Logs are checked first. A log that cannot be right ends the command; a log of --validate is left out instead, and a
    log of --trust is used all the same. Either way the screen, the report and --json say what the checks found.

    From logs of rovtwin itself: [bold]rovtwin identify double_blueye runs/*/log.mcap -o identified.yaml[/bold]

    From the log of an ArduSub vehicle (.BIN, .tlog) or of PX4 (.ulg): [bold]rovtwin identify bluerov2_heavy
    00000042.BIN -o identified.yaml[/bold]

    Positions from the vehicle's own camera: [bold]rovtwin identify double_blueye runs/pool/log.mcap --track
    aruco[/bold]

    From other recordings: [bold]rovtwin identify --evidence evidence.yaml[/bold]

    After a change of payload, even before any test: [bold]rovtwin identify new.yaml --prior identified.yaml -o
    predicted.yaml[/bold]
    """
    from rovtwin.cli.identification.identify_logs import looked_over, read_logs, share_of
    from rovtwin.core.log.files import keeping
    from rovtwin.identification.identify import identify as estimate
    from rovtwin.identification.joint.result.overlay import to_yaml
    from rovtwin.identification.logs.evidence_file import read_evidence
    from rovtwin.identification.result.store import require_replaceable
    from rovtwin.scenario.assets import MESHES, kept_beside
    from rovtwin.vehicle import load_vehicle

    screen = console(as_json)
    evidence_file = read_evidence(evidence) if evidence else None
    name = vehicle or (evidence_file.vehicle if evidence_file else None)
    if name is None:
        raise ConfigError("no vehicle: name one, or an evidence file that does (--evidence FILE)")
    if evidence_file is None and not logs and prior is None:
        raise ConfigError("no logs: give some, an evidence file (--evidence FILE) or an old result (--prior FILE)")
    if out.is_dir() or not out.parent.is_dir():
        raise ConfigError(f"{out}: expected the name of a file to write, in a folder that is there")
    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"{out}: expected a name that ends in .yaml; the report goes into a folder of that name")
    require_replaceable(out.with_suffix(".nc"))
    if fit_share is not None and not logs:
        raise ConfigError("--fit-share is for logs on the command line; an evidence file says fit_share at the log")
    refuse_idle({"--track": track is not None and not logs and not validate}, "it is for logs on the command line")
    described = load_vehicle(name, identified=prior is None)
    old = _prior(prior, keep)
    tests: dict[Path, bool] = {}
    given, held_back = logs, validate
    if track is not None:
        tests, held = (_tracked(screen, described, track, paths or []) for paths in (logs, validate))
        logs, validate = list(tests), list(held)
    fit_share = share_of(screen, fit_share, tests, bool(validate))
    used = looked_over(
        screen, described, read_logs(described, evidence_file, logs or [], validate or [], fit_share), trust, trust_logs
    )
    with _progress(screen) as progress:
        result = estimate(
            described,
            used.fitted,
            validate=used.held_out,
            free=free or (evidence_file.file.free if evidence_file else []),
            prior=evidence_file.file.prior if evidence_file else None,
            anchors=evidence_file.file.anchors if evidence_file else (),
            old=old,
            options=({} if evidence_file is None else dict(evidence_file.file.options))
            | ({"structure": structure} if structure else {})
            | ({"discrepancy": discrepancy} if discrepancy else {}),
            progress=progress,
        )
    result = replace(result, findings=[*used.remarks, *result.findings], records=[*result.records, *used.left_out])
    more = [word for path in held_back or [] for word in ("--validate", _short(path))]
    more += [word for pattern in free or [] for word in ("--free", f"'{pattern}'")]
    more += ["--fit-share", f"{fit_share:g}"] if fit_share is not None else []
    more += ["--structure", structure] if structure else []
    more += [word for name in trust or [] for word in ("--trust", Path(name).name)]
    more += ["--discrepancy", discrepancy] if discrepancy else []
    more += ["--trust-logs"] if trust_logs else []
    more += ["--keep"] if keep else []
    more += ["--track", track] if track else []
    written = keep or not result.doubts
    if written:
        # Meshes lie with the report: the file says nothing of the machine it was made on, and can be passed on.
        data = kept_beside(result.file(), out.parent, f"{out.stem}/{MESHES}")
        with keeping(out.parent, "Nothing of the result was written"), whole(out) as beside:
            beside.write_text(to_yaml(data, _command_line(vehicle, given, evidence, prior, more)), encoding="utf-8")
            held = result.save(out.with_suffix(".nc"), overwrite=True)
    else:  # beside a good file of before stays its own result
        held = result.save(out.with_suffix(".doubtful.nc"), overwrite=True)
    with keeping(out.parent, f"The result is kept: {held}"):
        page = _report(result, out) if report and result.solution is not None else None
    if as_json:
        files = {"file": str(out) if written else None, "report": None if page is None else str(page)}
        files["result"] = str(held)
        emit(as_object(result) | files)
    else:
        _print(screen, result)
        progress = f"written: {out}" if written else f"not written: {out}; to have it all the same, add --keep"
        progress += f"   result: {held}" + (f"   report: {page}" if page else "")
        screen.print(f"\n{progress}", markup=False)
    raise typer.Exit(FAILED if result.doubts else DONE)


def _prior(path: str | None, keep: bool) -> Any:
    """An earlier identification.

    Raises:
        IdentificationError: It is not to be relied on, and nobody said to use it all the same.
    """
    from rovtwin.vehicle import load_vehicle

    old = None if path is None else load_vehicle(path)
    if old is not None and old.doubts and not keep:
        raise IdentificationError(
            f"--prior {path}: found an identification that is not to be relied on: {'; '.join(old.doubts)}. Identify "
            "that vehicle again, or add --keep to start from it all the same"
        )
    return old


def _tracked(screen: Console, vehicle: Any, kind: str, logs: list[Path]) -> dict[Path, bool]:
    """Logs of the tracks, `<log>_aruco.mcap` beside the logs given, made anew each time; says how good they are.

    Each with whether it is a test, a programme of manoeuvres.
    """
    from rovtwin.cli.cameras.track import looking_for_markers, summary
    from rovtwin.cli.identification.identify_logs import files_of
    from rovtwin.runs.track import track_run

    if kind != "aruco":
        raise ConfigError(f"--track: found '{kind}', expected aruco")
    tracks = {}
    for path in files_of(logs):
        with looking_for_markers() as progress:
            found, log = track_run(path, vehicle, "smoother", progress=progress)
        out = path.with_name(f"{path.stem}_aruco.mcap")
        log.write(out, overwrite=True)
        tracks[out] = bool(log.metadata.get("test"))
        for line in [*summary(found), *found.notes]:
            screen.print(f"{_short(path)}: {line}", style="dim", markup=False, soft_wrap=True)
        screen.print(f"wrote {out}", markup=False, soft_wrap=True)
    return tracks


class _progress:
    """A bar on a screen; in a pipe or a file a line on standard error now and then."""

    _EVERY = 10.0  # [s] between such lines

    def __init__(self, screen: Console):
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
        self._screen, self._printed_at = screen, time.monotonic()
        self._bar = Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)

    def __enter__(self) -> Any:
        self._bar.start()
        task = self._bar.add_task("reading", total=1.0)

        def update(text: str, share: float) -> None:
            self._bar.update(task, description=text, completed=min(share, 0.99))
            if not self._screen.is_terminal and time.monotonic() - self._printed_at > self._EVERY:
                self._printed_at = time.monotonic()
                print(text, file=sys.stderr, flush=True)

        return update

    def __exit__(self, *_: object) -> None:
        self._bar.stop()


def _report(result: "Identification", out: Path) -> Path:
    from rovtwin.report.identification.html import write_identification_report

    return write_identification_report(result, out.with_suffix(""))


def _command_line(
    vehicle: str | None, logs: list[Path] | None, evidence: Path | None, prior: str | None, more: list[str]
) -> str:
    """Without folders: a file that is passed on says nothing of the machine it was made on."""
    words = ["rovtwin identify", Path(vehicle).name if vehicle else "", *(_short(p) for p in logs or [])]
    words += [f"--evidence {evidence.name}"] if evidence else []
    words += [f"--prior {Path(prior).name}"] if prior else []
    return " ".join(word for word in [*words, *more] if word)


def _short(path: Path) -> str:
    """A run's log goes by the name of its folder: all of them are called log.mcap."""
    return f"{path.parent.name}/{path.name}" if path.stem == "log" and path.parent.name else path.name


def as_object(result: "Identification") -> dict[str, Any]:
    """The result in plain types."""
    from rovtwin.report.identification.parameter_words import what_teaches
    from rovtwin.report.identification.words import excitation

    rows = []
    for i, (p, why) in enumerate(zip(result.parameters.free, excitation(result), strict=True)):
        low, high = result.interval(p.name)
        rows.append(
            {
                "name": p.name,
                "unit": p.unit,
                "value": result.values[p.name],
                "interval_95": [low, high],
                "start": p.base,
                "verdict": result.verdicts[i],
                "excitation": why,
                "taught_by": what_teaches(p.name),
            }
        )
    scores = [
        {
            "record": p.record,
            "held_out": held,
            "window_s": p.window,
            "components": {
                k: {
                    "fit_percent": s.fit,
                    "rms": s.rms,
                    "rms_hold": s.hold,
                    "rms_still": s.still,
                    "excited": p.excited[k],
                }
                for k, s in p.scores.items()
            },
        }
        for held, group in ((False, result.fitted), (True, result.held_out))
        for p in group
    ]
    return {
        "vehicle": result.vehicle.name,
        "parameters": rows,
        "blind": [b.text for b in result.blind],
        "findings": result.findings,
        "tests": result.records,
        "predictions": scores,
        "converged": result.solution is None or result.solution.converged,
        "reliable": not result.doubts,
        "standing": _standing(result),
        "discrepancy": _discrepancy(result),
        "doubts": result.doubts,
        "seconds": result.seconds,
    }


def _discrepancy(result: "Identification") -> dict[str, Any]:
    """Whether a learned wrench was taken, along which axes, and the comparison where there was one."""
    parts = [] if result.discrepancy is None else [[part.axis, part.of] for part in result.discrepancy.parts]
    found: dict[str, Any] = {"parts": parts}
    if (made := result.acceptance) is not None:
        errors = {name: {"without": pair[0], "with": pair[1]} for name, pair in made.errors.items()}
        figures = {"change": made.change, "std": made.std}
        found |= {key: None if value != value else value for key, value in figures.items()}
        found |= {"blocks": made.blocks, "rms": errors, "taken": made.taken, "words": made.words}
    return found


def _standing(result: "Identification") -> dict[str, Any]:
    standing = result.standing
    return {
        "grade": standing.grade,
        "learnt": standing.learnt,
        "up_to_scale": result.up_to_scale.removeprefix(", "),
        "contradicted": standing.contradicted,
        "parameters": standing.count,
        "held_out_error": None if standing.error != standing.error else standing.error,
        "held_out_better": standing.better,
        "held_out_judged": standing.judged,
    }


_COLUMNS = ("parameter", "start", "estimate", "95 % interval", "unit", "verdict")


def _print(screen: Console, result: "Identification") -> None:
    from rovtwin.report.identification.parameter_words import groups_in_words
    from rovtwin.report.identification.tables import between, estimated
    from rovtwin.report.identification.words import in_families, is_coupling, not_learnt

    rows = table(
        f"{result.vehicle.name}: parameters", "parameter", "start", "estimate", "95 % interval", "unit", "verdict"
    )
    styles = {"learnt": "green", "partly": "yellow", "prior only": "red", "contradicted": "bold red"}
    learnt = {p.name: word for p, word in zip(result.parameters.free, result.verdicts, strict=True)}
    for i, p in enumerate(result.parameters.free):
        if is_coupling(p.name):
            continue
        low, high = result.interval(p.name)
        verdict = result.verdicts[i]
        rows.add_row(
            p.name,
            figure(p.base),
            estimated(result.values[p.name], low, high),
            between(low, high),
            p.unit,
            f"[{styles[verdict]}]{verdict}[/]",
        )
    screen.print(rows)
    for line in groups_in_words(result.parameters.groups, result.vehicle.thruster_names):
        screen.print(line, markup=False, soft_wrap=True)
    for line in not_learnt(result):
        screen.print(line, markup=False, soft_wrap=True)
    if couplings := [name for name in learnt if is_coupling(name)]:
        known = in_families(couplings, [name for name in couplings if learnt[name] == "learnt"]) or "none"
        screen.print(f"learnt of {len(couplings)} couplings between directions (values: report, --json): {known}")
    _print_predictions(screen, result)
    for heading, lines in (
        ("What the tests could not tell", [b.text for b in result.blind]),
        ("Remarks", result.findings),
    ):
        if lines:
            screen.print(f"\n{heading}", style="bold")
            for line in lines:
                screen.print(f"- {line}", markup=False)
    standing = result.standing
    learnt_words = f"{standing.learnt} of {standing.count} parameters learnt{result.up_to_scale}"
    heading = standing.heading(learnt_words, result.doubts)
    style = "bold" if not result.doubts else "bold yellow" if standing.predicts else "bold red"
    screen.print(f"\n{heading}", style=style, markup=False)
    screen.print(f"\n{result.seconds:.0f} s", style="dim")


def _print_predictions(screen: Console, result: "Identification") -> None:
    if not result.held_out:
        return
    rows = table("held-out tests, open loop", "test", "restarts", "signal", "fit", "rms", "held", "at rest")
    for p in result.held_out:
        for name, score in p.scores.items():
            if p.excited[name]:
                still = None if score.still != score.still else score.still
                rows.add_row(
                    p.record,
                    "never" if p.window is None else f"every {p.window:g} s",
                    name,
                    f"{score.fit:.0f} %",
                    figure(score.rms),
                    figure(score.hold),
                    figure(still),
                )
    screen.print(rows)
