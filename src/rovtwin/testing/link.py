"""The contract of `core.link.Link`, held by a link with a vehicle at its other end that can be looked at."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import COMMAND_LIFE, Link
from rovtwin.core.numerics import as_array
from rovtwin.testing.source import lets_errors_out_of_a_with_block


@dataclass
class LinkRig:
    """A link of a vehicle with three thrusters, and the vehicle at its other end.

    Attributes:
        link: Open and, where it has to be, armed.
        wait: Lets so many seconds pass for the vehicle.
        listen: Reads until all that came is read.
        applied: What the thrusters do now, normalised.
        times: How often three thrusters are repeated in a command, each time with the same values.
        period: Between two readings of its fastest sensor [s].
    """

    link: Link
    wait: Callable[[float], None]
    listen: Callable[[], list[Measurement]]
    applied: Callable[[], Float[np.ndarray, "3"]]
    times: int = 1
    period: float = 0.02

    def send(self, *u: float) -> None:
        """A command of three thrusters."""
        self.link.send(Command(as_array(np.tile(u, self.times))))

    @property
    def source(self) -> Link:
        """A link is a source, too."""
        return self.link


def check_link(rig: Callable[[], AbstractContextManager[LinkRig]]) -> None:
    """Hold a link to all clauses of the contract, each on a fresh one.

    Args:
        rig: Opens one, and closes both ends at the end of a with block.

    Raises:
        AssertionError: It breaks a clause.
    """
    for clause in CLAUSES:
        with rig() as fresh:
            clause(fresh)


def delivers_readings(rig: LinkRig) -> None:
    """A list of Measurements with numbers in SI and the time they were valid, none twice, none lost."""
    rig.wait(0.2)
    readings = rig.link.read()
    assert isinstance(readings, list)
    readings = readings + rig.listen()
    assert readings, "no reading in 0.2 s"
    for reading in readings:
        assert isinstance(reading, Measurement) and isinstance(reading.sensor, str)
        assert isinstance(reading.value, np.ndarray) and reading.value.ndim == 1 and reading.value.dtype == float
        assert np.isfinite(reading.value).all() and np.isfinite(reading.t_valid), reading
    rig.wait(0.2)
    readings += rig.listen()
    for sensor in {reading.sensor for reading in readings}:
        times = [reading.t_valid for reading in readings if reading.sensor == sensor]
        # One clock, no latency: the order of arrival is that of the times.
        assert times == sorted(set(times)), f"{sensor}: a reading twice, or out of order"
        assert np.ptp(np.diff(times)) < 0.5 * rig.period, f"{sensor}: a gap: readings got lost"


def is_quiet_without_error(rig: LinkRig) -> None:
    """Nothing new is an empty list, however often one asks."""
    rig.listen()
    for _ in range(3):
        assert rig.link.read() == []
    rig.send(0.1, 0.1, 0.1)


def passes_commands_on(rig: LinkRig) -> None:
    """A command arrives as it is."""
    rig.send(0.5, -0.25, 0.0)
    _applies(rig, 0.5, -0.25, 0.0)


def rests_before_the_first_command(rig: LinkRig) -> None:
    """Nothing moves before the first command."""
    _rests(rig)


def clips_commands(rig: LinkRig) -> None:
    """A command beyond +-1 is cut there."""
    rig.send(2.0, -7.0, 0.5)
    _applies(rig, 1.0, -1.0, 0.5)


def takes_a_command_as_it_was(rig: LinkRig) -> None:
    """The array stays the caller's: writing into it later changes nothing."""
    u = np.full(3 * rig.times, 0.5)
    rig.link.send(Command(u))  # type: ignore[arg-type]  (NumPy, which can be written into)
    u[:] = -1.0
    _applies(rig, 0.5, 0.5, 0.5)


def _stops_on(bad: float) -> Callable[[LinkRig], None]:
    def stops_on_no_number(rig: LinkRig) -> None:
        """A command that is no number stops, and stop latches."""
        rig.send(0.5, 0.5, 0.5)
        rig.send(0.5, bad, 0.5)
        _rests(rig)
        rig.send(0.5, 0.5, 0.5)
        _rests(rig)

    stops_on_no_number.__name__ = f"stops_on_{bad}"
    return stops_on_no_number


def latches_stop(rig: LinkRig) -> None:
    """After a stop no command moves anything, and the vehicle still sends."""
    rig.send(0.5, 0.5, 0.5)
    rig.link.stop()
    _rests(rig)
    rig.send(0.5, 0.5, 0.5)
    _rests(rig)
    rig.link.stop()
    rig.wait(0.2)
    assert rig.listen(), "a stopped vehicle still sends"


def lets_commands_expire(rig: LinkRig) -> None:
    """COMMAND_LIFE after the last command the thrusters are off; the next command brings them back."""
    rig.send(0.5, 0.5, 0.5)
    rig.wait(COMMAND_LIFE / 3.0)
    assert rig.applied().any(), "a command that is young enough is obeyed"
    rig.wait(COMMAND_LIFE + 0.1)
    _rests(rig)
    rig.send(0.5, 0.5, 0.5)
    assert rig.applied().any(), "the next command brings the thrusters back"


def closes_twice(rig: LinkRig) -> None:
    """A closed link can be closed, stopped and commanded again, and gives no reading."""
    rig.send(0.5, 0.5, 0.5)
    rig.link.close()
    rig.link.close()
    assert rig.link.read() == []
    rig.send(0.5, 0.5, 0.5)
    rig.link.stop()
    rig.wait(0.1)
    assert rig.link.read() == []


def closes_after_a_with_block(rig: LinkRig) -> None:
    """`with link:` closes it."""
    with rig.link as link:
        assert link is rig.link
        rig.wait(0.2)
        assert link.read()
    rig.wait(0.2)
    assert rig.link.read() == []


CLAUSES = (
    delivers_readings,
    is_quiet_without_error,
    passes_commands_on,
    rests_before_the_first_command,
    clips_commands,
    takes_a_command_as_it_was,
    *(_stops_on(bad) for bad in (np.nan, np.inf, -np.inf)),
    latches_stop,
    lets_commands_expire,
    closes_twice,
    closes_after_a_with_block,
    lets_errors_out_of_a_with_block,
)


def _applies(rig: LinkRig, *u: float) -> None:
    np.testing.assert_allclose(rig.applied(), u, atol=1e-3)


def _rests(rig: LinkRig) -> None:
    applied = rig.applied()
    assert not applied.any(), f"thrusters do {applied}, expected them off"
