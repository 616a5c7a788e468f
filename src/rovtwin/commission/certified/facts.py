"""What the certificate says: figures of all passed stages as text, what is not known, and every attempt."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rovtwin.commission.certified import first_page
from rovtwin.commission.certified.cleaning import Cleaner, public_url
from rovtwin.commission.certified.first_page import measured
from rovtwin.commission.certified.manifest import versions
from rovtwin.commission.dossier import Attempt, Dossier
from rovtwin.commission.stage import Outcome, Stage
from rovtwin.report.commission.certificate import (
    AttemptPage,
    Certificate,
    CheckLine,
    StagePage,
    State,
    mappings,
    measured_tables,
    rows_of,
)
from rovtwin.report.parts.verdict import Verdict
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.identified import fingerprint

SIGNATURES = ("Place", "Date", "Tested by", "Approved by")
MOST_UNKNOWN, MOST_LETTERS = 7, 170  # lines on the first sheet, and letters of each
NAMED = 4  # parameters that a line names
SHOWN_VERSIONS = ("rovtwin", "python", "jax", "numpy")


def certificate_of(
    dossier: Dossier, stages: Sequence[Stage], vehicle: Vehicle, issued: str, seal: str, not_derived: str
) -> Certificate:
    """The certificate as plain data.

    Args:
        dossier: Of the commissioning.
        stages: Those before the certificate.
        vehicle: As it was identified, or as it is described.
        issued: UTC.
        seal: Of the evidence.
        not_derived: Why the identification cannot be derived again, "" where it can.
    """
    outcomes = passed_outcomes(dossier, stages)
    unknown = list(_unknown(outcomes, not_derived))
    warnings = sum(check.verdict == "warning" for one in outcomes.values() for check in one.checks)
    return Certificate(
        vehicle=_short(vehicle.name, 80),
        verdict=_verdict(outcomes, stages, unknown, warnings),
        unknown=_clipped(unknown),
        facts=tuple(_facts(dossier, stages, vehicle, issued, seal)),
        figures=first_page.figures(outcomes, vehicle, dossier.request.interval),
        proofs=first_page.proofs(outcomes),
        signatures=SIGNATURES,
        stages=tuple(_stage_page(k, stage, dossier) for k, stage in enumerate(stages, start=1)),
    )


def passed_outcomes(dossier: Dossier, stages: Sequence[Stage]) -> dict[str, Outcome]:
    """The page of the last attempt of each stage that is passed."""
    found = {stage.name: dossier.passed(stage.name) for stage in stages}
    return {name: one.outcome for name, one in found.items() if one is not None and one.outcome is not None}


def _verdict(
    outcomes: Mapping[str, Outcome], stages: Sequence[Stage], unknown: Sequence[Any], warnings: int
) -> Verdict:
    whole, lacking = len(outcomes) == len(stages), bool(_missing(outcomes))
    headline = f"{len(outcomes)} of {len(stages)} stages passed"
    if whole:
        headline = "Commissioned" + (" in part" if lacking else "") + ": all stages passed"
        headline += "; what is not known stands below" if unknown else ""
    sentences = []
    if warnings:
        sentences.append(f"{warnings} warning{'s' * (warnings != 1)} stood when it was issued; the appendix has them.")
    return Verdict(None if whole and lacking else whole, headline, sentences, [])


def _unknown(outcomes: Mapping[str, Outcome], not_derived: str) -> Iterator[tuple[str, str]]:
    """What is not known and why: skipped, not learnt, or not measured at all."""
    for name, outcome in outcomes.items():
        if outcome.skipped:
            yield name, outcome.skipped
    parameters = mappings(measured(outcomes, "identify").get("parameters"))
    if left := [str(one.get("name")) for one in parameters if one.get("verdict") == "prior only"]:
        names = ", ".join(left[:NAMED]) + (f" and {len(left) - NAMED} more" if len(left) > NAMED else "")
        yield "parameters", f"{len(left)} of {len(parameters)} stay as predicted, no test tells of them: {names}"
    if against := [str(one.get("name")) for one in parameters if one.get("verdict") == "contradicted"]:
        names = ", ".join(against[:NAMED]) + (f" and {len(against) - NAMED} more" if len(against) > NAMED else "")
        yield "contradicted", f"tests contradict what was known before, or each other, of {names}"
    yield from _missing(outcomes)
    if not_derived and parameters:
        yield "re-derivation", f"rovtwin verify checks files only: {not_derived}"


def _missing(outcomes: Mapping[str, Outcome]) -> list[tuple[str, str]]:
    """Figures that a whole commissioning has and this one has not."""
    identified = measured(outcomes, "identify")
    figures = (
        ("parameters", rows_of(identified.get("parameters")), "no test of this commissioning identified any"),
        ("damping forces", rows_of(identified.get("damping")), "none was measured"),
        ("repeatability", rows_of(identified.get("repeatability")), "no test was repeated"),
        ("envelope", rows_of(measured(outcomes, "prove").get("envelope")), "no mission was flown on the twin"),
        ("prediction", measured(outcomes, "predict").get("inside"), "no flight was predicted before it was flown"),
    )
    return [(what, why) for what, found, why in figures if not found]


def _clipped(lines: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    kept = [(f"{what[:1].upper()}{what[1:]}", _short(why, MOST_LETTERS)) for what, why in lines[:MOST_UNKNOWN]]
    more = len(lines) - len(kept)
    return tuple(kept + ([("More", f"{more} other lines, see the appendix")] if more else []))


def _short(text: str, letters: int) -> str:
    return text if len(text) <= letters else f"{text[: letters - 2].rstrip()} .."


def _facts(
    dossier: Dossier, stages: Sequence[Stage], vehicle: Vehicle, issued: str, seal: str
) -> Iterator[tuple[str, str]]:
    request = dossier.request
    began = sorted(one.began for stage in stages for one in dossier.attempts(stage.name))
    days = list(dict.fromkeys(time[:10] for time in (began[:1] + began[-1:])))
    minutes = (
        sum(one.outcome.seconds for stage in stages for one in dossier.attempts(stage.name) if one.outcome is not None)
        / 60
    )
    yield "Vehicle", _short(vehicle.name, 80)
    yield "Tested", f"{' to '.join(days)} (UTC)" if days else "-"
    yield "Issued", f"{issued[:16].replace('T', ' ')} UTC"
    yield "Water", f"tank {_tank(request.tank)}"
    yield "Link", _short(public_url(request.link), 120)
    if request.sensors:
        yield "Instruments", _short(", ".join(public_url(url) for url in request.sensors), 160)
    yield "Vehicle time", f"{minutes:.1f} min in all attempts"
    here = versions()
    yield "Versions", ", ".join(f"{name} {here[name]}" for name in SHOWN_VERSIONS if name in here)
    yield "Parts list", fingerprint(vehicle.file)
    yield "Seal of evidence", seal


def _tank(text: str) -> str:
    return text.lower().replace("m", "").replace("x", " x ") + " m"


def _stage_page(number: int, stage: Stage, dossier: Dossier) -> StagePage:
    attempts = tuple(_attempt_page(k, one, dossier) for k, one in enumerate(dossier.attempts(stage.name), start=1))
    purpose = f"{stage.purpose[:1].upper()}{stage.purpose[1:]}."
    return StagePage(number, stage.name, stage.title, purpose, attempts)


def _attempt_page(number: int, attempt: Attempt, dossier: Dossier) -> AttemptPage:
    outcome = attempt.outcome
    began = attempt.began[:19].replace("T", " ") + " UTC"
    if outcome is None:
        logs = sorted(path.relative_to(attempt.folder).as_posix() for path in attempt.folder.glob("**/log.mcap"))
        return AttemptPage(number, began, "cut off", files=tuple(logs))
    clean = Cleaner(dossier.folder).text
    checks = tuple(CheckLine(c.verdict, clean(c.what), clean(c.text), clean(c.fix)) for c in outcome.checks)
    state: State = "go" if outcome.go else "no-go"
    tables = measured_tables(_cleaned(outcome.measured, clean))
    return AttemptPage(number, began, state, outcome.seconds, checks, tables, outcome.files, clean(outcome.skipped))


def _cleaned(value: Any, clean: Any) -> Any:
    """Plain data whose texts are cleaned."""
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, Mapping):
        return {key: _cleaned(one, clean) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_cleaned(one, clean) for one in value]
    return value
