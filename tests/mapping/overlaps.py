"""Features that two lines truly saw: from true poses, true mount and true floor, to the hundredth of a pixel."""

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from rovtwin.mapping.alignment.ground_points import ground_points
from rovtwin.mapping.alignment.ties import ControlPoints, Ties
from rovtwin.mapping.georeference import Georeference


class Strip:
    """One line of a survey: which pixel of which moment sees a place."""

    def __init__(self, truth: Georeference, begin: float, end: float, every: float = 0.25):
        self.truth, self.begin, self.end = truth, begin, end
        pixels = np.linspace(0, truth.imager.pixels - 1, 25)
        t, pixel = (x.ravel() for x in np.meshgrid(np.arange(begin, end, every), pixels, indexing="ij"))
        seen = ground_points(truth, t, pixel)
        at = seen.point[seen.valid, :2]
        self.find = LinearNDInterpolator(at, np.column_stack([t, pixel])[seen.valid])

    def sees(self, place):
        """Times and pixels, no number where it does not see the place."""
        found = self.find(place)
        inside = np.isfinite(found).all(axis=1)
        for _ in range(3):
            t, pixel = np.nan_to_num(found[:, 0], nan=0.5 * (self.begin + self.end)), np.nan_to_num(found[:, 1])
            moved = [ground_points(self.truth, t + a, pixel + b).point[:, :2] for a, b in ((0, 0), (0.05, 0), (0, 2.0))]
            J = np.stack([(moved[1] - moved[0]) / 0.05, (moved[2] - moved[0]) / 2.0], axis=-1)
            J[~inside] = np.eye(2)
            step = np.linalg.solve(J, (place - moved[0])[..., None])[..., 0]
            found = np.where(inside[:, None], np.column_stack([t, pixel]) + step, np.nan)
        inside &= (found[:, 1] >= 0) & (found[:, 1] <= self.truth.imager.pixels - 1)
        inside &= (found[:, 0] >= self.begin) & (found[:, 0] <= self.end)
        return np.where(inside[:, None], found, np.nan)


def ideal_ties(strips, rng, every=1.0, std=0.01):
    """A tie a metre along each overlap of neighbouring strips, each with noise of `std` [m] between the two."""
    rows = []
    for a, b in zip(strips[:-1], strips[1:], strict=True):
        ends = np.concatenate([s.find.points for s in (a, b)])
        north = np.arange(ends[:, 0].min() + 0.5, ends[:, 0].max() - 0.5, every)
        middle = 0.5 * (a.find.points[:, 1].mean() + b.find.points[:, 1].mean())
        place = np.column_stack([north, middle + rng.uniform(-0.15, 0.15, len(north))])
        one, other = a.sees(place), b.sees(place + std * rng.normal(size=place.shape))
        good = np.isfinite(one).all(1) & np.isfinite(other).all(1)
        rows.append(np.stack([one[good], other[good]], axis=1))
    both = np.concatenate(rows)
    n = len(both)
    return Ties(both[..., 0], both[..., 1], np.tile(std**2 * np.eye(2), (n, 1, 1)), np.ones(n))


def with_false(ties, share, rng, size=0.3):
    """Some matched to another feature, as far as `size` [m] along the line and a tenth of the swath across."""
    t, pixel = ties.t.copy(), ties.pixel.copy()
    bad = rng.choice(len(t), round(share * len(t)), replace=False)
    t[bad, 1] += rng.choice([-1, 1], len(bad)) * rng.uniform(0.5, size / 0.2, len(bad))
    pixel[bad, 1] += rng.choice([-1, 1], len(bad)) * rng.uniform(20, 90, len(bad))
    return Ties(t, pixel, ties.covariance, ties.quality), bad


def known_points(strips, places, rng, std=0.005):
    """Places seen by the first strip that sees each, picked with noise of `std` [m]."""
    t, pixel, kept = [], [], []
    for place in places:
        for strip in strips:
            found = strip.sees(np.asarray(place)[None] + std * rng.normal(size=(1, 2)))[0]
            if np.isfinite(found).all():
                t.append(found[0]), pixel.append(found[1]), kept.append(place)
                break
    return ControlPoints(np.array(t), np.array(pixel), np.array(kept), np.full(len(t), std))
