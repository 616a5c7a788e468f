"""MANIFEST.json: every file of a bundle with size and SHA-256, and the figures that can be derived again."""

import hashlib
import json
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any, BinaryIO, Literal

from pydantic import Field

from rovtwin._version import __version__
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import Strict, parse
from rovtwin.core.user_files.jsontext import to_json

NAME, FORMAT, VERSION = "MANIFEST.json", "rovtwin commissioning bundle", 1
PAGE, PDF = "certificate.html", "certificate.pdf"
PAGES = (PAGE, PDF)  # not in the seal: they show it
MOST_BYTES = 20_000_000  # of a manifest
MOST_FILES, MOST_IN_ALL = 20_000, 50_000_000_000  # files of a bundle, and their bytes
PACKAGES = ("numpy", "scipy", "jax", "jaxlib", "equinox", "netCDF4", "mcap", "matplotlib")
_PIECE = 1 << 20

Hash = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Name = Annotated[str, Field(min_length=1, max_length=1000)]


class FileEntry(Strict):
    """A file of the bundle."""

    path: Name
    bytes: int = Field(ge=0, le=MOST_IN_ALL)
    sha256: Hash


class CleanedEntry(Strict):
    """A file from which paths of the machine were taken, and what it was before."""

    path: Name
    sha256_before: Hash


class LeftOut(Strict):
    """A file that is not in the bundle, and why."""

    path: Name
    why: str


class TestEntry(Strict):
    """A test that the identification rests on."""

    __test__ = False  # not one of pytest's

    log: Name
    name: str
    use: Literal["fit", "held out"]
    duration_s: float = Field(gt=0)


class ParameterEntry(Strict):
    """A parameter as identified: in its unit, and as the estimator counts (relative where it is positive)."""

    name: Name
    unit: str
    value: float
    theta: float
    sd: float = Field(gt=0)


class Derived(Strict):
    """What can be derived again, and of what."""

    result: Name
    vehicle: Name
    tests: list[TestEntry] = Field(min_length=1)
    anchors: list[dict[str, Any]]
    parameters: list[ParameterEntry] = Field(min_length=1)


class Manifest(Strict):
    """The content of MANIFEST.json."""

    format: Literal["rovtwin commissioning bundle"]
    version: int
    vehicle: str
    issued: str
    versions: dict[str, str]
    seal: Hash
    derived: Derived | None
    not_derived: str
    files: list[FileEntry] = Field(max_length=MOST_FILES)
    cleaned: list[CleanedEntry]
    left_out: list[LeftOut]

    def text(self) -> str:
        """As it is written."""
        return to_json(self.model_dump(mode="json")) + "\n"


def read_manifest(content: bytes, where: str) -> Manifest:
    """The manifest in a file's content.

    Raises:
        ConfigError: It is none, one of a newer format, or names files outside of the bundle.
    """
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise ConfigError(
            f"{where}: found no JSON ({str(error)[:80]}), expected what rovtwin commission wrote"
        ) from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise ConfigError(f"{where}: found no '{FORMAT}', expected the manifest that rovtwin commission wrote")
    if data.get("version") != VERSION:
        raise ConfigError(
            f"{where}: found version {str(data.get('version'))[:20]} of the bundle, expected {VERSION}: verify it with "
            "the rovtwin that made it, or a newer one"
        )
    found = parse(Manifest, data, where)
    paths = [one.path for one in found.files]
    named = [*paths, *(one.path for one in (*found.cleaned, *found.left_out))]
    if found.derived is not None:
        named += [found.derived.result, found.derived.vehicle, *(test.log for test in found.derived.tests)]
    for path in named:
        require_inside(path, where)
    if len(set(paths)) < len(paths):
        raise ConfigError(f"{where}: found a file that is named twice, expected each once")
    files = set(paths)
    if both := next((path[:i] for path in paths for i, c in enumerate(path) if c == "/" and path[:i] in files), None):
        raise ConfigError(f"{where}: {ascii(both)[:120]} is a file and a folder, expected one. Do not use this bundle")
    if sum(one.bytes for one in found.files) > MOST_IN_ALL:
        raise ConfigError(f"{where}: found more than {MOST_IN_ALL / 1e9:.0f} GB in all, expected a bundle")
    return found


def require_inside(path: str, where: str) -> None:
    """ConfigError unless a path leads to a place within the bundle, written in the one way that all systems know."""
    parts = path.split("/")
    strange = any(not c.isprintable() for c in path) or "\\" in path or ":" in path or len(path) > 1000
    if strange or any(part in ("", ".", "..") for part in parts):
        raise ConfigError(
            f"{where}: found the path {ascii(path)[:120]}, expected one within the bundle, such as "
            "stages/1-paper/x.json. Do not use this bundle"
        )


def digest(stream: BinaryIO) -> tuple[int, str]:
    """Number of bytes and SHA-256 of what a stream gives."""
    found, size = hashlib.sha256(), 0
    while piece := stream.read(_PIECE):
        found.update(piece)
        size += len(piece)
    return size, found.hexdigest()


def seal(files: Iterable[FileEntry]) -> str:
    """One SHA-256 for all files but the certificate's pages, which show it; that of `sha256sum` lines, by path."""
    lines = [f"{one.sha256}  {one.path}\n" for one in sorted(files, key=lambda one: one.path) if one.path not in PAGES]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def versions() -> dict[str, str]:
    """Of what computes, on this machine."""
    found = {"rovtwin": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
