"""A mosaic classified by the command: files, areas, checks, training, and what cannot be."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
import spectral
from tests.mapping.classes.reef import CELL, NAMES, WAVELENGTHS, cube, folder_of, shares, spectra
from typer.testing import CliRunner

import rovtwin
from rovtwin.cli import app
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.mapping.classes.angle import angles
from rovtwin.runs.mapping.classification.make import classify
from rovtwin.runs.mapping.classification.places import Ground
from rovtwin.runs.mapping.classification.request import ClassifyRequest
from rovtwin.runs.mapping.classification.sources import prepare
from rovtwin.runs.mapping.classification.work import _named, classified
from rovtwin.runs.mapping.result import Mosaic

SHAPE = (60, 72)
STAR = slice(20, 32), slice(40, 54)  # of a material that the library does not have


def run(*arguments):
    return CliRunner().invoke(app, ["map-classify", *map(str, arguments)])


@pytest.fixture(scope="module")
def reef(tmp_path_factory):
    """A mosaic, the shares that it was made of, and its folder."""
    rng = np.random.default_rng(15)  # of each class 100 cells and more are pure
    a = shares(rng, SHAPE, length=9.0)
    x = cube(rng, a, spectra(rng, 0.02))
    x[STAR] = 0.3 * spectra(names=("paint_yellow",))[0]
    x[:4] = np.nan
    x[10:14, :, 30:34] = np.nan  # full in some bands
    a[STAR] = 0.0
    return a, x, folder_of(tmp_path_factory.mktemp("reef") / "mosaic", x)


def places(path, rows, head="name,north,east"):
    path.write_text("\n".join([head, *(",".join(str(one) for one in row) for row in rows)]) + "\n")
    return path


def named(folder, a, rng, count):
    """Cells of one material each, as name, north and east: the map is turned a little against these."""
    ground, found = Ground.of(Mosaic.read(folder)), []
    for k, name in enumerate(NAMES):
        low = np.where(np.arange(SHAPE[0])[:, None] > 15, a[..., k], 0.0)
        rows, columns = np.unravel_index(np.argsort(-low, axis=None)[:100], SHAPE)
        some = rng.choice(100, count, replace=False)
        xy = np.column_stack([ground.grid.x[columns[some]], ground.grid.y[rows[some]]])
        found += [(name, *np.round(place, 4)) for place in ground.projection.to_place(xy)]
    return found


@pytest.mark.system
def test_classes_lie_where_they_were_put_and_areas_are_within_their_intervals(reef, tmp_path):
    a, x, folder = reef
    out = tmp_path / "classes"
    done = run(folder, "--classes", ",".join(NAMES), "--draws", 40, "-o", out)
    assert done.exit_code == 0, done.output
    with rasterio.open(out / "classes.tif") as file:
        value, table = file.read(1), file.colormap(1)
        assert file.nodata == 255 and file.crs.to_epsg() == 32632 and file.res == (CELL, CELL)
    assert table[1][:3] == (232, 205, 140)
    assert (value[:4] == 255).all() and (value[STAR] == 0).mean() > 0.95
    sure = a.max(axis=-1) > 0.95
    sure[:4] = False
    assert (value == a.argmax(axis=-1) + 1)[sure].mean() > 0.97
    note = json.loads((out / "classes.json").read_text())
    total = note["figures"]["classified_m2"]
    assert total == pytest.approx((value != 255).sum() * CELL**2, rel=1e-3)
    assert note["figures"]["not_of_library_m2"] == pytest.approx((value == 0).sum() * CELL**2, rel=1e-3)
    true = a[4:].sum(axis=(0, 1)) / a[4:, :, 0].size * total
    for row, area in zip(note["areas"], true, strict=True):
        assert row["low_m2"] - 0.003 <= area <= row["high_m2"] + 0.003 and row["most_m2"] >= row["high_m2"]
    names = [one.text for one in ElementTree.parse(out / "classes.tif.aux.xml").iter("Category")]
    assert names == ["not of this library", *NAMES, "mixed"]
    theirs = spectral.open_image(str(out / "classes.hdr"))
    assert (theirs.read_band(0) == value).all() and theirs.metadata["class names"] == names
    with rasterio.open(out / "abundance.tif") as file:
        share = file.read([1, 2, 3, 4])
        assert file.descriptions[:5] == (*NAMES, "sand sd")
    assert np.nansum(share, axis=0)[value != 255][value[value != 255] > 0] == pytest.approx(1.0, abs=1e-5)
    assert np.isnan(share[:, value == 0]).all()
    assert (out / "report.html").exists() and "not of this library" in (out / "report.html").read_text()
    assert "exists already" in str(run(folder, "-o", out).exception)


@pytest.mark.system
def test_training_places_and_check_points(reef, tmp_path):
    a, x, folder = reef
    rng = np.random.default_rng(3)
    train = places(tmp_path / "train.csv", named(folder, a, rng, 3))
    rows = named(folder, a, rng, 12)
    check = places(tmp_path / "check.csv", rows)
    found = rovtwin.map_classify(folder, tmp_path / "c", train=train, check=check, draws=40)
    areas = found.to_pandas()
    total = found.about["figures"]["classified_m2"]
    true = a[4:].sum(axis=(0, 1)) / a[4:, :, 0].size * total
    assert areas["area_m2"].loc[list(NAMES)].to_numpy() == pytest.approx(true, abs=0.05 * total)
    figures = found.about["figures"]
    assert found.about["checks"]["overall"] > 0.95
    assert figures["checked_accuracy"] == pytest.approx(
        found.about["checks"]["overall"], abs=0.03
    )  # of what has points
    assert any(one.startswith("fewer than 20 check points on sand, kelp") for one in found.remarks())
    assert (areas["checked_low_m2"] <= areas["checked_m2"]).all()
    assert any("fewer than 2 check points on" in one for one in found.remarks())
    assert any("spectra of the mosaic itself" in one for one in found.remarks())
    assert repr(found).startswith("<Classification: 4 classes on") and found.plot().get_title()
    radiance = folder_of(tmp_path / "radiance", 7.0 * x, "radiance", 7.0 * 0.004)
    again = rovtwin.map_classify(radiance, tmp_path / "r", train=train, draws=40)
    with rasterio.open(tmp_path / "c" / "classes.tif") as one, rasterio.open(again.folder / "classes.tif") as other:
        assert (one.read(1) == other.read(1)).mean() > 0.98
    assert "expected some of" in str(run(folder, "--train", train, "--check", places(
        tmp_path / "k.csv", [("klep", *rows[0][1:])]), "-o", tmp_path / "k").exception)  # fmt: skip


@pytest.mark.system
def test_a_missing_material_a_fixed_brightness_and_a_limit_of_ones_own(reef, tmp_path):
    a, _, folder = reef
    rest = ("sand", "maerl", "mud")
    found = rovtwin.map_classify(folder, tmp_path / "a", classes=rest, draws=40)
    kelp = a[4:, :, 1].sum() / a[4:, :, 0].size
    f = found.about["figures"]
    assert f["not_of_library_m2"] > 0.7 * kelp * f["classified_m2"]  # 18 deg and more from all others
    fixed = rovtwin.map_classify(folder, tmp_path / "b", classes=NAMES, fixed_brightness=True, draws=40)
    with rasterio.open(fixed.folder / "abundance.tif") as file:
        assert np.nanmax(np.abs(file.read(9) - 1.0)) < 1e-4
    tight = rovtwin.map_classify(folder, tmp_path / "c", classes=NAMES, threshold={"": 0.3}, draws=40)
    assert tight.about["figures"]["not_of_library_m2"] > 0.5 * f["classified_m2"]


def library(path, w=WAVELENGTHS, **columns):
    rows = [",".join(map(str, row)) for row in zip(w, *columns.values(), strict=True)]
    path.write_text("\n".join([",".join(["wavelength", *columns]), *rows]) + "\n")
    return path


def test_what_does_not_go_together_is_named(reef, tmp_path):
    _, x, folder = reef
    sand, kelp = spectra()[:2]
    far = library(tmp_path / "far.csv", WAVELENGTHS + 600.0, a=sand, b=kelp)
    same = library(tmp_path / "same.csv", a=sand, pale=0.5 * sand)
    out = places(tmp_path / "out.csv", [("sand", 900.0, 0.0)])
    nowhere = places(tmp_path / "nowhere.csv", [("sand", -0.01, 0.2)])
    radiance = folder_of(tmp_path / "radiance", x, "radiance")
    rng = np.random.default_rng(4)
    many = library(tmp_path / "many.csv", **{f"c{k}": rng.uniform(0.1, 0.4, len(sand)) for k in range(len(sand))})
    black = library(tmp_path / "black.csv", sand=sand, tar=0.0 * sand)
    sums = library(tmp_path / "sums.csv", sand=sand, kelp=kelp, mud=spectra()[3], blend=0.3 * sand + 0.7 * kelp)
    reserved = library(tmp_path / "reserved.csv", sand=sand, Mixed=kelp)
    other = places(tmp_path / "other.csv", [("sand", -0.3, 0.3), ("other", -0.3, 0.3)])
    for arguments, words in (
        ((folder, "--library", far), "they share 0 bands"),
        ((folder, "--library", same), "a and pale have spectra of one shape"),
        ((folder, "--classes", "sand,seagrass"), "found 'seagrass', expected some of sand, mud"),
        ((folder, "--classes", "sand,sand"), "names 'sand' twice"),
        ((folder, "--classes", "grey_20,white_50"), "tells apart"),
        ((folder, "--library", many), "found 41 classes, expected at most 36"),
        ((folder, "--library", black), "tar is 0 in all 37 bands"),
        ((folder, "--library", sums), "nearly a sum of multiples of sand, kelp"),
        ((folder, "--library", reserved), "reserved.csv: found a class 'Mixed', expected none of mixed"),
        ((folder, "--train", other), "other.csv: row 3: found a class 'other'"),
        ((folder, "--train", other, "--classes", "sand"), "--train, --classes: expected one of them"),
        ((folder, "--train", out), "lies outside the mosaic"),
        ((folder, "--train", nowhere), "no cell within 0.04 m has all"),
        ((folder, "--train", out, "--library", far), "expected one of them"),
        ((folder, "--threshold", "kelp=x"), "--threshold: found 'kelp=x'"),
        ((folder, "--threshold", "klep=4"), "expected some of sand"),
        ((radiance,), "holds radiance, and a library has reflectances"),
    ):
        refused = run(*arguments, "-o", tmp_path / "c").exception
        assert isinstance(refused, ConfigError) and words in str(refused), (arguments, refused)
    assert not (tmp_path / "c").exists()
    assert isinstance(run(tmp_path, "-o", tmp_path / "c").exception, LogError)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"classes": "sand,kelp"}, "classes: found 'sand,kelp', expected several names"),
        ({"variability": float("nan")}, "variability: found nan, expected 0 to 30 deg"),
        ({"threshold": 6.0}, "threshold: found 6.0, expected degrees by class"),
        ({"threshold": {"kelp": 0.0}}, "threshold of 'kelp': found 0.0"),
        ({"draws": 10}, "draws: found 10, expected 0, or 40 or more"),
        ({"seed": -1}, "seed: found -1, expected a whole number"),
    ],
)
def test_settings_out_of_range_are_named(settings, words):
    with pytest.raises(ConfigError, match=words):
        ClassifyRequest(**settings)


def test_a_folder_that_cannot_be_made_is_refused_before_the_work(reef, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="file is no folder, expected one that"):
        classify(Mosaic.read(reef[2]), ClassifyRequest(), tmp_path / "file" / "x", lambda *_: pytest.fail("worked"))


def test_cells_with_fewer_bands_than_classes_are_named_by_their_angle(reef):
    prepared = prepare(Mosaic.read(reef[2]), ClassifyRequest(classes=NAMES))
    E = prepared.classes.spectra
    known = np.zeros(E.shape, bool)
    known[:, ::12] = True
    x = np.where(known, E, 0.0)
    assert known.sum(axis=1).max() <= len(NAMES)
    near = angles(x, known, E, np.ones((len(E), 1)) * prepared.noise)
    shares_of = prepared.unmixing.shares(x, known, np.ones(len(E)))
    assert np.isnan(shares_of.value).all()
    assert _named(prepared, near, shares_of, known.sum(axis=1))[0].tolist() == [1, 2, 3, 4]


def test_areas_are_all_of_what_is_named_where_cells_have_no_shares(reef, tmp_path):
    x = np.full(reef[1].shape, np.nan)
    x[:, :, 3::7] = reef[1][:, :, 3::7]
    x[50:54, :, 18:] = np.nan  # three bands, four classes
    found = classified(prepare(Mosaic.read(folder_of(tmp_path / "few", x)), ClassifyRequest(classes=NAMES, draws=0)))
    assert len(found.prepared.bands) == 5 and (found.layers.value[50:54] <= len(NAMES)).all()
    assert np.isnan(found.layers.share[50:54]).all() and (found.layers.value[50:54] > 0).any()
    assert found.areas.unmixed.sum() + found.areas.outside == pytest.approx(1.0, abs=1e-6)
    assert np.isfinite(found.means[found.cells > 0]).all()
