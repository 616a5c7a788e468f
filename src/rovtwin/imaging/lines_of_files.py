"""Several files of lines of one dive as one, in order of time: instruments cut a dive into files.

Lines count through all files. What must be the same in all is compared before anything is read: pixels, bands, imager,
mount, datum, and in a simulation its scene. Dark and response frames are each file's own.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse_yaml
from rovtwin.imaging.lines import LinesFile, LinesHead, Truth

if TYPE_CHECKING:
    from rovtwin.imaging.imager import Imager

_Head = TypeVar("_Head", bound=LinesHead)
_ALIKE = 1e-6  # within which wavelengths are the same [nm], and places of a mount [m]
_MOUNTS = ("mount_position", "mount_rotation", "truth/mount_position", "truth/mount_rotation")


class LinesOfFiles(LinesFile):
    """Files of lines of one dive, in order of time, as one `LinesFile`; its path is that of the first.

    Args:
        files: Open; they are closed with this.

    Raises:
        ConfigError: They do not belong together, see `in_order`.
    """

    def __init__(self, files: Sequence[LinesFile]) -> None:
        self._files: list[LinesFile] = in_order(files)
        first = self._files[0]
        self.path, self.datum, self.counts = first.path, first.datum, first.counts
        self.wavelengths, self.fwhm, self.saturation = first.wavelengths, first.fwhm, first.saturation
        self.imager, self.mount = first.imager, first.mount
        self.t = np.concatenate([one.t for one in self._files])
        self.exposure = np.concatenate([one.exposure for one in self._files])
        self._begins = np.cumsum([0, *(one.shape[0] for one in self._files)])

    @property
    def files(self) -> Sequence[LinesHead]:
        """See `LinesHead`."""
        return self._files

    @property
    def shape(self) -> tuple[int, int, int]:
        """Lines of all files, pixels, bands."""
        return int(self._begins[-1]), *self._files[0].shape[1:]

    def pieces(self, first: int, last: int) -> Iterator[tuple[LinesHead, int, int]]:
        """See `LinesHead`."""
        for one, begin, end in zip(self._files, self._begins[:-1], self._begins[1:], strict=True):
            if first < end and last > begin:
                yield one, int(max(first - begin, 0)), int(min(last, end) - begin)

    def read(self, first: int, last: int) -> Float[np.ndarray, "line pixel band"]:
        """See `LinesHead`."""
        return np.concatenate([one.read(a, b) for one, a, b in self.pieces(first, last)])

    def radiance(
        self, first: int, last: int
    ) -> tuple[Float[np.ndarray, "line pixel band"], Bool[np.ndarray, "line pixel band"]]:
        """See `LinesHead`."""
        found = [one.radiance(a, b) for one, a, b in self.pieces(first, last)]
        return np.concatenate([value for value, _ in found]), np.concatenate([trusted for _, trusted in found])

    @property
    def frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Those of the first file; `pieces` leads to those of each."""
        return self._files[0].frames

    @property
    def described(self) -> bool:
        """See `LinesHead`."""
        return self._files[0].described

    @property
    def simulated(self) -> bool:
        """See `LinesHead`."""
        return self._files[0].simulated

    @cached_property
    def truth(self) -> Truth | None:
        """See `LinesFile`."""
        found = [truth for one in self._files if (truth := one.truth) is not None]
        if not found:
            return None
        t, position, attitude, floor = (
            np.concatenate([getattr(truth, name) for truth in found]) for name in ("t", "position", "attitude", "floor")
        )
        return Truth(t, position, attitude, found[0].mount, found[0].scene, floor)

    def navigation(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Of all files; where one begins before another ends, or each has that of the whole dive, it counts once."""
        rows, latest = [], -np.inf
        for one in self._files:
            if (found := one.navigation()) is None:
                continue
            t = found[0] + one._start - self._start  # a datum may have come from elsewhere since
            later = ~(t <= latest)
            rows.append((t[later], found[1][later], found[2][later]))
            latest = float(np.nanmax(t, initial=latest))
        if not rows:
            return None
        t, place, euler = (np.concatenate(part) for part in zip(*rows, strict=True))
        return t, place, euler

    def close(self) -> None:
        """No more reading."""
        for one in self._files:
            one.close()


def open_lines(paths: Sequence[Path], imager: "Imager | None" = None) -> LinesFile:
    """One file of lines, or several as one.

    Raises:
        ConfigError, LogError: See `LinesFile` and `in_order`.
    """
    if len(paths) == 1:
        return LinesFile(paths[0], imager)
    with ExitStack() as opened:
        files = [opened.enter_context(LinesFile(path, imager)) for path in paths]
        found = LinesOfFiles(files)
        opened.pop_all()
    return found


def in_order(files: Sequence[_Head]) -> list[_Head]:
    """Files of one dive in order of time.

    Raises:
        ConfigError: Two of them differ in what must be the same, or their lines overlap in time.
    """
    ordered = sorted(files, key=lambda one: float(one.t[0]))
    for one in files:
        if differing := _differing(files[0], one):
            raise ConfigError(
                f"--lines {files[0].path} and {one.path}: {'; '.join(differing)}. Expected files of one dive, of one "
                "imager on one vehicle; map others by themselves"
            )
    for one, other in zip(ordered[:-1], ordered[1:], strict=True):
        if other.t[0] <= one.t[-1]:
            raise ConfigError(
                f"--lines {one.path} and {other.path}: found lines of {one.t[0]:.3f} to {one.t[-1]:.3f} s and of "
                f"{other.t[0]:.3f} to {other.t[-1]:.3f} s, expected files that follow one upon the other. Is a file "
                "given twice, or are they of two dives?"
            )
    return ordered


def _differing(a: LinesHead, b: LinesHead) -> list[str]:
    """What is not the same in two files that must be, with both values."""
    if a.shape[1:] != b.shape[1:]:
        sizes = ["{} x {}".format(*one.shape[1:]) for one in (a, b)]
        return [f"found lines of {sizes[0]} and of {sizes[1]} (pixels x bands)"]
    found = []
    for name in ("wavelengths", "fwhm"):
        apart = np.abs(getattr(a, name) - getattr(b, name))
        if not (apart <= _ALIKE).all():
            k = int(np.argmax(apart))
            found.append(f"{name} of band {k}: found {getattr(a, name)[k]:g} and {getattr(b, name)[k]:g} nm")
    for name, of in (("counts", bool), ("saturation", float), ("datum", lambda datum: datum)):
        values = of(getattr(a, name)), of(getattr(b, name))
        if values[0] != values[1]:
            found.append(f"{name}: found {values[0]} and {values[1]}")
    if keys := _differing_keys(a, b):
        found.append(f"imager: {', '.join(keys)} not the same")
    for name in _MOUNTS:
        places = [one.stated(name) for one in (a, b)]
        if not _same(*places):
            found.append(f"{name}: found {_shown(places[0])} and {_shown(places[1])}")
    if a.simulated != b.simulated or a.text("truth/scene") != b.text("truth/scene"):
        found.append("the scene that a simulation saw is not the same")
    return found


def _differing_keys(a: LinesHead, b: LinesHead) -> list[str]:
    """Keys of the imagers' descriptions that are not the same."""
    texts = [one.text("imager") for one in (a, b)]
    if texts[0] == texts[1]:
        return []
    one, other = ({} if text is None else parse_yaml(text, "imager") for text in texts)
    return sorted(key for key in one.keys() | other.keys() if one.get(key) != other.get(key))


def _same(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    if a is None or b is None:
        return a is b
    return a.shape == b.shape and bool((np.abs(a - b) <= _ALIKE).all())


def _shown(values: np.ndarray | None) -> str:
    return "none" if values is None else str(np.round(values, 4).tolist())
