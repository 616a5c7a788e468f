"""How long pulls, ways home and decays of a test take, and how far a hand tilts: from the vehicle that flies it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.gnc.experiment import mixing
from rovtwin.gnc.scales import VehicleScales
from rovtwin.vehicle.physics.linearisation import restoring_stiffness
from rovtwin.vehicle.physics.model import Model

TWO_HANDS = 150.0  # force of a person who tilts a vehicle by its edge [N]
TIPPED = 0.7  # largest sine of a release: 45 degrees


@dataclass(frozen=True)
class ExperimentScales:
    """What a test's lengths and times are multiples of.

    Attributes:
        able: Axes that thrusters push alone.
        rise: Time in which a pull along each axis reaches its speed, m/d and the thrusters' lag [s]; along an axis
            without thrusters the mean of the others.
        unit: Geometric mean of `rise` over the directions that thrusters push, of the turns where there are none [s].
        home: Time constant of the way home: one over the bandwidth [s].
        swing: Longer natural period of roll and pitch [s]; None where nothing rights the vehicle.
        tilt: Largest roll and pitch that two hands hold against the righting moment [rad]; 0 where nothing rights the
            vehicle.
        length: Cube root of the volume [m].
    """

    able: Bool[np.ndarray, "6"]
    rise: Float[np.ndarray, "6"]
    unit: float
    home: float
    swing: float | None
    tilt: Float[np.ndarray, "2"]
    length: float

    @classmethod
    def of(cls, model: Model) -> "ExperimentScales":
        """Of the vehicle as it is assumed to be."""
        scales = VehicleScales.of(model)
        able = np.abs(mixing(model)).max(axis=0, initial=0.0) > 0
        able &= scales.acceleration > 0.0
        lag = float(np.max(np.asarray(model.thrusters.time_constant), initial=0.0))
        rise = scales.top / np.where(able, scales.acceleration, 1.0) + 2.0 * lag
        some = able & (np.arange(6) < 3) if able[:3].any() else able
        unit = float(np.exp(np.log(rise[some]).mean())) if some.any() else 1.0 / scales.level_bandwidth
        righting = float(restoring_stiffness(model)[3])
        inertia = np.diagonal(np.asarray(model.inertia))[3:5]
        swing = float(2.0 * np.pi * np.sqrt(inertia.max() / righting)) if righting > 0.0 else None
        # Roll is turned by the side, pitch by the bow.
        lever = np.abs(np.asarray(model.hull.corners)).max(axis=0)[[1, 0]]
        tilt = np.arcsin(np.minimum(TIPPED, TWO_HANDS * lever / righting)) if righting > 0.0 else np.zeros(2)
        return cls(able, np.where(able, rise, unit), unit, 1.0 / scales.level_bandwidth, swing, tilt, scales.length)
