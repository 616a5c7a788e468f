"""Libraries: CSV, ENVI as SPy writes it, resampled to bands, and what is none."""

import numpy as np
import pytest
from spectral.io import envi

from rovtwin.core.errors import ConfigError
from rovtwin.mapping.classes.library import Library, made_here, read_library, similarity

W = np.arange(380.0, 801.0, 5.0)


def csv(path, head, *columns):
    rows = [",".join(f"{x:.6g}" if np.isfinite(x) else "" for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def test_a_table_is_read_in_the_order_of_wavelengths_with_its_gaps(tmp_path):
    sand = 0.1 + W / 4000.0
    sand[10] = np.nan
    found = read_library(csv(tmp_path / "l.csv", "wavelength_nm, sand, kelp", W[::-1], sand[::-1], 0 * W + 0.05))
    assert found.names == ("sand", "kelp") and found.wavelengths.tolist() == W.tolist()
    np.testing.assert_allclose(found.spectra[0], sand, atol=1e-6)
    assert found.chosen(("kelp",)).spectra.shape == (1, len(W))


@pytest.mark.parametrize("unit", ["nanometers", "micrometers", "\u00b5m", "\u03bcm"])
def test_an_envi_library_of_spy_is_read_by_its_header_and_by_its_numbers(tmp_path, unit):
    spectra = np.array([np.linspace(0.1, 0.4, len(W)), np.linspace(0.3, 0.2, len(W))])
    w = W if unit == "nanometers" else 1e-3 * W
    head = {"wavelength": w.tolist(), "wavelength units": unit, "spectra names": ["pale sand", "mud"]}
    envi.SpectralLibrary(spectra, head).save(str(tmp_path / "site"))
    for name in ("site.hdr", "site.sli"):
        found = read_library(tmp_path / name)
        assert found.names == ("pale sand", "mud") and found.wavelengths == pytest.approx(W)
        np.testing.assert_allclose(found.spectra, spectra, rtol=1e-6)


def test_bands_are_means_by_their_width_and_none_where_the_library_ends():
    w = np.arange(400.0, 701.0, 0.5)
    line = np.exp(-0.5 * ((w - 550.0) / 6.0) ** 2)
    library = Library(("line", "slope"), w, np.array([line, w / 1000.0]), "here")
    bands, fwhm = np.array([390.0, 500.0, 550.0, 560.0, 699.0]), np.full(5, 2.3548 * 4.0)
    found = library.resampled(bands, fwhm)
    assert np.isnan(found[:, [0, 4]]).all()
    assert found[1, 1:4] == pytest.approx(bands[1:4] / 1000.0, rel=1e-6)
    wide = np.hypot(6.0, 4.0)  # two Gaussians one after the other; the bands' tails beyond a width are cut
    assert found[0, 2:4] == pytest.approx(6.0 / wide * np.exp(-0.5 * ((bands[2:4] - 550.0) / wide) ** 2), rel=0.02)


def test_materials_made_here_are_apart_but_for_flat_paints():
    library = made_here()
    between = np.degrees(similarity(library.spectra))
    flat = [library.names.index(name) for name in ("white_50", "grey_20", "black_3")]
    assert between[np.ix_(flat, flat)].max() < 1e-6
    assert np.sort(between[0])[1] > 1.0 and between == pytest.approx(between.T)


@pytest.mark.parametrize(
    ("head", "factor", "words"),
    [
        ("wavelength,sand,sand", 1.0, "has 'sand' twice"),
        ("wavelength,sand,mud", 100.0, "Divide what is in percent by 100"),
        ("name,sand,mud", 1.0, "expected wavelength,name1"),
        ("wavelength,sand", 1.0, "found 3 cells, expected 2"),
    ],
)
def test_what_is_no_library_is_named(tmp_path, head, factor, words):
    with pytest.raises(ConfigError, match=words):
        read_library(csv(tmp_path / "l.csv", head, W, 0 * W + 0.3 * factor, 0 * W + 0.2))


def test_micrometres_words_a_missing_file_and_a_cube_are_named(tmp_path):
    with pytest.raises(ConfigError, match="expected nm"):
        read_library(csv(tmp_path / "um.csv", "wavelength,a,b", 1e-3 * W, 0 * W + 0.1, 0 * W + 0.2))
    (tmp_path / "w.csv").write_text("wavelength,a\n400,dark\n500,0.2\n")
    with pytest.raises(ConfigError, match="row 2: found 'dark' for a"):
        read_library(tmp_path / "w.csv")
    with pytest.raises(ConfigError, match="cannot be read"):
        read_library(tmp_path / "none.csv")
    (tmp_path / "cube.hdr").write_text("ENVI\nfile type = ENVI Standard\nsamples = 3\n")
    with pytest.raises(ConfigError, match="expected the header of an ENVI spectral library"):
        read_library(tmp_path / "cube.hdr")
    with pytest.raises(ConfigError, match="expected some of sand"):
        made_here().chosen(("sand", "seagrass"))


def integers(folder, offset=0, **fields):
    """An ENVI library of two spectra in ten-thousandths, one of which lacks a value."""
    values = np.full((2, len(W)), 2500, "<i2")
    values[1, 3] = -999
    values.tofile(folder / "l.sli")
    head = {
        "samples": len(W),
        "lines": 2,
        "data type": 2,
        "file type": "ENVI Spectral Library",
    }
    head |= {"wavelength": "{" + ", ".join(map(str, W)) + "}", "spectra names": "{sand, mud}"}
    head["header offset"] = offset
    head |= {name.replace("_", " "): value for name, value in fields.items()}
    (folder / "l.hdr").write_text("\n".join(["ENVI", *(f"{name} = {value}" for name, value in head.items())]) + "\n")
    return folder / "l.hdr"


def test_values_to_ignore_are_those_of_the_file_before_they_are_scaled(tmp_path):
    found = read_library(integers(tmp_path, reflectance_scale_factor=10000, data_ignore_value=-999))
    assert np.isnan(found.spectra[1, 3]) and np.isnan(found.spectra).sum() == 1
    assert np.nanmax(found.spectra) == np.nanmin(found.spectra) == 0.25


def test_negative_reflectances_and_offsets_beyond_the_file_are_named(tmp_path):
    with pytest.raises(ConfigError, match=r"mud has -0\.0999 at 395 nm, expected reflectances"):
        read_library(integers(tmp_path, reflectance_scale_factor=10000))
    with pytest.raises(ConfigError, match="found a header offset of 5000, expected less than the 340 bytes"):
        read_library(integers(tmp_path, offset=5000))
    with pytest.raises(ConfigError, match="found a reflectance scale factor of 0"):
        read_library(integers(tmp_path, reflectance_scale_factor=0))
    with pytest.raises(ConfigError, match=r"sand has -0\.05 at 380 nm"):
        read_library(csv(tmp_path / "l.csv", "wavelength,sand", W, np.where(W < 385.0, -0.05, 0.2)))
