"""What the marker filter assumes about noise and motion, and when it rejects a marker."""

import equinox as eqx

from rovtwin.core.numerics import as_array
from rovtwin.core.types import Index, Scalar, Vector3


class SlamTuning(eqx.Module):
    """Standard deviations and limits.

    Attributes:
        pixel: Of a corner, of whatever size its marker is: `detection` finds all alike [px].
        attitude: Of one reading of roll, pitch and yaw, independent from frame to frame [rad].
        acceleration: Of the vehicle, which is a first-order Gauss-Markov process [m/s2], axes of n.
        correlation: Its correlation time [s].
        start_position: Of the position at the start [m]; zero where no marker's place is known: the start is the frame.
        start_velocity: Of the velocity at the start [m/s].
        offset: Of a constant offset of the attitude, axes of n [rad]; zero keeps the attitude's north.
        offset_walk: Its random walk [rad/sqrt(s)].
        tilt: Of a new marker's attitude, before its corners are looked at [rad].
        gate: Largest squared normalised innovation of eight coordinates that is accepted.
        patience: Frames in a row in which a marker may contradict the others before it is taken for moved, and in
            which all may contradict before the vehicle is taken for lost.
        wide: Standard deviation of the position beyond which it is taken afresh from what is seen [m].
    """

    pixel: Scalar
    attitude: Vector3
    acceleration: Vector3
    correlation: Scalar
    start_position: Scalar
    start_velocity: Scalar
    offset: Vector3
    offset_walk: Vector3
    tilt: Scalar
    gate: Scalar
    patience: Index
    wide: Scalar

    @classmethod
    def of(
        cls,
        pixel: float = 0.12,
        attitude: object = 1e-3,
        acceleration: object = 0.1,
        correlation: float = 1.0,
        start_position: float = 0.0,
        start_velocity: float = 0.3,
        offset: object = 0.0,
        offset_walk: object = 0.0,
        tilt: float = 0.6,
        gate: float = 35.0,
        patience: int = 5,
        wide: float = 0.3,
    ) -> "SlamTuning":
        """Defaults: a small ROV in calm water, and the noise of the thesis's attitude sensor (1 mrad)."""
        three = as_array([1.0, 1.0, 1.0])
        return cls(
            as_array(pixel),
            three * as_array(attitude),
            three * as_array(acceleration),
            as_array(correlation),
            as_array(start_position),
            as_array(start_velocity),
            three * as_array(offset),
            three * as_array(offset_walk),
            as_array(tilt),
            as_array(gate),
            as_array(patience, dtype=int),
            as_array(wide),
        )
