"""What changed between two dives over one place: planted squares are found, and little else."""

from types import SimpleNamespace

import numpy as np
import pytest
from tests.mapping.change import seabed
from tests.mapping.change.seabed import CELL, WAVELENGTHS

from rovtwin.mapping.change import detect
from rovtwin.mapping.change.channels import channels_of, noise_of, without_trend
from rovtwin.mapping.change.displacement import Displacement, displacement
from rovtwin.mapping.change.patches import Matches
from rovtwin.mapping.change.things import least_contrast, things

SHAPE, LEAST = (200, 300), 0.1


@pytest.fixture(scope="module", params=[0, 1])
def dives(request):
    """Two dives, the squares in the second as the first sees their places, and the true displacement."""
    rng = np.random.default_rng(request.param)
    before = seabed.albedo(rng, SHAPE)
    after, places = seabed.planted(rng, before)
    first, u_1 = seabed.seen(rng, before, (0.0, 0.0), 0.012)
    second, u_2 = seabed.seen(rng, after, (0.07, -0.05), 0.012)
    a, b = (channels_of(cube, WAVELENGTHS, np.ones(12, bool), 6) for cube in (first, second))
    wide = round(detect.TREND * LEAST / CELL)
    x, y = (without_trend(one.value, wide).mean(axis=2) for one in (a, b))
    moved = displacement(x, y, CELL, 0.2, 0.017)
    at = places.round().astype(int)
    return a, b, moved, places + u_1[at[:, 0], at[:, 1]], u_2 - u_1


def test_the_displacement_is_found_to_its_stated_uncertainty(dives):
    _, _, moved, _, true = dives
    inside = (slice(25, -25), slice(25, -25))
    error = (moved.shift - true)[inside] * CELL
    stated = moved.sd[inside] * CELL
    assert np.sqrt(np.mean(error**2)) < 0.006, "of 17 mm that the two differ by within, and 86 mm as a whole"
    normalised = np.mean((error / stated[:, :, None]) ** 2)
    assert 0.2 < normalised < 3.5


def test_the_displacement_jumps_where_one_line_of_a_survey_ends_and_the_next_begins():
    """By 24 mm, of which nothing is stated; beside the seam, and where a survey does not say which line saw what."""
    rng = np.random.default_rng(4)
    floor = seabed.albedo(rng, SHAPE)
    line = np.broadcast_to(np.arange(SHAPE[1]) >= 150, SHAPE).astype(float)
    (first, u_1), (second, u_2) = (
        seabed.seen(rng, floor, shift, 0.004, jump=jump)
        for shift, jump in (((0, 0), 0.0), ((0.03, 0.02), 0.024 * line))
    )
    a, b = (channels_of(cube, WAVELENGTHS, np.ones(12, bool), 6) for cube in (first, second))
    x, y = (without_trend(one.value, round(detect.TREND * LEAST / CELL)).mean(axis=2) for one in (a, b))
    seam = (slice(25, -25), np.r_[139:148, 153:162])
    errors = {}
    for name, lines in (("known", (np.zeros(SHAPE), line)), ("not", None)):
        moved = displacement(x, y, CELL, 0.2, 0.017, lines)
        assert moved is not None
        error = (moved.shift - (u_2 - u_1))[seam] * CELL
        errors[name] = np.sqrt(np.mean(error**2))
        if name == "known":
            assert 0.2 < np.mean((error / moved.sd[seam][:, :, None] / CELL) ** 2) < 4.0
    assert errors["known"] < 0.003 and errors["known"] < 0.5 * errors["not"], errors


def test_planted_squares_are_found_and_little_else(dives):
    a, b, moved, places, _ = dives
    test = detect.tested(a, b, moved, CELL, LEAST, 0.05)
    found = things(test, CELL, LEAST, 0.1)
    apart = np.linalg.norm(np.array([one.place for one in found])[:, None] - places[None], axis=2) * CELL
    hits, false = int((apart.min(axis=0) < 0.06).sum()), int((apart.min(axis=1) > 0.12).sum())
    assert hits >= 0.9 * len(places), f"{hits} of {len(places)}"
    assert false <= max(0.05 * len(found), 2), [one.place for one in found]
    sure = [one for one, near in zip(found, apart.min(axis=1), strict=True) if near < 0.06]
    assert np.median([abs(one.contrast.mean()) for one in sure]) == pytest.approx(0.28, abs=0.05)
    assert np.median([one.area for one in sure]) == pytest.approx(0.01, rel=0.4)


def test_the_same_seabed_has_not_changed():
    rng = np.random.default_rng(5)
    floor = seabed.albedo(rng, SHAPE)
    a, b = (
        channels_of(seabed.seen(rng, floor, shift, 0.012)[0], WAVELENGTHS, np.ones(12, bool), 6)
        for shift in ((0.0, 0.0), (0.03, 0.04))
    )
    wide = round(detect.TREND * LEAST / CELL)
    x, y = (without_trend(one.value, wide).mean(axis=2) for one in (a, b))
    moved = displacement(x, y, CELL, 0.2, 0.017)
    assert moved is not None
    test = detect.tested(a, b, moved, CELL, LEAST, 0.05)
    assert len(things(test, CELL, LEAST, 0.1)) <= 2


def test_places_with_nothing_in_common_are_not_laid_upon_each_other():
    rng = np.random.default_rng(2)
    images = [np.log(seabed.albedo(rng, (120, 120)).mean(axis=2)) for _ in range(2)]
    x, y = (without_trend(image[:, :, None], 20)[:, :, 0] for image in images)
    found = displacement(x, y, CELL, 0.1, 0.01)
    assert found is None or len(found.matches.score) < 12, "of some 64 patches"


def test_noise_is_read_off_neighbouring_bands():
    rng = np.random.default_rng(3)
    cube = np.linspace(0.1, 0.4, 30) + rng.normal(0.0, 0.004, (50, 60, 30))
    assert noise_of(cube) == pytest.approx(np.full(30, 0.004), rel=0.1)


def test_bands_without_a_number_leave_cells_out_and_those_beside_them():
    cube = np.full((9, 12, 12), 0.2)
    cube[1, 2, 3] = np.nan
    cube[7, 8, :] = -0.1
    found = channels_of(cube, WAVELENGTHS, np.ones(12, bool), 3, np.full(12, 0.01))
    gone = [(i, j) for r, c in ((1, 2), (7, 8)) for i in range(9) for j in range(12) if abs(i - r) + abs(j - c) <= 2]
    assert not any(found.seen[cell] for cell in gone) and found.seen.sum() == 9 * 12 - len(gone)
    assert found.noise[0, 0] == pytest.approx(0.01 / 2.0 / 0.2)


def test_squares_that_changed_their_colour_alone_are_found():
    """Spectra tilted about their middle: the sign of the mean over channels is that of noise, and no thing's parts."""
    rng, shape = np.random.default_rng(0), (120, 150)
    floor = seabed.albedo(rng, shape)
    after, tilt = floor.copy(), np.linspace(-0.7, 0.7, 12)
    places = [(row, column) for row in range(15, 120, 30) for column in range(15, 150, 30)]
    for k, (row, column) in enumerate(places):
        after[row - 2 : row + 3, column - 2 : column + 3] *= np.exp(tilt * (-1) ** k)
    cubes = [seabed.seen(rng, cube, (0.0, 0.0), 0.004)[0] for cube in (floor, after)]
    test = _still(*cubes)
    at = np.array([one.place for one in things(test, CELL, LEAST, 0.1)])
    named = [
        place for place in places if test.changed[place[0] - 3 : place[0] + 4, place[1] - 3 : place[1] + 4].sum() >= 7
    ]
    listed = [np.linalg.norm(at - place, axis=1).min() * CELL < 0.06 for place in named]
    assert len(named) > 0.9 * len(places) and all(listed), listed
    assert len(at) <= len(places) + 2


def test_a_thing_whose_halves_changed_in_opposite_ways_is_one_where_neither_is_large_enough():
    shape, half = (40, 40), np.zeros((40, 40, 1))
    half[18:22, 18:20], half[18:22, 20:22] = 0.5, -0.4  # of a least thing of 5 x 5 cells a part has 13 or more
    nothing = np.ones(shape)
    changed = half[:, :, 0] != 0
    test = SimpleNamespace(difference=half, changed=changed, sd=0.01 * nothing, chance=np.where(changed, 1e-6, 1.0))
    (only,) = things(test, CELL, LEAST, 0.1)  # pyright: ignore[reportArgumentType]
    assert only.place == (19.5, 19.5) and (only.cells == changed).all()
    half[16:24, 16:20], half[16:24, 20:24] = 0.5, -0.4
    test.changed[16:24, 16:24] = True
    assert sorted(one.place[1] for one in things(test, CELL, LEAST, 0.1)) == [17.5, 21.5]  # pyright: ignore


@pytest.mark.system
def test_single_squares_of_the_contrast_that_is_stated_are_found_over_half_of_the_floor():
    """Each at a random place of its own pair of dives; one and a half times as strong, most are."""
    rng, shape, hits = np.random.default_rng(11), (120, 150), {1.0: [], 1.5: [], 0.5: []}
    for _ in range(24):
        floor = seabed.albedo(rng, shape)
        cubes = [seabed.seen(rng, floor, (0.0, 0.0), 0.004)[0] for _ in range(2)]
        row, column = rng.integers(15, shape[0] - 15), rng.integers(15, shape[1] - 15)
        stated = least_contrast(_still(*cubes), CELL, LEAST, 0.05)
        for times, found in hits.items():
            after = cubes[1].copy()
            after[row - 2 : row + 3, column - 2 : column + 3] *= 1.0 + times * stated
            some = things(_still(cubes[0], after), CELL, LEAST)
            found.append(any(np.hypot(one.place[0] - row, one.place[1] - column) * CELL < 0.08 for one in some))
    shares = {times: np.mean(some) for times, some in hits.items()}
    assert 0.3 < shares[1.0] <= 0.75 and shares[1.5] > 0.7 and shares[0.5] < 0.2, shares  # 0.58, 0.75, 0.08


def _still(first, second):
    """Test of two cubes that lie upon each other."""
    shape = first.shape[:2]
    a, b = (channels_of(cube, WAVELENGTHS, np.ones(12, bool), 6) for cube in (first, second))
    none = Matches(*(np.zeros(size) for size in ((0, 2), (0, 2), (0, 2), (0, 2), 0)))
    return detect.tested(
        a, b, Displacement(np.zeros((*shape, 2)), np.full(shape, 0.25), none, 0, 1.0), CELL, LEAST, 0.05
    )
