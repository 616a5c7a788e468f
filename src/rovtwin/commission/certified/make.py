"""The bundle: all that a commissioning rests on in one folder, in a form that another machine can check."""

import shutil
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rovtwin.commission.certified.again import derived_of
from rovtwin.commission.certified.cleaning import Cleaner, public_url
from rovtwin.commission.certified.manifest import (
    FORMAT,
    NAME,
    VERSION,
    CleanedEntry,
    Derived,
    FileEntry,
    LeftOut,
    Manifest,
    digest,
    seal,
    versions,
)
from rovtwin.commission.dossier import Dossier
from rovtwin.core.errors import RovtwinError
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.identification.joint.result.overlay import to_yaml
from rovtwin.identification.result import Identification
from rovtwin.scenario.assets import MESHES, kept_beside
from rovtwin.vehicle import Vehicle, load_vehicle

STAGES, VEHICLE, IDENTIFIED, PRIOR = "stages", "vehicle.yaml", "identified.yaml", "prior.yaml"
AUTOPILOT, REQUEST, VERSIONS, README = "autopilot.yaml", "request.json", "versions.json", "README.txt"
INDEX, CERTIFICATE = "commission.json", "certificate"
MOST_ZIPPED = 200_000_000  # bytes of a bundle that is given as a zip, too
EARLY = (1980, 1, 1, 0, 0, 0)  # the time of every file in the zip, so that the same files give the same zip

Progress = Callable[[str], None]

_README = """Evidence of a commissioning, made by rovtwin.

certificate.html, certificate.pdf   what was found, and every attempt at every stage
vehicle.yaml, identified.yaml       the vehicle as it was described, and as it was identified
autopilot.yaml                      the autopilot that was proven, where there is one
request.json, versions.json         what was asked for, and the software that did it
stages/                             pages, logs and results, a folder for each attempt
MANIFEST.json                       size and SHA-256 of every file, and the figures that can be derived again

To check every file and to derive the figures again on your machine: rovtwin verify FOLDER (or its zip).
The first line that it prints, the seal, is the one on the signed certificate if nothing was changed.
"""


@dataclass
class Evidence:
    """A bundle while it is made.

    Attributes:
        folder: Of the bundle.
        cleaned, left_out: What was done to files, see `Manifest`.
        derived: What can be derived again.
        not_derived: Why nothing can be.
        seal: Of all files but the certificate's pages.
        log_files: Path in the bundle of each log.
    """

    folder: Path
    cleaned: list[CleanedEntry] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    derived: Derived | None = None
    not_derived: str = ""
    seal: str = ""
    log_files: dict[str, Path] = field(default_factory=dict)


def gather(dossier: Dossier, folder: Path, progress: Progress) -> Evidence:
    """Copy everything but the certificate into a folder, which is made; paths of this machine are taken out.

    Raises:
        ConfigError: A vehicle file cannot be used any more.
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True)
    evidence = Evidence(folder)
    described = [Path(text).parent for text in (dossier.request.vehicle, dossier.request.prior) if text]
    cleaner = Cleaner(dossier.folder, [place for place in described if str(place) != "."])
    _copy_stages(evidence, dossier, cleaner, progress)
    _copy_vehicles(evidence, dossier)
    _copy_autopilot(evidence, dossier, cleaner)
    request = dossier.request.to_dict() | {"vehicle": VEHICLE, "prior": PRIOR if dossier.request.prior else None}
    request |= {"link": public_url(request["link"]), "sensors": [public_url(url) for url in request["sensors"]]}
    write_text(folder / REQUEST, to_json(request) + "\n")
    write_text(folder / VERSIONS, to_json(versions()) + "\n")
    write_text(folder / README, _README)
    progress("finding the tests that the identification rests on")
    _find_derived(evidence, dossier)
    evidence.seal = seal(_entries(folder))
    return evidence


def _copy_stages(evidence: Evidence, dossier: Dossier, cleaner: Cleaner, progress: Progress) -> None:
    """Every file of every attempt at the stages before the certificate."""
    sources = sorted(
        path
        for path in dossier.folder.glob("[0-9]*-*/*/**/*")
        if path.is_file() and not path.is_symlink() and not path.name.startswith(".")
    )
    sources = [path for path in sources if not _of_certificate(path.relative_to(dossier.folder))]
    for k, source in enumerate(sources):
        within = source.relative_to(dossier.folder).as_posix()
        progress(f"copying {within} ({k + 1} of {len(sources)})")
        name, before = f"{STAGES}/{within}", ""
        done = cleaner.copy(source, evidence.folder / name)
        if done == "cleaned":
            with open(source, "rb") as stream:
                before = digest(stream)[1]
            evidence.cleaned.append(CleanedEntry(path=name, sha256_before=before))
        elif done:
            evidence.left_out.append(LeftOut(path=name, why=done))
            continue
        if source.suffix == ".mcap":
            evidence.log_files[name] = evidence.folder / name


def _of_certificate(within: Path) -> bool:
    return within.parts[0].partition("-")[2] == CERTIFICATE


def _copy_vehicles(evidence: Evidence, dossier: Dossier) -> None:
    """The vehicle as described, as identified, and as of before, each with its meshes beside it."""
    files = {VEHICLE: dossier.request.vehicle, PRIOR: dossier.request.prior}
    passed, name = dossier.passed("identify"), dossier.measured("identify").get("vehicle_file")
    files[IDENTIFIED] = str(passed.folder / str(name)) if passed is not None and name else None
    for name, source in files.items():
        if source is not None:
            write_vehicle(load_vehicle(source), evidence.folder / name)


def write_vehicle(vehicle: Vehicle, path: Path) -> None:
    """A vehicle's file that needs no other but the meshes beside it."""
    data = kept_beside(vehicle.to_dict(), path.parent, f"{path.stem}_{MESHES}")
    write_text(path, to_yaml(data, "rovtwin commission"))


def _copy_autopilot(evidence: Evidence, dossier: Dossier, cleaner: Cleaner) -> None:
    """The autopilot that was proven: a file of that stage, or a section that its figures hold."""
    passed, measured = dossier.passed("prove"), dossier.measured("prove")
    name, section = measured.get("autopilot_file"), measured.get("autopilot")
    if passed is not None and isinstance(name, str) and (passed.folder / name).is_file():
        cleaner.copy(passed.folder / name, evidence.folder / AUTOPILOT)
    elif isinstance(section, dict) and section:
        write_text(evidence.folder / AUTOPILOT, cleaner.text(dump_yaml(section)))


def _find_derived(evidence: Evidence, dossier: Dossier) -> None:
    """What `rovtwin verify` will derive again, or why it cannot."""
    passed, name = dossier.passed("identify"), dossier.measured("identify").get("result_file")
    if passed is None or not name:
        evidence.not_derived = "nothing was identified"
        return
    result = f"{STAGES}/{(passed.folder / str(name)).relative_to(dossier.folder).as_posix()}"
    excited = dossier.passed("excite")
    first = "" if excited is None else f"{STAGES}/{excited.folder.relative_to(dossier.folder).as_posix()}/"
    logs = dict(
        sorted(evidence.log_files.items(), key=lambda item: (not (first and item[0].startswith(first)), item[0]))
    )
    try:
        evidence.derived = derived_of(
            Identification.load(evidence.folder / result),
            IDENTIFIED,
            result,
            logs,
            dossier.measured("scale").get("anchors") or [],
        )
    except RovtwinError as error:
        evidence.not_derived = str(error)


def finish(evidence: Evidence, vehicle: str, issued: str, pages: list[Path]) -> Manifest:
    """Put the certificate's pages in, and write the manifest of all that is there."""
    for page in pages:
        shutil.copyfile(page, evidence.folder / page.name)
    manifest = Manifest(
        format=FORMAT, version=VERSION, vehicle=vehicle, issued=issued, versions=versions(), seal=evidence.seal,
        derived=evidence.derived, not_derived=evidence.not_derived, files=_entries(evidence.folder),
        cleaned=evidence.cleaned, left_out=evidence.left_out,
    )  # fmt: skip
    write_text(evidence.folder / NAME, manifest.text())
    return manifest


def _entries(folder: Path) -> list[FileEntry]:
    """Every file of a bundle but its manifest, by path."""
    found = []
    for path in folder.glob("**/*"):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and name != NAME:
            with open(path, "rb") as stream:
                size, sha256 = digest(stream)
            found.append(FileEntry(path=name, bytes=size, sha256=sha256))
    return sorted(found, key=lambda one: one.path)


def zip_of(folder: Path, target: Path) -> Path | None:
    """A zip of a bundle, None where it is too large for one; the same files give the same bytes."""
    files = sorted(path for path in folder.glob("**/*") if path.is_file())
    if sum(path.stat().st_size for path in files) > MOST_ZIPPED:
        return None
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in files:
            entry = zipfile.ZipInfo(f"{folder.name}/{path.relative_to(folder).as_posix()}", EARLY)
            entry.external_attr, entry.compress_type = 0o644 << 16, zipfile.ZIP_DEFLATED
            with open(path, "rb") as source, archive.open(entry, "w", force_zip64=True) as out:
                shutil.copyfileobj(source, out)
    return target
