"""The contract of `core.link.Source`, held by an instrument's driver on something that measures."""

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from rovtwin.core.flow import Measurement
from rovtwin.core.link import Source
from rovtwin.core.sensors import SENSORS, kind_of

AT_ONCE = 0.5  # what counts as returning at once, on a busy machine [s]
QUIET = 0.15  # in which what is on its way has come [s]


class HasSource(Protocol):
    """A rig of a source, or of a link, which is one too."""

    @property
    def source(self) -> Source: ...


@dataclass
class SourceRig:
    """A source and the instrument that it listens to.

    Attributes:
        source: Open, its instrument reached, all that came until now read.
        measure: Lets the instrument measure everything once.
        sensors: Names of the readings that one round of measuring gives.
        sizes: Number of values of those that `core.sensors` does not know.
        thread: Name of the thread that listens, which ends with the source; "" for none.
    """

    source: Source
    measure: Callable[[], None]
    sensors: set[str]
    sizes: dict[str, int] = field(default_factory=dict)
    thread: str = ""

    def listen(self, rounds: int = 1) -> list[Measurement]:
        """Measure, and read until each round has come through."""
        got: list[Measurement] = []
        for _ in range(rounds):
            self.measure()
            came: list[Measurement] = []

            def whole(came: list[Measurement] = came) -> bool:
                came.extend(self.source.read())
                return {r.sensor for r in came} >= self.sensors

            _wait_until(whole, f"a round of {', '.join(sorted(self.sensors))}")
            got += came
        return got

    def size(self, sensor: str) -> int:
        """Number of values of a reading."""
        return self.sizes[sensor] if sensor in self.sizes else SENSORS[kind_of(sensor)].size


def check_source(rig: Callable[[], AbstractContextManager[SourceRig]]) -> None:
    """Hold a source to all clauses of the contract, each on a fresh one.

    Args:
        rig: Opens one, and closes it at the end of a with block.

    Raises:
        AssertionError: It breaks a clause.
    """
    for clause in CLAUSES:
        with rig() as fresh:
            clause(fresh)


def delivers_readings(rig: SourceRig) -> None:
    """A list of Measurements of known names and sizes, finite, each valid before now and none before the last."""
    got = rig.listen(10)
    assert {r.sensor for r in got} == rig.sensors
    for r in got:
        assert isinstance(r, Measurement)
        assert isinstance(r.value, np.ndarray) and r.value.dtype == float
        assert r.value.shape == (rig.size(r.sensor),), f"{r.sensor}: found the shape {r.value.shape}"
        assert np.isfinite(r.value).all() and np.isfinite(r.t_valid), r
        assert r.t_valid <= time.monotonic(), f"{r.sensor}: valid in the future"
    for sensor in rig.sensors:
        times = [r.t_valid for r in got if r.sensor == sensor]
        assert times == sorted(times), f"{sensor}: out of order"


def loses_none_and_delivers_none_twice(rig: SourceRig) -> None:
    """Ten rounds are ten readings of each sensor."""
    got = rig.listen(10)
    time.sleep(0.1)
    got += rig.source.read()
    for sensor in rig.sensors:
        assert len([r for r in got if r.sensor == sensor]) == 10, f"{sensor}: found other than ten readings of ten"


def gives_values_away(rig: SourceRig) -> None:
    """Writing into what was read changes nothing that is read later."""
    for r in rig.listen():
        r.value[:] = -1e3
    assert all((r.value > -1e3).all() for r in rig.listen())


def is_quiet_without_error(rig: SourceRig) -> None:
    """Nothing new is an empty list, however often one asks, and at once."""
    for _ in range(5):
        assert _timed(rig.source.read) == []


def closes_twice(rig: SourceRig) -> None:
    """A closed source can be closed again, and says nothing more."""
    rig.listen()
    rig.measure()
    _timed(rig.source.close)
    _timed(rig.source.close)
    assert rig.source.read() == []
    rig.measure()
    time.sleep(QUIET)
    assert rig.source.read() == []


def closes_after_a_with_block(rig: SourceRig) -> None:
    """`with source:` closes it."""
    with rig.source as source:
        assert source is rig.source
        assert rig.listen()
    rig.measure()
    time.sleep(QUIET)
    assert rig.source.read() == []


def lets_errors_out_of_a_with_block(rig: HasSource) -> None:
    """What goes wrong inside `with source:` is raised."""
    with suppress(ZeroDivisionError):
        with rig.source:
            raise ZeroDivisionError
        raise AssertionError("the error was swallowed")


def leaves_no_thread(rig: SourceRig) -> None:
    """The thread that listened ends with the source."""
    if not rig.thread:
        return
    assert _is_running(rig.thread), f"no thread {rig.thread}"
    rig.source.close()
    _wait_until(lambda: not _is_running(rig.thread), f"the thread {rig.thread} to end")


CLAUSES = (
    delivers_readings,
    loses_none_and_delivers_none_twice,
    gives_values_away,
    is_quiet_without_error,
    closes_twice,
    closes_after_a_with_block,
    lets_errors_out_of_a_with_block,
    leaves_no_thread,
)


def _is_running(thread: str) -> bool:
    return any(one.name == thread for one in threading.enumerate())


def _timed(call: Callable[[], object]) -> object:
    start = time.monotonic()
    result = call()
    assert time.monotonic() - start < AT_ONCE, "did not return at once"
    return result


def _wait_until(condition: Callable[[], object], what: str, seconds: float = 5.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.01)
