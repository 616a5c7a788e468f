"""A flight predicted: bands of path and effort over drawn vehicles, written down before anything moves."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.commission.proving.bands import AXES, UNITS, Corridor, Track, band_of, track_of_flown
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import cannot, write_text
from rovtwin.planning.tank import Tank
from rovtwin.report.parts.page import save
from rovtwin.report.studies.prediction import prediction_figure
from rovtwin.runs.compose.composition import Simulation
from rovtwin.runs.ensemble.efforts import Foreseen, effort_of_flown, foreseen
from rovtwin.runs.ensemble.flights import fly_all
from rovtwin.runs.scoring.scores import Flown, finished

BANDS, EFFORTS, FIGURE = "prediction.csv", "prediction_effort.csv", "prediction"
LABELS = tuple(zip(AXES, UNITS, strict=True))


@dataclass(frozen=True)
class Prediction:
    """What drawn vehicles do.

    Attributes:
        band: Of their estimated paths.
        efforts: Along the axes that they agree about.
        room: Least distance of the hull, turned any way, from the tank's walls [m].
        lasting: From arming to the end [s].
    """

    band: Corridor
    efforts: list[Foreseen]
    room: float
    lasting: float

    @property
    def half_widths(self) -> dict[str, float]:
        """Half of the band's width by axis, median over time [m, m, m, deg]."""
        widths = 0.5 * np.median(self.band.high - self.band.low, axis=0)
        return dict(zip(AXES, (float(one) for one in widths), strict=True))

    def write(self, folder: Path) -> list[str]:
        """Both tables and the figure; names of the files, the tables first."""
        try:
            write_text(folder / BANDS, _bands(self.band))
            write_text(folder / EFFORTS, _efforts(self.efforts))
        except OSError as error:
            raise ConfigError(f"{folder}: the prediction cannot be written ({cannot(error)})") from None
        self.draw(folder)
        return [BANDS, EFFORTS, f"figures/{FIGURE}.png", f"figures/{FIGURE}.svg"]

    def draw(self, folder: Path, track: Track | None = None, captions: Sequence[str] = ("",) * len(AXES)) -> None:
        """The figure, with the flight if there is one."""
        band, flown = self.band, None
        if track is not None:
            pose = track.pose.copy()
            pose[:, 3] += 360.0 * np.round((band.middle[0, 3] - pose[0, 3]) / 360.0)
            flown = track.t, pose
        made = prediction_figure(band.t, band.low, band.high, band.middle, flown, LABELS, captions)
        save(made, folder, FIGURE)


def predicted(
    runs: Sequence[Simulation], tank: Tank, progress: Callable[[float], None]
) -> tuple[Prediction | None, list[str]]:
    """Fly drawn vehicles; None, and why, where one of them does not complete the mission."""
    flown = fly_all(runs, progress)
    tracks = [track_of_flown(one) for one in flown]
    came = [track for track, one in zip(tracks, flown, strict=True) if track is not None and finished(one)]
    if len(came) < len(runs):
        return None, [f"{len(runs) - len(came)} of {len(runs)} drawn vehicles do not complete it, expected none."]
    band = band_of(came)
    lasting = float(band.t[-1])
    efforts = [effort_of_flown(one, track.began, lasting) for one, track in zip(flown, came, strict=True)]
    around = float(np.hypot(*np.asarray(runs[0].model.hull.corners)[:, :2].T).max())
    room = min(_room(one, tank, around) for one in flown)
    return Prediction(band, foreseen(efforts), room, max(track.began for track in came) + lasting), []


def _room(flown: Flown, tank: Tank, around: float) -> float:
    """Least distance of a circle about the hull, of radius `around`, from the walls on the true path [m]."""
    away = np.abs(flown.eta[:, :2] - np.array(tank.middle[:2]))
    return float((0.5 * np.array(tank.sizes[:2]) - away).min() - around)


def _bands(band: Corridor) -> str:
    """Lower end, upper end and median of each axis over time."""
    names = [f"{axis}_{what}_{unit}" for axis, unit in LABELS for what in ("low", "high", "median")]
    rows = [
        [f"{t:.1f}", *(f"{x:.4f}" for x in np.column_stack([band.low[i], band.high[i], band.middle[i]]).ravel())]
        for i, t in enumerate(band.t)
    ]
    return _table(["t_s", *names], rows)


def _efforts(efforts: Sequence[Foreseen]) -> str:
    """Median of each axis' effort, and its 95 % interval as ratios to that."""
    rows: list[list[Any]] = [
        [one.axis, f"{one.middle:.6g}", *(f"{ratio:.4f}" for ratio in one.ratio())] for one in efforts
    ]
    return _table(["axis", "median", "low_ratio", "high_ratio"], rows)


def _table(head: list[str], rows: list[list[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text).writerows([head, *rows])
    return text.getvalue()
