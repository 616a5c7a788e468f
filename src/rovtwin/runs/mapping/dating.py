"""Which origin and which start of the clock the lines of a file count from."""

import numpy as np

from rovtwin.core.datum import Datum, datum_of
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Log
from rovtwin.imaging.lines import LinesFile

_UNIX = 1e8  # stamps beyond it are unix time, not seconds of a run [s]
_ALIKE = 1e-9, 1e-6  # within which two origins are one: latitude and longitude [deg], height [m]


def date(lines: LinesFile, given: Datum | None, log: Log | None) -> None:
    """Put lines on the run's origin and clock; without a run their clock counts from the first of them.

    Args:
        lines: Open file; its `datum` and `t` are changed where it has no datum.
        given: By `--datum`; only its place counts.
        log: Of the run, or None.

    Raises:
        ConfigError: Two origins or two starts are stated that are not the same.
        LogError: Nobody knows what the run's clock is against the stamps.
    """
    run = None if log is None else datum_of(log.metadata)
    _agree(lines, given, run)
    if lines.datum is not None or (run is None and given is None):
        return
    if run is not None:
        lines.datum = run
        lines.t = lines.t - unix_start(run)
    elif given is not None and log is not None:
        if lines.t[0] > _UNIX:
            raise LogError(
                f"{lines.path}: its stamps are unix time, and the run's log has no datum that says when its clock "
                "began, so poses and lines cannot be put together. Write `datum` with utc_start into the log's "
                "metadata, or subtract the start from the stamps"
            )
        lines.datum = given
    elif given is not None:
        start = np.datetime64(int(lines.t[0] * 1e3), "ms")
        lines.datum = Datum(given.latitude, given.longitude, given.height, f"{start}Z")
        lines.t = lines.t - unix_start(lines.datum)


def unix_start(datum: Datum) -> float:
    """Time zero of a datum's clock [unix s]."""
    return float(datum.utc(0.0).astype("datetime64[ns]").astype(np.int64)) * 1e-9


def _agree(lines: LinesFile, given: Datum | None, run: Datum | None) -> None:
    own = lines.datum
    if own is not None and run is not None and (not _one_place(own, run) or own.utc_start != run.utc_start):
        raise ConfigError(
            f"{lines.path}: its datum is {own}; that of the run's log is {run}. Are the lines of another run? Poses "
            "and lines must count from one origin and one start"
        )
    there, whose = (run, "the run's log") if run is not None else (own, str(lines.path))
    if given is not None and there is not None and not _one_place(given, there):
        raise ConfigError(f"--datum: found {given}, but {whose} says {there}. Leave --datum out")


def _one_place(a: Datum, b: Datum) -> bool:
    apart = abs(a.latitude - b.latitude), abs(a.longitude - b.longitude)
    return max(apart) < _ALIKE[0] and abs(a.height - b.height) < _ALIKE[1]
