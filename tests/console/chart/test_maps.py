"""Maps under the chart: things lie where the datum puts them, whatever file they come from."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("rasterio", reason="maps need rasterio: pip install 'rovtwin[map]'")

import rasterio
from rasterio.shutil import copy
from rasterio.transform import from_origin
from rasterio.warp import transform

from rovtwin.console.chart.maps import MOST_PIXELS, SIDE, describe, plane_of, tile
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.mapping.projection import project

DATUM = Datum(63.44, 10.42, 40.0)
RED, GREY = (255, 0, 0), 120
MARK = (31.0, 47.0)  # north and east of a red mark [m]
SYSTEMS = {"EPSG:32632": 0.5, "EPSG:3857": 1.0, "EPSG:4326": 5e-6}  # and pixels of files, in its unit


def picture(system: str, pixel: float, at=MARK, side: int = 700) -> tuple[np.ndarray, object]:
    """Grey around the datum, with a red mark of 5 x 5 pixels about a place; and what places it."""
    (x, y), (u, v) = project(DATUM, system, np.array([[0.0, 0.0, 0.0], [*at, 0.0]]))
    step = from_origin(x - side / 2 * pixel, y + side / 2 * pixel, pixel, pixel)
    colours = np.full((3, side, side), GREY, np.uint8)
    column, row = ~step @ (u, v)
    colours[:, int(row) - 2 : int(row) + 3, int(column) - 2 : int(column) + 3] = np.array(RED)[:, None, None]
    return colours, step


def written(path: Path, values: np.ndarray, step: object, system: str | None, **more) -> Path:
    count, height, width = values.shape
    kind = {"count": count, "height": height, "width": width, "dtype": values.dtype, "crs": system, "transform": step}
    with rasterio.open(path, "w", driver=more.pop("driver", "GTiff"), **kind | more) as file:
        file.write(values)
    return path


def seen(file, level: int, place=MARK) -> tuple[np.ndarray, np.ndarray]:
    """A tile about a place, and where its red pixels are in the mean, north and east [m]."""
    size = SIDE * 2.0**-level
    row, column = (int(np.floor(value / size)) for value in place)
    pixels = np.asarray(Image.open(io.BytesIO(tile(file, DATUM, level, row, column)))).astype(int)
    v, u = (np.argwhere((pixels[..., 0] > 180) & (pixels[..., 1] < 90)) + 0.5).mean(axis=0)
    return pixels, np.array([(row + 1) * size - v * 2.0**-level, column * size + u * 2.0**-level])


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_place_of_the_file_lies_where_the_datum_puts_it(tmp_path, system):
    pixel = SYSTEMS[system]
    file = describe(written(tmp_path / "a.tif", *picture(system, pixel), system), DATUM)
    for level in (2, 1):
        _, place = seen(file, level)
        np.testing.assert_allclose(place, MARK, atol=0.6 * file.pixel)  # a mark of whole pixels is off by half of one
    assert file.north[0] < -100 < 100 < file.north[1] and file.shades is None


@pytest.mark.parametrize("driver", ["GPKG", "MBTiles"])
def test_tiles_of_others_are_read(tmp_path, driver):
    plain = written(tmp_path / "a.tif", *picture("EPSG:3857", 1.19432856696), "EPSG:3857")  # as zoom level 17 has it
    path = tmp_path / f"a.{driver.lower()}"
    if driver == "GPKG":
        copy(plain, path, driver=driver)
    else:
        copy(plain, path, driver=driver, TILE_FORMAT="PNG")
    file = describe(path, DATUM)
    _, place = seen(file, 1)
    np.testing.assert_allclose(place, MARK, atol=0.8 * file.pixel)


def test_the_plane_is_that_of_the_datum():
    """PROJ's projection against the datum's own conversion, to 10 km: the plane's lean makes 1 cm of it there."""
    places = np.random.default_rng(1).uniform(-7000, 7000, (50, 2))
    latitude, longitude, _ = DATUM.geodetic(np.column_stack([places, np.zeros(50)]))
    east, north, *_ = transform("EPSG:4326", plane_of(DATUM), longitude.tolist(), latitude.tolist())
    np.testing.assert_allclose(np.column_stack([north, east]), places, atol=0.07)
    near = np.abs(places).max(axis=1) < 1000
    np.testing.assert_allclose(np.column_stack([north, east])[near], places[near], atol=0.01)


def test_depths_become_shades_and_what_is_not_known_stays_clear(tmp_path):
    _, step = picture("EPSG:32632", 1.0, side=400)
    depth = np.tile(np.linspace(-40, -10, 400, dtype=np.float32), (1, 400, 1))
    depth[:, :, :60] = -9999.0
    file = describe(written(tmp_path / "d.tif", depth, step, "EPSG:32632", nodata=-9999.0), DATUM)
    np.testing.assert_allclose(file.shades, (-35, -10.5), atol=1.0)
    pixels = np.asarray(Image.open(io.BytesIO(tile(file, DATUM, 0, 0, 0)))).astype(int)
    assert (np.diff(pixels[200, 10:190, 0]) >= 0).all() and pixels[200, 180, 0] > pixels[200, 20, 0] + 100
    west = np.asarray(Image.open(io.BytesIO(tile(file, DATUM, 0, 0, -1)))).astype(int)
    assert west[200, 70, 3] == 0 and west[200, 200, 3] == 255  # outside of the file and without a depth; a depth


def test_a_palette_keeps_its_colours(tmp_path):
    _, step = picture("EPSG:32632", 1.0, side=300)
    values = np.full((1, 300, 300), 7, np.uint8)
    path = written(tmp_path / "p.tif", values, step, "EPSG:32632", photometric="palette")
    with rasterio.open(path, "r+") as file:
        file.write_colormap(1, {7: (10, 200, 30, 255)})
    pixels = np.asarray(Image.open(io.BytesIO(tile(describe(path, DATUM), DATUM, 1, 0, 0))))
    assert tuple(pixels[40, 40]) == (10, 200, 30, 255)


def test_coarse_tiles_come_from_overviews(tmp_path):
    """Whose colour is another one here, so that it can be told."""
    colours, step = picture("EPSG:32632", 0.5, side=1024)
    path = written(tmp_path / "o.tif", colours, step, "EPSG:32632", tiled=True)
    with rasterio.open(path, "r+") as file:
        file.build_overviews([2, 4, 8])
    with rasterio.open(path, "r+", overview_level=2) as overview:
        overview.write(np.full((3, *overview.shape), 250, np.uint8))
    file = describe(path, DATUM)
    fine, coarse = (np.asarray(Image.open(io.BytesIO(tile(file, DATUM, z, 0, 0)))) for z in (0, -2))
    assert fine[100, 100, 0] == GREY and coarse[-20, 20, 0] == 250


def test_nothing_is_made_where_the_file_is_not(tmp_path):
    file = describe(written(tmp_path / "a.tif", *picture("EPSG:32632", 0.5), "EPSG:32632"), DATUM)
    assert tile(file, DATUM, 0, 20, 20) is None
    Path(file.path).unlink()
    with pytest.raises(ConfigError, match="cannot be read any more"):
        tile(describe_again(file, tmp_path), DATUM, 0, 0, 0)


def describe_again(file, folder):
    from dataclasses import replace

    return replace(file, path=str(folder / "gone.tif"))


def test_what_is_no_map_of_this_place_is_refused_in_words(tmp_path):
    colours, step = picture("EPSG:32632", 0.5)
    (tmp_path / "text.tif").write_text("no raster")
    (tmp_path / "chart.000").write_text("S-57")
    bad = {
        tmp_path / "nowhere.tif": "cannot be read: No such file",
        tmp_path: "cannot be read",
        tmp_path / "text.tif": "cannot be read as a raster",
        tmp_path / "chart.000": "S-57 too, have to be drawn first",
        written(tmp_path / "bare.tif", colours, step, None): "says no coordinate system",
    }
    for path, message in bad.items():
        with pytest.raises(ConfigError, match=message):
            describe(path, DATUM)
    file = written(tmp_path / "a.tif", colours, step, "EPSG:32632")
    with pytest.raises(ConfigError, match="more than 10 km from the datum"):
        describe(file, Datum(62.0, 10.0))
    side = int(np.sqrt(MOST_PIXELS)) + 1
    sparse = {"driver": "GTiff", "count": 1, "dtype": "uint8", "tiled": True, "sparse_ok": True, "crs": "EPSG:32632"}
    with rasterio.open(tmp_path / "large.tif", "w", width=side, height=side, transform=step, **sparse):
        pass
    with pytest.raises(ConfigError, match="gdaladdo -r average"):
        describe(tmp_path / "large.tif", DATUM)
