"""The log of a drone: bounded, and packed as the SDK reads it."""

import blueye.protocol as bp
import pytest
from blueye.sdk.logs import LogStream

from rovtwin.links.blueye.drone import divelog
from rovtwin.links.blueye.drone.divelog import DiveLog, packed, stamp_of


def depth(value: float) -> bytes:
    return bp.DepthTel.serialize(bp.DepthTel(depth={"value": value}))


@pytest.fixture
def log() -> DiveLog:
    return DiveLog("SERIAL", "hardware", "4.0.5")


def read(log: DiveLog) -> list[float]:
    return [content.depth.value for *_, content in LogStream(packed(log.records()))]


def test_what_was_kept_is_read(log):
    assert log.index() == []
    for k in range(40):
        log.keep("DepthTel", depth(float(k)), 0.1 * k, 1.7e9 + 0.1 * k)
    assert read(log) == [0.0, 10.0, 20.0, 30.0]
    (entry,) = log.index()
    assert entry["start_time"] == 1_700_000_000 and entry["binlog_size"] == log.size and entry["is_dive"] is False


def test_clock_that_begins_anew_is_no_gap(log):
    log.keep("DepthTel", depth(1.0), 100.0, 1.7e9)
    log.keep("DepthTel", depth(2.0), 0.0, 1.7e9)
    assert read(log) == [1.0, 2.0]


def test_no_notification_is_left_out(log):
    for level in (1, 2, 3):
        note = bp.NotificationTel(notification={"level": level})
        log.keep("NotificationTel", bp.NotificationTel.serialize(note), 1.0, 1.7e9)
    levels = [content.notification.level for *_, content in LogStream(packed(log.records()))]
    assert levels == [1, 2, 3]


def test_room_is_bounded_and_the_newest_stay(log, monkeypatch):
    monkeypatch.setattr(divelog, "ROOM", 2000)
    for k in range(1000):
        log.keep("DepthTel", depth(float(k)), float(k), 1.7e9 + k)
    kept = read(log)
    assert log.size <= 2000 and kept[-1] == 999.0 and kept == list(range(int(kept[0]), 1000)) and len(kept) > 10


@pytest.mark.parametrize(("deepest", "shown"), [(0.2, 0), (9.7, 9), (37.0, 30)])
def test_depth_is_published_as_the_drone_does(log, deepest, shown):
    log.keep("DepthTel", depth(1.0), 0.0, 1.7e9)
    log.saw_depth(deepest)
    (entry,) = log.index()
    assert entry["max_depth_magnitude"] == shown and entry["is_dive"] is (deepest > 0.25)


def test_stamps():
    assert stamp_of(1.25) == {"seconds": 1, "nanos": 250_000_000} and stamp_of(0.0) == {"seconds": 0, "nanos": 0}
