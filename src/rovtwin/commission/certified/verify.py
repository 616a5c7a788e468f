"""A bundle checked on any machine: every file against its hash, versions, and the figures derived again."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rovtwin.commission.certified.again import Row, derive_again
from rovtwin.commission.certified.manifest import (
    NAME,
    Manifest,
    digest,
    read_manifest,
    seal,
    versions,
)
from rovtwin.commission.certified.opening import DAMAGED, Bundle, manifest_bytes, opened
from rovtwin.core.errors import RovtwinError
from rovtwin.core.user_files.files import cannot

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Finding:
    """A file that is not as the manifest has it: `differs`, `missing` or `extra`, and how."""

    kind: str
    path: str
    text: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.path}: {self.text}"


@dataclass(frozen=True)
class Verified:
    """What was found.

    Attributes:
        manifest: Of the bundle.
        findings: Files that differ, are missing or extra.
        seal: Of the files as they are, "" where there is none: some are missing or have another size.
        versions: A line for each package that is another one here.
        rows: Parameters derived again; empty where nothing was.
        not_derived: Why nothing was derived again.
        contradiction: What the bundle says twice and differently, or why its evidence cannot be used.
    """

    manifest: Manifest
    findings: tuple[Finding, ...]
    seal: str
    versions: tuple[str, ...]
    rows: tuple[Row, ...] = ()
    not_derived: str = ""
    contradiction: str = ""

    @property
    def off(self) -> list[Row]:
        """Parameters that came out otherwise."""
        return [row for row in self.rows if not row.same]

    @property
    def good(self) -> bool:
        """Whether everything is as it was certified."""
        return not self.findings and not self.off and not self.contradiction and self.seal == self.manifest.seal


def verify(path: Path, quick: bool = False, progress: Progress = lambda words, share: None) -> Verified:
    """Check a bundle, a folder or a zip.

    Args:
        path: Where it is.
        quick: Only hashes and versions.
        progress: Called with what is being done and how far it is, 0 to 1.

    Raises:
        ConfigError: It is no bundle, or one that would harm.
    """
    with opened(path) as bundle:
        manifest = read_manifest(manifest_bytes(bundle), f"{bundle.where}: {NAME}")
        findings, found = _compared(bundle, manifest, progress)
        done = Verified(manifest, tuple(findings), found, tuple(_other_versions(manifest)))
        if quick:
            return replace(done, not_derived="--quick")
        if findings or found != manifest.seal:
            return replace(done, not_derived="the files are not those that were certified")
        if manifest.derived is None:
            return replace(done, not_derived=manifest.not_derived)
        with bundle.on_disk([one.path for one in manifest.files]) as folder:
            try:
                return replace(done, rows=tuple(derive_again(folder, manifest.derived, progress)))
            except RovtwinError as error:
                return replace(done, contradiction=str(error))
            except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:  # of a forged result
                text = f"{manifest.derived.result} cannot be used ({type(error).__name__}: {str(error)[:120]})"
                return replace(done, contradiction=text)


def _compared(bundle: Bundle, manifest: Manifest, progress: Progress) -> tuple[list[Finding], str]:
    """What differs, and the seal of the files as they are; "" where some are missing or were not looked into."""
    findings, as_found = [], []
    for k, one in enumerate(manifest.files):
        progress(f"checking {one.path}", k / len(manifest.files))
        size = bundle.sizes.get(one.path)
        if size is None:
            findings.append(Finding("missing", one.path, f"expected {one.bytes} bytes"))
        elif size != one.bytes:
            findings.append(Finding("differs", one.path, f"found {size} bytes, expected {one.bytes}"))
        else:
            sha256, why = _hash(bundle, one.path, size)
            as_found.append(one.model_copy(update={"sha256": sha256}))
            if sha256 != one.sha256:
                text = why or f"found SHA-256 {sha256[:16]}.., expected {one.sha256[:16]}.."
                findings.append(Finding("differs", one.path, text))
    named = {one.path for one in manifest.files} | {NAME}
    findings += [Finding("extra", path, "not in the manifest") for path in sorted(set(bundle.sizes) - named)]
    return findings, seal(as_found) if len(as_found) == len(manifest.files) else ""


def _hash(bundle: Bundle, path: str, size: int) -> tuple[str, str]:
    """SHA-256 of a file, and why it has none."""
    try:
        with bundle.open(path) as stream:
            found, sha256 = digest(stream)
    except (*DAMAGED, RuntimeError) as error:
        return "", f"cannot be unpacked ({error})"
    except OSError as error:
        return "", f"cannot be read ({cannot(error)})"
    return sha256, "" if found == size else f"unpacks to {found} bytes, expected {size}"


def _other_versions(manifest: Manifest) -> list[str]:
    """A line for each package that is not the one of then."""
    here = versions()
    lines = []
    for name, then in manifest.versions.items():
        now = here.get(name)
        if now is None:
            lines.append(f"{name} {then} then, not there now")
        elif now != then:
            lines.append(f"{name} {then} then, {now} now ({_order(then, now)})")
    return lines


def _order(then: str, now: str) -> str:
    """Whether a version is newer or older; `another` where that cannot be read off."""
    try:
        before, after = ([int(part) for part in text.split(".")] for text in (then, now))
    except ValueError:
        return "another"
    return "newer" if after > before else "older" if after < before else "another"
