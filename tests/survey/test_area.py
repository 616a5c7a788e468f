"""Areas from files: what is read, and every kind of bad file named."""

import json
from pathlib import Path

import numpy as np
import pytest

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.survey.area import read_area

HERE = Datum()
EXAMPLES = Path(__file__).parents[2] / "examples" / "survey"


def ring(*metres, datum=HERE):
    """A closed GeoJSON ring from places [north, east] in metres about the datum."""
    latitude, longitude, _ = datum.geodetic([[north, east, 0.0] for north, east in (*metres, metres[0])])
    return np.stack([longitude, latitude], axis=-1).tolist()


SQUARE = ring((0, 0), (10, 0), (10, 10), (0, 10))
HOLE = ring((4, 4), (6, 4), (6, 6), (4, 6))


def written(folder, data, name="area.geojson"):
    path = folder / name
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return path


def polygon(*rings):
    return {"type": "Polygon", "coordinates": list(rings)}


@pytest.mark.parametrize(
    "data",
    [
        polygon(SQUARE, HOLE),
        {"type": "MultiPolygon", "coordinates": [[SQUARE, HOLE]]},
        {"type": "Feature", "properties": None, "geometry": polygon(SQUARE, HOLE)},
        {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": polygon(SQUARE, HOLE)}]},
        {"type": "GeometryCollection", "geometries": [polygon(SQUARE, HOLE)]},
        polygon([[*place, 40.0] for place in SQUARE], HOLE[:-1]),  # with a height; a ring left open
    ],
)
def test_every_kind_of_geojson_is_the_same_area(tmp_path, data):
    area = read_area(written(tmp_path, data), HERE)
    assert area.shape.geom_type == "MultiPolygon" and area.name == "area"
    assert area.shape.area == pytest.approx(96.0, abs=1e-3)
    assert np.allclose(area.shape.bounds, (0, 0, 10, 10), atol=1e-4)  # x is north, y is east


def test_metres_are_read_as_they_are(tmp_path):
    area = read_area(written(tmp_path, "outline: [[0, 0], [20, 0], [20, 5], [0, 5]]", "a.yaml"))
    assert area.shape.bounds == (0, 0, 20, 5) and area.datum == HERE


def test_the_datum_may_follow_the_area(tmp_path):
    there = Datum(-33.9, 151.2)
    path = written(tmp_path, polygon(ring((0, 0), (10, 0), (10, 20), (0, 20), datum=there)))
    area = read_area(path)
    assert np.allclose(area.shape.bounds, (-5, -10, 5, 10), atol=0.1)
    assert area.datum.latitude == pytest.approx(-33.9, abs=1e-3)


def test_parts_stay_apart_and_overlapping_ones_are_joined(tmp_path):
    far = ring((20, 0), (30, 0), (30, 10), (20, 10))
    near = ring((5, 5), (15, 5), (15, 15), (5, 15))
    for other, parts, size in ((far, 2, 200), (near, 1, 175)):
        data = {"type": "MultiPolygon", "coordinates": [[SQUARE], [other]]}
        area = read_area(written(tmp_path, data), HERE)
        assert len(area.shape.geoms) == parts and area.shape.area == pytest.approx(size, abs=1e-3)


@pytest.mark.parametrize("name", ["area.geojson", "pool.yaml"])
def test_examples_are_areas(name):
    assert read_area(EXAMPLES / name, HERE).shape.area > 50


SWAPPED = [[latitude, longitude] for longitude, latitude in SQUARE]
BAD = {
    "bow tie": (polygon(ring((0, 0), (10, 10), (10, 0), (0, 10))), r"coordinates\[0\]: Self-intersection\[10.36"),
    "swapped": (polygon(SWAPPED), "swapped.*longitude first"),
    "beyond the pole": (polygon([[10, 95], [11, 95], [11, 96]]), r"coordinates\[0\]\[0\]: latitude 95.*-90 and 90"),
    "far": (polygon([[5, 60], [5.001, 60], [5.001, 60.001]]), r"reaches \d+ km from the datum at 63.45.*--datum 60"),
    "zero": (polygon(ring((0, 0), (5, 0), (10, 0))), "an area of zero"),
    "two corners": (polygon(ring((0, 0), (5, 0))), "found 2 corners, expected at least 3"),
    "hole as large": (polygon(SQUARE, SQUARE), r"coordinates\[0\]"),
    "hole outside": (polygon(SQUARE, ring((20, 20), (22, 20), (22, 22))), "Hole lies outside"),
    "a line": ({"type": "LineString", "coordinates": SQUARE}, "type: found 'LineString', expected Polygon"),
    "empty": ({"type": "FeatureCollection", "features": []}, "features: found a list of 0 values"),
    "no geometry": ({"type": "Feature", "geometry": None}, "geometry.type: found nothing"),
    "text": (polygon([["a", "b"]]), r"coordinates\[0\]\[0\]: found a list of 2 values, expected \[longitude"),
    "projected": ({**polygon(SQUARE), "crs": {"properties": {"name": "EPSG:25832"}}}, "expected WGS-84"),
    "list": ([1, 2], "expected GeoJSON"),
    "not json": ("{", "line 1, column 2: not JSON"),
    "nan": ('{"type": "Polygon", "coordinates": [[[NaN, 1], [1, 2], [2, 3]]]}', "longitude nan"),
}


@pytest.mark.parametrize("data, message", BAD.values(), ids=BAD)
def test_bad_geojson_is_named(tmp_path, data, message):
    with pytest.raises(ConfigError, match=message) as found:
        read_area(written(tmp_path, data), HERE)
    assert str(found.value).startswith("area.geojson: ")


@pytest.mark.parametrize(
    "text, message",
    [
        ("outline: [[0, 0], [1, 0]]", "a.yaml: outline: found 2 values, expected 3"),
        ("outlin: [[0, 0], [1, 0], [1, 1]]", "a.yaml: outlin: no such key. Did you mean 'outline'"),
        ("outline: [[0, 0], [1, 0], [1, a]]", r"outline\[2\]\[1\]: found 'a', expected a number"),
        ("outline: [[0, 0], [9, 0], [9, 9], [0, 9]]\nholes: [[[1, 1], [2, 2], [2, 1], [1, 2]]]", "Self-intersection"),
        ("outline: [[0, 0], [90000, 0], [90000, 9]]", "reaches 90 km.*expected metres"),
    ],
)
def test_bad_metres_are_named(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        read_area(written(tmp_path, text, "a.yaml"))


def test_wrong_files_are_named(tmp_path):
    for name, message in (
        ("a.kml", "expected a GeoJSON"),
        ("none.geojson", "no such file"),
        ("none.yaml", "no such file"),
    ):
        with pytest.raises(ConfigError, match=message):
            read_area(tmp_path / name)
    (tmp_path / "b.geojson").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ConfigError, match="not JSON text"):
        read_area(tmp_path / "b.geojson")
