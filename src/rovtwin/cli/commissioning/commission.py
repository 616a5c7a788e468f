"""rovtwin commission: from a vehicle file with a new payload to a proven vehicle, stage by stage."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, progress_bar, table
from rovtwin.core.errors import ConfigError
from rovtwin.links.registry import forms

if TYPE_CHECKING:
    from rovtwin.commission.dossier import Attempt, Dossier
    from rovtwin.commission.stage import Stage

STYLES = {"ok": "green", "note": "dim", "warning": "yellow", "stop": "bold red"}


def commission(
    vehicle: Annotated[
        str | None, typer.Argument(metavar="VEHICLE", help="Its file or library name; not needed to go on.")
    ] = None,
    link: Annotated[
        str | None, typer.Option(metavar="URL", help=f"The vehicle: {forms('link')}; see `rovtwin links`.")
    ] = None,
    sensor: Annotated[
        list[str] | None, typer.Option("--sensor", metavar="URL", help=f"An instrument beside it: {forms('source')}.")
    ] = None,
    tank: Annotated[
        str | None, typer.Option(help="Length x width x depth of the test water [m], such as 6x3x1.5.")
    ] = None,
    prior: Annotated[
        str | None, typer.Option(metavar="FILE", help="An earlier identified file, of these parts or of others.")
    ] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder, new or of a commissioning that goes on.")] = Path(
        "commissioned"
    ),
    stage: Annotated[
        list[str] | None, typer.Option("--stage", help="Do only this stage, again if it is passed; repeatable.")
    ] = None,
    minutes: Annotated[
        float | None, typer.Option(min=1.0, max=240.0, help="Most minutes of test flying. [default: 15]")
    ] = None,
    interval: Annotated[
        float | None,
        typer.Option(min=0.005, max=1.0, help="Test until damping forces are known to this share. [default: 0.05]"),
    ] = None,
    current: Annotated[
        list[float] | None,
        typer.Option(min=0.0, max=5.0, help="Speed of water to prove it in [m/s]; repeatable. [default: 0, 0.1, 0.2]"),
    ] = None,
    sea: Annotated[
        list[float] | None,
        typer.Option(min=0.0, max=10.0, help="Significant wave height to prove it in [m]; repeatable. [default: 0]"),
    ] = None,
    missions: Annotated[
        int | None, typer.Option(min=1, max=10_000, help="Missions of the proof in each current and sea. [default: 20]")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(min=0.01, max=50.0, help="Speed of a served twin's time. [default: 1]")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all that is drawn. [default: 1]")] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Answer yes to every question: for a twin, never for a real vehicle.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Commission a vehicle: check, test, identify, prove and certify it, one stage after the other.

    Each stage ends in a page: what was done, what was measured, go or no-go with the reason. A stage that moves the
    vehicle asks first. Ctrl-C or a crash loses nothing that was measured: the same command goes on where it was left.

    Example: [bold]rovtwin commission my.yaml --link blueye://192.168.1.101 --tank 6x3x1.5 -o commissioned[/bold]

    Later: [bold]rovtwin commission -o commissioned[/bold] goes on; [bold]--stage dip[/bold] repeats one stage.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `plan-tests`: NumPy reads it when it is imported
    from rovtwin.commission.dossier import status
    from rovtwin.commission.run import commission as run
    from rovtwin.commission.stages import STAGES

    screen = console(as_json)
    options = {"tank": tank, "prior": prior, "minutes": minutes, "interval": interval, "samples": missions}
    options |= {"speed": speed, "seed": seed}
    options |= {"currents": tuple(current) if current else None, "seas": tuple(sea) if sea else None}
    given = {name: value for name, value in options.items() if value is not None}
    request = _request(vehicle, link, sensor or [], given, out)
    _require_answers(yes, request.link)
    with progress_bar("") as bar:
        person = Terminal(screen, bar, yes)
        dossier = run(
            request,
            out,
            STAGES,
            person,
            only=stage or (),
            shown=lambda one, attempt: _print_page(person.screen, one, attempt),
        )
    rows = status(dossier, STAGES)
    _print_status(screen, rows, out)
    passed = all(words == "passed" for _, words, _ in rows)
    if as_json:
        emit(_as_data(dossier, rows))
    raise typer.Exit(DONE if passed or (stage and _stages_passed(rows, stage)) else FAILED)


def _request(vehicle: str | None, link: str | None, sensors: list[str], given: dict[str, Any], out: Path) -> Any:
    """What is asked for: of a commissioning that goes on, what was asked for with what is given now in its place.

    Raises:
        ConfigError: A new one without vehicle or link, or another vehicle than it was begun with.
    """
    from dataclasses import replace

    from rovtwin.commission.dossier import INDEX, Dossier
    from rovtwin.commission.request import Request

    if (out / INDEX).exists():
        before = Dossier.open(out).request
        changed = given | ({} if link is None else {"link": link}) | ({"sensors": tuple(sensors)} if sensors else {})
        asked = replace(before, **changed)
        if vehicle is not None and replace(asked, vehicle=vehicle).absolute().vehicle != before.vehicle:
            raise ConfigError(
                f"-o {out}: found the commissioning of {before.vehicle}, expected one of {vehicle}: take another folder"
            )
        return asked
    missing = [
        name for name, value in (("VEHICLE", vehicle), ("--link", link), ("--tank", given.get("tank"))) if not value
    ]
    if missing:
        raise ConfigError(
            f"commission: found no {', '.join(missing)}, and {out} is no commissioning that could go on. Expected: "
            "rovtwin commission my.yaml --link blueye://192.168.1.101 --tank 6x3x1.5"
        )
    return Request(vehicle=str(vehicle), link=str(link), sensors=tuple(sensors), **given)


def _require_answers(yes: bool, link: str) -> None:
    """ConfigError where nobody can be asked, or where a script says yes to what may be a real vehicle."""
    from rovtwin.live.connect import on_this_machine

    if yes and not on_this_machine(link):
        raise ConfigError(
            f"--yes: {link} may be a real vehicle, which moves only when a person confirms each time; it is for a twin "
            "that is served on this machine"
        )
    if not yes and not sys.stdin.isatty():
        raise ConfigError("commission: found no terminal to ask on; run it in one, or add --yes for a twin")


class Terminal:
    """The person at a terminal."""

    def __init__(self, screen: Console, bar: Any, yes: bool):
        self.screen = bar.console if screen.is_terminal else screen
        self._bar, self._yes = bar, yes
        self._task = bar.add_task("", total=None)

    def confirm(self, question: str) -> bool:
        """Yes or no; no is the default."""
        if self._yes:
            self.say(f"{question} yes (--yes)")
            return True
        self._bar.stop()
        _forget_keys()
        answer = typer.confirm(question, default=False, err=True)
        self._bar.start()
        return answer

    def number(self, question: str, unit: str) -> float | None:
        """A figure in a unit; an empty answer is none."""
        if self._yes:
            return None
        self._bar.stop()
        try:
            while True:
                text = typer.prompt(
                    f"{question} [{unit}, empty: not to be had]", default="", err=True, show_default=False
                )
                if not text.strip():
                    return None
                try:
                    return float(text)
                except ValueError:
                    self.say(f"found '{text}', expected a number in {unit}, such as 12.5")
        finally:
            self._bar.start()

    def say(self, line: str) -> None:
        self.screen.print(line, markup=False, soft_wrap=True)

    def progress(self, what: str, share: float | None = None) -> None:
        self._bar.update(self._task, description=what, total=None if share is None else 1.0, completed=share or 0.0)


def _forget_keys() -> None:
    """What was typed before a question is no answer to it."""
    import termios

    if sys.stdin.isatty():
        termios.tcflush(sys.stdin, termios.TCIFLUSH)


def _print_page(screen: Console, stage: "Stage", attempt: "Attempt") -> None:
    outcome = attempt.outcome
    assert outcome is not None  # it has just ended
    for check in outcome.checks:
        screen.print(
            f"  [{STYLES[check.verdict]}]{check.verdict:7}[/]  {escape(f'{check.what}: {check.text} {check.fix}')}",
            soft_wrap=True,
        )
    if outcome.skipped:
        screen.print(f"  without it: {outcome.skipped}", style="yellow", markup=False, soft_wrap=True)
    verdict = f"GO. {stage.next}" if outcome.go else "NO-GO. Mend it, then give the same command again."
    screen.print(f"  {verdict}\n", style="bold green" if outcome.go else "bold red", markup=False, soft_wrap=True)


def _print_status(screen: Console, rows: list[Any], out: Path) -> None:
    shown = table("commissioning", "stage", "state", "vehicle time", "page")
    for number, (stage, words, attempt) in enumerate(rows, start=1):
        outcome = None if attempt is None else attempt.outcome
        seconds = "" if outcome is None or not outcome.seconds else f"{outcome.seconds:.0f} s"
        place = "" if attempt is None else str(attempt.folder.relative_to(out))
        shown.add_row(f"{number} {stage.title}", words, seconds, escape(place))
    screen.print(shown)
    left = [stage for stage, words, _ in rows if words != "passed"]
    line = f"next: {left[0].title}: {left[0].purpose}. rovtwin commission -o {out}" if left else "all stages are passed"
    screen.print(line, markup=False, soft_wrap=True)


def _stages_passed(rows: list[Any], names: list[str]) -> bool:
    return all(words == "passed" for stage, words, _ in rows if stage.name in names)


def _as_data(dossier: "Dossier", rows: list[Any]) -> dict[str, Any]:
    return {
        "folder": str(dossier.folder),
        "stages": [
            {
                "name": stage.name,
                "state": words,
                "outcome": None if attempt is None or attempt.outcome is None else attempt.outcome.to_dict(),
            }
            for stage, words, attempt in rows
        ],
    }
