"""Ties out of pictures: shifts planted to a part of a cell are found, as well as is stated; out of nothing, none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from tests.mapping.helper import moving
from tests.mapping.surveys import survey
from tests.mapping.test_registration import errors, rms

from rovtwin.mapping.alignment.ground_points import ground_points
from rovtwin.mapping.alignment.matching import USUAL, correlations, match_strips
from rovtwin.mapping.alignment.registration import register
from rovtwin.mapping.alignment.strips import LONGEST, Strip, short_runs, straight_runs, strip_of
from rovtwin.mapping.alignment.ties import observe

CELL = 0.02


def texture(seed, size=700, length=2.0):
    return (
        gaussian_filter(np.random.default_rng(seed).normal(size=(size, size)), length) * 2.0 * np.sqrt(np.pi) * length
    )


def strips(shift, noise=0.2, seed=0):
    """Two strips side by side, 0.6 m of both the same; the second is stated to lie `shift` cells from where it is.

    Stamp and pixel are planes, so that what a tie says of them is a place.
    """
    picture, rng = texture(seed), np.random.default_rng(seed + 1)
    rows, columns = (x.astype(float) for x in np.indices((250, 70)))
    found = []
    for begin, moved in ((0, (0.0, 0.0)), (40, shift)):
        where = np.array([rows + 50 + moved[0], columns + begin + 50 + moved[1]])
        bright = map_coordinates(picture, where, order=3) + noise * rng.normal(size=rows.shape)
        found.append(Strip(np.array([0.0, begin * CELL]), CELL, bright, where[0] * CELL, where[1] * CELL))
    return found


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.3, -2.6), (-7.45, 5.2)])
def test_planted_shifts_are_found_to_a_part_of_a_cell(shift):
    ties = match_strips(strips(shift))
    assert len(ties.t) >= 7
    # A feature's own row and column, which stand for stamp and pixel, agree in both strips.
    miss = np.column_stack([ties.t[:, 1] - ties.t[:, 0], ties.pixel[:, 1] - ties.pixel[:, 0]])
    assert np.sqrt(np.mean(miss**2)) < 0.35 * CELL
    z = np.einsum("mi,mij,mj->m", miss, np.linalg.inv(ties.covariance), miss)
    assert z.mean() < 4.0


def test_noise_makes_ties_less_sure_and_pictures_of_nothing_make_none():
    clear, noisy = match_strips(strips((1.0, 1.0), 0.1)), match_strips(strips((1.0, 1.0), 0.6))
    assert noisy.quality.mean() < clear.quality.mean()
    assert np.trace(noisy.covariance.mean(0)) > np.trace(clear.covariance.mean(0))
    one, _ = strips((0.0, 0.0))
    _, other = strips((0.0, 0.0), seed=9)
    assert not len(match_strips([one, other]).t)


def test_of_more_patches_than_are_tried_those_that_are_lie_all_along_the_overlap():
    every, some = match_strips(strips((1.0, 1.0))), match_strips(strips((1.0, 1.0)), replace(USUAL, most=4))
    assert len(some.t) == 4 < len(every.t)
    assert some.t[0, 0] == every.t[0, 0] and some.t[-1, 0] == every.t[-1, 0]
    assert some.untried == len(every.t) - 4 and every.untried == 0


def test_a_long_oblique_run_is_cut_so_that_grids_stay_small():
    navigation, t = moving((0.0, 0.0, 0.25 * np.pi), speed=0.5, seconds=200.0), np.arange(0.0, 200.0, 0.1)  # 100 m
    (whole,) = straight_runs(navigation, t)
    pieces = short_runs(navigation, t, [whole])
    assert np.array_equal(np.concatenate(pieces), whole) and len(pieces) == 9
    assert max(0.5 * np.ptp(t[piece]) for piece in pieces) <= LONGEST


def test_stripes_tie_nothing():
    """They look the same all along themselves."""
    rows, columns = np.indices((250, 70))
    found = []
    for begin in (0, 40):
        bright = np.sin(0.5 * (columns + begin)) + 0.05 * np.random.default_rng(begin).normal(size=rows.shape)
        found.append(Strip(np.array([0.0, begin * CELL]), CELL, bright, rows * CELL, columns * CELL))
    assert not len(match_strips(found).t)


def test_correlations_are_those_of_numpy_and_need_enough_in_common():
    rng = np.random.default_rng(0)
    search = rng.normal(size=(9, 9))
    patch = search[2:7, 3:8] + 0.1 * rng.normal(size=(5, 5))
    patch[0, 0] = np.nan
    found, count = correlations(patch, search, 0.6)
    good = np.isfinite(patch)
    assert found[2, 3] == pytest.approx(np.corrcoef(patch[good], search[2:7, 3:8][good])[0, 1])
    assert count[2, 3] == 24 and found.shape == (5, 5)
    patch[:3] = np.nan
    assert not np.isfinite(correlations(patch, search, 0.6)[0]).any()


def pictures(one, noise=0.05):
    """Lines of a survey and what their pixels see of a textured floor under lamps that are brighter in the middle."""
    floor = texture(3, length=1.5)
    t = np.concatenate([np.arange(a + 0.05, b, 0.1) for a, b in one.lines])
    pixel = np.arange(one.truth.imager.pixels, dtype=float)
    T, P = np.meshgrid(t, pixel, indexing="ij")
    seen = ground_points(one.truth, T.ravel(), P.ravel())
    place = (seen.point[:, :2] + 2.0) / CELL
    bright = np.exp(0.2 * map_coordinates(floor, place.T, order=1)).reshape(T.shape)
    lamp = 1.0 + np.cos((pixel - pixel.mean()) / len(pixel) * 2.0)
    rng = np.random.default_rng(8)
    return t, bright * lamp * (1.0 + noise * rng.normal(size=T.shape))


@pytest.mark.system
def test_a_survey_is_put_together_by_its_pictures_alone():
    one = survey(seed=3)
    t, bright = pictures(one)
    runs = straight_runs(one.stated.navigation, t)
    assert len(runs) == len(one.lines)
    ties = match_strips([strip_of(one.stated, t[run], bright[run], 0.03) for run in runs])
    assert len(ties.t) >= 15
    found = register(one.joint, observe(one.joint, one.stated, ties))
    before, _ = errors(one)
    after, stated = errors(one, found.joint)
    assert rms(after - after.mean(0)) < 0.75 * rms(before - before.mean(0))
    assert found.dropped <= 0.2 * len(ties.t) and 0.3 < found.nis < 2.0
    assert np.mean(np.einsum("mi,mij,mj->m", after, np.linalg.inv(stated.absolute), after)) < 5.0
