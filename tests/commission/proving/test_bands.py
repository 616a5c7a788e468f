"""Bands and verdicts: right for flights that are alike, whatever their distribution, and for one that is not."""

import numpy as np
import pytest
from tests.runs.ensemble.walks import SAMPLES, walks

from rovtwin.commission.proving.bands import (
    AXES,
    DRAWS,
    TOGETHER,
    Track,
    band_of,
    held,
    together,
    track_of,
)


def tracks(curves: np.ndarray) -> list[Track]:
    """Flights with the same curve on each axis."""
    t = np.arange(SAMPLES) / 10.0
    return [Track(t, np.repeat(one[:, None], len(AXES), axis=1), 0.0) for one in curves]


def test_the_band_holds_one_more_flight_with_95_percent():
    rng = np.random.default_rng(1)
    inside = []
    for _ in range(60):
        *drawn, one_more = tracks(walks(rng, DRAWS + 1))
        band = band_of(drawn)
        inside.append(np.mean((one_more.pose >= band.low) & (one_more.pose <= band.high)))
    assert band.level == pytest.approx(0.95)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
    assert np.std(inside) > 3.0 * np.sqrt(0.95 * 0.05 / SAMPLES)  # correlated: 300 samples are not 300


def test_flights_that_are_alike_are_seldom_called_outside():
    rng = np.random.default_rng(4)
    verdicts = []
    for _ in range(200):
        *drawn, one_more = tracks(walks(rng, DRAWS + 1))
        verdicts.append(held(band_of(drawn), one_more)[0].agrees)
    assert np.mean(verdicts) > 0.96  # 0.9875 of one axis


def test_another_flight_is_called_outside_on_the_axis_where_it_is():
    *drawn, one_more = tracks(walks(np.random.default_rng(5), DRAWS + 1))
    off = one_more.pose.copy()
    off[:, 1] += 6.0
    rows = held(band_of(drawn), Track(one_more.t, off, 0.0))
    assert [row.agrees for row in rows] == [True, False, True, True]
    assert rows[1].inside < 0.2 and rows[1].outside_by > 0.5


def of_several(rng, count):
    """Flights whose axes differ from each other."""
    t = np.arange(SAMPLES) / 10.0
    poses = np.stack([walks(rng, count) for _ in AXES], axis=2)
    return [Track(t, pose, 0.0) for pose in poses]


def test_a_flight_that_is_a_little_off_on_every_axis_is_unlikely_as_a_whole():
    """A BlueROV2's four corners had 30 % inside on three axes, and each alone had one drawn flight as bad."""
    rng = np.random.default_rng(11)
    alone, whole, alike = [], [], []
    for _ in range(60):
        *drawn, one_more = of_several(rng, DRAWS + 1)
        band = band_of(drawn)
        alike.append(together(band, one_more) <= TOGETHER)
        off = Track(one_more.t, one_more.pose + 2.0 * drawn[0].pose.std(), 0.0)
        alone.append(all(row.agrees for row in held(band, off)))
        whole.append(together(band, off) <= TOGETHER)
    print(f"alike {np.mean(alike):.3f}, off: passed by each axis {np.mean(alone):.2f}, found {np.mean(whole):.2f}")
    assert np.mean(alike) <= 0.1 and np.mean(whole) > 1.0 - np.mean(alone)


def test_time_begins_when_the_first_corner_is_left_and_headings_are_unwrapped():
    t = np.arange(0.0, 20.0, 0.1)
    eta = np.zeros((len(t), 6))
    eta[:, 0] = t
    eta[:, 5] = np.angle(np.exp(1j * 0.5 * t))  # turns through pi
    track = track_of(t, eta, (t > 1.95).astype(float) + (t > 4.95))
    assert track is not None
    assert track.began == pytest.approx(5.0) and track.pose[0, 0] == pytest.approx(5.0)
    assert np.all(np.diff(track.pose[:, 3]) > 0.0) and len(track.t) == len(track.pose)
    assert track_of(t, eta, (t > 1.95).astype(float)) is None, "on the leg to the first corner it is not yet alike"


def test_headings_a_whole_turn_apart_are_the_same():
    drawn = tracks(walks(np.random.default_rng(7), DRAWS + 1))
    turned = drawn[-1].pose.copy()
    turned[:, 3] += 360.0
    band = band_of(drawn[:-1])
    assert held(band, Track(drawn[-1].t, turned, 0.0))[3] == held(band, drawn[-1])[3]
