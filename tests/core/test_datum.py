"""The datum: n to the map and back, against the geometry of the ellipsoid written out."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rovtwin.core.datum import INVERSE_FLATTENING, SEMI_MAJOR_AXIS, Datum, coordinates_text, datum_of
from rovtwin.core.errors import ConfigError

E2 = (2 - 1 / INVERSE_FLATTENING) / INVERSE_FLATTENING  # eccentricity squared
TRONDHEIM = Datum()


def earth_fixed(latitude, longitude, height) -> np.ndarray:
    """Earth-centred coordinates of one place [m], the textbook formula."""
    lat, lon = math.radians(latitude), math.radians(longitude)
    N = SEMI_MAJOR_AXIS / math.sqrt(1 - E2 * math.sin(lat) ** 2)
    return np.array(
        [
            (N + height) * math.cos(lat) * math.cos(lon),
            (N + height) * math.cos(lat) * math.sin(lon),
            ((1 - E2) * N + height) * math.sin(lat),
        ]
    )


def axes(latitude, longitude) -> np.ndarray:
    """North, east and down at a place as rows, in the same coordinates."""
    (sa, ca), (so, co) = ((math.sin(math.radians(a)), math.cos(math.radians(a))) for a in (latitude, longitude))
    return np.array([[-sa * co, -sa * so, ca], [-so, co, 0.0], [-ca * co, -ca * so, -sa]])


@given(
    st.floats(-90, 90), st.floats(-180, 180), st.floats(-100, 5000),
    st.floats(-7e3, 7e3), st.floats(-7e3, 7e3), st.floats(0, 1000),
)  # fmt: skip
def test_to_the_map_and_back_is_within_a_micrometre_over_10_km(latitude, longitude, height, north, east, depth):
    datum = Datum(latitude, longitude, height)
    lat, lon, h = datum.geodetic([north, east, depth])
    assert abs(lat) <= 90 and abs(lon) <= 180 and h == height - depth
    np.testing.assert_allclose(datum.position(lat, lon, depth), [north, east, depth], rtol=0, atol=1e-6)


@given(st.floats(-89, 89), st.floats(-180, 180), st.floats(-7e3, 7e3), st.floats(-7e3, 7e3), st.floats(0, 1000))
def test_the_map_agrees_with_the_geometry_written_out(latitude, longitude, north, east, depth):
    """The place found on the map, taken through earth-fixed coordinates to the plane, is where it started."""
    datum = Datum(latitude, longitude, 40.0)
    lat, lon, _ = (float(v) for v in datum.geodetic([north, east, depth]))
    centre, R = earth_fixed(latitude, longitude, 40.0), axes(latitude, longitude)
    # The vertical line of that place, cut where the third coordinate is the depth.
    low, high = (R @ (earth_fixed(lat, lon, h) - centre) for h in (0.0, 100.0))
    place = low + (depth - low[2]) / (high - low)[2] * (high - low)
    np.testing.assert_allclose(place, [north, east, depth], rtol=0, atol=1e-6)


@pytest.mark.parametrize(("latitude", "length"), [(0.0, 1842.9), (45.0, 1852.2), (89.99, 1861.6)])
def test_a_minute_of_latitude(latitude, length):
    """Against the lengths in any pilot book, and exactly: meridian radius M = a (1 - e2) / (1 - e2 sin2)^(3/2)."""
    M = SEMI_MAJOR_AXIS * (1 - E2) / (1 - E2 * math.sin(math.radians(latitude)) ** 2) ** 1.5
    half = 0.5 / 60
    north = Datum(latitude, 10.36).position([latitude + half, latitude - half], [10.36, 10.36], [0.0, 0.0])[:, 0]
    assert north[0] - north[1] == pytest.approx(length, abs=0.05)
    assert north[0] - north[1] == pytest.approx(M * math.radians(1 / 60), rel=1e-7)


def test_a_minute_of_longitude_off_trondheim():
    N = SEMI_MAJOR_AXIS / math.sqrt(1 - E2 * math.sin(math.radians(63.45)) ** 2)
    east = TRONDHEIM.position(63.45, 10.36 + 1 / 60, 0.0)[1]
    assert east == pytest.approx(N * math.cos(math.radians(63.45)) * math.radians(1 / 60), rel=1e-7)
    assert TRONDHEIM.distance(63.45, 10.36 + 1 / 60) == pytest.approx(east, rel=1e-6)


def test_the_origin_is_the_datum_and_depth_goes_straight_down():
    lat, lon, height = TRONDHEIM.geodetic([[0, 0, 0], [0, 0, 300]])
    np.testing.assert_allclose(lat, 63.45, rtol=0, atol=1e-12)
    np.testing.assert_allclose(lon, 10.36, rtol=0, atol=1e-12)
    assert height.tolist() == [0, -300]


def test_arrays_of_any_shape_and_values_that_are_not_finite():
    places = np.random.default_rng(1).uniform(0, 100, (3, 4, 3))
    lat, lon, height = TRONDHEIM.geodetic(places)
    assert lat.shape == lon.shape == height.shape == (3, 4)
    np.testing.assert_allclose(TRONDHEIM.position(lat, lon, -height), places, rtol=0, atol=1e-6)
    lat, _, height = TRONDHEIM.geodetic([[np.nan, 0, 1], [0, 0, 1]])
    assert np.isnan(lat[0]) and lat[1] == pytest.approx(63.45) and height[1] == -1


def test_times_of_the_clock():
    utc = Datum(utc_start="2021-06-01T12:00:00+02:00").utc([0.0, 1.5, 3600.000000001])
    assert np.datetime_as_string(utc).tolist() == [
        "2021-06-01T10:00:00.000000000", "2021-06-01T10:00:01.500000000", "2021-06-01T11:00:00.000000001",
    ]  # fmt: skip


def test_it_survives_the_metadata_of_a_log():
    datum = Datum(-33.9, 151.2, 22.5, "2026-01-02T03:04:05.25Z")
    assert datum_of({"datum": datum.metadata()}) == datum
    assert datum.utc_start == "2026-01-02T03:04:05.250000Z"
    for other in ({}, {"datum": "x"}, {"datum": "[]"}, {"datum": '{"latitude": 1}'}, {"datum": "null"},
                  {"datum": datum.metadata().replace("-33.9", "-133.9")}):  # fmt: skip
        assert datum_of(other) is None
    assert str(datum) == "33.900000° S, 151.200000° E, water level 22.5 m, start 2026-01-02T03:04:05.250000Z"
    assert coordinates_text(63.45, -10.36) == "63.450000° N, 10.360000° W"


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ({"latitude": 100.0}, "latitude 100: expected degrees between -90 and 90. Are latitude and longitude swapped?"),
        ({"longitude": -181.0}, "longitude -181: expected degrees between -180 and 180"),
        ({"latitude": math.nan}, "latitude nan"),
        ({"height": math.inf}, "height inf: expected a finite number"),
        ({"utc_start": "2021-06-01T10:00:00"}, "without a zone, expected a time in UTC such as .*: add a Z"),
        ({"utc_start": "yesterday"}, "found 'yesterday', expected a time in UTC"),
        ({"utc_start": "2021-06-31T10:00:00Z"}, "expected a time in UTC"),
    ],
)
def test_a_datum_that_is_nowhere(wrong, expected):
    with pytest.raises(ConfigError, match=expected.replace(".*", "ANY").replace(".", r"\.").replace("ANY", ".*")):
        Datum(**wrong)


def test_no_such_place():
    with pytest.raises(ConfigError, match="latitude 97"):
        TRONDHEIM.position([63.0, 97.0], [10.0, 10.0], [0.0, 0.0])
