"""Printed markers: to scale, measured in the PDF itself."""

import re
import zlib

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.report.cameras.markers import PAGES, numbers, sheet, write_markers

cv2 = pytest.importorskip("cv2")
POINT = 0.0254 / 72  # of PDF [m]


def contents(path):
    """Page sizes [m], shape (n, 2), and drawing commands of each page of a PDF that matplotlib wrote."""
    data = path.read_bytes()
    boxes = [b.split() for b in re.findall(rb"/MediaBox \[([^\]]*)\]", data)]
    streams = [zlib.decompress(s).decode("latin1") for s in re.findall(rb"stream\r?\n(x.*?)endstream", data, re.S)]
    return np.array([[float(x) * POINT for x in b[2:]] for b in boxes]), [s for s in streams if " re W n" in s]


def drawn_paths(page):
    """Fill colour (grey), operator and corners [m] of every path that a page fills or strokes."""
    fill, kept, numbers_, path = 0.0, [], [], []
    for word in page.split():
        if re.fullmatch(r"[-+]?\d*\.?\d+", word):
            numbers_.append(float(word))
            continue
        if word == "q":
            kept.append(fill)
        elif word == "Q":
            fill = kept.pop()
        elif word == "g":
            fill = numbers_[-1]
        elif word == "rg":
            fill = sum(numbers_[-3:]) / 3
        elif word in ("m", "l"):
            path = [*path, numbers_[-2:]] if word == "l" else [numbers_[-2:]]
        elif word in ("f", "S"):
            yield fill, word, np.array(path) * POINT
        numbers_ = []


def black_areas(page):
    """Corners [m], shape (n, 4, 2), of the filled rectangles of a page that are black."""
    return np.array([path for fill, how, path in drawn_paths(page) if how == "f" and fill == 0.0 and len(path) == 4])


def drawn(page, dots=4000):
    """The black of a page as a picture with `dots` pixels a metre, row 0 its top."""
    areas = black_areas(page)
    high = int(np.ceil(0.43 * dots))
    picture = np.full((high, high), 255, np.uint8)
    for area in areas:
        low, top = np.rint(area.min(axis=0) * dots).astype(int), np.rint(area.max(axis=0) * dots).astype(int)
        picture[high - top[1] : high - low[1], low[0] : top[0]] = 0
    return picture


@pytest.mark.parametrize(("size", "page"), [(0.15, "a4"), (0.05, "letter"), (0.2, "a3")])
def test_black_squares_are_as_large_as_asked_for_on_paper_of_its_size(tmp_path, size, page):
    write_markers(tmp_path / "m.pdf", "DICT_4X4_50", [0, 1, 2], size, page)
    boxes, pages = contents(tmp_path / "m.pdf")
    assert np.allclose(np.sort(boxes, axis=1), np.sort(PAGES[page]), atol=1e-5)
    areas = np.concatenate([black_areas(p) for p in pages])
    # The top row of a marker's border is one run of black as wide as the marker.
    widths = np.ptp(areas[..., 0], axis=1)
    assert widths.max() == pytest.approx(size, abs=2e-6)
    assert np.ptp(areas[..., 1], axis=1) == pytest.approx(size / 6, abs=2e-6)


def test_what_is_printed_is_detected_with_its_ids_and_its_size(tmp_path):
    count = write_markers(tmp_path / "m.pdf", "DICT_5X5_100", [7, 0, 42, 99, 13], 0.04)
    assert count == 1
    (page,) = contents(tmp_path / "m.pdf")[1]
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100))
    corners, ids, _ = detector.detectMarkers(drawn(page))
    assert sorted(ids.ravel().tolist()) == [0, 7, 13, 42, 99]
    for corner in corners:
        sides = np.linalg.norm(np.roll(corner[0], -1, axis=0) - corner[0], axis=1) / 4000
        assert sides == pytest.approx(0.04, abs=6e-4)


def test_the_ruler_is_as_long_as_it_says(tmp_path):
    write_markers(tmp_path / "m.pdf", "DICT_4X4_50", [0], 0.15)
    page = contents(tmp_path / "m.pdf")[1][0]
    lines = [path for _, how, path in drawn_paths(page) if how == "S" and len(path) == 2]
    level = [np.ptp(line[:, 0]) for line in lines if np.ptp(line[:, 1]) < 1e-9]
    assert max(level) == pytest.approx(0.18, abs=2e-6)


def test_as_many_lie_on_a_page_as_fit_and_none_reaches_beyond_it():
    for size in (0.03, 0.05, 0.08, 0.12, 0.14):
        plan = sheet(size, 6, "a4")
        places = [plan.corner(i) for i in range(plan.across * plan.down)]
        low, high = np.min(places, axis=0), np.max(places, axis=0) + plan.board
        assert (low > 0.0).all() and (high < [plan.width, plan.height]).all()
        apart = [np.abs(np.subtract(a, b)).max() for i, a in enumerate(places) for b in places[:i]]
        assert all(gap >= plan.board for gap in apart)
    assert sheet(0.05, 6, "a4").across * sheet(0.05, 6, "a4").down >= 6
    assert sheet(0.15, 6, "a4").across == 1  # the thesis's markers on the paper that everybody has


@pytest.mark.parametrize(("text", "found"), [("0-3", [0, 1, 2, 3]), ("5, 1-2", [5, 1, 2]), ("7", [7])])
def test_ids_are_read_as_people_write_them(text, found):
    assert numbers(text, "--ids") == found


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 0.3}, "a4 has room for 150 mm: take a smaller one or --page a3"),
        ({"page": "a5"}, "expected one of a4, a3, letter"),
        ({"ids": [50]}, "DICT_4X4_50 ends with 49"),
        ({"dictionary": "DICT_4X4_60"}, "Did you mean 'DICT_4X4_50'"),
    ],
)
def test_what_cannot_be_printed_is_named(tmp_path, change, message):
    given = {"dictionary": "DICT_4X4_50", "ids": [0], "size": 0.1, "page": "a4"} | change
    with pytest.raises(ConfigError, match=message):
        write_markers(tmp_path / "m.pdf", **given)


@pytest.mark.parametrize("text", ["", "a", "3-1", "1,1", "0-5,3", "-3"])
def test_ids_that_cannot_be_are_named(text):
    with pytest.raises(ConfigError, match="--ids: found"):
        numbers(text, "--ids")
