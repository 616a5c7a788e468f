"""Floors: elevation models in other coordinate systems, and what an altimeter's track tells of what lies between."""

import numpy as np
import pytest
import rasterio
from tests.mapping.helper import moving

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.mapping.altimeter import Altimeter, altimeter_hits, surface_through
from rovtwin.mapping.floors import Elevation, elevation_model
from rovtwin.mapping.projection import Projection, crs_of, project, utm_of

DATUM = Datum(63.45, 10.36, 40.0)
LOW, HIGH = np.array([-2.0, -1.0]), np.array([12.0, 7.0])


def depth_at(north, east):
    return 5.0 + 0.02 * north - 0.01 * east + 0.2 * np.sin(0.8 * north + 0.3 * east)


def dem(path, crs="EPSG:32632", cell=0.25, change=None, **given):
    """An elevation model of `depth_at`, heights over the ellipsoid, made by exact projection of its cells."""
    there = rasterio.crs.CRS.from_user_input(crs) if crs else None
    system = there or rasterio.crs.CRS.from_user_input("EPSG:32632")
    corners = project(DATUM, system, np.array([[n, e, 5.0] for n in (-5.0, 15.0) for e in (-4.0, 10.0)]))
    step = cell if system.is_projected else cell / 111e3
    x, y = (np.arange(a, b, step) for a, b in zip(corners.min(0), corners.max(0), strict=True))
    middle = np.stack(np.meshgrid(x + 0.5 * step, y[::-1] + 0.5 * step), -1)
    from rasterio.warp import transform

    lon, lat = transform(system, "EPSG:4326", middle[..., 0].ravel(), middle[..., 1].ravel())
    place = DATUM.position(np.array(lat), np.array(lon), np.full(len(lat), 5.0))
    height = (DATUM.height - depth_at(place[:, 0], place[:, 1])).reshape(middle.shape[:2])
    height = height if change is None else change(height)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float64", "height": len(y), "width": len(x), "crs": there}
    where = rasterio.transform.from_origin(x[0], y[-1] + step, step, step)
    with rasterio.open(path, "w", **(profile | {"transform": where} | given)) as file:
        file.write(height, 1)
    return path


@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:4326", "EPSG:25833"])
def test_an_elevation_model_is_where_its_coordinate_system_says(tmp_path, crs):
    floor = elevation_model(dem(tmp_path / "dem.tif", crs), DATUM, LOW, HIGH, Elevation())
    rng = np.random.default_rng(3)
    place = LOW + (HIGH - LOW) * rng.random((500, 2))
    depth, slope = floor.depth_and_slope(place)
    assert np.abs(depth - depth_at(*place.T)).max() < 1e-3  # of cells of 0.25 m on waves of 7 m
    steep = 0.2 * np.cos(0.8 * place[:, 0] + 0.3 * place[:, 1])
    assert np.abs(slope - np.column_stack([0.02 + 0.8 * steep, -0.01 + 0.3 * steep])).max() < 0.01
    assert np.isnan(floor.depth_and_slope(np.array([[50.0, 0.0]]))[0]).all()


def test_cells_without_heights_are_no_floor(tmp_path):
    def holed(height):
        height[:, :25] = -9999.0
        return height

    floor = elevation_model(dem(tmp_path / "dem.tif", change=holed, nodata=-9999.0), DATUM, LOW, HIGH, Elevation())
    depth, _ = floor.depth_and_slope(np.array([[5.0, 0.0], [5.0, 6.0]]))
    assert np.isnan(depth[0]) and depth[1] == pytest.approx(depth_at(5.0, 6.0), abs=1e-3)


def test_whole_numbers_with_a_scale_and_an_offset_are_heights(tmp_path):
    path = dem(tmp_path / "dem.tif", change=lambda h: np.rint((h - 30.0) / 0.01), dtype="int16")
    with rasterio.open(path, "r+") as file:
        file.scales, file.offsets = (0.01,), (30.0,)
    floor = elevation_model(path, DATUM, LOW, HIGH, Elevation())
    assert floor.depth_and_slope(np.array([[5.0, 2.0]]))[0][0] == pytest.approx(depth_at(5.0, 2.0), abs=0.01)


def test_what_is_wrong_with_an_elevation_model_is_named(tmp_path):
    def read(path, given=Elevation(), low=LOW):
        return elevation_model(path, DATUM, low, low + 5.0, given)

    with pytest.raises(ConfigError, match="says no coordinate system"):
        read(dem(tmp_path / "none.tif", crs=None))
    good = dem(tmp_path / "good.tif")
    with pytest.raises(ConfigError, match="Is it of another place"):
        read(good, low=LOW + 3000.0)
    with pytest.raises(ConfigError, match="above the water"):
        read(dem(tmp_path / "high.tif", change=lambda h: h + 100.0))
    with pytest.raises(ConfigError, match="cannot be read"):
        read(tmp_path / "nothing.tif")
    (tmp_path / "text.tif").write_text("depths")
    with pytest.raises(ConfigError, match="expected such as a GeoTIFF"):
        read(tmp_path / "text.tif")
    moved = dem(tmp_path / "moved.tif", crs="EPSG:32632")
    with rasterio.open(moved, "r+") as file:
        file.crs = rasterio.crs.CRS.from_epsg(32633)  # another zone than it was made in
    with pytest.raises(ConfigError, match="another system"):
        read(moved)


def test_maps_planes_are_met_and_systems_that_do_not_fit_are_refused():
    assert utm_of(DATUM) == "EPSG:32632" and utm_of(Datum(-33.9, 151.2)) == "EPSG:32756"
    assert utm_of(Datum(60.4, 5.3)) == "EPSG:32632"  # Bergen
    for longitude, zone in ((8.9, 31), (9.1, 33), (11.93, 33), (20.9, 33), (21.1, 35), (33.1, 37), (42.1, 38)):
        assert utm_of(Datum(78.92, longitude)) == f"EPSG:326{zone}"
    found = Projection.of(DATUM, crs_of("EPSG:32632", "t"), LOW, HIGH, 5.0)
    place = LOW + (HIGH - LOW) * np.random.default_rng(1).random((50, 2))
    exact = project(DATUM, found.crs, np.column_stack([place, np.full(50, 5.0)]))
    assert found.worst < 1e-5 and np.abs(found.to_map(place) - exact).max() < 1e-5
    assert np.abs(found.to_place(exact) - place).max() < 1e-5
    turned = found.slope(np.zeros(2))  # x grows east, y north, turned by the meridians' convergence
    assert np.degrees(np.arctan2(turned[0, 0], turned[1, 0])) == pytest.approx(-1.217, abs=2e-3)
    for name, message in (("EPSG:4326", "no coordinates in metres"), ("utm33", "expected a coordinate system")):
        with pytest.raises(ConfigError, match=message):
            crs_of(name, "--crs")


def test_a_surface_through_echoes_knows_how_unsure_it_is():
    rng = np.random.default_rng(5)
    tracks = [np.column_stack([np.arange(0.0, 10.0, 0.04), np.full(250, east)]) for east in (0.5, 1.5, 2.5, 3.5)]
    track = np.concatenate(tracks)
    hits = np.column_stack([track, depth_at(*track.T) + 0.01 * rng.standard_normal(len(track))])
    found = surface_through(hits, np.zeros(2), np.array([10.0, 4.0]), 0.01)
    place = np.array([10.0, 4.0]) * rng.random((2000, 2))
    error = found.floor.depth_and_slope(place)[0] - depth_at(*place.T)
    z = error / found.floor.depth_sigma(place)
    assert np.std(error) < 0.01 and 0.3 < np.sqrt(np.mean(z**2)) < 2.0
    far = found.floor.depth_sigma(np.array([[5.0, 1.5], [5.0, 2.0], [9.9, 0.0]]))
    assert far[0] < far[1] < far[2]


def test_echoes_are_placed_along_the_beam_and_strays_are_left_out():
    navigation, t = moving((0.1, 0.2, 0.4)), np.arange(0.0, 4.0, 0.05)
    down = Altimeter(np.array([0.1, 0.0, 0.1]), np.array([0.0, 0.0, 1.0]))
    poses = navigation.at(t)
    begin = poses.position + poses.rotation @ down.position
    ranges = (5.0 - begin[:, 2]) / poses.rotation[:, 2, 2]
    ranges[[10, 40]] = [0.3, 9.0]
    ranges[50] = np.nan
    hits, dropped = altimeter_hits(navigation, down, np.r_[t, 99.0], np.r_[ranges, 1.0])
    assert dropped == 4 and np.abs(hits[:, 2] - 5.0).max() < 1e-9
    with pytest.raises(LogError, match="found 3 echoes"):
        surface_through(hits[:3], np.zeros(2), np.ones(2), 0.01)
