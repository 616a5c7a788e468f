"""Identify: parameters with covariance from all that was flown, whether the tests repeat, the uncertainty budget."""

from collections.abc import Iterator, Sequence
from typing import Any

from rovtwin.commission.evidence.budget import budget
from rovtwin.commission.evidence.estimated import estimated, written
from rovtwin.commission.evidence.forces import COVERAGE, Quantity, damping_forces, pushed, thrust_forces
from rovtwin.commission.evidence.logs import logs_of, read_logs
from rovtwin.commission.evidence.repeats import about, repeats
from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.identification.identify import Identification
from rovtwin.identification.joint.model.parameters import Parameter
from rovtwin.live.connect import is_computed
from rovtwin.report.identification.html import write_identification_report

FILE, RESULT, DOUBTFUL, REPORT = "identified.yaml", "identified.nc", "identified.doubtful.nc", "identified"
SCALE = "no pull on a scale: forces, masses and drag are known only up to a common factor, as well as the thrust curve"
CHAIN = (
    "their exponents, dead bands and time constants are those of all that lies between a command on this link and the "
    "thrust: the vehicle's own firmware is in them, and a data sheet of the thruster need not agree"
)
HELP = (  # what a doubt begins with or holds, and what would help
    ("the fitted tests last", "Fly more: --stage excite."),
    ("has not settled", "Fly more: --stage excite --minutes 25."),
    (
        "the model misses",
        "See the residuals in the report: a tether, a current or a sensor's noise in the vehicle file?",
    ),
    ("its prior", "Identify that vehicle again, or begin anew without --prior."),
)


def run(work: Work) -> Outcome:
    """Estimate from all parts, and write the vehicle file, the result and its report."""
    flown = read_logs(work.vehicle, logs_of(work.dossier), work.folder)
    checks = [one for one in flown.checks if one.verdict != "ok"]
    if not flown.records:
        fix = "Fly some first: --stage excite."
        return Outcome((*checks, Check("stop", "tests", "found no log of the vehicle as it is described now.", fix)))
    if any(one.verdict == "stop" for one in checks):
        return Outcome(tuple(checks))
    anchors = list(work.dossier.measured("scale").get("anchors", []))
    result = estimated(work, flown.records, anchors)
    work.person.progress("writing the report")
    files = _files(work, result)
    forces = damping_forces(result)
    repeated = repeats(result, forces)
    budgets = budget(result, [*forces, *thrust_forces(result)], anchors)
    rows = [_force(one, result, budgets[k] if budgets else None) for k, one in enumerate(forces)]
    checks += [*_about(result, bool(anchors), work.request.link), *_known(work, result, rows), *about(repeated)]
    measured = {
        "result_file": files["result_file"],
        "report_file": files["report_file"],
        "parameters": _parameters(result),
        "damping": rows,
        "repeatability": repeated,
        "budget": budgets,
        "doubts": list(result.doubts),
        "minutes": flown.minutes,
    } | ({} if result.doubts else {"vehicle_file": FILE})
    return Outcome(tuple(checks), measured, tuple(files.values()), skipped="" if anchors else SCALE)


def _files(work: Work, result: Identification) -> dict[str, str]:
    """Names of what is written; a vehicle file only of a result that can be relied on."""
    name = DOUBTFUL if result.doubts else RESULT
    result.save(work.folder / name, overwrite=True)
    page = write_identification_report(result, work.folder / REPORT)
    files = {"result_file": name, "report_file": str(page.relative_to(work.folder))}
    if not result.doubts:
        written(work, result, FILE)
        files["vehicle_file"] = FILE
    return files


def _about(result: Identification, pulled: bool, link: str) -> Iterator[Check]:
    """Doubts stop, contradictions warn, remarks are noted."""
    for doubt in result.doubts:
        yield Check("stop", "estimate", f"not to be relied on: {doubt}.", _help(doubt))
    count = result.verdicts.count("learnt")
    tests = "1 test" if len(result.records) == 1 else f"{len(result.records)} tests"
    scale = result.up_to_scale
    yield Check(
        "ok" if pulled or not scale else "note",
        "parameters",
        f"{count} of {len(result.verdicts)} learnt from {tests}{scale}",
    )
    if any(p.name.startswith("thrusters.") for p in result.parameters.free) and not is_computed(link):
        yield Check("note", "thrusters", CHAIN)
    for p, word in zip(result.parameters.free, result.verdicts, strict=True):
        if word == "contradicted":
            yield _contradicted(p, result.values[p.name], result.interval(p.name))
    for line in result.findings:
        yield Check("note", "remark", f"{line}")


def _contradicted(p: Parameter, value: float, interval: tuple[float, float]) -> Check:
    """By the file, or by each other: intervals are made wider until parts agree, so that they may hold the file's."""
    unit, (low, high) = "" if p.unit == "1" else f" {p.unit}", interval
    found = f"{value:.3g}{unit} ({low:.3g} to {high:.3g})"
    if low <= p.base <= high:
        fix = "What changed between them: battery, tether, payload, current? See the report's findings."
        return Check("warning", p.name, f"parts of the tests disagree about it; together they say {found}.", fix)
    text = f"contradicted: {found}, the file says {p.base:.3g}{unit}."
    return Check("warning", p.name, text, "Is the file right (payload, ballast, water)? See the report's findings.")


def _known(work: Work, result: Identification, forces: Sequence[dict[str, Any]]) -> Iterator[Check]:
    """How well damping is known on each axis, against what was asked for."""
    goal = work.request.interval
    for axis in pushed(result.model()):
        own = [one for one in forces if one["axis"] == axis]
        if not own:
            yield Check(
                "warning", f"damping in {axis}", "not tested: it stays as predicted", "Fly more: --stage excite."
            )
            continue
        widest = max(own, key=lambda one: one["half_width_share"])
        share, force = widest["half_width_share"], f"{abs(widest['force']):.3g} {widest['unit']}"
        found = f"{force} ±{100 * share:.2g} % (k = {COVERAGE:g}) at {widest['speed']:+.2g}"
        text = f"{found}, asked for were ±{100 * goal:.2g} %"
        yield Check("ok" if share <= goal else "note", f"damping in {axis}", text)


def _help(doubt: str) -> str:
    return next((fix for words, fix in HELP if words in doubt), "See the report, and fly more: --stage excite.")


def _parameters(result: Identification) -> list[dict[str, Any]]:
    return [
        {
            "name": p.name,
            "unit": p.unit,
            "value": result.values[p.name],
            "interval_95": list(result.interval(p.name)),
            "verdict": verdict,
        }
        for p, verdict in zip(result.parameters.free, result.verdicts, strict=True)
    ]


def _force(one: Quantity, result: Identification, found: dict[str, Any] | None) -> dict[str, Any]:
    """A damping force with its expanded uncertainty, that of its budget where there is one."""
    half = COVERAGE * one.std(result.covariance) if found is None else found["expanded"]
    return {
        "axis": one.axis,
        "speed": one.at,
        "force": one.value,
        "unit": one.unit,
        "half_width_share": half / max(abs(one.value), 1e-12),
        "interval_95": [one.value - half, one.value + half],
    }
