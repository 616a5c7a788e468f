"""Tracks of earlier dives: where the vehicle was, about the chart's datum."""

import numpy as np
import pytest

from rovtwin.console.chart.tracks import MOST, STEP, thinned, track_of
from rovtwin.core.datum import METADATA_KEY, Datum
from rovtwin.core.errors import LogError
from rovtwin.core.log import Channel, Log

FIELDS = ("x", "y", "z", "phi", "theta", "psi")
UNITS = ("m",) * 3 + ("rad",) * 3
HERE = Datum(63.44, 10.42)


def dive(folder, t, x, y, datum=HERE, name="autopilot/eta"):
    """A run that was at these places."""
    folder.mkdir()
    eta = np.column_stack([x, y, np.full(len(t), 2.0), *np.zeros((3, len(t)))])
    channel = Channel(name, FIELDS, UNITS, "n")
    metadata = {METADATA_KEY: datum.metadata()} if datum else {}
    Log.from_arrays([channel], {name: (np.asarray(t, float), eta)}, metadata).write(folder / "log.mcap")
    return folder


def test_a_track_is_where_the_vehicle_was_and_no_longer_than_it_has_to_be(tmp_path):
    t = np.arange(0.0, 100.0, 0.1)
    x, y = 5 * np.cos(t / 10), 5 * np.sin(t / 10)
    (line,) = track_of(dive(tmp_path / "run", t, x, y), HERE, True)["lines"]
    assert len(line) < 1.1 * 50 / STEP
    np.testing.assert_allclose(np.hypot(*np.array(line).T), 5.0, atol=0.02)
    np.testing.assert_allclose(line[-1], [x[-1], y[-1]], atol=0.01)


def test_a_line_is_broken_where_nothing_is_known(tmp_path):
    t = np.array([0.0, 1.0, 2.0, 30.0, 31.0, 32.0])
    first, second = track_of(dive(tmp_path / "run", t, t, 0 * t), HERE, True)["lines"]
    assert (first[-1][0], second[0][0]) == (2.0, 30.0)
    # Who stands still is where he was.
    t = np.arange(60.0)
    still = np.where((t > 20) & (t < 40), 20.0, np.where(t <= 20, t, t - 20))
    assert len(track_of(dive(tmp_path / "still", t, still, 0 * t), HERE, True)["lines"]) == 1


def test_a_very_long_way_has_so_many_points(tmp_path):
    x = np.linspace(0, 30_000, 20_000)
    kept = thinned(np.column_stack([x, 0 * x]))
    assert len(kept) <= MOST + 2 and kept[0] == 0 and kept[-1] == 19_999
    assert list(thinned(np.zeros((5, 2)))) == [0, 4]


def test_a_dive_about_another_datum_lies_where_it_was_on_the_map(tmp_path):
    t = np.arange(10.0)
    there = Datum(63.45, 10.43)
    (line,) = track_of(dive(tmp_path / "run", t, 10 * t, 0 * t, there), HERE, True)["lines"]
    latitude, longitude, _ = there.geodetic([90.0, 0.0, 2.0])
    np.testing.assert_allclose(line[-1], HERE.position(latitude, longitude, 2.0)[:2], atol=0.01)
    for chart, given in ((HERE, False), (Datum(60.0, 10.0), True)):
        with pytest.raises(LogError, match="its metres count from 63.450000, 10.430000"):
            track_of(tmp_path / "run", chart, given)
    # The default is no place: nobody knows where it is from here.
    dive(tmp_path / "default", t, t, t, Datum())
    with pytest.raises(LogError, match="expected both given"):
        track_of(tmp_path / "default", HERE, True)
    assert len(track_of(tmp_path / "default", Datum(), False)["lines"]) == 1


def test_a_run_without_a_track_says_so(tmp_path):
    t = np.arange(3.0)
    with pytest.raises(LogError, match="there is no track to show"):
        track_of(dive(tmp_path / "run", t, t, t, name="sensor/eta"), HERE, True)


def test_a_dive_that_never_knew_where_it_was_has_no_track(tmp_path):
    nowhere = np.full(3, np.nan)
    with pytest.raises(LogError, match="no place that is known"):
        track_of(dive(tmp_path / "run", np.arange(3.0), nowhere, nowhere), HERE, True)
