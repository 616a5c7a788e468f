"""The file of an imager's lines: HDF5 in the layout that gref4hsi reads, read a few lines at a time.

`processed/radiance/dataCube` (line, pixel, band) holds counts or radiances, beside it time stamps, exposures, dark and
radiometric frames; `raw/nav` the vehicle's own navigation. What that layout does not have is in the group `rovtwin`:
the imager's file, where it sits, the datum, and where a simulation made the lines, the truth. A file of a real
instrument without that group is read, too, when its imager's description is given beside it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.datum import datum_of
from rovtwin.core.errors import LogError
from rovtwin.core.user_files.files import checked
from rovtwin.imaging.files import imager_from_text

if TYPE_CHECKING:  # heavy, and not needed to refuse a file
    from rovtwin.imaging.imager import Imager, Mount

RADIANCE, NAVIGATION, OWN = "processed/radiance", "raw/nav", "rovtwin"
CUBE, STAMP, EXPOSURE = (f"{RADIANCE}/{name}" for name in ("dataCube", "timestamp", "exposureTime"))
WAVELENGTHS, FWHM = (f"{RADIANCE}/calibration/spectral/{name}" for name in ("band2Wavelength", "fwhm"))
DARK, RESPONSE = (f"{RADIANCE}/calibration/radiometric/{name}" for name in ("darkFrame", "radiometricFrame"))
FIELD = f"{RADIANCE}/calibration/geometric/fieldOfView"
FORMAT = 1  # of the group `rovtwin`
LONGEST_GAP = 0.2  # between lines, beyond which lines are missing [s]
_HDF = b"\x89HDF\r\n\x1a\n"


@dataclass(frozen=True)
class Truth:
    """What a simulation knows of its lines and no instrument does.

    Attributes:
        t: Middle of each line's exposure on the run's clock [s].
        position: Of CO in n then [m].
        attitude: Quaternion q_nb then.
        mount: Where the imager truly sits: the stated place with its misalignment.
        scene: The scene's file, YAML.
        floor: Depth of the floor at the middle of the line [m], no number where the line missed it.
    """

    t: Float[np.ndarray, " line"]
    position: Float[np.ndarray, "line 3"]
    attitude: Float[np.ndarray, "line 4"]
    mount: "Mount"
    scene: str
    floor: Float[np.ndarray, " line"]


class LinesHead:
    """What a file of lines says of itself but for its imager, checked; a context manager.

    Attributes:
        path: Of the file.
        t: Stamps of the lines, middle of their exposure, by the imager's clock, on the run's time [s]; without a datum
            unix time.
        exposure: Time that each collected light [s].
        wavelengths: Centres of the bands [nm].
        fwhm: Widths of their responses [nm].
        datum: Where n lies on the map and when the run began; None where the file does not say.
        counts: Whether the cube holds counts, not radiances.
        saturation: A count from which on nothing is to be trusted; inf where the file does not say.

    Raises:
        LogError: The file is missing, damaged, no file of lines, or says no or wrong wavelengths or times.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file = _opened(self.path)
        try:
            self._read_head()
        except RuntimeError as error:  # of the HDF5 library
            self._file.close()
            raise LogError(damaged(self.path, error)) from None
        except BaseException:
            self._file.close()
            raise

    def _read_head(self) -> None:
        self._cube = self._required(CUBE, 3)
        lines, pixels, bands = self._cube.shape
        self.counts = np.issubdtype(self._cube.dtype, np.integer)
        self.wavelengths = self._vector(WAVELENGTHS, bands, "bands")
        if not (np.diff(self.wavelengths) > 0).all() or not (self.wavelengths > 0).all():
            raise LogError(f"{self.path}: {WAVELENGTHS}: expected wavelengths that grow [nm]")
        stored = self._found(FWHM)
        self.fwhm = np.gradient(self.wavelengths) if stored is None else self._vector(FWHM, bands, "bands")
        self.datum = datum_of({"datum": self.text("datum") or ""})
        stamps = self._vector(STAMP, lines, "lines")
        self.t = stamps - self._start
        check_stamps(self.t, str(self.path))
        self.exposure = 1e-3 * self._spread(EXPOSURE, lines)
        self.saturation = float(getattr(self._cube, "saturation", np.inf))

    @property
    def _start(self) -> float:
        """Time zero of the run's clock [unix s]."""
        if self.datum is None:
            return 0.0
        return float(self.datum.utc(0.0).astype("datetime64[ns]").astype(np.int64)) * 1e-9

    @property
    def shape(self) -> tuple[int, int, int]:
        """Lines, pixels, bands."""
        lines, pixels, bands = self._cube.shape
        return int(lines), int(pixels), int(bands)

    @property
    def files(self) -> Sequence["LinesHead"]:
        """The files that the lines lie in, in order of time: this one."""
        return [self]

    def pieces(self, first: int, last: int) -> Iterator[tuple["LinesHead", int, int]]:
        """The files that lines `first` up to, without, `last` lie in, and their numbers there."""
        yield self, first, last

    @property
    def name(self) -> str:
        """Of the file, or of the first of several and how many more there are."""
        more = len(self.files) - 1
        return self.path.name + (f" and {more} more" if more else "")

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Where lines are missing: begin and end [s] of each way between two that is longer than LONGEST_GAP."""
        at = np.flatnonzero(np.diff(self.t) > LONGEST_GAP)
        return [(float(self.t[k]), float(self.t[k + 1])) for k in at]

    def read(self, first: int, last: int) -> Float[np.ndarray, "line pixel band"]:
        """Lines `first` up to, without, `last` as the file has them, counts or radiances, float32."""
        try:
            return np.asarray(self._cube[first:last], dtype=np.float32)
        except RuntimeError as error:  # of the HDF5 library
            raise LogError(f"{damaged(self.path, error)} (lines {first} to {last})") from None

    def radiance(
        self, first: int, last: int
    ) -> tuple[Float[np.ndarray, "line pixel band"], Bool[np.ndarray, "line pixel band"]]:
        """Spectral radiance in the water before the port [W/(m2 sr nm)] of lines, and where it is to be trusted.

        Not where a count is saturated or no number.

        Raises:
            LogError: The file has counts and no frames to make radiances of them.
        """
        found = self.read(first, last)
        trusted = np.isfinite(found) & (found < self.saturation)
        if self.counts:
            dark, response = self.frames
            found = (found - dark) / (response * self.exposure[first:last, None, None].astype(np.float32))
        return np.where(trusted, found, np.nan).astype(np.float32), trusted

    @cached_property
    def frames(self) -> tuple[Float[np.ndarray, "pixel band"], Float[np.ndarray, "pixel band"]]:
        """Counts of the dark, and counts a second for a radiance of 1.

        Raises:
            LogError: There are none.
        """
        dark, response = (self._found(name) for name in (DARK, RESPONSE))
        if dark is None or response is None:
            raise LogError(
                f"{self.path}: holds counts, but no {DARK if dark is None else RESPONSE}: radiances need both frames"
            )
        for name, frame in ((DARK, dark), (RESPONSE, response)):
            if frame.shape != self.shape[1:]:
                raise LogError(f"{self.path}: {name} has the shape {frame.shape}, the lines {self.shape[1:]}")
        return np.asarray(dark[:], np.float32), np.asarray(response[:], np.float32)

    @property
    def described(self) -> bool:
        """Whether the file describes its imager."""
        return self._found(f"{OWN}/imager") is not None

    @property
    def simulated(self) -> bool:
        """Whether a simulation made the lines, and left the truth with them."""
        return self._found(f"{OWN}/truth/t") is not None

    def navigation(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """The vehicle's own, in the file: times on the run's clock [s], ECEF [m], roll, pitch, yaw [rad]; or None."""
        if self._found(f"{NAVIGATION}/timestamp") is None:
            return None
        t, place, euler = (
            np.asarray(self._required(f"{NAVIGATION}/{name}", n)[:], float)
            for name, n in (("timestamp", 1), ("position_ecef", 2), ("euler_angles", 2))
        )
        return t - self._start, place, np.radians(euler)

    def close(self) -> None:
        """No more reading."""
        if self._file.isopen():
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _found(self, name: str) -> Any:
        try:
            return self._file[name]
        except (IndexError, KeyError):
            return None

    def _required(self, name: str, dimensions: int) -> Any:
        found = self._found(name)
        if found is None or not hasattr(found, "shape"):
            raise LogError(f"{self.path}: no {name}; expected a file of lines in the layout of gref4hsi")
        if len(found.shape) != dimensions or 0 in found.shape:
            raise LogError(f"{self.path}: {name} has the shape {tuple(found.shape)}, expected {dimensions} dimensions")
        return found

    def _vector(self, name: str, count: int, of: str) -> Float[np.ndarray, " n"]:
        values = np.asarray(self._required(name, 1)[:], float)
        if len(values) != count:
            raise LogError(f"{self.path}: {name} has {len(values)} values for {count} {of}")
        if not np.isfinite(values).all():
            raise LogError(f"{self.path}: {name}: number {int(np.argmin(np.isfinite(values)))} is no number")
        return values

    def _spread(self, name: str, count: int) -> Float[np.ndarray, " n"]:
        """One value for all, or one for each."""
        values = np.asarray(self._required(name, 1)[:], float)
        if len(values) not in (1, count):
            raise LogError(f"{self.path}: {name} has {len(values)} values for {count} lines")
        if not (values > 0).all():
            raise LogError(f"{self.path}: {name}: expected times above 0 [ms]")
        return np.broadcast_to(values, (count,))

    def text(self, name: str) -> str | None:
        """A text of the group `rovtwin`, such as the imager's file; None where there is none."""
        found = self._found(f"{OWN}/{name}")
        return None if found is None else str(found[...])

    def stated(self, name: str) -> Float[np.ndarray, "..."] | None:
        """Numbers of the group `rovtwin`, such as the place of the mount; None where there are none."""
        found = self._found(f"{OWN}/{name}")
        return None if found is None else np.asarray(found[...], float)


class LinesFile(LinesHead):
    """A file of lines with its imager, open for reading; a context manager.

    Attributes:
        imager: That took them.
        mount: Where the imager sits on the vehicle, as stated; None where the file does not say.

    Raises:
        LogError: See `LinesHead`; or the file does not describe its imager, or that one has other pixels.
        ConfigError: The imager's description in it cannot be used.
    """

    def __init__(self, path: str | Path, imager: "Imager | None" = None) -> None:
        super().__init__(path)
        try:
            self.imager = imager or self._own_imager()
            if self.imager.pixels != self.shape[1]:
                raise LogError(
                    f"{self.path}: {CUBE} has {self.shape[1]} pixels a line, {self.imager.file.name} "
                    f"{self.imager.pixels}"
                )
            mounted = self._found(f"{OWN}/mount_position") is not None
            self.mount = self._mount("mount") if mounted else None
        except BaseException:
            self._file.close()
            raise

    @cached_property
    def truth(self) -> Truth | None:
        """What the simulation that made the lines knows; None for those of an instrument."""
        if self._found(f"{OWN}/truth/t") is None:
            return None
        t, position, attitude, floor = (
            np.asarray(self._file[f"{OWN}/truth/{name}"][:]) for name in ("t", "position", "attitude", "floor")
        )
        return Truth(t, position, attitude, self._mount("truth/mount"), self.text("truth/scene") or "", floor)

    def _own_imager(self) -> "Imager":
        from rovtwin.imaging.imager import Imager

        text = self.text("imager")
        if text is None:
            raise LogError(
                f"{self.path}: says nothing of the imager's lens and port. Describe it in a file such as "
                "`rovtwin scan --imager uhi` uses, and give that one"
            )
        return Imager(imager_from_text(text, f"{self.path.name}: {OWN}/imager"))

    def _mount(self, name: str) -> "Mount":
        from rovtwin.imaging.imager import Mount

        position, rotation = (np.asarray(self._file[f"{OWN}/{name}_{part}"][:]) for part in ("position", "rotation"))
        return Mount(position, rotation, self.text(f"{name}_name") or "")


def check_stamps(t: Float[np.ndarray, " line"], where: str) -> None:
    """Raise LogError where stamps do not grow."""
    if (wrong := np.flatnonzero(np.diff(t) <= 0)).size:
        k = int(wrong[0])
        raise LogError(
            f"{where}: the stamp of line {k + 1} is {t[k] - t[k + 1]:.4g} s before that of line {k}, expected stamps "
            "that grow. Was the clock set during the dive? Cut the file there"
        )


def _opened(path: Path) -> Any:
    import netCDF4  # on use: a heavy library

    try:
        with checked(path, np.inf).open("rb") as stream:
            if stream.read(len(_HDF)) != _HDF:
                raise LogError(f"{path}: is no HDF5 file, expected one of an imager's lines")
        file = netCDF4.Dataset(path, "r")
        file.set_auto_maskandscale(False)
        return file
    except OSError as error:
        if "HDF" in str(error):  # of its library, which numbers its errors below 0
            raise LogError(damaged(path, error)) from None
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from None
    except RuntimeError as error:
        raise LogError(damaged(path, error)) from None


def damaged(path: Path, error: Exception) -> str:
    """What to say of a file that the HDF5 library cannot read."""
    why = getattr(error, "strerror", None) or error
    return (
        f"{path}: is damaged or cut short, {path.stat().st_size:,} bytes ({why}). Compare its size with that of "
        "the original and copy it again; if the recording itself broke off, h5clear of the HDF5 tools may mend it; "
        "lines of a simulation: rovtwin scan again"
    )
