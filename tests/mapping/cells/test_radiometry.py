"""Reflectance of counts: what a simulation put in comes out, and what noise does to it is as stated."""

import numpy as np
import pytest
from tests.imaging.helper import head, imager
from tests.mapping.helper import mount, moving

from rovtwin.imaging.floor import Plane
from rovtwin.imaging.lines import LinesFile
from rovtwin.imaging.lines_writer import write_lines
from rovtwin.imaging.radiance import Radiometry, fine_wavelengths
from rovtwin.imaging.spectra.water import Constituents, SpectralWater
from rovtwin.mapping.cells.radiometry import Calibrated, Correction, Unsure, budget, lowered
from rovtwin.mapping.georeference import Georeference
from rovtwin.simulation.imager.detector import DetectorModel

LINES, ALBEDO = 60, 0.3


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """Counts of a floor of one reflectance under lamps, in a file; where the pixels lie; light and water."""
    small, t = imager(pixels=24), 1.0 + 0.05 * np.arange(LINES)
    navigation = moving((0.05, -0.03, 0.2), seconds=5.0)
    located = Georeference(small, mount(), navigation, Plane(5.0, (0.1, 0.0))).locate(t)
    water = SpectralWater.of(Constituents.model_validate({}), fine_wavelengths(small))
    model, detector = Radiometry(small, water, 12.0, 0.2, 0.4), DetectorModel(small, 1)
    counts = []
    for i in range(LINES):
        hits = type("Hits", (), {"way": located.way[i], "point": located.point[i], "normal": located.normal[i]})
        gain, veil = model.gain_and_veil(hits, located.position[i], located.rotation[i])
        counts.append(detector.counts(gain * np.float32(ALBEDO) + veil, i))
    given = head(LINES, pixels=24)
    own = type(given)(
        small, given.mount, given.datum, t, given.exposure * 0 + small.file.exposure, detector.dark_frame,
        detector.response_frame, detector.full,
    )  # fmt: skip
    path = write_lines(tmp_path_factory.mktemp("l") / "l.h5", own, [np.stack(counts)])
    with LinesFile(path) as lines:
        yield lines, located, model


def test_reflectance_comes_back_and_its_noise_is_as_stated(seen):
    lines, located, model = seen
    value, variance, full = Calibrated(lines, Correction(lines.imager, model)).values(lines.read(0, LINES), 0, located)
    assert full == 0 and np.abs(value.mean((0, 1)) / ALBEDO - 1.0).max() < 0.01  # of 1440 pixels
    z = (value - ALBEDO) / np.sqrt(variance)
    assert 0.9 < z.std() < 1.15 and abs(z.mean()) < 0.15


def test_an_error_of_the_floors_height_is_what_the_budget_says(seen):
    lines, located, model = seen
    calibrated = Calibrated(lines, Correction(lines.imager, model))
    cube = lines.read(0, LINES)
    wrong = calibrated.values(cube.copy(), 0, lowered(located, 0.05))[0].mean((0, 1))
    right = calibrated.values(cube.copy(), 0, located)[0].mean((0, 1))
    some = [(k, _line(located, k), lines.read(k, k + 1)) for k in (5, 30, 50)]
    found = budget(calibrated, some, Unsure(height=0.05, water=0.2, lamps=0.1))
    assert np.allclose(found.height, np.abs(wrong / right - 1.0), rtol=0.1) and found.height.min() > 0.015
    assert (found.water > 0.05).all() and np.allclose(found.lamps, 0.1, rtol=0.35)
    assert np.allclose(found.common, np.sqrt(found.height**2 + found.water**2 + found.lamps**2))


def test_pixels_between_those_that_are_computed_have_their_light(seen):
    lines, located, model = seen
    gain, veil = Correction(lines.imager, model).gain_and_veil(located, 3)
    hits = type("Hits", (), {"way": located.way[3], "point": located.point[3], "normal": located.normal[3]})
    exact = model.gain_and_veil(hits, located.position[3], located.rotation[3])
    # 24 pixels over the whole field: a pixel is as wide as forty of a real imager.
    assert np.abs(gain / exact[0] - 1.0).max() < 0.05 and np.allclose(veil, exact[1], rtol=0.05)


def test_pixels_beside_a_hole_of_the_floor_have_their_own_light(seen):
    lines, located, model = seen
    whole = type("Hits", (), {"way": located.way[3], "point": located.point[3], "normal": located.normal[3]})
    exact, _ = model.gain_and_veil(whole, located.position[3], located.rotation[3])
    holed = _lines(located, slice(3, 4))
    for name in ("way", "point", "normal", "valid"):
        holes = getattr(holed, name).copy()
        holes[0, 8] = 0 if name == "valid" else np.nan  # one of those that others are drawn from
        object.__setattr__(holed, name, holes)
    gain, _ = Correction(lines.imager, model).gain_and_veil(holed, 0)
    near = np.r_[1:8, 9:16]
    assert np.allclose(gain[near], exact[near], rtol=1e-6)


def test_full_pixels_have_no_value(seen):
    lines, located, model = seen
    cube = lines.read(0, 2)
    cube[1, 3, 2] = lines.saturation
    value, _, full = Calibrated(lines, Correction(lines.imager, model)).values(cube, 0, _lines(located, slice(0, 2)))
    assert full == 1 and np.isnan(value[1, 3, 2]) and np.isfinite(value).sum() == value.size - 1


def test_radiance_alone_is_what_the_file_says(seen):
    lines, located, _ = seen
    found = Calibrated(lines, Correction(lines.imager, None)).values(lines.read(0, LINES), 0, located)[0]
    assert np.allclose(found, lines.radiance(0, LINES)[0], rtol=1e-4)


def _line(located, k):
    return _lines(located, slice(k, k + 1))


def _lines(located, part):
    names = ("point", "way", "cosine", "normal", "position", "rotation", "valid")
    return type(located)(*(getattr(located, name)[part] for name in names))
