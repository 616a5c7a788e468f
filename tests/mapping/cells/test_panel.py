"""A reference panel: lamps that are wrong drop out, water that is wrong as far as ranges agree; what cannot be used."""

from dataclasses import replace

import numpy as np
import pytest
from tests.imaging.helper import head, imager
from tests.mapping.helper import mount, moving

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.floor import Plane
from rovtwin.imaging.lines import LinesFile
from rovtwin.imaging.lines_writer import write_lines
from rovtwin.imaging.radiance import Radiometry, fine_wavelengths
from rovtwin.imaging.spectra.water import Constituents, SpectralWater
from rovtwin.mapping.cells.panel import Panel, look_at
from rovtwin.mapping.cells.radiometry import Calibrated, Correction, Unsure, budget
from rovtwin.mapping.georeference import Georeference
from rovtwin.simulation.imager.detector import DetectorModel

LINES, ALBEDO, GREY = 80, 0.3, 0.2
PLACE, SIDE, HEIGHT = np.array([0.75, 0.45]), 0.30, 0.10


class Scene:
    """Lines over a sloping floor of one reflectance, on it a level panel whose face is 10 cm above the floor there."""

    def __init__(self, folder):
        small, self.t = imager(pixels=60), 0.2 + 0.05 * np.arange(LINES)
        navigation = moving((0.05, -0.03, 0.2), seconds=5.0)
        self.where = Georeference(small, mount(), navigation, Plane(5.0, (0.1, 0.0)))
        located, above = (
            replace(self.where, floor=floor).locate(self.t)
            for floor in (self.where.floor, Plane(5.0 - HEIGHT, (0.1, 0.0)))
        )
        self.located = located
        water = SpectralWater.of(Constituents.model_validate({}), fine_wavelengths(small))
        self.model, detector, counts = Radiometry(small, water, 12.0), DetectorModel(small, 1), []
        self.on = (np.abs(above.point[..., :2] - PLACE) < 0.5 * SIDE).all(axis=-1)
        for i in range(LINES):
            gain, veil = self._light(located, i)
            there, before = self._light(above, i)
            light = np.where(self.on[i, :, None], there * np.float32(GREY) + before, gain * np.float32(ALBEDO) + veil)
            counts.append(detector.counts(light, i))
        given = head(LINES, pixels=60)
        own = replace(
            given, imager=small, t=self.t, exposure=np.full(LINES, small.file.exposure), dark=detector.dark_frame,
            response=detector.response_frame, saturation=detector.full, navigation=None,
        )  # fmt: skip
        self.path = write_lines(folder / "lines.h5", own, [np.stack(counts)])

    def _light(self, located, i):
        hits = type("Hits", (), {"way": located.way[i], "point": located.point[i], "normal": located.normal[i]})
        return self.model.gain_and_veil(hits, located.position[i], located.rotation[i])

    def off(self, water=1.0, lamps=1.0):
        """The model as a user has it who takes water and lamps for so many times what they are."""
        fine = self.model.at_fine
        murky = SpectralWater(water * fine.absorption, water * fine.scattering, water * fine.backscattering)
        model = replace(self.model, at_fine=murky)
        model.__dict__["intensities"] = model.intensities * np.float32(lamps)
        return model

    def error(self, lines, model, panel):
        """Median error of the floor's reflectance in the mean over lines, relative; and the panel's pixels."""
        calibrated = Calibrated(lines, Correction(lines.imager, model))
        pixels = None
        if panel is not None:
            pixels = look_at(panel, calibrated, self.where, self.t, np.ones(LINES, bool))
            factor = pixels.factor(calibrated.correction)
            calibrated = Calibrated(lines, replace(calibrated.correction, factor=factor))
        value = calibrated.values(lines.read(0, LINES), 0, self.located)[0]
        value[self.on] = np.nan
        return float(np.median(np.abs(np.nanmean(value, axis=0) / ALBEDO - 1.0))), pixels


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return Scene(tmp_path_factory.mktemp("panel"))


@pytest.fixture
def lines(scene):
    with LinesFile(scene.path) as opened:
        yield opened


def grey(**given):
    return replace(Panel("grey", PLACE, 0.09, HEIGHT, np.full(5, GREY), 0.02), **given)


def test_lamps_that_are_wrong_drop_out(scene, lines):
    noise, _ = scene.error(lines, scene.off(), None)
    without, _ = scene.error(lines, scene.off(lamps=1.25), None)
    with_panel, pixels = scene.error(lines, scene.off(lamps=1.25), grey())
    assert without > 0.18 and with_panel < noise + 0.01
    assert pixels is not None and np.allclose(
        pixels.factor(Correction(lines.imager, scene.off(lamps=1.25))), 1.25, rtol=0.02
    )


def test_water_and_lamps_that_are_wrong_lose_most_of_their_error(scene, lines):
    without, _ = scene.error(lines, scene.off(1.2, 1.1), None)
    with_panel, _ = scene.error(lines, scene.off(1.2, 1.1), grey())
    assert without > 0.10 and with_panel < 0.03
    worse, _ = scene.error(lines, scene.off(1.2, 0.9), None)
    same, _ = scene.error(lines, scene.off(1.2, 0.9), grey())
    assert worse > 0.3 and same == pytest.approx(with_panel, abs=1e-3)


def test_a_panel_alone_scales_radiances_where_nobody_describes_lamps(scene, lines):
    found, pixels = scene.error(lines, None, grey())
    assert (
        pixels is not None and 0.1 < found < 0.4
    )  # of lamps' beams and ranges: nothing is put right but the panel itself
    calibrated = Calibrated(lines, Correction(lines.imager, None, pixels.factor(Correction(lines.imager, None))))
    assert (calibrated.correction.quantity, calibrated.correction.unit) == ("reflectance", "1")
    value = calibrated.values(lines.read(0, LINES), 0, scene.located)[0]
    on = np.concatenate([value[number][on] for number, on in zip(pixels.lines, pixels.on, strict=True)])
    assert np.abs(on.mean(axis=0) / GREY - 1.0).max() < 1e-3  # so is the factor defined


def test_the_height_of_its_face_counts(scene, lines):
    _, right = scene.error(lines, scene.off(), grey())
    _, wrong = scene.error(lines, scene.off(), grey(height=0.0))
    factor = [pixels.factor(Correction(lines.imager, scene.off())) for pixels in (right, wrong)]
    assert np.abs(factor[0] - 1.0).max() < 0.02 and (factor[1] < 0.93).all()
    assert np.allclose(wrong.ways.mean() - right.ways.mean(), HEIGHT, atol=0.02)


def test_the_budget_has_the_panel_in_place_of_the_lamps_and_less_of_the_water(scene, lines):
    plain = Calibrated(lines, Correction(lines.imager, scene.off()))
    pixels = look_at(grey(), plain, scene.where, scene.t, np.ones(LINES, bool))
    scaled = Calibrated(lines, replace(plain.correction, factor=pixels.factor(plain.correction)))
    some = [(k, scene.where.locate(scene.t[k : k + 1]), lines.read(k, k + 1)) for k in (5, 40, 70)]
    unsure = Unsure(height=0.02, water=0.2, lamps=0.1)
    before, after = budget(plain, some, unsure), budget(scaled, some, unsure, pixels)
    assert (before.lamps > 0.05).all() and not after.lamps.any() and not before.panel.any()
    assert (after.water < 0.5 * before.water).all() and np.array_equal(after.panel, pixels.unsure())
    # Panel and floor are lower together, and the factor takes most of that away.
    assert (after.height < 0.5 * before.height).all() and (before.height > 0.01).all()
    assert np.allclose(pixels.unsure(), np.hypot(0.02, pixels.noise())) and (pixels.noise() > 0).all()


BAD = [
    ({"place": np.array([9.0, 0.0])}, r"found 0 pixels within 0\.09 m of north 9\.000.*comes within [0-9.]+ m"),
    ({"radius": 0.004}, "expected 20 or more"),
]


@pytest.mark.parametrize(("changed", "message"), BAD, ids=[str(list(one[0])) for one in BAD])
def test_a_panel_that_was_not_seen_or_too_small_is_named(scene, lines, changed, message):
    with pytest.raises(ConfigError, match=message):
        look_at(grey(**changed), Calibrated(lines, Correction(lines.imager, scene.off())), scene.where, scene.t,
                np.ones(LINES, bool))  # fmt: skip


def test_a_panel_on_lines_that_are_not_used_is_not_seen_and_a_full_one_is_refused(scene, lines):
    calibrated = Calibrated(lines, Correction(lines.imager, scene.off()))
    with pytest.raises(ConfigError, match="found 0 pixels"):
        look_at(grey(), calibrated, scene.where, scene.t, scene.t > 99.0)
    lines.saturation = 1.0
    with pytest.raises(ConfigError, match=r"up to 100% are full, in 5 bands from 450 to 650 nm"):
        look_at(grey(), calibrated, scene.where, scene.t, np.ones(LINES, bool))


def test_a_band_without_a_number_and_dead_pixels_are_no_full_ones(scene, lines):
    calibrated = Calibrated(lines, Correction(lines.imager, scene.off()))
    whole = look_at(grey(), calibrated, scene.where, scene.t, np.ones(LINES, bool))
    some = calibrated._per_count
    for _, over in some.values():
        over[..., 2] = np.nan  # a band without a response
        over[::4] = np.nan  # dead: a quarter of the pixels, more than may be full
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Calibrated, "_per_count", some)
        pixels = look_at(grey(), calibrated, scene.where, scene.t, np.ones(LINES, bool))
    factor, usual = (one.factor(calibrated.correction) for one in (pixels, whole))
    known = np.array([0, 1, 3, 4])
    assert np.isnan(factor[2]) and np.isnan(pixels.noise()[2])
    assert factor[known] == pytest.approx(usual[known], rel=0.02)
    assert np.isfinite(pixels.spread(calibrated.correction)[known]).all()
