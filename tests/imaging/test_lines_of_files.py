"""Several files of lines as one: the numbers of the whole, in order of time; what does not belong together is named."""

from dataclasses import replace

import numpy as np
import pytest
from tests.imaging.helper import cut, head

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.imaging import lines as layout
from rovtwin.imaging.imager import Mount
from rovtwin.imaging.lines import LinesFile, LinesHead
from rovtwin.imaging.lines_of_files import in_order, open_lines
from rovtwin.imaging.lines_writer import write_lines

CUBE = np.random.default_rng(1).integers(70, 4000, (7, 12, 5)).astype(np.uint16)


@pytest.fixture
def whole(tmp_path):
    return write_lines(tmp_path / "lines.h5", head(truth=True), [CUBE])


def test_lines_cut_into_three_files_are_those_of_the_whole_in_whatever_order_they_are_given(whole, tmp_path):
    a, b, c = cut(whole, tmp_path / "cut", [2, 3])
    with LinesFile(whole) as one, open_lines([c, a, b]) as three:
        assert three.shape == one.shape and [file.path for file in three.files] == [a, b, c]
        for name in ("t", "exposure", "wavelengths", "fwhm"):
            assert np.array_equal(getattr(three, name), getattr(one, name))
        for first, last in ((0, 7), (1, 2), (1, 4), (2, 3), (3, 7)):
            assert np.array_equal(three.read(first, last), one.read(first, last))
            for x, y in zip(three.radiance(first, last), one.radiance(first, last), strict=True):
                assert np.array_equal(x, y, equal_nan=True)
        for x, y in zip(three.navigation() or (), one.navigation() or (), strict=True):
            assert np.array_equal(x, y)
        assert three.truth is not None and one.truth is not None
        assert np.array_equal(three.truth.position, one.truth.position) and three.truth.scene == one.truth.scene
        assert three.datum == one.datum and three.described and three.simulated and three.gaps == one.gaps
        assert three.name == f"{a.name} and 2 more" and one.name == "lines.h5"
        assert [(file.path, x, y) for file, x, y in three.pieces(1, 4)] == [(a, 1, 2), (b, 0, 1), (c, 0, 1)]


def test_each_file_has_frames_of_its_own(whole, tmp_path):
    def darker(file, k):
        file[layout.DARK][:] += 10 * k
        file[layout.CUBE][:] += np.uint16(10 * k)

    with LinesFile(whole) as one, open_lines(cut(whole, tmp_path / "cut", [4], darker)) as two:
        assert np.array_equal(two.radiance(0, 7)[0], one.radiance(0, 7)[0])


def test_navigation_that_overlaps_from_file_to_file_counts_once(whole, tmp_path):
    def part(file, k):
        stamps = file[f"{layout.NAVIGATION}/timestamp"]
        stamps[:] = np.where((np.arange(7) < 5) if k == 0 else (np.arange(7) >= 3), stamps[:], np.nan)

    with LinesFile(whole) as one, open_lines(cut(whole, tmp_path / "cut", [4], part)) as two:
        t, place, _ = two.navigation() or ()
        known = np.isfinite(t)
        expected = one.navigation() or ()
        assert np.array_equal(t[known], expected[0]) and np.array_equal(place[known], expected[1])


BAD = [
    ({"datum": Datum(63.0, 10.0)}, "datum: found "),
    (
        {"mount": Mount(np.array([0.2, 0.0, 0.11]), np.eye(3), "uhi.camera")},
        r"mount_position: found .0.1, 0.0, 0.11.",
    ),
    ({"saturation": 4000.0}, "saturation: found 4095.0 and 4000.0"),
    ({"truth": None}, "the scene that a simulation saw is not the same"),
    ({"pixels": 16}, r"found lines of 12 x 5 and of 16 x 5 \(pixels x bands\)"),
    (
        {"bands": {"first": 451.0, "last": 650.0, "count": 5, "fwhm": 4.0}},
        "wavelengths of band 0: found 450 and 451",
    ),
    ({"lens": {"field_of_view_deg": 50.0}}, "imager: lens not the same"),
    ({}, "follow one upon the other"),
]


@pytest.mark.parametrize(("changed", "message"), BAD, ids=[str(list(one[0])) for one in BAD])
def test_files_that_do_not_belong_together_are_named_with_what_differs(whole, tmp_path, changed, message):
    of_head = {key: value for key, value in changed.items() if hasattr(head(), key)}
    other = replace(head(truth=True, **{k: v for k, v in changed.items() if k not in of_head}), **of_head)
    cube = np.zeros((7, *other.dark.shape), np.uint16)
    later = other if not changed else replace(other, t=other.t + 10.0)
    path = write_lines(tmp_path / "other.h5", later, [cube])
    with LinesHead(whole) as one, LinesHead(path) as two, pytest.raises(ConfigError, match=message) as error:
        in_order([one, two])
    assert str(whole) in str(error.value) and str(path) in str(error.value)
    with pytest.raises(ConfigError, match=message):
        open_lines([whole, path])
