"""Bands that noise hides: alike wherever rows are cut, and whole where there is no signal."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.cells.gridding import LAYERS, gridded
from rovtwin.mapping.cells.masking import AROUND, masked, without_signal
from rovtwin.mapping.cells.mosaic import UNITS, join
from rovtwin.mapping.cells.parts import Parts
from rovtwin.mapping.formats.envi import NO_DATA, opened
from rovtwin.mapping.projection import crs_of

WAVELENGTHS = np.array([450.0, 550.0, 620.0, 740.0])


def test_a_dark_floor_in_good_light_is_not_masked():
    value, sigma = np.array([0.3, 0.3, 0.01, 0.01]), np.array([0.05, 0.07, 0.009, 0.02])
    cells = [np.broadcast_to(x, (4, 5, 4)) for x in (value, sigma)]
    assert (masked(*cells, np.ones((4, 5), bool), 5.0) == [False, True, False, True]).all()


def test_a_mask_does_not_choose_the_bright_ones_of_what_is_alike():
    rng = np.random.default_rng(3)
    sigma = np.full((60, 80, 1), 0.0405)
    value = 0.2 + sigma * rng.standard_normal(sigma.shape)
    alone = value[sigma * 5.0 <= np.maximum(np.abs(value), 0.05)]
    kept = value[~masked(value, sigma, np.ones((60, 80), bool), 5.0)]
    assert alone.mean() > 0.22 and (len(kept) == 0 or abs(kept.mean() - 0.2) < 0.01)


def test_a_cell_depends_on_the_rows_beside_it_and_no_others_to_the_last_bit():
    rng = np.random.default_rng(4)
    value, sigma = rng.normal(0.2, 0.2, (50, 30, 3)), rng.gamma(2.0, 0.02, (50, 30, 3))
    seen = rng.random((50, 30)) > 0.2
    whole = masked(value, sigma, seen, 5.0)
    assert 0.1 < whole.mean() < 0.9
    for begin in (0, 7, 23):
        a, b = max(begin - AROUND // 2, 0), min(begin + 9 + AROUND // 2, 50)
        part = masked(value[a:b], sigma[a:b], seen[a:b], 5.0)
        assert (part[begin - a : begin - a + 9] == whole[begin : begin + 9]).all()


def test_full_counts_among_the_cells_about_one_do_not_count():
    value, sigma = np.full((20, 20, 1), 0.3), np.full((20, 20, 1), 0.055)
    value[::2], sigma[::2] = np.nan, np.nan
    assert not masked(value, sigma, np.ones((20, 20), bool), 5.0).any()
    assert masked(value, 1.2 * sigma, np.ones((20, 20), bool), 5.0)[1::2].all()


def job_of(folder):
    """Cells of 60 x 40 in two parts; the noise of each band grows, and in the last there is nothing else."""
    grid, rng = Grid(crs_of("EPSG:32632", "t"), 1000.0, 2000.0, 0.01, 60, 40), np.random.default_rng(6)
    parts, bands = Parts(folder, "a"), len(WAVELENGTHS)
    for number in range(2):
        cells = np.sort(rng.choice(2400, 1700, replace=False))
        sigma = rng.gamma(4.0, 0.25, (1700, bands)) * [0.001, 0.03, 0.05, 0.5]
        value = [0.3, 0.2, 0.25, 0.0] + sigma * rng.standard_normal(sigma.shape)
        parts.add(number, gridded(cells, rng.random(1700), rng.random((1700, len(LAYERS))), value, sigma**2), {})
    lines = SimpleNamespace(wavelengths=WAVELENGTHS, fwhm=np.full(bands, 4.0))
    correction = SimpleNamespace(reflects=True, factor=None)
    calibrated = SimpleNamespace(lines=lines, has_noise=True, correction=correction)
    names = list(LAYERS)
    job = SimpleNamespace(
        calibrated=calibrated, grid=grid, layer_names=names, numbers=range(2), best=True, units=lambda: UNITS
    )
    return job, parts


def test_a_mosaic_is_the_same_to_the_last_bit_however_many_rows_are_joined_at_once(tmp_path, monkeypatch):
    job, parts = job_of(tmp_path / "p")
    cubes, layers = [], []
    for k, size in enumerate((1e9, 1.0, 8.0 * 4 * 40 * 13)):
        monkeypatch.setattr("rovtwin.mapping.cells.parts._AT_ONCE", size)
        joined = join(job, parts, tmp_path / f"{k}.img", "t", 5.0)  # pyright: ignore
        cubes.append((tmp_path / f"{k}.img").read_bytes())
        layers.append(np.dstack([*(layer for layer, _ in joined.layers.values()), joined.rgb]).tobytes())
        assert 0.05 < joined.masked[2] < 0.9  # it is a mask that depends on where a cell lies
    assert cubes[0] == cubes[1] == cubes[2] and layers[0] == layers[1] == layers[2]


def test_a_band_without_a_signal_is_masked_whole(tmp_path):
    job, parts = job_of(tmp_path / "p")
    joined = join(job, parts, tmp_path / "c.img", "t", 5.0)  # pyright: ignore
    cube = opened(tmp_path / "c.img", (60, 40, 4))
    assert (cube[:, 3] == NO_DATA).all() and joined.masked[3] == 1.0 and (cube[:, 0] > 0).any()
    assert list(without_signal(np.array([0.0, 0.98, 0.99, 1.0]))) == [False, False, True, True]


def test_a_colour_whose_bands_are_masked_whole_has_no_number_in_the_picture(tmp_path):
    job, parts = job_of(tmp_path / "p")
    job.calibrated.lines.wavelengths = np.array([450.0, 550.0, 700.0, 720.0]) - 75.0  # the last one is red
    joined = join(job, parts, tmp_path / "c.img", "t", 5.0)  # pyright: ignore
    assert joined.masked[3] == 1.0
    red = joined.rgb[..., 0][joined.seen]
    assert np.nanmedian(red) == pytest.approx(0.25, abs=0.05)  # of the band at 625 nm alone
