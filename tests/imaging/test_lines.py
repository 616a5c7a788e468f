"""Files of lines: what is written is read, what is wrong is named."""

import dataclasses
import errno

import netCDF4
import numpy as np
import pytest
from tests.imaging.helper import head, imager

from rovtwin.core.errors import LogError
from rovtwin.imaging import lines
from rovtwin.imaging.lines import LinesFile
from rovtwin.imaging.lines_writer import write_lines

RNG = np.random.default_rng(1)
CUBE = RNG.integers(64, 4095, (7, 12, 5)).astype(np.uint16)


@pytest.fixture
def path(tmp_path):
    return write_lines(tmp_path / "lines.h5", head(truth=True), [CUBE[:4], CUBE[4:]])


def test_lines_come_back_as_they_were(path):
    given = head(truth=True)
    with LinesFile(path) as found:
        assert found.shape == (7, 12, 5) and found.counts and found.saturation == 4095.0
        assert (found.read(2, 5) == CUBE[2:5]).all() and found.read(0, 7).dtype == np.float32
        assert np.abs(found.t - given.t).max() < 1e-6 and np.allclose(found.exposure, 0.04)
        assert (found.wavelengths == given.imager.wavelengths).all() and (found.fwhm == 4.0).all()
        assert found.imager == given.imager and found.datum == given.datum and not found.gaps
        assert found.mount and found.mount.name == "uhi.camera" and (found.mount.rotation == given.mount.rotation).all()
        assert given.truth and found.truth and found.truth.scene == "name: flat\n"
        for name in ("t", "position", "attitude", "floor"):
            assert (getattr(found.truth, name) == getattr(given.truth, name)).all()
        t, place, euler = found.navigation() or pytest.fail("no navigation")
        assert np.abs(t - given.t).max() < 1e-6 and np.allclose(euler, [0.01, -0.02, 0.5])
        assert np.abs(place - given.datum.ecef(given.navigation.position)).max() < 1e-8
        assert np.linalg.norm(place[0]) == pytest.approx(6.36e6, rel=1e-3)


def test_radiances_are_counts_less_dark_over_response_and_exposure(path):
    with LinesFile(path) as found:
        radiance, trusted = found.radiance(0, 7)
    assert np.allclose(radiance[trusted], (CUBE[trusted] - 64.0) / (2e6 * 0.04), rtol=1e-6)


def test_a_full_pixel_is_not_trusted(tmp_path):
    full = CUBE.copy()
    full[3, 4, 2] = 4095
    with LinesFile(write_lines(tmp_path / "full.h5", head(), [full])) as found:
        radiance, trusted = found.radiance(0, 7)
    assert not trusted[3, 4, 2] and np.isnan(radiance[3, 4, 2]) and trusted.sum() == full.size - (full >= 4095).sum()


def test_datasets_are_where_gref4hsi_looks_for_them(path):
    with netCDF4.Dataset(path) as file:
        for name in ("dataCube", "timestamp", "exposureTime", "calibration/spectral/band2Wavelength"):
            assert file[f"processed/radiance/{name}"].shape
        for name in ("fwhm", "band2Wavelength"):
            assert file[f"processed/radiance/calibration/spectral/{name}"].shape == (5,)
        for name in ("darkFrame", "radiometricFrame"):
            assert file[f"processed/radiance/calibration/radiometric/{name}"].shape == (12, 5)
        assert file["raw/nav/position_ecef"].shape == file["raw/nav/euler_angles"].shape == (7, 3)
        assert np.allclose(file["processed/radiance/exposureTime"][:], 40.0)  # ms
        assert file["processed/radiance/timestamp"][0] == pytest.approx(1622541600.0 + 1.0)
        assert np.allclose(file["raw/nav/euler_angles"][0, 2], np.degrees(0.5))


def test_lines_of_an_instrument_need_its_description(path):
    with netCDF4.Dataset(path, "a") as file:
        file["rovtwin"].renameVariable("imager", "other")
        file["rovtwin"].renameVariable("datum", "elsewhere")
    with pytest.raises(LogError, match="says nothing of the imager"):
        LinesFile(path)
    with LinesFile(path, imager()) as found:
        assert found.datum is None and found.t[0] == pytest.approx(1622541601.0)
    with pytest.raises(LogError, match="12 pixels a line, uhi 13"):
        LinesFile(path, imager(pixels=13))


def _with(path, name, change):
    with netCDF4.Dataset(path, "a") as file:
        file[name][:] = change(np.array(file[name][:]))


BAD = [
    (lines.STAMP, lambda t: np.where(np.arange(7) == 4, t[2], t), "line 4 is 0.05 s before that of line 3"),
    (lines.STAMP, lambda t: np.where(np.arange(7) == 4, np.nan, t), "number 4 is no number"),
    (lines.WAVELENGTHS, lambda w: w[::-1], "expected wavelengths that grow"),
    (lines.WAVELENGTHS, lambda w: 0 * w, "expected wavelengths that grow"),
    (lines.EXPOSURE, lambda e: 0 * e, "expected times above 0"),
]


@pytest.mark.parametrize(("name", "change", "message"), BAD, ids=[m for *_, m in BAD])
def test_what_is_wrong_with_a_file_is_named(path, name, change, message):
    _with(path, name, change)
    with pytest.raises(LogError, match=message):
        LinesFile(path)


def test_missing_lines_are_gaps(path):
    _with(path, lines.STAMP, lambda t: t + np.where(np.arange(7) > 3, 1.0, 0.0))
    with LinesFile(path) as found:
        assert np.allclose(found.gaps, [(1.15, 2.2)], atol=1e-6)


def test_files_that_are_none_are_named(tmp_path, path):
    with pytest.raises(LogError, match="cannot be read: No such file"):
        LinesFile(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("lines")
    with pytest.raises(LogError, match="is no HDF5 file"):
        LinesFile(tmp_path / "text.h5")
    cut = tmp_path / "cut.h5"
    cut.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(LogError, match="is damaged or cut short, 3,000 bytes .* copy it again"):
        LinesFile(cut)
    with netCDF4.Dataset(tmp_path / "other.h5", "w") as file:
        file.title = "other"
    with pytest.raises(LogError, match="no processed/radiance/dataCube; expected a file of lines"):
        LinesFile(tmp_path / "other.h5")


def test_what_cannot_be_written_leaves_nothing(tmp_path, path):
    with pytest.raises(LogError, match="exists already"):
        write_lines(path, head(), [CUBE])
    with pytest.raises(LogError, match="found 4 lines for 7 stamps"):
        write_lines(tmp_path / "short.h5", head(), [CUBE[:4]])

    def full():
        yield CUBE[:4]
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(LogError, match="Free some space"):
        write_lines(tmp_path / "short.h5", head(), full())
    backwards = dataclasses.replace(head(), t=head().t[::-1])
    with pytest.raises(LogError, match="expected stamps that grow"):
        write_lines(tmp_path / "short.h5", backwards, [CUBE])
    assert [p.name for p in tmp_path.iterdir()] == ["lines.h5"]
