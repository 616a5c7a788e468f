"""Certificate: one page with the figures, all pages behind it, and the evidence in a bundle that anybody can check."""

from collections.abc import Sequence

from rovtwin.commission.certified.facts import certificate_of
from rovtwin.commission.certified.make import Evidence, finish, gather, zip_of
from rovtwin.commission.certified.manifest import NAME, PAGE, PDF, Manifest
from rovtwin.commission.dossier import status
from rovtwin.commission.stage import Check, Outcome, Stage
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import cannot
from rovtwin.report.commission.certificate import write_certificate_page
from rovtwin.report.commission.pdf import write_certificate_pdf
from rovtwin.vehicle import load_vehicle

BUNDLE, ZIP = "bundle", "bundle.zip"
FRESH = "Give the same command again: it repeats that stage."


def run(work: Work, stages: Sequence[Stage]) -> Outcome:
    """The page of the certificate; `stages` are those that come before it."""
    if stale := [(stage, words) for stage, words, _ in status(work.dossier, stages) if words != "passed"]:
        lines = [Check("stop", stage.name, f"it is {words}, expected passed.", FRESH) for stage, words in stale]
        return Outcome(tuple(lines))
    try:
        return _issued(work, stages)
    except OSError as error:
        raise ConfigError(f"{work.folder}: cannot be written ({cannot(error)})") from None


def _issued(work: Work, stages: Sequence[Stage]) -> Outcome:
    say = work.person.progress
    issued = work.dossier.attempts("certificate")[-1].began
    vehicle = load_vehicle(work.current_vehicle())
    evidence = gather(work.dossier, work.folder / BUNDLE, say)
    say("writing the certificate")
    found = certificate_of(work.dossier, stages, vehicle, issued, evidence.seal, evidence.not_derived)
    letters = write_certificate_pdf(found, work.folder / PDF)
    pages = [write_certificate_page(found, work.folder / PAGE, letters), work.folder / PDF]
    say("writing the bundle")
    manifest = finish(evidence, vehicle.name, issued, pages)
    zipped = zip_of(work.folder / BUNDLE, work.folder / ZIP)
    measured = {"certificate": PAGE, "pdf": PDF, "bundle": BUNDLE, "seal": evidence.seal, "files": len(manifest.files)}
    measured |= {} if zipped is None else {"zip": ZIP}
    files = (PAGE, PDF, f"{BUNDLE}/{NAME}", *([] if zipped is None else [ZIP]))
    unknown = [Check("note", f"not known: {what}", why) for what, why in found.unknown]
    return Outcome((*_checks(evidence, manifest, zipped is not None), *unknown), measured, files)


def _checks(evidence: Evidence, manifest: Manifest, zipped: bool) -> list[Check]:
    """What became of the evidence."""
    size = sum(one.bytes for one in manifest.files) / 1e6
    lines = [Check("ok", "bundle", f"{len(manifest.files)} files, {size:.1f} MB, seal {evidence.seal}")]
    if evidence.derived is not None:
        count, tests = len(evidence.derived.parameters), len(evidence.derived.tests)
        lines.append(Check("ok", "re-derivation", f"{count} parameters rest on {tests} tests that are in the bundle"))
    else:
        text = f"`rovtwin verify` can check files only: {evidence.not_derived}."
        lines.append(Check("warning", "re-derivation", text))
    if not zipped:
        lines.append(Check("note", "zip", "the bundle is too large for one: pass the folder on."))
    if evidence.cleaned:
        lines.append(Check("note", "bundle", f"paths of this machine were taken out of {len(evidence.cleaned)} files"))
    for one in evidence.left_out:
        lines.append(Check("warning", "bundle", f"{one.path} is not in it: {one.why}."))
    return lines
