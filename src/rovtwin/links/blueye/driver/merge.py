"""Readings of two drones that are one vehicle, joined: what belongs together is averaged, what is alone is moved to CO.

The two drones sit at +r and -r about CO, so that in the mean of both what a lever arm adds cancels: depth by roll and
pitch, velocity by turning, specific force by angular acceleration and centripetally. Of one drone alone these parts are
subtracted with the newest attitude and gyro, except the one of angular acceleration in specific force: a gyro's
derivative is noise (0.28 m at 0.2 rad/s2 is 0.06 m/s2 along surge).
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import rotation_from_euler, wrapped
from rovtwin.core.flow import Measurement

TOGETHER = 0.1  # readings further apart, or that waited longer for the other's, do not belong together [s]
OUTDATED = 10.0  # age up to which a drone's battery and leak count beside the other's [s]
JUMP = 1.0  # a reading that is older than the last by more is accepted: the clock was set [s]
WAITING = 256  # readings of one sensor that wait at most
STATES = ("battery", "leak")  # of the two together: the worse one
SIDES = (0, 1)


class Merge:
    """Two streams into one.

    Args:
        levers: Places of the drones seen from CO, b [m], shape (2, 3).
    """

    def __init__(self, levers: Float[np.ndarray, "drones 3"]):
        self._levers = np.asarray(levers, dtype=float)
        self._waiting: dict[str, tuple[list[Measurement], list[Measurement]]] = {}
        self._newest: tuple[dict[str, Measurement], dict[str, Measurement]] = ({}, {})
        self._euler, self._omega = np.zeros(3), np.zeros(3)
        self._last: dict[str, float] = {}

    def join(self, streams: Sequence[Sequence[Measurement]], now: float, silent: Sequence[bool]) -> list[Measurement]:
        """One stream of both, each sensor in order of time.

        Args:
            streams: New readings of each drone, in order of arrival.
            now: Time by the clock of their stamps [s].
            silent: Whether a drone has been silent for a while: the other does not wait for it.
        """
        arrived = sorted(((r, side) for side in SIDES for r in streams[side]), key=lambda pair: pair[0].t_valid)
        found: list[Measurement] = []
        for reading, side in arrived:
            if reading.sensor in STATES:
                found += self._worse(reading, side)
            else:
                found += self._pair(reading, side)
        for sensor in self._waiting:
            found += self._give_up(sensor, now, silent)
        return [reading for reading in found if self._in_order(reading)]

    def _in_order(self, reading: Measurement) -> bool:
        last = self._last.get(reading.sensor, -np.inf)
        if last >= reading.t_valid > last - JUMP:  # one from long before: a clock was set back
            return False
        self._last[reading.sensor] = reading.t_valid
        return True

    def _worse(self, reading: Measurement, side: int) -> list[Measurement]:
        self._newest[side][reading.sensor] = reading
        other = self._newest[1 - side].get(reading.sensor)
        if other is None or reading.t_valid - other.t_valid > OUTDATED:
            return [reading]
        a, b = reading.value, other.value
        both = np.array([min(a[0], b[0]), a[1] + b[1]]) if reading.sensor == "battery" else np.maximum(a, b)
        return [Measurement(reading.sensor, both, reading.t_valid)]

    def _pair(self, reading: Measurement, side: int) -> list[Measurement]:
        mine, other = (self._waiting.setdefault(reading.sensor, ([], []))[s] for s in (side, 1 - side))
        if not other:
            mine.append(reading)
            overdue = mine[:-WAITING]
            del mine[:-WAITING]
            return [self._alone(r, side) for r in overdue]
        nearest = min(range(len(other)), key=lambda i: abs(other[i].t_valid - reading.t_valid))
        partner, late = other[nearest], other[:nearest]
        del other[: nearest + 1]
        found = [self._alone(r, 1 - side) for r in late]
        if abs(partner.t_valid - reading.t_valid) > TOGETHER:
            mine.append(reading)
            return [*found, self._alone(partner, 1 - side)]
        return [*found, self._mean(reading, partner)]

    def _give_up(self, sensor: str, now: float, silent: Sequence[bool]) -> list[Measurement]:
        found = []
        for side in SIDES:
            mine = self._waiting[sensor][side]
            while mine and (silent[1 - side] or now - mine[0].t_valid > TOGETHER):
                found.append(self._alone(mine.pop(0), side))
        return found

    def _mean(self, a: Measurement, b: Measurement) -> Measurement:
        change = b.value - a.value
        value = a.value + 0.5 * (wrapped(change) if a.sensor == "attitude" else change)
        return self._noted(Measurement(a.sensor, value, 0.5 * (a.t_valid + b.t_valid)))

    def _alone(self, reading: Measurement, side: int) -> Measurement:
        move = _MOVES.get(reading.sensor)
        value = reading.value if move is None else move(reading.value, self._levers[side], self._euler, self._omega)
        return self._noted(Measurement(reading.sensor, value, reading.t_valid))

    def _noted(self, reading: Measurement) -> Measurement:
        if reading.sensor == "attitude":
            reading = Measurement("attitude", wrapped(reading.value), reading.t_valid)
            self._euler = reading.value
        elif reading.sensor == "gyro":
            self._omega = reading.value
        return reading


def _in_n(euler: Float[np.ndarray, "3"], r: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """R_nb r."""
    return rotation_from_euler(euler) @ r


# Sensor -> its reading at CO from that at r: (value, r, Euler angles, omega)
_MOVES: dict[str, Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]] = {
    "pressure": lambda value, r, euler, omega: value - _in_n(euler, r)[2],
    "altimeter": lambda value, r, euler, omega: value + _in_n(euler, r)[2],
    "position": lambda value, r, euler, omega: value - _in_n(euler, r)[:2],
    "dvl": lambda value, r, euler, omega: value - np.cross(omega, r),
    "accelerometer": lambda value, r, euler, omega: value - np.cross(omega, np.cross(omega, r)),
}
