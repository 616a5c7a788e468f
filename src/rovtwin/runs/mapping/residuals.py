"""Ties and control points of a registration, one by one: as GeoJSON, and as the report draws them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.datum import Datum
from rovtwin.mapping.alignment.registration import Registration
from rovtwin.mapping.alignment.ties import Observations
from rovtwin.mapping.formats.vectors import line, point, write_geojson

TIES = "ties.geojson"


@dataclass(frozen=True)
class Residuals:
    """What ties and control points measured, and what registration left of it.

    Attributes:
        observed: As they were measured, by the poses before.
        registration: What became of them.
        lines: Numbers of the two lines of each, between two where it lies between two; none for a control point.
        depth: Of the floor, about [m].
        counts: How many lines each file has.
        files: Their names.
    """

    observed: Observations
    registration: Registration
    lines: Float[np.ndarray, "m 2"]
    depth: float
    counts: tuple[int, ...] = ()
    files: tuple[str, ...] = ()

    @property
    def used(self) -> Bool[np.ndarray, " m"]:
        """Which counted."""
        return self.registration.used

    def properties(self, k: int) -> dict[str, Any]:
        """Of one, for people and programs."""
        what, done = self.observed, self.registration
        before, after, T = what.d[k], done.left[k], float(done.statistics[k])
        known = np.isfinite(self.lines[k])
        return {
            "name": what.names[k],
            "kind": "tie" if known.all() else "control",
            "lines": np.round(self.lines[k][known], 2).tolist(),
            **self._in_files(self.lines[k][known]),
            "pixels": np.round(what.pixel[k][known], 2).tolist(),
            "seconds": np.round(what.t[k][known], 4).tolist(),
            "before_m": round(float(np.hypot(*before)), 5),
            "before_north_east_m": np.round(before, 5).tolist(),
            "after_m": round(float(np.hypot(*after)), 5),
            "after_north_east_m": np.round(after, 5).tolist(),
            "kept": bool(done.used[k]),
            "test": round(T, 3),
            "test_limit": round(done.gate, 3),
            "why": f"test statistic {T:.1f} {'within' if done.used[k] else 'beyond'} {done.gate:.1f} "
            "(chi-square of 2, against all others)",
        }

    def _in_files(self, lines: Float[np.ndarray, " n"]) -> dict[str, Any]:
        """Where lines count through several files: which file each lies in, and its number there."""
        if len(self.files) < 2:
            return {}
        begins = np.cumsum([0, *self.counts])
        at = np.searchsorted(begins[1:-1], lines + 0.5, side="right")
        return {
            "files": [self.files[i] for i in at],
            "lines_in_files": np.round(lines - begins[at], 2).tolist(),
        }

    def features(self, datum: Datum) -> list[dict[str, Any]]:
        """Of each a point where it lies, and a line from where one line puts it to where the other does."""
        found = []
        for k, ends in enumerate(self.observed.ends):
            about = self.properties(k)
            (a, b), middle = np.column_stack([ends, [self.depth] * 2]), np.r_[ends.mean(axis=0), self.depth]
            found += [point(datum, middle, **about), line(datum, np.stack([a, b]), **about)]
        return found


def write_ties(folder: Path, residuals: Residuals, datum: Datum) -> Path:
    """Write `ties.geojson`.

    Raises:
        LogError: It cannot be written.
    """
    done = residuals.registration
    about = {"name": "ties", "rms_before_m": done.before, "rms_after_m": done.after, "nis": done.nis}
    return write_geojson(folder / TIES, residuals.features(datum), **about)
