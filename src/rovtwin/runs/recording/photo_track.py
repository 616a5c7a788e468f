"""Poses of a run that pictures are placed by."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation, Slerp

from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Log

SOURCES = {"estimate": "autopilot", "smoothed": "smoothed", "truth": "truth"}
LONGEST_GAP = 0.5  # between poses of a track that pictures may be placed in [s]


@dataclass(frozen=True, eq=False)
class Track:
    """Poses that tags are made of.

    Attributes:
        t: [s].
        position: Of CO in n [m].
        euler: Roll, pitch, yaw [rad].
        std: Of north, east, down [m] and roll, pitch, yaw [rad]; None where nothing is known.
    """

    t: Float[np.ndarray, " k"]
    position: Float[np.ndarray, "k 3"]
    euler: Float[np.ndarray, "k 3"]
    std: Float[np.ndarray, "k 6"] | None

    def at(
        self, t: Float[np.ndarray, " n"], spread: float | Float[np.ndarray, " n"] = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Positions (n, 3), attitudes R_nb (n, 3, 3), and standard deviations (n, 6) or None, between its poses.

        Args:
            t: When [s].
            spread: Standard deviation of the times [s]: it counts in those of the place, as fast as the vehicle goes.
        """
        position = np.stack([np.interp(t, self.t, column) for column in self.position.T], axis=-1)
        R = Slerp(self.t, Rotation.from_euler("ZYX", self.euler[:, ::-1]))(t).as_matrix()
        std = None if self.std is None else np.stack([np.interp(t, self.t, c) for c in self.std.T], axis=-1)
        if std is not None:
            ends = [np.clip(t + half, self.t[0], self.t[-1]) for half in (-0.5, 0.5)]
            before, after = (np.stack([np.interp(x, self.t, c) for c in self.position.T], axis=-1) for x in ends)
            speed = (after - before) / (ends[1] - ends[0])[:, None]
            std[:, :3] = np.hypot(std[:, :3], speed * np.broadcast_to(spread, t.shape)[:, None])
        return position, R, std

    def covers(self, t: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Whether times lie between poses that are near enough to each other."""
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        near = self.t[after] - self.t[after - 1] <= LONGEST_GAP
        return near & (t >= self.t[0]) & (t <= self.t[-1])


def track_of(log: Log, folder: Path, source: str) -> Track:
    """Of a log, or of `smoothed.mcap` beside it.

    Args:
        log: Of the run.
        folder: That it lies in.
        source: Of `SOURCES`.

    Raises:
        ConfigError: The run is not smoothed.
        LogError: The log lacks the poses.
    """
    if source == "smoothed":
        path = folder / "smoothed.mcap"
        if not path.is_file():
            raise ConfigError(f"{path}: not there; make it first: rovtwin smooth {folder}")
        log = Log.read(path)
    name = f"{SOURCES[source]}/eta"
    if name not in log or len(log[name].t) < 2:
        raise LogError(f"{folder}: the log has no {name}, which --navigation {source} asks for")
    series, std = log[name], None
    if (deviations := f"{SOURCES[source]}/std") in log:
        std = np.stack([np.interp(series.t, log[deviations].t, c) for c in log[deviations].values[:, :6].T], axis=-1)
    return Track(series.t, series.values[:, :3], series.values[:, 3:6], std)
