"""Where the vehicle was while its imager took lines: poses of a log or of a file of lines, and between them."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.errors import LogError
from rovtwin.core.log import Log
from rovtwin.imaging.lines import LinesFile
from rovtwin.imaging.path import LONGEST_STEP, POSES, PosePath, quaternions

_SAME = 1e-9  # stamps nearer than that are one [s]


@dataclass(frozen=True)
class Poses:
    """At some times.

    Attributes:
        position: Of CO in n [m]; no number where there is no pose.
        rotation: R_nb.
        quaternion: q_nb, scalar first.
        valid: Where there is a pose: within the navigation, and in none of its gaps.
    """

    position: Float[np.ndarray, "n 3"]
    rotation: Float[np.ndarray, "n 3 3"]
    quaternion: Float[np.ndarray, "n 4"]
    valid: Bool[np.ndarray, " n"]


@dataclass(frozen=True)
class Navigation:
    """A vehicle's poses in time.

    Attributes:
        t: On the run's clock [s], increasing.
        position: Of CO in n, motion in waves included [m].
        quaternion: q_nb, scalar first.
        covariance: Of (position n [m], attitude as a small rotation seen from b [rad]); None where nobody knows it.
        source: Whose poses these are: estimate, smoothed, truth, lines.
        dropped: Poses left out because they repeat the stamp before, or are no numbers.

    Raises:
        LogError: Fewer than two poses, or stamps that turn back.
    """

    t: Float[np.ndarray, " k"]
    position: Float[np.ndarray, "k 3"]
    quaternion: Float[np.ndarray, "k 4"]
    covariance: Float[np.ndarray, "k 6 6"] | None = None
    source: str = ""
    dropped: int = field(default=0, kw_only=True)

    def __post_init__(self) -> None:
        good = np.isfinite(self.t) & np.isfinite(self.position).all(1) & np.isfinite(self.quaternion).all(1)
        steps = np.diff(self.t[good], prepend=-np.inf)
        if (wrong := np.flatnonzero(steps < -_SAME)).size:
            at = self.t[good][wrong[0]]
            raise LogError(
                f"navigation {self.source}: the stamp {at:.3f} s comes {-steps[wrong[0]]:.4g} s before that of the "
                "pose before it, expected stamps that grow. Was the clock set during the dive? Cut the file there"
            )
        keep = np.flatnonzero(good)[steps > _SAME]
        if len(keep) < 2:
            raise LogError(f"navigation {self.source}: found {len(keep)} poses, expected at least 2")
        object.__setattr__(self, "dropped", self.dropped + len(self.t) - len(keep))
        for name in ("t", "position", "quaternion", "covariance"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, np.asarray(given, float)[keep])

    @classmethod
    def of_lines(cls, lines: LinesFile) -> "Navigation":
        """The vehicle's own, as the file of lines holds it.

        Raises:
            LogError: There is none, or no datum to place it by.
        """
        found = lines.navigation()
        if found is None:
            raise LogError(f"{lines.path}: holds no navigation (raw/nav); say where the run's log is")
        if lines.datum is None:
            raise LogError(f"{lines.path}: says nothing of a datum, the origin of north, east, down; say --datum")
        t, ecef, euler = found
        posed = np.isfinite(t) & np.isfinite(ecef).all(1) & np.isfinite(euler).all(1)
        t, ecef, euler = t[posed], ecef[posed], euler[posed]  # latitudes are checked, and those of no number refused
        place = lines.datum.position_of_ecef(ecef) if len(t) else np.zeros((0, 3))
        return cls(t, place, quaternions(euler), source="lines", dropped=int((~posed).sum()))

    @classmethod
    def of_log(cls, log: Log, source: str, where: str = "the log") -> "Navigation":
        """Of a run's log: `truth`, the vehicle's own `estimate`, or `smoothed` (of the log that `rovtwin smooth` made).

        Raises:
            LogError: The log has no such poses.
        """
        name = POSES[source]
        if name not in log:
            raise LogError(f"{where}: has no {name}, which navigation {source} asks for")
        series = log[name]
        return cls(series.t, series.values[:, :3], quaternions(series.values[:, 3:6]), source=source)

    @cached_property
    def gaps(self) -> list[tuple[float, float]]:
        """Begin and end [s] of each way between poses that is longer than `LONGEST_STEP`."""
        at = np.flatnonzero(np.diff(self.t) > LONGEST_STEP)
        return [(float(self.t[k]), float(self.t[k + 1])) for k in at]

    @cached_property
    def _stretches(self) -> list[PosePath]:
        cuts = [0, *(np.flatnonzero(np.diff(self.t) > LONGEST_STEP) + 1), len(self.t)]
        return [
            PosePath.through(self.t[a:b], self.position[a:b], self.quaternion[a:b])
            for a, b in zip(cuts[:-1], cuts[1:], strict=True)
            if b - a >= 2
        ]

    def at(self, t: Float[np.ndarray, " n"]) -> Poses:
        """Poses at times [s] by splines; none outside, in gaps, and beside a pose that stands alone in a gap."""
        n = len(t)
        position, quaternion = np.full((n, 3), np.nan), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        rotation, valid = np.tile(np.eye(3), (n, 1, 1)), np.zeros(n, bool)
        for path in self._stretches:
            within = (t >= path.t[0]) & (t <= path.t[-1])
            if within.any():
                position[within], rotation[within], quaternion[within] = path.at(t[within])
                valid |= within
        return Poses(position, rotation, quaternion, valid)

    def turn_rates(self, t: Float[np.ndarray, " n"], over: float = 0.5) -> Float[np.ndarray, " n"]:
        """How fast the course of b's x axis over ground turns at times [s], by a difference over `over` [rad/s].

        No number where there are no poses.
        """
        ends = [self.at(np.clip(t + half, self.t[0], self.t[-1])) for half in (-0.5 * over, 0.5 * over)]
        headings = [np.arctan2(end.rotation[:, 1, 0], end.rotation[:, 0, 0]) for end in ends]
        apart = np.clip(t + 0.5 * over, self.t[0], self.t[-1]) - np.clip(t - 0.5 * over, self.t[0], self.t[-1])
        turned = (headings[1] - headings[0] + np.pi) % (2.0 * np.pi) - np.pi
        return np.where(ends[0].valid & ends[1].valid, turned / np.maximum(apart, 1e-3), np.nan)
