"""Bundles as they come, a folder or a zip, from whoever sent them: read, never believed to be what they should be.

Nothing is written outside of a temporary folder, links are not followed, and of a zip only files are unpacked that its
manifest names, with the size that it names.
"""

import os
import shutil
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path, PurePosixPath
from typing import BinaryIO, Protocol

from rovtwin.commission.certified.manifest import MOST_BYTES, MOST_FILES, NAME, require_inside
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import cannot

DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError)
_ENCRYPTED = 0x1


class Bundle(Protocol):
    """Files of a bundle.

    Attributes:
        where: For messages.
        sizes: Bytes of each file by its path in the bundle.
    """

    where: str
    sizes: dict[str, int]

    def open(self, path: str) -> BinaryIO:
        """The content of a file."""
        ...

    def on_disk(self, paths: list[str]) -> AbstractContextManager[Path]:
        """A folder in which these files lie."""
        ...


class Folder:
    """A bundle that is a folder."""

    def __init__(self, folder: Path):
        self.where, self._folder = str(folder), folder
        self.sizes = dict(_walked(folder))

    def open(self, path: str) -> BinaryIO:
        return open(self._folder / path, "rb")

    @contextmanager
    def on_disk(self, paths: list[str]) -> Iterator[Path]:
        yield self._folder


def _walked(folder: Path) -> Iterator[tuple[str, int]]:
    """Path and size of every file; a link or a device is refused."""
    count, waiting = 0, [folder]
    while waiting:
        for entry in os.scandir(waiting.pop()):
            path = Path(entry.path).relative_to(folder).as_posix()
            count += 1
            if count > 2 * MOST_FILES:
                raise ConfigError(f"{folder}: found more than {MOST_FILES} files, expected a bundle")
            mode = entry.stat(follow_symlinks=False)
            if stat.S_ISDIR(mode.st_mode):
                waiting.append(Path(entry.path))
            elif stat.S_ISREG(mode.st_mode):
                yield path, mode.st_size
            else:
                kind = "a link" if stat.S_ISLNK(mode.st_mode) else "no ordinary file"
                raise ConfigError(
                    f"{folder}: {ascii(path)[:120]} is {kind}, expected files only. Do not use this bundle"
                )


class Zipped:
    """A bundle that is a zip."""

    def __init__(self, path: Path, archive: zipfile.ZipFile):
        self.where, self._archive = str(path), archive
        entries = [entry for entry in archive.infolist() if not entry.is_dir()]
        if len(entries) > 2 * MOST_FILES:
            raise ConfigError(f"{path}: found {len(entries)} files, expected at most {MOST_FILES}")
        for entry in entries:
            self._require_plain(entry)
        names = [entry.filename for entry in entries]
        if len(set(names)) < len(names):
            raise ConfigError(f"{path}: found a file that is in it twice, expected each once. Do not use this bundle")
        # Zips of a folder have it in every name.
        tops = {PurePosixPath(name).parts[0] for name in names}
        self._within = f"{tops.pop()}/" if NAME not in names and len(tops) == 1 else ""
        self.sizes = {entry.filename.removeprefix(self._within): entry.file_size for entry in entries}

    def _require_plain(self, entry: zipfile.ZipInfo) -> None:
        name = entry.orig_filename  # zipfile cuts a name at a zero byte
        require_inside(name, self.where)
        mode = entry.external_attr >> 16
        if mode and not stat.S_ISREG(mode) and stat.S_IFMT(mode):
            raise ConfigError(
                f"{self.where}: {ascii(name)[:120]} is a link or a device, expected files only. Do not use this bundle"
            )
        if entry.flag_bits & _ENCRYPTED:
            raise ConfigError(f"{self.where}: {name} is encrypted, expected a plain zip: unpack it first")

    def open(self, path: str) -> BinaryIO:
        return self._archive.open(self._within + path)  # type: ignore[return-value]  (its stub says IO[bytes])

    @contextmanager
    def on_disk(self, paths: list[str]) -> Iterator[Path]:
        """A folder in which these files lie, whose sizes were checked before; it goes away afterwards."""
        with tempfile.TemporaryDirectory(prefix="rovtwin-verify-") as text:
            folder = Path(text)
            need, free = sum(self.sizes[path] for path in paths), shutil.disk_usage(folder).free
            if need > 0.9 * free:
                raise ConfigError(
                    f"{self.where}: unpacked it takes {need / 1e9:.1f} GB, and {tempfile.gettempdir()} has "
                    f"{free / 1e9:.1f} GB left: free some space, set TMPDIR, or add --quick"
                )
            for path in paths:
                target = folder / path
                target.parent.mkdir(parents=True, exist_ok=True)
                with self.open(path) as stream, open(target, "wb") as out:
                    _copied(stream, out, self.sizes[path])
            yield folder


def _copied(stream: BinaryIO, out: BinaryIO, most: int) -> None:
    """At most so many bytes: a zip may hold more than it says."""
    while most > 0 and (piece := stream.read(min(1 << 20, most))):
        out.write(piece)
        most -= len(piece)


@contextmanager
def opened(path: Path) -> Iterator[Bundle]:
    """The bundle at a path.

    Raises:
        ConfigError: There is none, or it is made so that using it would harm.
    """
    if not path.exists():
        raise ConfigError(f"{path}: no such folder or file, expected a bundle of rovtwin commission")
    if path.is_dir():
        try:
            yield Folder(_within(path))
        except PermissionError as error:
            raise ConfigError(f"{path}: cannot be read ({cannot(error)})") from None
        return
    if not path.is_file():
        raise ConfigError(f"{path}: is a pipe or a device, expected a folder or a zip")
    try:
        archive = zipfile.ZipFile(path)
    except (*DAMAGED, OSError, ValueError) as error:
        raise ConfigError(
            f"{path}: found no zip that can be read ({error}), expected the folder `bundle` of a commissioning, or its "
            "zip"
        ) from None
    with archive:
        yield Zipped(path, archive)


def _within(folder: Path) -> Path:
    """The bundle in a folder: itself, the one in it, or that of the last certificate of a commissioning."""

    def attempt(bundle: Path) -> tuple[int, str]:
        return (int(bundle.parent.name) if bundle.parent.name.isdigit() else 0, str(bundle))

    places = [folder, folder / "bundle", *sorted(folder.glob("*-certificate/*/bundle"), key=attempt, reverse=True)]
    return next((place for place in places if (place / NAME).exists()), folder)


def manifest_bytes(bundle: Bundle) -> bytes:
    """The content of the manifest.

    Raises:
        ConfigError: There is none, or it is too large to be one.
    """
    if NAME not in bundle.sizes:
        raise ConfigError(
            f"{bundle.where}: found no {NAME}, expected the folder `bundle` of a commissioning, or its zip"
        )
    if bundle.sizes[NAME] > MOST_BYTES:
        raise ConfigError(f"{bundle.where}: {NAME} has {bundle.sizes[NAME] / 1e6:.0f} MB, expected far less")
    try:
        with bundle.open(NAME) as stream:
            return stream.read(MOST_BYTES)
    except (*DAMAGED, RuntimeError) as error:
        raise ConfigError(f"{bundle.where}: {NAME} cannot be unpacked ({error}); copy the bundle once more") from None
