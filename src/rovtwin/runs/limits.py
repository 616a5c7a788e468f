"""What a vehicle can do at most, in plain numbers, for whoever judges a mission before or after it."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.gnc.guidance.level_speed import SPARE
from rovtwin.gnc.scales import VehicleScales
from rovtwin.vehicle import Model
from rovtwin.vehicle.analysis.stability import steady_speed
from rovtwin.vehicle.physics.actuation import axis_limits, size

TURNING = 1.2  # room to turn, over that at the largest turning rate
_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


@dataclass(frozen=True)
class Limits:
    """Limits of each axis alone, surge to yaw; columns: negative and positive direction, as sizes.

    Attributes:
        length: Cube root of the volume of water that the vehicle displaces [m].
        force: Of all thrusters together, weight and buoyancy counted in heave [N, N m]; 0 along an axis without
            thrusters.
        top: Speed at which drag takes all of it [m/s, rad/s].
        mass: Of each axis, added mass included [kg, kg m2].
        level: Speed through the water in surge and sway at which it stays level [m/s].
        upright: Speed at which half of what rights it is left [m/s].
        munk_yaw: Added mass in sway beyond that in surge [kg]: a flow of speed U turns the vehicle across itself with
            up to half of it times U^2 (Fossen 2021, sec. 6.3.3).
    """

    length: float
    force: Float[np.ndarray, "6 2"]
    top: Float[np.ndarray, "6 2"]
    mass: Float[np.ndarray, "6"]
    level: Float[np.ndarray, "2"]
    upright: Float[np.ndarray, "2"]
    munk_yaw: float

    @classmethod
    def of(cls, model: Model) -> "Limits":
        """Of a model with sound thrusters."""
        low, high = axis_limits(model)
        net = np.zeros(6)
        net[2] = float(model.weight) - float(model.buoyancy)
        force = np.maximum(np.stack([-(low + net), high + net], axis=1), 0.0)
        force[low >= high] = 0.0
        top = [[steady_speed(model, i, -float(a)), steady_speed(model, i, float(b))] for i, (a, b) in enumerate(force)]
        scales, added = VehicleScales.of(model), np.diagonal(np.asarray(model.added_mass))
        return cls(
            length=size(model),
            force=force,
            top=np.array(top),
            mass=np.diagonal(np.asarray(model.inertia)),
            level=scales.level_speed,
            upright=scales.upright[:2],
            munk_yaw=float(added[1] - added[0]),
        )

    def can(self, axis: int) -> bool:
        """Whether thrusters push both ways along an axis."""
        return bool(self.force[axis].min() > 0.0)

    def both_ways(self, axis: int) -> float:
        """Force or moment that there is either way [N or N m]."""
        return float(self.force[axis].min())

    def turning_room(self, speed: float) -> float:
        """Radius that a vehicle without thrust in sway needs to turn at a speed [m], a fifth more than at its quickest.

        0 for one that goes sideways, and one that nothing turns.
        """
        rate = float(self.top[5].min())
        if self.can(1) or rate <= 0.0:
            return 0.0
        return TURNING * min(speed, float(self.top[0, 1])) / rate

    @property
    def turns_in(self) -> float:
        """Largest flow in which the moment in yaw turns the vehicle through every heading [m/s]; inf: any."""
        return math.sqrt(2.0 * self.both_ways(5) / self.munk_yaw) if self.munk_yaw > 0.0 else math.inf

    @property
    def through(self) -> Float[np.ndarray, "2 2"]:
        """Speed through the water in surge and sway, columns as above, by thrust and level [m/s]."""
        return np.minimum(self.top[:2], self.level[:, None])

    @property
    def through_water(self) -> float:
        """The largest of them, with the better axis turned into the current [m/s]."""
        return max(float(self.through[0, 1]), float(self.through[1].min()))

    def made_good(self, along: float, across: float) -> float:
        """Largest speed over ground in a current with these parts along and across the course [m/s]; -inf: none.

        It looks along the course and crabs, or turns its bow into the current, or its side where that is level longer.
        """
        ahead, aside = self.through[0, 1], self.through[1, 0 if across > 0 else 1]  # it pushes against what runs across
        best = -math.inf
        if aside > abs(across):
            level = self.level[0] * math.sqrt(max(1.0 - (across / self.level[1]) ** 2, 0.0))
            best = min(float(self.top[0, 1]), level) + along
        turns = math.hypot(along, across) > SPARE * self.level[0]  # else it goes slower (`gnc.guidance.level_speed`)
        for speed in (ahead, self.through[1].min() if turns else 0.0):
            if speed > abs(across):
                best = max(best, math.sqrt(speed**2 - across**2) + along)
        return float(best)

    def stopping(self, speed: float) -> float:
        """Way from a speed ahead to rest under full thrust astern, without drag [m]; inf without such thrust."""
        braking = float(self.force[0, 0] / self.mass[0])
        return 0.5 * speed**2 / braking if braking > 0.0 else math.inf


def compass_point(angle: float) -> str:
    """The nearest of the eight points of the compass to an angle from north over east [rad]."""
    return _POINTS[round(angle / (math.pi / 4.0)) % 8]
