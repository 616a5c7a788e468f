"""Files of a mosaic as others read them: rasterio (GDAL), Spectral Python, netCDF4, json."""

import json

import netCDF4
import numpy as np
import pytest
import rasterio
import spectral
from tests.mapping.helper import moving

from rovtwin.core.datum import Datum
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.formats.envi import NO_DATA, EnviCube, opened
from rovtwin.mapping.formats.geotiff import write_cube, write_layers, write_picture
from rovtwin.mapping.formats.netcdf import write_netcdf
from rovtwin.mapping.formats.vectors import polygons, write_geojson, write_immersion
from rovtwin.mapping.projection import Projection, crs_of

UTM = crs_of("EPSG:32632", "t")
GRID = Grid(UTM, 567820.0, 7036450.0, 0.05, 40, 30)
W, FWHM = np.array([450.0, 550.5, 650.0]), np.array([4.0, 4.0, 5.0])
CUBE = np.random.default_rng(2).random((40, 30, 3)).astype(np.float32)
CUBE[3, 4] = np.nan


@pytest.fixture
def cube(tmp_path):
    made = EnviCube(tmp_path / "cube.img", GRID, W, FWHM, "reflectance")
    made.append(CUBE[:17])
    made.append(CUBE[17:])
    made.close()
    return tmp_path / "cube.img"


def placed(file):
    assert file.crs == UTM and file.shape == (40, 30)
    assert np.allclose(file.transform[:6], (0.05, 0.0, 567820.0, 0.0, -0.05, 7036450.0))


def test_gdal_reads_the_envi_cube_where_it_lies(cube):
    with rasterio.open(cube) as file:
        placed(file)
        assert file.count == 3 and file.nodata == NO_DATA
        values = np.moveaxis(file.read(), 0, -1)
        assert np.allclose(np.where(values == NO_DATA, np.nan, values), CUBE, equal_nan=True)
        assert "450" in (file.descriptions[0] or "")
        assert float(file.tags(2)["wavelength"]) == 550.5 and "anometer" in file.tags(2)["wavelength_units"]


def test_spectral_python_reads_the_envi_cube_with_its_bands(cube):
    found = spectral.open_image(str(cube.with_suffix(".hdr")))
    assert found.shape == (40, 30, 3) and found.bands.centers == list(W) and found.bands.bandwidths == list(FWHM)
    assert found.bands.band_unit == "Nanometers"
    assert np.allclose(found.read_pixel(10, 11), CUBE[10, 11]) and (found.read_pixel(3, 4) == NO_DATA).all()
    assert found.metadata["map info"][:3] == ["UTM", "1", "1"] and found.metadata["map info"][7:9] == ["32", "North"]


def test_the_cube_as_geotiff_has_its_wavelengths_twice(cube, tmp_path):
    path = write_cube(
        tmp_path / "c.tif", GRID, opened(cube, (40, 30, 3)), W, FWHM, NO_DATA, {"quantity": "reflectance"}
    )
    with rasterio.open(path) as file:
        placed(file)
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG" and file.tags()["quantity"] == "reflectance"
        assert file.tags(2)["wavelength"] == "550.5000" and file.tags(2)["wavelength_units"] == "Nanometers"
        assert float(file.tags(2, ns="IMAGERY")["CENTRAL_WAVELENGTH_UM"]) == pytest.approx(0.5505)
        assert float(file.tags(3, ns="IMAGERY")["FWHM_UM"]) == pytest.approx(0.005)
        assert np.allclose(file.read(2, masked=True).filled(np.nan), CUBE[..., 1], equal_nan=True)
    assert [p.name for p in tmp_path.glob("*c.tif*")] == ["c.tif"]  # nothing beside it that would shadow it


def test_layers_and_picture_open_with_names_units_and_opacity(tmp_path):
    layers = {"range": (CUBE[..., 0], "m"), "coverage": (CUBE[..., 1], "1")}
    with rasterio.open(write_layers(tmp_path / "l.tif", GRID, layers, {})) as file:
        placed(file)
        assert file.descriptions == ("range", "coverage") and file.tags(1)["units"] == "m" and np.isnan(file.nodata)
    rgb = np.random.default_rng(1).integers(0, 255, (40, 30, 4)).astype(np.uint8)
    with rasterio.open(write_picture(tmp_path / "p.tif", GRID, rgb)) as file:
        placed(file)
        assert file.colorinterp[3] == rasterio.enums.ColorInterp.alpha and (file.read(1) == rgb[..., 0]).all()


def test_netcdf_has_coordinates_and_a_system_that_gdal_finds(cube, tmp_path):
    layers = {"range": (CUBE[..., 0], "m")}
    view = opened(cube, (40, 30, 3))
    path = write_netcdf(tmp_path / "m.nc", GRID, view, (W, FWHM), ("reflectance", "1"), layers, NO_DATA, {})
    with netCDF4.Dataset(path) as file:
        assert file["reflectance"].dimensions == ("wavelength", "y", "x") and file["range"].units == "m"
        system = file["spatial_ref"]
        assert system.grid_mapping_name == "transverse_mercator" and system.longitude_of_central_meridian == 9.0
        assert np.allclose(file["x"][:], GRID.x) and np.allclose(file["y"][:], GRID.y)
        values = np.moveaxis(np.ma.filled(file["reflectance"][:], np.nan), 0, -1)
        assert np.allclose(values, CUBE, equal_nan=True)
    with rasterio.open(f"netcdf:{path}:reflectance") as file:
        placed(file)


def test_gaps_are_polygons_on_the_globe_with_their_area(tmp_path):
    mask = np.zeros((40, 30), bool)
    mask[5:15, 5:25], mask[8:10, 10:12] = True, False  # a hole in it
    mask[30, 3] = True  # too small to fly for
    features = polygons(mask, GRID)
    assert len(features) == 1 and features[0]["properties"]["area_m2"] == pytest.approx((200 - 4) * 0.05**2)
    data = json.loads(write_geojson(tmp_path / "g.geojson", features, name="gaps").read_text())
    (lon, lat), *_ = data["features"][0]["geometry"]["coordinates"][0]
    assert abs(lon - 10.36) < 0.02 and abs(lat - 63.45) < 0.02 and data["type"] == "FeatureCollection"
    assert polygons(np.zeros((40, 30), bool), GRID) == []


def test_navigation_is_as_immersion_reads_it(tmp_path):
    navigation, datum = moving((0.1, -0.05, 0.5)), Datum()
    projection = Projection.of(datum, UTM, np.array([-1.0, -1.0]), np.array([3.0, 3.0]), 4.0)
    text = write_immersion(tmp_path / "n.csv", navigation, datum, projection).read_text().splitlines()
    row = text[5].split(",")
    assert len(text) == len(navigation.t) and row[:2] == ["01.06.2021", "10:00:00.500"]
    x, y = projection.to_map(navigation.position[5, :2])
    found = [float(value) for value in row[2:]]
    assert np.allclose(found, [x, y, np.degrees(-0.05), np.degrees(0.1), np.degrees(0.5), 3.4, -1.0], atol=1e-3)
