"""The log that a drone keeps of its own telemetry, as the SDK downloads and reads it: BinlogRecord after BinlogRecord.

Each record is preceded by its length as a varint, and all are packed with gzip. Kept in memory, each message at most
once a second but notifications, all of them; the oldest go when there is no more room, which is after some hours.
"""

import gzip
from collections import deque
from typing import Any

from rovtwin.links.blueye.protobuf import PACKAGE, message

ROOM = 8 << 20  # bytes of records that are kept
PERIOD = 1.0  # between two records of one message [s of the vehicle's time]
ALWAYS = {"NotificationTel"}  # each says something of its own
SUBMERGED = 0.25  # depth from which it is a dive [m], http-api.yml


class DiveLog:
    """What a drone has sent.

    Attributes:
        name: Serial number, hardware id and number of the dive.
        size: Of the records that are kept [bytes].
    """

    def __init__(self, serial: str, hardware: str, software: str):
        self.name = f"{serial}_{hardware}_00001"
        self.size = 0
        self._software = software
        self._records: deque[bytes] = deque()
        self._last: dict[str, float] = {}
        self._start = 0.0
        self._deepest = 0.0

    def keep(self, name: str, payload: bytes, t: float, utc: float) -> None:
        """A message of telemetry that went out.

        Args:
            name: Without the package.
            payload: Its bytes.
            t: The vehicle's time [s].
            utc: The drone's clock [s since 1970].
        """
        if name not in ALWAYS and 0.0 <= t - self._last.get(name, -PERIOD) < PERIOD:
            return
        self._last[name] = t
        self._start = self._start or utc
        any_of = {"type_url": f"type.googleapis.com/{PACKAGE}{name}", "value": payload}
        content = {"payload": any_of, "unix_timestamp": stamp_of(utc), "clock_monotonic": stamp_of(max(t, 0.0))}
        record = message("BinlogRecord")(**content).SerializeToString()
        self._records.append(_varint(len(record)) + record)
        self.size += len(self._records[-1])
        while self.size > ROOM:
            self.size -= len(self._records.popleft())

    def saw_depth(self, depth: float) -> None:
        """The drone is so deep [m]."""
        self._deepest = max(self._deepest, depth)

    def index(self) -> list[dict[str, Any]]:
        """What `GET /logs` answers: this one log, once there is something in it."""
        if not self._records:
            return []
        entry: dict[str, Any] = {"name": self.name, "log_number": 1, "is_open": True, "has_binlog": True}
        entry |= {"is_dive": self._deepest > SUBMERGED, "binlog_size": self.size, "has_dive_info": False}
        entry |= {"videos": [], "pictures": [], "multibeam_recordings": [], "start_time": int(self._start)}
        deepest = int(self._deepest) if self._deepest < 10.0 else 10 * int(self._deepest / 10.0)
        entry |= {"blunux_version": self._software, "model_name": "Pioneer", "max_depth_magnitude": deepest}
        return [entry]

    def records(self) -> list[bytes]:
        """All that is kept, to be packed by `packed` in a thread of its own."""
        return list(self._records)


def packed(records: list[bytes]) -> bytes:
    """The file that is downloaded."""
    return gzip.compress(b"".join(records), compresslevel=1)


def stamp_of(t: float) -> dict[str, int]:
    """Fields of a protobuf Timestamp [s since 1970]."""
    whole = int(t // 1.0)
    return {"seconds": whole, "nanos": min(999_999_999, int(1e9 * (t - whole)))}


def _varint(value: int) -> bytes:
    parts = []
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])
