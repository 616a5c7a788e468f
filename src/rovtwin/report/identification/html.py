"""The HTML report of an identification: what was learnt, what not, and what a reader needs to judge it.

Takes the result as it is: `parameters`, `theta`, `covariance`, `prior`, `verdicts`, predictions and residuals, as
`rovtwin.identification.identify` gives them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.report.identification import figures, tables
from rovtwin.report.identification.repeatability import repeatability_table
from rovtwin.report.identification.test_figures import prediction_figure
from rovtwin.report.identification.words import assumptions, is_coupling, verdict
from rovtwin.report.parts.curves import DIRECTIONS, Curves, Subject, curves, speed_grid
from rovtwin.report.parts.page import Picture, save, write_page
from rovtwin.report.parts.tables import Table
from rovtwin.vehicle.physics.model import Model

_DRAWN = 8  # tests that get a figure of their own, fitted and held out each
_SPEED = (0.5,) * 3 + (1.0,) * 3  # curves where nobody tested [m/s, rad/s]


@dataclass(frozen=True)
class Section:
    """A part of the page: words first, then tables and figures in order."""

    key: str
    title: str
    paragraphs: Sequence[str] = ()
    points: Sequence[str] = ()
    items: Sequence[Table | Picture] = ()


def write_identification_report(result: Any, folder: Path) -> Path:
    """Write `report.html` and its figures as `figures/*.png` and `figures/*.svg`.

    Args:
        result: What `identify` returns.
        folder: Made where it does not exist; a report that is there is replaced.

    Returns:
        The path of the page.
    """
    folder = Path(folder)
    now, before = curves_of(result)
    parts = [
        _repeatability(result),
        Section("findings", "Findings", points=result.findings) if result.findings else None,
        _forces(result, now, before, folder),
        _parameters(result, now, before, folder),
        _blind(result, folder),
        _tests(result, folder),
        _validation(result, folder),
        _learned(result),
        _residuals(result, folder),
        Section("provenance", "Provenance", items=[tables.provenance_table(result)]),
    ]
    return write_page(
        folder / "report.html",
        "sections.html.j2",
        title=f"Identification of {result.vehicle.name}",
        verdict=verdict(result, now),
        sections=[part for part in parts if part is not None],
    )


def curves_of(result: Any) -> tuple[Curves, Curves]:
    """Curves at the estimate and at the prior, over the tested speeds and all commands."""
    p = result.parameters

    def at(theta: Any) -> Model:
        return p.model_at(theta)[0]

    ranges = result.tested
    speeds = {
        name: speed_grid([ranges[name]] if name in ranges else [], (-_SPEED[i], _SPEED[i]))
        for i, name in enumerate(DIRECTIONS)
    }
    commands = np.linspace(-1.0, 1.0, 81)
    now = Subject("identified", at, result.theta, result.covariance, p.groups, ranges)
    before = Subject("prior", at, result.prior.mean, result.prior.covariance, p.groups, {})
    return curves(now, speeds, commands), curves(before, speeds, commands)


def _repeatability(result: Any) -> Section | None:
    table = repeatability_table(result)
    return None if table is None else Section("repeatability", "Do the tests repeat?", items=[table])


def _forces(result: Any, now: Curves, before: Curves, folder: Path) -> Section:
    tested = (
        "the speeds that the tests covered" if result.tested else "speeds chosen for the picture: nothing was tested"
    )
    damping = save(
        figures.damping_figure(now, before), folder, "damping", "Damping against speed",
        f"Motion in one direction at a time, over {tested}. The narrower the blue band against the grey one, the more "
        "the tests have added. A grey band that leaves the panel is wider than it shows.",
    )  # fmt: skip
    thrust = save(
        figures.thrust_figure(now, before, result.tested), folder, "thrust", "Thrust against command",
        "Steady force of one thruster of each group. Where shaded, commands were never given: extrapolated.",
    )  # fmt: skip
    return Section("forces", "Forces", items=[damping, tables.force_table(result, now, before), thrust])


def _parameters(result: Any, now: Curves, before: Curves, folder: Path) -> Section:
    added = save(
        figures.added_mass_figure(now, before), folder, "added_mass", "Added mass",
        "Diagonal of M_A with 95 % intervals, before and after the tests.",
    )  # fmt: skip
    coupled = [table] if (table := tables.parameter_table(result, True)).rows else []
    return Section("parameters", "Parameters", ["What the 95 % intervals assume:"], assumptions(result),
                   [tables.parameter_table(result, False), added, *coupled])  # fmt: skip


def _blind(result: Any, folder: Path) -> Section:
    words = []
    items: list[Any] = []
    if result.blind:
        items.append(tables.blind_table(result))
    elif result.solution is not None:
        words.append("In every direction of the parameters the tests say more than the prior.")
    names = result.parameters.names
    kept = [i for i, name in enumerate(names) if not is_coupling(name)]
    shown = [names[i] for i in kept], result.covariance[np.ix_(kept, kept)]
    correlations = save(
        figures.correlation_figure(*shown), folder, "correlation", "Correlations",
        "Of the estimate's errors, prior included, without the couplings. Dark red: known as a ratio; dark blue: known "
        "as a sum. What is pale is known by itself.",
    )  # fmt: skip
    strongest = tables.correlated_table(result)
    return Section(
        "blind", "Not separable", words, (), [*items, correlations, *([strongest] if strongest.rows else [])]
    )


def _tests(result: Any, folder: Path) -> Section | None:
    if not result.records:
        return None
    items: list[Any] = [tables.record_table(result)]
    for k, prediction in enumerate(result.fitted[:_DRAWN]):
        items.append(save(
            prediction_figure([prediction]), folder, f"fit_{k + 1}", f"Fitted test {prediction.record}",
            "Read, and run open loop from the first state through the whole test at the estimate. Errors of speed add "
            "up in position, so that a drift there is no bad fit; what was fitted are segments of a second or so.",
        ))  # fmt: skip
    left = [p.record for p in result.fitted[_DRAWN:]]
    words = [f"Not drawn: {', '.join(left)}; their scores are below."] if left else []
    if result.fitted:
        items.append(tables.validation_table(result.fitted))
    return Section("tests", "Tests and fits", words, (), items)


def _validation(result: Any, folder: Path) -> Section:
    if not result.held_out:
        missing = (
            "No test was held out. Keep one back (use: validate in the evidence file): a fit alone does not show that "
            "the model predicts."
        )
        return Section("validation", "Held-out tests", [missing])
    names = list(dict.fromkeys(p.record for p in result.held_out))
    items: list[Any] = []
    for k, name in enumerate(names[:_DRAWN]):
        both = [p for p in result.held_out if p.record == name]
        items.append(save(
            prediction_figure(both), folder, f"held_out_{k + 1}", f"Held-out test {name}",
            "Never fitted; predicted from a measured state and the commands alone, never one step ahead. "
            "The remarks are of the first prediction.",
        ))  # fmt: skip
    left = names[_DRAWN:]
    words = [f"Not drawn: {', '.join(left)}; their scores are below."] if left else []
    return Section("validation", "Held-out tests", words, (), [*items, tables.validation_table(result.held_out)])


def _learned(result: Any) -> Section | None:
    """The comparison of predictions with and without a learned wrench, and what was learned."""
    made = result.acceptance
    if made is None and result.discrepancy is None:
        return None
    words = [] if made is None else [made.words[0].upper() + made.words[1:] + "."]
    items = [tables.learned_errors_table(made)] if made is not None and made.errors else []
    if result.discrepancy is not None:
        items.append(tables.learned_parts_table(result.discrepancy))
    return Section("learned", "Learned beside the equations", words, (), items)


def _residuals(result: Any, folder: Path) -> Section | None:
    if not result.residuals:
        return None
    white = save(
        figures.whiteness_figure(result.residuals), folder, "whiteness", "Whiteness of the residuals",
        "Autocorrelation of what the fit leaves. Where model and noise are right, 19 of 20 bars end within the band.",
    )  # fmt: skip
    # What was declared of the sensors is in the problem, which a result from a file no longer has.
    noise = [] if result.problem is None else [tables.residual_table(result), tables.disturbance_table(result)]
    return Section("residuals", "Noise and residuals", items=[white, *noise])
