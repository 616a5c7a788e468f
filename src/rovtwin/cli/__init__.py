"""The command line: `rovtwin --help`. Numerics are imported inside the commands, so that help answers at once."""

import atexit
import gc
import os
import re
import sys
from typing import Any

import typer

from rovtwin.cli.cameras.calibrate import calibrate
from rovtwin.cli.cameras.map import map_lines
from rovtwin.cli.cameras.map_classify import map_classify
from rovtwin.cli.cameras.map_diff import map_diff
from rovtwin.cli.cameras.markers import markers
from rovtwin.cli.cameras.photos import photos
from rovtwin.cli.cameras.render import render
from rovtwin.cli.cameras.scan import scan
from rovtwin.cli.cameras.track import track
from rovtwin.cli.commissioning.commission import commission
from rovtwin.cli.commissioning.verify import verify
from rovtwin.cli.evidence.app import evidence_app
from rovtwin.cli.flight.console import console
from rovtwin.cli.flight.links import links
from rovtwin.cli.flight.live import record
from rovtwin.cli.flight.logs import log_app
from rovtwin.cli.flight.runs import demo, fly, report
from rovtwin.cli.flight.serve import replay, serve
from rovtwin.cli.flight.smooth import smooth
from rovtwin.cli.identification.identify import identify
from rovtwin.cli.identification.thesis import thesis
from rovtwin.cli.identification.watch import watch
from rovtwin.cli.output import report_error
from rovtwin.cli.planning.convert import convert
from rovtwin.cli.planning.plan_survey import plan_survey
from rovtwin.cli.planning.plan_tests import plan_tests
from rovtwin.cli.planning.sea import sea
from rovtwin.cli.scenarios import scenario_app
from rovtwin.cli.studies.campaign import campaign
from rovtwin.cli.studies.scores import score
from rovtwin.cli.studies.tune import tune
from rovtwin.cli.vehicle.compare import compare
from rovtwin.cli.vehicle.vehicles import vehicle_app
from rovtwin.core.errors import RovtwinError
from rovtwin.core.user_files.files import cannot

app = typer.Typer(
    name="rovtwin",
    help="Identify, simulate and control small underwater vehicles from one description.\n\n"
    "Start with [bold]rovtwin demo[/bold], then [bold]rovtwin fly lawnmower_calm[/bold] "
    "and [bold]rovtwin vehicle show double_blueye[/bold].\n\n"
    "Exit codes: 0 done, 1 the mission or fit failed (the reason is printed), 2 bad input. "
    "With --json one object goes to standard output, everything else to standard error.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(fly)
app.command()(demo)
app.command()(serve)
app.command()(replay)
app.command()(links)
app.command()(console)
app.command()(record)
app.command()(score)
app.command()(campaign)
app.command()(tune)
app.command()(sea)
app.command()(identify)
app.command()(commission)
app.command()(verify)
app.command()(report)
app.command()(thesis)
app.command("plan-tests")(plan_tests)
app.command("plan-survey")(plan_survey)
app.command()(convert)
app.command()(compare)
app.command()(markers)
app.command()(render)
app.command()(track)
app.command()(scan)
app.command()(photos)
app.command("map")(map_lines)
app.command()(map_diff)
app.command()(map_classify)
app.command()(smooth)
app.command()(watch)
app.command()(calibrate)
app.add_typer(vehicle_app, name="vehicle")
app.add_typer(scenario_app, name="scenario")
app.add_typer(log_app, name="log")
app.add_typer(evidence_app, name="evidence")


def _version(asked: bool) -> None:
    if asked:
        from rovtwin._version import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _common(
    version: bool = typer.Option(False, "--version", callback=_version, help="Print the version."),
    trust_code: bool = typer.Option(
        False,
        "--trust-code",
        help="Run code that scenario files name (blocks and forces of one's own), as ROVTWIN_TRUST_CODE=1 does. "
        "Before the command: rovtwin --trust-code fly mine.yaml.",
    ),
) -> None:
    if trust_code:
        from rovtwin.core.trust import ALL, consent_to

        consent_to(ALL)


_BRACKET = re.compile(r"(?<!\\)\[(?!/?bold\])")
_WITHIN = re.compile(r"(?<!\n)\n(?!\s|- )")  # the end of a line that is not the end of a paragraph


def readable(command: Any) -> Any:
    """The command with help as it was written: `[m/s]` is a unit, and paragraphs fill the screen's width.

    Rich takes all brackets but escaped ones for its own marks, and keeps the lines of a docstring.
    """
    command.help = _WITHIN.sub(" ", _BRACKET.sub(r"\\[", command.help or ""))
    for parameter in command.params:
        if isinstance(text := getattr(parameter, "help", None), str):
            parameter.help = _BRACKET.sub(r"\\[", text)
    for inner in getattr(command, "commands", {}).values():
        readable(inner)
    return command


def main() -> None:
    """Entry point: what the user can mend is one message and exit code 2, never a traceback."""
    # OpenBLAS's threads wait for more work as busily as they work, 30 ms each time: let them sleep sooner.
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "16")
    atexit.register(gc.freeze)  # or Python would look through all there is once more before it ends: up to a second
    gc.set_threshold(50_000)  # importing and composing make many objects that stay: looking for waste is a tenth of it
    try:
        readable(typer.main.get_command(app))()
    except RovtwinError as error:
        report_error(error, as_json="--json" in sys.argv)
        sys.exit(2)
    except BrokenPipeError:
        # The reader, such as `head`, has seen enough.
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        # A folder that cannot be written, a name that is too long, a full disk: the system says what and where.
        report_error(type(error)(cannot(error)), as_json="--json" in sys.argv)
        sys.exit(2)
