"""Two mosaics held against each other by the command: files, page, and what cannot be compared."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
from rasterio.crs import CRS
from tests.mapping.change.seabed import CELL, WAVELENGTHS, albedo, planted, seen
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.formats.envi import NO_DATA, header
from rovtwin.mapping.formats.geotiff import write_layers, write_picture
from rovtwin.runs.mapping.change import difference
from rovtwin.runs.mapping.change.difference import Difference, _spoken
from rovtwin.runs.mapping.result import Mosaic

SHAPE = (140, 180)


def mosaic(folder, cube, east=0, cell=CELL, quantity="reflectance", sigma=True, slant: float | None = 0.0):
    """A folder as `rovtwin map` leaves it, of a cube (row, column, band), so many cells farther east.

    Args:
        slant: Under which all of it was seen, to the east; None: not stated.
    """
    folder.mkdir()
    grid = Grid(CRS.from_epsg(32632), 567000.0 + east * cell, 7036000.0, cell, *cube.shape[:2])
    bil = np.where(np.isfinite(cube), cube, NO_DATA).transpose(0, 2, 1).astype(np.float32)
    bil.tofile(folder / "cube.img")
    (folder / "cube.hdr").write_text(header(grid, WAVELENGTHS, np.full(12, 20.0), quantity))
    layers = {"coverage": (np.ones(grid.shape), "1")}
    if sigma:
        layers |= {"sigma": (np.full(grid.shape, 0.04), "m"), "sigma_within": (np.full(grid.shape, 0.012), "m")}
    if slant is not None:
        layers |= {"slant_x": (np.full(grid.shape, slant), "1"), "slant_y": (np.zeros(grid.shape), "1")}
    write_layers(folder / "layers.tif", grid, layers, {})
    write_picture(folder / "rgb.tif", grid, np.full((*grid.shape, 4), 120, np.uint8))
    about = {
        "quantity": quantity,
        "grid": {"crs": "EPSG:32632", "left_m": grid.left, "top_m": grid.top, "cell_m": cell} | dict(
            zip(("rows", "columns"), grid.shape, strict=True)
        ),
        "wavelengths_nm": WAVELENGTHS.tolist(),
        "figures": {"seen_m2": 1.0},
    }  # fmt: skip
    (folder / "map.json").write_text(json.dumps(about))
    return folder


def run(*arguments):
    return CliRunner().invoke(app, ["map-diff", *map(str, arguments)])


@pytest.fixture(scope="module")
def dives(tmp_path_factory):
    """Two mosaics whose edges differ, planted squares in the second, and where these are on the map."""
    folder, rng = tmp_path_factory.mktemp("dives"), np.random.default_rng(7)
    before = albedo(rng, SHAPE)
    after, places = planted(rng, before)
    first, u = seen(rng, before, (0.0, 0.0), 0.01)
    second, _ = seen(rng, after, (0.06, 0.04), 0.01)
    at = places.round().astype(int)
    places = places + u[at[:, 0], at[:, 1]]
    one, other = mosaic(folder / "may", first), mosaic(folder / "june", second[:, 10:], east=10)
    return one, other, np.column_stack([567000.0 + places[:, 1] * CELL, 7036000.0 - places[:, 0] * CELL])


@pytest.mark.system
def test_changes_are_where_they_were_planted(dives, tmp_path):
    one, other, places = dives
    out = tmp_path / "change"
    found = run(one, other, "-o", out)
    assert found.exit_code == 0, found.output
    note = json.loads((out / "change.json").read_text())
    at = np.array([[row["x_m"], row["y_m"]] for row in note["changes"]])
    inside = places[places[:, 0] > 567000.0 + 14 * CELL]
    apart = np.linalg.norm(at[:, None] - inside[None], axis=2)
    assert (apart.min(axis=0) < 0.06).mean() >= 0.8 and (apart.min(axis=1) > 0.12).sum() <= 2
    north, east = note["figures"]["shift_north_east_m"]
    assert (north, east) == pytest.approx((-0.06, 0.04), abs=0.03)  # and the means of two warps of 10 mm
    with rasterio.open(out / "change.tif") as file:
        assert file.crs.to_epsg() == 32632 and file.descriptions[:3] == ("change", "sd", "chance")
        assert file.transform.c == pytest.approx(567000.0 + 10 * CELL)
    features = json.loads((out / "changes.geojson").read_text())["features"]
    assert [one["properties"]["number"] for one in features] == list(range(1, len(at) + 1))
    assert (out / "report.html").exists() and (out / "figures" / "changes.png").exists()
    assert "exists already" in str(run(one, other, "-o", out).exception)


@pytest.mark.system
def test_errors_that_a_mosaic_does_not_state_are_assumed_in_words(dives, tmp_path):
    one, _, _ = dives
    silent = mosaic(tmp_path / "silent", Mosaic.read(one).cube.transpose(0, 2, 1), sigma=False, slant=None)
    found = run(one, silent, "-o", tmp_path / "c")
    assert found.exit_code == 0
    note = json.loads((tmp_path / "c" / "change.json").read_text())
    assert (
        "does not state how unsure" in note["remarks"][1] and "silent does not state from where" in note["remarks"][2]
    )
    assert note["changes"] == [] == note["standing_or_moved"]


@pytest.mark.system
def test_without_slants_nothing_is_explained_by_a_height(dives, tmp_path, monkeypatch):
    """Nor by what registration alone may leave, which is tried with each height: that would explain all of these."""
    one, other, _ = dives
    silent = mosaic(tmp_path / "silent", Mosaic.read(other).cube.transpose(0, 2, 1), east=10, slant=None)
    monkeypatch.setattr(difference, "explained", lambda test, *_: np.ones(test.changed.shape, bool))
    assert run(one, silent, "-o", tmp_path / "c").exit_code == 0
    note = json.loads((tmp_path / "c" / "change.json").read_text())
    assert len(note["changes"]) > 5 and not note["standing_or_moved"]
    assert not any("only elsewhere" in remark for remark in note["remarks"])


@pytest.mark.system
def test_too_few_cells_for_a_statistic_are_refused(tmp_path):
    rng = np.random.default_rng(4)
    floor = albedo(rng, (88, 88))
    later = floor.copy()
    later[30:55, 30:55] *= 0.3
    small = [cube.reshape(35, 2, 35, 2, 12).mean(axis=(1, 3)) for cube in (floor[:70, :70], later[:70, :70])]
    one, other = (mosaic(tmp_path / name, cube, cell=0.05) for name, cube in zip("ab", small, strict=True))
    found = run(one, other, "--least", 0.25, "-o", tmp_path / "c")
    assert isinstance(found.exception, LogError), found.output
    assert "cells to be compared" in str(found.exception) and "expected about 1260" in str(found.exception)
    assert not (tmp_path / "c").exists()


def test_a_contrast_that_nobody_knows_is_null_and_no_infinity():
    cells = np.ones((2, 2))
    moved = SimpleNamespace(shift=np.zeros((2, 2, 2)), sd=cells, matches=SimpleNamespace(score=[]), dropped=0)
    grid = SimpleNamespace(cell=0.02)
    test = SimpleNamespace(sd=cells)
    found = Difference([], [], np.inf, test, moved, grid, cells > 0, np.ones(1), [])  # pyright: ignore
    assert json.loads(json.dumps(found.figures, allow_nan=False))["least_contrast_named"] is None
    assert not _spoken(np.inf, 0.1, 0.1, [], 0.3)


@pytest.mark.system
def test_what_stands_above_the_floor_is_listed_apart(tmp_path):
    """A plate 25 cm above the floor, seen from either side: 10 cm apart; and a square that changed, away from it."""
    rng = np.random.default_rng(4)
    floor = albedo(rng, SHAPE)
    later, cubes = floor.copy(), []
    later[100:105, 50:55] *= 0.5
    for ground, column in ((floor, 92), (later, 87)):
        cube = ground.copy()
        cube[50:80, column : column + 40] = np.linspace(0.3, 0.6, 12)
        cubes.append(seen(rng, cube, (0.0, 0.0), 0.006)[0])
    one, other = (
        mosaic(tmp_path / name, cube, slant=slant)
        for name, cube, slant in zip(("may", "june"), cubes, (0.2, -0.2), strict=True)
    )
    changes = []
    for relief in (0.3, 0.0):
        out = tmp_path / f"c{relief}"
        assert run(one, other, "--relief", relief, "-o", out).exit_code == 0
        note = json.loads((out / "change.json").read_text())
        changes.append(note["changes"])
        features = json.loads((out / "changes.geojson").read_text())["features"]
        kinds = [feature["properties"]["kind"] for feature in features]
        assert kinds.count("change") == len(note["changes"]) == note["figures"]["changes"]
        assert (
            kinds.count("standing or moved") == len(note["standing_or_moved"]) == note["figures"]["standing_or_moved"]
        )
        assert bool(note["standing_or_moved"]) == any("only elsewhere" in remark for remark in note["remarks"])
        place = (567000.0 + 52.5 * CELL, 7036000.0 - 102.5 * CELL)
        assert any(np.hypot(row["x_m"] - place[0], row["y_m"] - place[1]) < 0.06 for row in note["changes"])
    assert len(changes[0]) <= 2 and len(changes[1]) >= len(changes[0]) + 2


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"cell": 0.04}, ("cell [m] 0.04", "--resolution")),
        ({"quantity": "radiance"}, ("quantity radiance", "expected reflectance")),
        ({"east": 5000}, ("does not overlap", "100.0 m to the east")),
    ],
)
def test_what_cannot_be_compared_is_named(dives, tmp_path, given, words):
    one, _, _ = dives
    other = mosaic(tmp_path / "other", np.full((*SHAPE, 12), 0.2), **given)
    found = run(one, other, "-o", tmp_path / "c")
    assert isinstance(found.exception, ConfigError) and all(word in str(found.exception) for word in words)
    assert not (tmp_path / "c").exists()


def test_too_small_a_thing_and_a_folder_without_a_mosaic_are_refused(dives, tmp_path):
    one, other, _ = dives
    refused = run(one, other, "--least", 0.05, "-o", tmp_path / "c").exception
    assert isinstance(refused, ConfigError) and "--least 0.05" in str(refused)
    empty = run(one, tmp_path, "-o", tmp_path / "c").exception
    assert isinstance(empty, LogError) and "map.json" in str(empty)
