"""Bands of drawn curves: the share that one more has inside, and how much of it is chance."""

import numpy as np
import pytest
from tests.runs.ensemble.walks import SAMPLES, walks

from rovtwin.runs.ensemble.bands import Axis, band_between, effective_of, held_against, shares_inside

DRAWS, RANK = 79, 2


def test_shares_held_against_each_other_are_95_percent_on_average_exactly():
    curves = walks(np.random.default_rng(2), DRAWS + 1)
    assert np.mean(shares_inside(curves, RANK)) == pytest.approx(0.95, abs=1e-12)


def test_a_share_against_the_others_is_that_of_their_band():
    curves = walks(np.random.default_rng(3), DRAWS + 1)
    ordered = np.sort(curves[:-1], axis=0)
    inside = (curves[-1] >= ordered[RANK - 1]) & (curves[-1] <= ordered[-RANK])
    assert shares_inside(curves, RANK)[-1] == np.mean(inside)


def test_effective_samples_are_few_where_samples_are_correlated():
    rng = np.random.default_rng(6)
    white, slow = (
        effective_of(shares_inside(walks(rng, DRAWS, memory), RANK), 0.95, SAMPLES) for memory in (0.0, 0.995)
    )
    assert slow < 0.2 * white <= SAMPLES


@pytest.mark.parametrize(("count", "rank", "level"), [(39, 1, 0.95), (19, 1, 0.9), (79, 2, 0.95)])
def test_the_level_is_that_of_one_more_curve(count, rank, level):
    rng = np.random.default_rng(11)
    axis, inside = Axis("across", "m", 0.05), []
    for _ in range(150):
        curves = walks(rng, count + 1, 0.9)[:, :, None]
        band = band_between(curves[:-1], rank)
        inside.append(held_against(band, curves[-1], [axis], 0.02)[0].inside)
    assert band.level == pytest.approx(level)
    assert np.mean(inside) == pytest.approx(level, abs=0.02)


def test_a_curve_beside_the_band_by_little_is_near_it():
    curves = np.linspace(0.0, 1.0, 40)[:, None, None] * np.ones((40, 50, 1))
    band, near = band_between(curves, 1), Axis("across", "m", 0.05)
    for off, verdict in ((-0.01, "inside"), (0.04, "near"), (0.06, "outside")):
        (row,) = held_against(band, np.full((50, 1), 1.0 + off), [near], 2 / 41)
        assert (row.verdict, row.beyond) == (verdict, pytest.approx(max(off, 0.0)))
