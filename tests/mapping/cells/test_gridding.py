"""Cells: sums over pixels against sums by hand, parts that are joined, and what was broken off."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.cells.gridding import gridded
from rovtwin.mapping.cells.parts import Parts
from rovtwin.mapping.projection import crs_of

UTM = crs_of("EPSG:32632", "t")
GRID = Grid(UTM, 1000.0, 2000.0, 0.5, 6, 8)
RNG = np.random.default_rng(4)


def pixels(n=500, bands=3):
    xy = np.column_stack([RNG.uniform(1000.0, 1004.0, n), RNG.uniform(1997.0, 2000.0, n)])
    return xy, RNG.uniform(0.2, 1.0, n), RNG.random((n, 4)), RNG.random((n, bands)), RNG.random((n, bands))


def test_cells_are_counted_from_the_north_western_corner():
    xy = np.array([[1000.1, 1999.9], [1003.9, 1997.1], [1000.6, 1999.4], [999.9, 1999.0], [np.nan, 1999.0]])
    assert list(GRID.number(xy)) == [0, 47, 9, -1, -1]
    assert GRID.x[0] == 1000.25 and GRID.y[0] == 1999.75 and GRID.y[-1] == 1997.25
    held = Grid.over(UTM, np.array([[10.3, 20.7], [11.1, 19.9]]), 0.5)
    assert (held.left, held.top, held.rows, held.columns) == (10.0, 21.0, 3, 3)
    with pytest.raises(ConfigError, match="--resolution"):
        Grid.over(UTM, np.array([[0.0, 0.0], [1e4, 1e4]]), 0.01)


def test_a_part_has_weighted_means_and_the_variance_of_each():
    xy, weight, layers, value, variance = pixels()
    number = GRID.number(xy)
    part = gridded(number, weight, layers, value, variance)
    for k in (0, len(part.cells) // 2):
        own = number == part.cells[k]
        w = weight[own] / weight[own].sum()
        assert part.count[k] == own.sum() and part.weight[k] == pytest.approx(weight[own].sum(), rel=1e-5)
        assert np.allclose(part.value[k], w @ value[own], rtol=1e-5)
        assert np.allclose(part.variance[k], (w**2) @ variance[own], rtol=1e-5)
        assert np.allclose(part.layers[k], w @ layers[own], rtol=1e-5)


def test_a_pixel_without_a_number_in_a_band_does_not_count_there():
    value = np.array([[1.0, 1.0], [np.nan, 3.0], [1.0, 1.0], [np.nan, 1.0]])
    part = gridded(np.array([4, 4, 5, 6]), np.ones(4), np.zeros((4, 4)), value, np.ones((4, 2)))
    assert part.value[0] == pytest.approx([1.0, 2.0]) and part.variance[0] == pytest.approx([1.0, 0.5])
    assert (part.value[1] == 1.0).all() and np.isnan(part.value[2, 0]) and part.value[2, 1] == 1.0
    left_out = gridded(np.array([4, -1, 5]), np.array([1.0, 1.0, 0.0]), np.zeros((3, 4)), value[:3], 0 * value[:3])
    assert list(left_out.cells) == [4]


def two_parts(folder):
    parts = Parts(folder, "a")
    xy, weight, layers, value, variance = pixels()
    for number, own in enumerate((slice(0, 300), slice(300, 500))):
        args = (x[own] for x in (GRID.number(xy), weight, layers, value, variance))
        parts.add(number, gridded(*args), {"saturated": number})
    return parts, (GRID.number(xy), weight, value, variance)


def test_the_mean_of_parts_is_that_of_all_pixels_whatever_the_rows_at_once(tmp_path, monkeypatch):
    parts, (number, weight, value, variance) = two_parts(tmp_path / "p")
    monkeypatch.setattr("rovtwin.mapping.cells.parts._AT_ONCE", 1.0)
    blocks = list(parts.joined(range(2), GRID, 3, 4, best=False))
    assert len(blocks) == 1  # eight rows at least, and there are six
    dense = blocks[0][2]
    for cell in range(48):
        own = number == cell
        if not own.any():
            continue
        w = weight[own] / weight[own].sum()
        assert dense.count[cell] == own.sum() and np.allclose(dense.value[cell], w @ value[own], rtol=1e-4)
        assert np.allclose(dense.variance[cell], (w**2) @ variance[own], rtol=1e-4)
    assert parts.notes(range(2)) == {"saturated": 1}


def test_the_best_is_one_part_whole(tmp_path):
    parts = Parts(tmp_path / "p", "a")
    cells = np.arange(48)
    for number, quality in enumerate((np.linspace(0.0, 1.0, 48) + 0.01, np.linspace(1.0, 0.0, 48) + 0.01)):
        value = np.full((48, 2), float(number + 1))
        parts.add(number, gridded(cells, quality, np.zeros((48, 4)), value, value), {})
    ((_, _, dense),) = parts.joined(range(2), GRID, 2, 4, best=True)
    assert (dense.value[:24] == 2.0).all() and (dense.value[24:] == 1.0).all() and (dense.count == 2.0).all()


@pytest.mark.parametrize("best", [True, False])
def test_a_band_that_is_full_in_some_lines_is_taken_from_others(tmp_path, best):
    parts, cells = Parts(tmp_path / "p", "a"), np.arange(48)
    full = np.array([[np.nan, 2.0]] * 48)
    parts.add(0, gridded(cells, np.full(48, 2.0), np.zeros((48, 4)), full, np.ones((48, 2))), {})
    parts.add(1, gridded(cells, np.ones(48), np.zeros((48, 4)), np.full((48, 2), 5.0), np.ones((48, 2))), {})
    ((_, _, dense),) = parts.joined(range(2), GRID, 2, 4, best=best)
    assert np.allclose(dense.value, [5.0, 2.0 if best else 3.0]) and np.isfinite(dense.variance).all()
    ((_, _, alone),) = parts.joined(range(1), GRID, 2, 4, best=best)
    assert np.isnan(alone.value[:, 0]).all() and np.isnan(alone.variance[:, 0]).all()


def test_a_cell_between_two_lines_is_filled_from_its_neighbours_and_a_hole_is_not(tmp_path):
    parts = Parts(tmp_path / "p", "a")
    cells = np.array([c for c in range(48) if c // 8 != 2 and c % 8 < 6])  # one row is missing, and two columns
    value = np.column_stack([cells // 8, cells % 8]).astype(float)
    parts.add(0, gridded(cells, np.ones(len(cells)), np.zeros((len(cells), 4)), value, 0 * value), {})
    ((_, _, dense),) = parts.joined(range(1), GRID, 2, 4, best=True)
    row = slice(17, 21)
    assert np.allclose(dense.value[row, 0], 2.0) and np.allclose(dense.value[row, 1], [1.0, 2.0, 3.0, 4.0])
    assert (dense.count[row] == 0).all() and (dense.weight[row] > 0).all() and (dense.weight[6::8] == 0).all()


def test_parts_of_something_else_and_half_written_ones_are_thrown_away(tmp_path):
    parts, _ = two_parts(tmp_path / "p")
    (tmp_path / "p" / "part_00007.half").mkdir()
    again = Parts(tmp_path / "p", "a")
    assert again.has(1) and not (tmp_path / "p" / "part_00007.half").exists()
    assert not Parts(tmp_path / "p", "b").has(1)
