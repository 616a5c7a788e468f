"""The file of a reference panel: read, or named with what is wrong in it; what is said of its range."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.runs.mapping.classification.sources import _errors
from rovtwin.runs.mapping.panel import about_range, read_panel

BANDS, FWHM = np.array([450.0, 500.0, 550.0, 600.0, 650.0]), np.full(5, 4.0)
WHOLE = "north: 1.0\neast: 2.0\nradius: 0.1\nreflectance: 0.2\n"


def panel(folder, text, spectrum=None):
    (folder / "panel.yaml").write_text(text)
    if spectrum is not None:
        (folder / "grey.csv").write_text(spectrum)
    return read_panel(folder / "panel.yaml", Datum(63.45, 10.36), BANDS, FWHM)


def test_one_number_holds_in_all_bands_and_a_spectrum_is_averaged_over_each(tmp_path):
    flat = panel(tmp_path, WHOLE)
    assert flat.reflectance.tolist() == [0.2] * 5 and flat.place.tolist() == [1.0, 2.0] and flat.sd == 0.02
    rows = "\n".join(f"{w},{0.1 + 0.001 * (w - 450)}" for w in range(450, 651, 5))  # ends at the outer bands
    sloping = panel(tmp_path, WHOLE.replace("0.2", "grey.csv"), f"wavelength,reflectance\n{rows}\n")
    assert np.allclose(sloping.reflectance, [0.1, 0.15, 0.2, 0.25, 0.3], atol=1e-12)


def test_a_place_in_degrees_is_that_place(tmp_path):
    text = WHOLE.replace("north: 1.0\neast: 2.0", "latitude: 63.45001\nlongitude: 10.36")
    assert np.allclose(panel(tmp_path, text).place, [1.115, 0.0], atol=2e-3)


BAD = [
    (WHOLE + "latitude: 63.0\n", None, "expected north and east .m., or latitude and longitude"),
    (WHOLE.replace("east: 2.0\n", ""), None, "expected north and east"),
    (WHOLE.replace("radius: 0.1\n", ""), None, "radius"),
    (WHOLE.replace("0.2", "20"), None, "reflectance"),
    (WHOLE.replace("0.2", "0.0"), None, "expected more than 0 in all bands"),
    (WHOLE.replace("0.2", "none.csv"), None, "--panel: reflectance .*none.csv: cannot be read"),
    (WHOLE.replace("0.2", "grey.csv"), "wavelength,a\n460,0.2\n700,0.2\n", "460 to 700 nm, expected .* 450 to 650 nm"),
    (
        WHOLE.replace("0.2", "grey.csv"),
        "wavelength,a,b\n400,0.2,0.2\n700,0.2,0.2\n",
        "has 2 spectra, expected one",
    ),
    (WHOLE.replace("0.2", "grey.csv"), "nm,a\n400,0.2\n700,0.2\n", "--panel: reflectance .*expected wavelength"),
]


@pytest.mark.parametrize(("text", "spectrum", "message"), BAD, ids=[str(k) for k in range(len(BAD))])
def test_what_is_wrong_in_the_file_is_named(tmp_path, text, spectrum, message):
    with pytest.raises(ConfigError, match=message):
        panel(tmp_path, text, spectrum)


def test_what_a_panel_cannot_put_right_is_in_the_remark():
    seen = SimpleNamespace(pixels=SimpleNamespace(ways=np.array([1.1, 1.3])))
    ways = np.linspace(1.0, 2.0, 101).reshape(1, -1)
    for modelled, given, words in ((False, False, "nothing corrects for range"), (True, False, "a guess"),
                                   (True, True, "as stated")):  # fmt: skip
        remark = about_range(seen, ways, modelled, given)  # type: ignore[arg-type]  (a stand-in)
        assert remark.startswith("panel at 1.20 m, the mosaic at 1.05 to 1.95 m (5 %, 95 %)") and words in remark


@pytest.mark.parametrize("older", [False, True])
def test_classes_count_the_error_of_a_panel_in_place_of_that_of_the_lamps(older):
    stated = {"height": 0.03 * np.ones(5), "water": 0.1 * np.ones(5), "lamps": np.zeros(5), "panel": 0.02 * np.ones(5)}
    if older:  # made before panels were
        stated |= {"lamps": 0.05 * np.ones(5), "panel": None}
    mosaic = SimpleNamespace(budget=lambda name, later=False: stated[name])
    errors, remarks = _errors(mosaic, np.arange(5))  # type: ignore[arg-type]  (a stand-in)
    assert set(errors) == {"height", "water", "lamps" if older else "panel"} and not remarks
