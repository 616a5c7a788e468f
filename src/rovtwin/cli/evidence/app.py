"""`rovtwin evidence`: one piece of knowledge about parameters at a time, each method on its own."""

import typer

from rovtwin.cli.evidence.check import check
from rovtwin.cli.evidence.decay import decay
from rovtwin.cli.evidence.empirical import empirical
from rovtwin.cli.evidence.free_running import free_running
from rovtwin.cli.evidence.panel import panel
from rovtwin.cli.evidence.thrust import thrust
from rovtwin.cli.evidence.towing import towing

evidence_app = typer.Typer(
    help="Parameters by one method at a time: a formula, a mesh, a towing, free-running or decay test.",
    no_args_is_help=True,
)
evidence_app.command()(towing)
evidence_app.command()(empirical)
evidence_app.command()(panel)
evidence_app.command()(decay)
evidence_app.command()(thrust)
evidence_app.command(name="free-running")(free_running)
evidence_app.command()(check)
