"""How far each place of a mosaic will be off, from the plan alone: sigma before the dive.

A place g is seen from a key frame of the way (`gnc.navigation.path_accuracy`), on a flat floor:

    dg = dp + R (S rho + d) c + r_h / r_z dh

with p the place of CO, c the constants that no reading tells (compass, Doppler log, boresight, clock), r the ray and h
the floor's depth. So every place of the mosaic is a row over one joint covariance; sigma within the mosaic is that of
the row less the mean of all. A feature found in two lines measures the difference of two rows; all of them together are
one linear update, as registration does it later.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.gnc.navigation.path_accuracy import CONSTANTS, KeyFrames
from rovtwin.imaging.footprint import Footprint
from rovtwin.planning.survey_assumptions import Assumptions
from rovtwin.survey.timeline import Timeline

# Constants of a map, the first of them navigation's.
OWN = (*CONSTANTS, "roll", "pitch", "yaw", "x", "y", "z", "clock")
MOST_FRAMES, EVERY = 500, 0.5  # key frames, and the way between them [m]
MOST_TIES, TIE_EVERY = 500, 0.5  # features, and the way between them [m]
VIEWS = 4  # lines at most that a place is seen from
CELLS = 60  # along the longer side of the map of sigma


@dataclass(frozen=True, eq=False)
class SigmaMap:
    """Standard deviations over the area, 2D: root of the sum of the variances north and east [m]; NaN where unseen.

    Attributes:
        north, east: Of the cells' middles [m].
        absolute: Of the place on Earth.
        within: Within the mosaic: less what is common to all of it.
        registered: Within the mosaic after its overlaps have been registered; None without overlaps.
        causes: What each cause makes of (absolute, within), rms over the map, alone [m].
        frames: Places of the key frames [m].
        ties: How many features.
    """

    north: Float[np.ndarray, " rows"]
    east: Float[np.ndarray, " columns"]
    absolute: Float[np.ndarray, "rows columns"]
    within: Float[np.ndarray, "rows columns"]
    registered: Float[np.ndarray, "rows columns"] | None
    causes: dict[str, tuple[float, float]]
    frames: Float[np.ndarray, "k 2"]
    ties: int

    def rms(self) -> dict[str, float | None]:
        """Over the map [m]."""
        found = {"absolute": self.absolute, "within": self.within, "registered": self.registered}
        return {name: None if grid is None else _rms(grid) for name, grid in found.items()}


def key_frames(line: Timeline) -> Int[np.ndarray, " k"]:
    """Instants on lines and laps from which the mosaic's places are seen."""
    on = np.flatnonzero(line.line >= 0)
    way = line.step * float(np.max(line.speed))
    stride = max(1, round(EVERY / way), -(-len(on) // MOST_FRAMES))
    return on[::stride]


def sigma_map(
    known: KeyFrames,
    line: Timeline,
    key: Int[np.ndarray, " k"],
    seen: Footprint,
    assumed: Assumptions,
    inside: Bool[np.ndarray, "rows columns"],
    north: Float[np.ndarray, " rows"],
    east: Float[np.ndarray, " columns"],
) -> SigmaMap:
    """The map.

    Args:
        known: Of the key frames, from `path_accuracy`.
        line: The way.
        key: Key frames in it.
        seen: What the imager sees.
        assumed: What no reading tells.
        inside: Whether cells belong to the area, shape (rows, columns).
        north: Of the cells' middles [m].
        east: The same.
    """
    places = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1)[inside]
    rows = _Rows(known, line, key, seen, assumed)
    views = rows.views(places)
    best = views[:, 0]
    cells = np.flatnonzero(best >= 0)
    mosaic = rows.of(best[cells], places[cells])
    variance = mosaic.floor_variance(assumed.floor)
    pairs = _ties(views, places)
    after = None
    if len(pairs):
        update = rows.updated(pairs, places, assumed)
        after = _grid(inside, cells, np.sqrt(mosaic.within(update) + variance))
    prior = rows.prior
    return SigmaMap(
        north,
        east,
        _grid(inside, cells, np.sqrt(mosaic.absolute(prior) + variance)),
        _grid(inside, cells, np.sqrt(mosaic.within(prior) + variance)),
        after,
        rows.causes(mosaic, variance),
        line.place[key],
        len(pairs),
    )


class _Rows:
    """Places of the floor as linear functions of z: errors of the key frames' places and constants."""

    def __init__(
        self, known: KeyFrames, line: Timeline, key: Int[np.ndarray, " k"], seen: Footprint, assumed: Assumptions
    ) -> None:
        self._place, self._heading, self._line = line.place[key], line.heading[key], line.line[key]
        self._seen, self._speed = seen, float(np.max(line.speed))
        self._response = known.response.reshape(-1, 2, len(CONSTANTS))
        bore = np.radians(assumed.boresight)
        self.std = np.array(
            [np.radians(assumed.heading), np.radians(assumed.dvl_yaw), assumed.dvl_scale, *[bore] * 3,
             *[assumed.lever] * 3, assumed.clock]
        )  # fmt: skip
        count = len(known.covariance)
        self.prior = np.zeros((count + len(OWN), count + len(OWN)))
        self.prior[:count, :count] = known.covariance
        self.prior[count:, count:] = np.diag(self.std**2)

    def views(self, places: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "n views"]:
        """Key frames that see each place, one of each line, the nearest first; -1 for none."""
        found, nearest = np.full((len(places), VIEWS), -1), np.full((len(places), VIEWS), np.inf)
        reach = 0.75 * max(EVERY, float(np.median(np.linalg.norm(np.diff(self._place, axis=0), axis=1))))
        for number in np.unique(self._line):
            of = np.flatnonzero(self._line == number)
            away = places[:, None] - self._place[of]
            along, across = self._split(away, self._heading[of])
            frame = np.argmin(np.abs(along), axis=1)
            row = np.arange(len(places))
            seen = (np.abs(along[row, frame]) <= reach) & (np.abs(across[row, frame]) <= 0.5 * self._seen.width)
            off = np.where(seen, np.abs(across[row, frame]), np.inf)
            found = np.concatenate([found, np.where(seen, of[frame], -1)[:, None]], axis=1)
            nearest = np.concatenate([nearest, off[:, None]], axis=1)
            order = np.argsort(nearest, axis=1, kind="stable")[:, :VIEWS]
            found, nearest = (np.take_along_axis(table, order, axis=1) for table in (found, nearest))
        return found

    @staticmethod
    def _split(away: Float[np.ndarray, "... 2"], heading: Float[np.ndarray, "..."]) -> tuple[np.ndarray, np.ndarray]:
        """Along and across a heading; both broadcast."""
        c, s = np.cos(heading), np.sin(heading)
        return away[..., 0] * c + away[..., 1] * s, -away[..., 0] * s + away[..., 1] * c

    def of(self, frame: Int[np.ndarray, " n"], places: Float[np.ndarray, "n 2"]) -> "_Mosaic":
        """Rows of places seen from key frames. The way is that of the swath's middle."""
        across = self._split((places - self._place[frame])[:, None], self._heading[frame][:, None])[1][:, 0]
        ahead, right = self._seen.middle[0], self._seen.middle[1] + across
        c, s = np.cos(self._heading[frame]), np.sin(self._heading[frame])
        R = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
        x, y = self._seen.place
        ray = np.stack([np.full_like(across, ahead - x), right - y, np.full_like(across, self._seen.height)], axis=-1)
        own = np.zeros((len(frame), 2, len(OWN)))
        own[:, 0, OWN.index("heading")], own[:, 1, OWN.index("heading")] = -right, ahead
        for axis, name in enumerate(("roll", "pitch", "yaw")):
            turned = np.cross(np.eye(3)[axis], ray)
            own[:, :, OWN.index(name)] = turned[:, :2] - ray[:, :2] / ray[:, 2:] * turned[:, 2:]
        for axis, name in enumerate(("x", "y", "z")):
            moved = np.eye(3)[axis]
            own[:, :, OWN.index(name)] = moved[:2] - ray[:, :2] / ray[:, 2:] * moved[2]
        own[:, 0, OWN.index("clock")] = self._speed
        own = R @ own
        own[:, :, : len(CONSTANTS)] += self._response[frame]
        slant = (R @ (ray[:, :2] / ray[:, 2:])[..., None])[..., 0]
        return _Mosaic(frame, own, slant, 2 * len(self._place))

    def updated(
        self, pairs: Int[np.ndarray, "t 3"], places: Float[np.ndarray, "n 2"], assumed: Assumptions
    ) -> Float[np.ndarray, "z z"]:
        """Covariance of z once features of two lines have been found: rows are (place, frame, other frame)."""
        one, other = (self.of(pairs[:, i], places[pairs[:, 0]]) for i in (1, 2))
        H = (one.dense() - other.dense()).reshape(-1, len(self.prior))
        parallax = (one.slant - other.slant) * assumed.floor
        noise = 2.0 * assumed.tie**2 + (parallax**2).reshape(-1)
        S = H @ self.prior @ H.T + np.diag(noise)
        gain = np.linalg.solve(S, H @ self.prior)
        after = self.prior - self.prior @ H.T @ gain
        return 0.5 * (after + after.T)

    def causes(self, mosaic: "_Mosaic", floor: Float[np.ndarray, " n"]) -> dict[str, tuple[float, float]]:
        """What each cause makes alone, rms [m]."""
        count = len(self.prior) - len(OWN)
        groups = {"heading": ("heading",), "dvl": ("dvl_yaw", "dvl_scale"), "boresight": ("roll", "pitch", "yaw"),
                  "lever": ("x", "y", "z"), "clock": ("clock",)}  # fmt: skip
        found = {}
        for name, members in (("readings", ()), *groups.items()):
            alone = np.zeros_like(self.prior)
            if name == "readings":
                alone[:count, :count] = self.prior[:count, :count]
            for member in members:
                i = OWN.index(member)
                alone[count + i, count + i] = self.std[i] ** 2
            found[name] = (
                float(np.sqrt(np.mean(mosaic.absolute(alone)))), float(np.sqrt(np.mean(mosaic.within(alone))))
            )  # fmt: skip
        found["floor"] = (float(np.sqrt(np.mean(floor))),) * 2
        return found


@dataclass(frozen=True)
class _Mosaic:
    """Rows of places: each has 1 at its key frame, and `own` at the constants."""

    frame: Int[np.ndarray, " n"]
    own: Float[np.ndarray, "n 2 c"]
    slant: Float[np.ndarray, "n 2"]  # d(place) / d(depth of the floor)
    count: int

    def floor_variance(self, std: float) -> Float[np.ndarray, " n"]:
        """What the floor's height makes of the variance, north and east together [m2]."""
        return np.sum(self.slant**2, axis=1) * std**2

    def dense(self) -> Float[np.ndarray, "n 2 z"]:
        """The rows in full."""
        rows = np.zeros((len(self.frame), 2, self.count + len(OWN)))
        for axis in range(2):
            rows[np.arange(len(self.frame)), axis, 2 * self.frame + axis] = 1.0
        rows[:, :, self.count :] = self.own
        return rows

    def _mean(self) -> Float[np.ndarray, "2 z"]:
        mean = np.zeros((2, self.count + len(OWN)))
        for axis in range(2):
            np.add.at(mean[axis], 2 * self.frame + axis, 1.0 / len(self.frame))
        mean[:, self.count :] = self.own.mean(axis=0)
        return mean

    def _times(self, axis: int, matrix: Float[np.ndarray, "z m"]) -> Float[np.ndarray, "n m"]:
        """One row of each place times a matrix."""
        return matrix[2 * self.frame + axis] + self.own[:, axis] @ matrix[self.count :]

    def absolute(self, Z: Float[np.ndarray, "z z"]) -> Float[np.ndarray, " n"]:
        """Variance, north and east together [m2]."""
        total = np.zeros(len(self.frame))
        for axis in range(2):
            row = self._times(axis, Z)
            total += row[np.arange(len(row)), 2 * self.frame + axis]
            total += np.sum(row[:, self.count :] * self.own[:, axis], axis=1)
        return total

    def within(self, Z: Float[np.ndarray, "z z"]) -> Float[np.ndarray, " n"]:
        """The same less the mean of all places."""
        mean = self._mean()
        common = Z @ mean.T
        total = self.absolute(Z) + np.trace(mean @ common)
        for axis in range(2):
            total -= 2.0 * self._times(axis, common[:, axis : axis + 1])[:, 0]
        return np.maximum(total, 0.0)


def _ties(views: Int[np.ndarray, "n views"], places: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "t 3"]:
    """Places that several lines see, about `TIE_EVERY` apart: rows are (place, key frame, that of another line)."""
    several, every = np.flatnonzero(views[:, 1] >= 0), TIE_EVERY
    while len(several):
        squares = np.round(places[several] / every).astype(int)
        chosen = several[np.unique(squares, axis=0, return_index=True)[1]]
        place, other = np.nonzero(views[chosen, 1:] >= 0)
        if len(place) <= MOST_TIES:
            return np.stack([chosen[place], views[chosen[place], 0], views[chosen[place], other + 1]], axis=1)
        every *= 1.3
    return np.zeros((0, 3), int)


def _grid(
    inside: Bool[np.ndarray, "rows columns"], cells: Int[np.ndarray, " n"], values: Float[np.ndarray, " n"]
) -> np.ndarray:
    flat = np.full(int(inside.sum()), np.nan)
    flat[cells] = values
    grid = np.full(inside.shape, np.nan)
    grid[inside] = flat
    return grid


def _rms(grid: Float[np.ndarray, "rows columns"]) -> float:
    return float(np.sqrt(np.nanmean(grid**2)))
