"""How long a vehicle takes along a way of straight legs, stopping to turn at each corner.

That is what the autopilots here do. A leg begins and ends at rest, with constant acceleration between rest and the
survey's speed; a turn begins and ends at rest likewise, up to a largest rate. Half of the thrust speeds up and turns,
the other half is kept for course and depth.

Reference: Fossen (2021), ch. 6.5 (decoupled equations of motion).
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import wrapped
from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.analysis.stability import reach, steady_speed
from rovtwin.vehicle.physics.model import Model

SHARE = 0.5  # of the largest force or moment, for speeding up and turning


@dataclass(frozen=True)
class Pace:
    """What a vehicle does along a way.

    Attributes:
        speed: On legs [m/s].
        speeding: Acceleration from rest [m/s^2].
        slowing: To rest, positive [m/s^2].
        turning_rate: Largest [rad/s].
        turning: Angular acceleration [rad/s^2].
        settling: Time at speed before a line in which the autopilot settles on its course [s].
    """

    speed: float
    speeding: float
    slowing: float
    turning_rate: float
    turning: float
    settling: float = 0.0

    @classmethod
    def of(cls, model: Model, speed: float, settling: float = 0.0) -> "Pace":
        """From a vehicle's thrust, drag and inertia in surge and yaw.

        Raises:
            ConfigError: It cannot go as fast with half its thrust, or cannot turn.
        """
        (astern, ahead), (port, starboard) = reach(model)[0], reach(model)[5]
        top = top_of_lines(model)
        if not 0 < speed < top:
            raise ConfigError(
                f"speed: found {speed:g} m/s, expected more than 0 and less than the {top:.2g} m/s that half of the "
                "thrust ahead gives; the other half keeps course"
            )
        moment = SHARE * min(-port, starboard)
        if moment <= 0:
            raise ConfigError("vehicle: its thrusters cannot turn it both ways, so that it can fly no lines")
        mass = np.asarray(model.inertia)
        # Drag helps to slow down and hinders speeding up, at the middle of both by half of its largest.
        drag = 0.5 * drag_ahead(model, speed)
        return cls(
            speed,
            (SHARE * ahead - drag) / mass[0, 0],
            (-SHARE * min(astern, 0.0) + drag) / mass[0, 0],
            min(steady_speed(model, 5, moment), steady_speed(model, 5, -moment)),
            moment / mass[5, 5],
            settling,
        )

    @property
    def lead_in(self) -> float:
        """Way from rest until speed and course are steady [m]."""
        return self.speed**2 / (2.0 * self.speeding) + self.speed * self.settling

    @property
    def lead_out(self) -> float:
        """Way to rest [m]."""
        return self.speed**2 / (2.0 * self.slowing)

    def leg(self, length: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
        """Times of legs [s] of lengths [m], both of any shape."""
        ramps = self.speed**2 * (0.5 / self.speeding + 0.5 / self.slowing)
        return np.where(length >= ramps, length / self.speed + ramps / self.speed, _peak(length, ramps, self.speed))

    def turn(self, angle: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
        """Times of turns [s] by angles [rad] of any sign and shape."""
        size, ramps = np.abs(angle), self.turning_rate**2 / self.turning
        if not np.isfinite(ramps):
            return 2.0 * np.sqrt(size / self.turning)
        long = size / self.turning_rate + ramps / self.turning_rate
        return np.where(size >= ramps, long, _peak(size, ramps, self.turning_rate))

    def times(self, points: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, " legs"], Float[np.ndarray, " turns"]]:
        """Times of the legs between points [s], and of the turns between them.

        The vehicle begins at the first point, turned to the second.
        """
        legs = np.diff(points, axis=0)
        course = np.arctan2(legs[:, 1], legs[:, 0])
        angle = wrapped(np.diff(course))
        return self.leg(np.linalg.norm(legs, axis=1)), self.turn(angle)


def _peak(length: Float[np.ndarray, "*axes"] | float, ramps: float, speed: float) -> Float[np.ndarray, "*axes"] | float:
    """Time of a leg too short for the full speed: up and down without a steady part."""
    return 2.0 * np.sqrt(np.maximum(length, 0.0) * ramps) / speed


def top_of_lines(model: Model) -> float:
    """Speed ahead that SHARE of the thrust gives [m/s]: lines are flown slower; 0 without thrust ahead."""
    ahead = float(reach(model)[0][1])
    return steady_speed(model, 0, SHARE * ahead) if ahead > 0 else 0.0


def line_speed(model: Model) -> float:
    """Fastest speed to the centimetre at which lines can be flown [m/s]; 0 where there is none."""
    return math.floor(100.0 * (top_of_lines(model) - 1e-6)) / 100.0 if top_of_lines(model) > 0.0 else 0.0


def drag_ahead(model: Model, speed: float) -> float:
    """Drag in surge at a speed ahead through the water [N]."""
    linear, quadratic = (
        float(np.asarray(d)[0, 0]) for d in (model.linear_damping_ahead, model.quadratic_damping_ahead)
    )
    return (linear + quadratic * speed) * speed
