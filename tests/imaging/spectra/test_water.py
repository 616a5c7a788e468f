"""Water by wavelength, against tables and against the figures of a coastal dive."""

import numpy as np
import pytest
from tests.imaging.helper import imager

from rovtwin.imaging.spectra.light import black_body, lamp_exponent, lamp_intensity
from rovtwin.imaging.spectra.materials import MATERIALS, reflectance
from rovtwin.imaging.spectra.pure_water import pure_absorption, pure_scattering
from rovtwin.imaging.spectra.water import BACK, Constituents, SpectralWater
from rovtwin.simulation.camera.water import Optics
from rovtwin.simulation.imager.water import spectral_water
from rovtwin.simulation.scene.schema import BANDS, WATERS, Water

NM = np.arange(380.0, 801.0, 2.5)
COAST = SpectralWater.of(Constituents(), NM)


def at(spectrum: np.ndarray, wavelength: float) -> float:
    return float(np.interp(wavelength, NM, spectrum))


@pytest.mark.parametrize(
    ("wavelength", "expected"), [(450, 0.37), (550, 0.47), (700, 0.10), (720, 0.017), (750, 1.2e-4)]
)
def test_two_way_transmission_in_coastal_water(wavelength, expected):
    """1.5 m up, the lamp 0.3 m aside. At 750 nm 4e-4 goes with 2.47/m of Smith and Baker (1981) in place of Kou's."""
    ways = 1.5 + np.hypot(1.5, 0.3)
    assert np.exp(-at(COAST.beam, wavelength) * ways) == pytest.approx(expected, rel=0.07)
    if wavelength == 750:
        assert np.exp(-(at(COAST.beam, 750) - 2.848 + 2.47) * ways) == pytest.approx(4e-4, rel=0.07)


def test_pure_water_is_that_of_the_tables():
    assert np.allclose(pure_absorption(np.array([440.0, 550.0, 600.0, 700.0])), [0.00635, 0.0565, 0.2224, 0.624])
    assert np.allclose(pure_absorption(np.array([740.0, 760.0])), [2.768, 2.861])  # Kou et al. (1993)
    assert np.allclose(pure_absorption(np.array([300.0])), 0.01137)
    assert pure_scattering(np.array([400.0]))[0] == pytest.approx(0.0076, rel=0.01)  # Morel (1974), sea water
    step = np.diff(pure_absorption(np.array([725.0, 727.0])))  # no jump where one table ends
    assert 0 < step < 0.25


def test_what_is_in_the_water_adds_up():
    pure = SpectralWater.of(Constituents(cdom_440=0, scattering_550=0), NM)
    assert np.allclose(pure.beam, pure_absorption(NM) + pure_scattering(NM))
    assert np.allclose(pure.backscattering, 0.5 * pure_scattering(NM))
    stained = SpectralWater.of(Constituents(cdom_440=0.5, scattering_550=0, cdom_slope=0.02), NM)
    assert np.allclose(stained.absorption - pure.absorption, 0.5 * np.exp(-0.02 * (NM - 440.0)))
    turbid = SpectralWater.of(Constituents(cdom_440=0, scattering_550=2.0, scattering_exponent=0.5), NM)
    assert np.allclose(turbid.scattering - pure.scattering, 2.0 * np.sqrt(550.0 / NM))
    assert np.allclose(turbid.backscattering - pure.backscattering, BACK * 2.0 * np.sqrt(550.0 / NM))
    green = SpectralWater.of(Constituents(cdom_440=0, scattering_550=0, chlorophyll=2.0), NM)
    assert at(green.absorption - pure.absorption, 440) == pytest.approx(0.10, rel=1e-3)
    assert (turbid.diffuse > turbid.absorption).all() and (turbid.diffuse < turbid.beam).all()


@pytest.mark.parametrize("kind", WATERS)
def test_the_imager_sees_the_water_that_cameras_see(kind):
    water = Water.model_validate({"type": kind})
    seen, spectral = Optics.of(water), spectral_water(water, BANDS)
    assert np.allclose(spectral.absorption, seen.absorption, atol=2e-6)
    assert np.allclose(spectral.scattering, np.maximum(seen.scattering, pure_scattering(BANDS)))
    between = spectral_water(water, NM)
    assert (between.absorption >= pure_absorption(NM)).all() and np.isfinite(between.beam).all()


def test_cameras_see_the_water_that_is_given_by_its_constituents():
    seen = Optics.of(Water.model_validate({"constituents": {"scattering_550": 0.5}}))
    assert np.allclose(seen.beam, SpectralWater.of(Constituents(scattering_550=0.5), BANDS).beam)


def test_a_lamp_gives_its_radiant_flux():
    lamp = imager().file.lamps[0]
    fine, angle = np.linspace(380.0, 800.0, 4201), np.linspace(0.0, 0.5 * np.pi, 20001)
    beam = np.trapezoid(2 * np.pi * np.sin(angle) * np.cos(angle) ** lamp_exponent(lamp), angle)
    assert beam * np.trapezoid(lamp_intensity(lamp, fine), fine) == pytest.approx(lamp.radiant_flux, rel=1e-5)
    assert np.cos(np.radians(0.5 * lamp.beam_deg)) ** lamp_exponent(lamp) == pytest.approx(0.5)


def test_black_bodies_are_brightest_where_wien_says():
    nm = np.arange(300.0, 900.0, 0.5)
    assert nm[np.argmax(black_body(nm, 5000.0))] == pytest.approx(2.8977719e6 / 5000.0, abs=0.5)
    assert black_body(np.array([550.0]), 3000.0)[0] == 1.0


def test_materials_reflect_a_share_of_the_light_and_differ():
    found = {name: reflectance(name, np.arange(300.0, 901.0)) for name in MATERIALS}
    for name, spectrum in found.items():
        assert 0.0 < spectrum.min() and spectrum.max() < 1.0, name
    seen = {k: reflectance(k, NM[(NM >= 400) & (NM <= 700)]) for k in ("sand", "mud", "kelp", "maerl", "coral", "rust")}
    for a in seen:
        for b in seen:
            cosine = seen[a] @ seen[b] / np.linalg.norm(seen[a]) / np.linalg.norm(seen[b])
            assert a == b or np.degrees(np.arccos(cosine)) > 5.0, (a, b)
