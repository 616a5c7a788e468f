"""Recorded video as a stream of timed images: pictures in MCAP, a film (MP4 ..), or a folder of pictures.

Times, by the clock of the log: MCAP has them. Of others they are in a table `<video>.csv` (for a folder, `times.csv` in
it) with one row for each frame, column `t` [s], for a folder also `file`; without it, a film starts at `start` and runs
at its own rate, and pictures are named by their time in seconds, such as 12.345.png.
"""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.log.pictures import read_pictures
from rovtwin.core.user_files.files import read_text
from rovtwin.core.vision import opencv

FILMS = (".mp4", ".avi", ".mov", ".mkv", ".m4v")
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


@dataclass
class Video:
    """One camera's recording; iterate over it for (time [s], grey image).

    Attributes:
        path: A film, or a folder of pictures.
        size: Width and height that the camera's calibration is for [px], or None to take any.
        start: Time of the first frame where no table says it [s].
        notes: What was left out while reading, one line each; filled by going through it.
    """

    path: Path
    size: tuple[int, int] | None = None
    start: float = 0.0
    notes: list[str] = field(default_factory=list)

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        """Frames in order of time.

        Raises:
            ConfigError: It cannot be read, has no times, or has another size than the camera.
        """
        self.notes.clear()
        last, late, first_late = -math.inf, 0, ""
        for t, image in self._frames():
            self._check_size(image)
            if t > last:
                last = t
                yield t, image
            else:
                late, first_late = late + 1, first_late or f"{t:g} s after {last:g} s"
        if late:
            self.notes.append(f"{self.path}: {late} frames out of order left out, the first at {first_late}")

    def _frames(self) -> Iterator[tuple[float, np.ndarray]]:
        if self.path.is_dir():
            return self._pictures()
        if not self.path.is_file():
            raise ConfigError(
                f"{self.path}: no such video; expected MCAP, a film ({', '.join(FILMS)}) or a folder of pictures"
            )
        return self._messages() if self.path.suffix == ".mcap" else self._film()

    def _messages(self) -> Iterator[tuple[float, np.ndarray]]:
        cv2, lost, count = opencv(), [], 0
        for t, data in read_pictures(self.path, damaged=lost.append):
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
            if image is None:
                lost.append("not a picture")
            else:
                count += 1
                yield t, image
        if not count:
            text = f", the first: {lost[0]}" if lost else ""
            raise ConfigError(f"{self.path}: found no picture in it that can be read{text}")
        if lost:
            self.notes.append(f"{self.path}: {len(lost)} parts cannot be read and are left out, the first: {lost[0]}")

    def _film(self) -> Iterator[tuple[float, np.ndarray]]:
        cv2 = opencv()
        reader = cv2.VideoCapture(str(self.path))
        rate, promised = reader.get(cv2.CAP_PROP_FPS), int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
        if not reader.isOpened() or not rate > 0:
            raise ConfigError(
                f"{self.path}: cannot be read as video; the file is damaged, cut, or of a kind that OpenCV does not "
                f"know. Try `ffmpeg -i {self.path.name} -c:v libx264 mended.mp4`"
            )
        table = self.path.with_suffix(".csv")
        times, k, untimed = self._table(table), 0, False
        try:
            while True:
                found, image = reader.read()
                untimed = found and times is not None and k >= len(times)
                if not found or untimed:
                    break
                t = self.start + k / rate if times is None else times[k][1]
                k += 1
                yield t, cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        finally:
            reader.release()
        if times == []:
            raise ConfigError(f"{table}: found no times in it; expected one row for each frame of {self.path.name}")
        if not k:
            raise ConfigError(f"{self.path}: found no frame in it; the file is damaged or cut")
        expected = max(promised, len(times or ()))
        if untimed:
            self.notes.append(f"{table}: has times of {k} of {expected} frames; the frames after them are left out")
        elif k < expected:
            self.notes.append(f"{self.path}: ends after {k} of {expected} frames; the rest is damaged or cut")

    def _pictures(self) -> Iterator[tuple[float, np.ndarray]]:
        cv2 = opencv()
        table = self._table(self.path / "times.csv")
        if table is None:
            table = [(p.name, self._named(p)) for p in self.path.iterdir() if p.suffix.lower() in PICTURES]
            table.sort(key=lambda row: row[1])
        if not table:
            raise ConfigError(f"{self.path}: found no pictures in it, expected {', '.join(PICTURES)}")
        lost = []
        for name, t in table:
            data = np.fromfile(self.path / name, np.uint8) if (self.path / name).is_file() else np.zeros(0, np.uint8)
            image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
            if image is None:
                lost.append(name)
            else:
                yield t, image
        if lost:
            self.notes.append(f"{self.path}: {len(lost)} of {len(table)} pictures cannot be read, the first {lost[0]}")
        if len(lost) == len(table):
            raise ConfigError(f"{self.path}: none of its {len(table)} pictures can be read")

    def _named(self, path: Path) -> float:
        try:
            return float(path.stem)
        except ValueError:
            raise ConfigError(
                f"{path}: found no time; name pictures by their time in seconds, such as 12.345.png, or write "
                f"{self.path / 'times.csv'} with the columns file,t"
            ) from None

    def _table(self, path: Path) -> list[tuple[str, float]] | None:
        """File and time of each frame, or None where there is no such table."""
        if not path.is_file():
            return None
        try:
            rows = list(csv.DictReader(read_text(path).splitlines()))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise ConfigError(f"{path}: is no table of file and time ({error})") from None
        columns = ("file", "t") if self.path.is_dir() else ("t",)
        out = []
        for number, row in enumerate(rows, start=2):
            try:
                values = [row[key] for key in columns]
                out.append((values[0], float(values[-1])))
            except (KeyError, TypeError, ValueError):
                raise ConfigError(
                    f"{path}: line {number}: found {', '.join(f'{k}={v}' for k, v in row.items())}; expected the "
                    f"columns {', '.join(columns)}, t in seconds by the clock of the log"
                ) from None
        return out

    def _check_size(self, image: np.ndarray) -> None:
        height, width = image.shape
        if self.size is not None and (width, height) != tuple(self.size):
            raise ConfigError(
                f"{self.path}: found frames of {width} x {height} pixels, but the camera is calibrated for "
                f"{self.size[0]} x {self.size[1]}. Calibrate in the mode that was recorded (rovtwin calibrate), or "
                "give that camera's file (--lens)"
            )
