"""A part of a way against the same part of the drawn flights'."""

import numpy as np
import pytest

from rovtwin.runs.ensemble.comparison import _axes
from rovtwin.runs.ensemble.course import Course

DRAWS = 39


@pytest.mark.parametrize(("reached", "first", "share"), [(1, 0, 0.25), (2, 1, 0.75), (2, 0, 0.5)])
def test_only_what_was_flown_of_the_drawn_flights_counts(reached, first, share):
    course = Course.of(np.array([[0.0, 0, 1], [5, 0, 1], [5, 5, 1]]), 0.0)
    half, n = course.each, 2 * course.each
    low = np.concatenate([np.full((half, 3), 1.0), np.full((half, 3), -1.0)])  # the flight is inside on the second leg
    predicted = {
        "bands": {"low": low.tolist(), "high": (low + 2.0).tolist()},
        "inside": {name: [[half // 4, 3 * half // 4]] * DRAWS for name in ("across", "depth", "heading")},
    }
    times = np.full((2, 4), np.nan)
    times[:reached] = 1.0
    rows = _axes(predicted, course, times, np.zeros((n, 3)), first)
    assert [row["least_usual"] for row in rows] == [share] * 3
    outside = {"across": "outside", "depth": "outside", "heading": "near"}
    assert [row["verdict"] for row in rows] == (
        [outside[row["axis"]] for row in rows] if not first and reached == 1 else ["inside"] * 3
    )
