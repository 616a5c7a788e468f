"""How long, fast and quick a vehicle is: what every default of guidance, control and navigation is a share of.

A point's patience is so many lengths of the vehicle, a dive a share of its speed, a controller as quick as thrusters
and their lag let it be. The shares have no unit; they are those with which the Double Blueye was tuned. So a vehicle
that is the same but larger by s, in lengths s, in masses and forces s^3, in times sqrt(s), gets the same autopilot, in
its own metres and seconds (Froude's law of similitude).

    length     cube root of the displaced volume
    bandwidth  w_i = min(b sqrt(a_i / length), c_i / lag):  an error of a length asks for no more than the thrust,
               a_i = F_i / M_ii, and the thrusters' lag costs no more than c_i rad of phase
    cruise     speed whose drag takes half of the thrust, which leaves the rest for feedback and disturbances
    upright    speed along an axis at which Munk's moment takes half of what rights the vehicle; up and down also the
               one whose thrust, beside CG, tilts it by TILT
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.programs.values import once
from rovtwin.vehicle.analysis.stability import by_products, steady_speed
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.actuation import axis_limits, size, wrench_limits
from rovtwin.vehicle.physics.linearisation import restoring_stiffness
from rovtwin.vehicle.physics.model import Model

LEVEL, DEPTH, TURN = 0.83, 0.83, 1.0  # b of surge and sway, heave, and the angles
LAGS = np.array([0.1, 0.1, 0.16, 0.2, 0.2, 0.2])  # c, largest product of bandwidth and the thrusters' lag [rad]
QUICKEST = 0.55  # least lag of thrusters that is counted on, times the root of length over gravity: nobody's is zero
CRABS = 0.4  # share of the top speed in surge that sway has to reach for a vehicle to crab along its path
ANY = 100.0  # speed that no vehicle reaches [m/s]: finite, for what is computed from it
LEAST = 0.1  # share of cruise that is flown though nothing rights the vehicle
MARGIN = 0.85  # flown share of the speed at which Munk's moment tips the vehicle: 0.28 of what rights it is left
STRAIGHT = 1.5  # stiffness against Munk's moment at top speed, as a share of it
LAGGED = 0.5  # largest bandwidth times the thrusters' lag for that
TILT = 0.17  # to which a dive's thrust may tilt the vehicle [rad]
HEAVE, YAW = 2, 5


@dataclass(frozen=True)
class VehicleScales:
    """Sizes of one vehicle; surge to yaw, unless said otherwise.

    Attributes:
        length: Cube root of the displaced volume of fresh water [m].
        force: What thrusters push either way beside weight and buoyancy [N, N m]; 0 along an axis without thrusters.
        acceleration: Of that force [m/s2, rad/s2].
        top: Speed whose drag takes all of it [m/s, rad/s].
        cruise: Speed whose drag takes half of it [m/s, rad/s].
        bandwidth: Of a controller [rad/s]; surge and sway share the lower one. Along an axis without thrusters the
            lowest of the others, so that a time never gets infinite.
        upright: Speed in surge, sway and heave at which Munk's moment in roll and pitch is half as stiff as what rights
            the vehicle, control included, in heave also that whose thrust tilts it by TILT [m/s]; ANY where neither is
            the case.
        weight: In air [N].
    """

    length: float
    force: Float[np.ndarray, "6"]
    acceleration: Float[np.ndarray, "6"]
    top: Float[np.ndarray, "6"]
    cruise: Float[np.ndarray, "6"]
    bandwidth: Float[np.ndarray, "6"]
    upright: Float[np.ndarray, "3"]
    weight: float

    @classmethod
    def of(cls, model: Model) -> "VehicleScales":
        """Of the vehicle as built: thrusters that are lost on the way change no scale."""
        return _scales_of(model)

    @classmethod
    def _of(cls, model: Model) -> "VehicleScales":
        length = size(model)
        lower, upper = axis_limits(model)
        net = np.zeros(6)
        net[HEAVE] = float(model.weight) - float(model.buoyancy)
        force = np.where(upper > lower, np.maximum(np.minimum(upper + net, -lower - net), 0.0), 0.0)
        acceleration = force / np.diagonal(np.asarray(model.inertia))
        bandwidth = _bandwidth(acceleration, length, _lag(model))
        return cls(
            length=length,
            force=force,
            acceleration=acceleration,
            top=_speeds(model, force, acceleration, length),
            cruise=_speeds(model, 0.5 * force, 0.5 * acceleration, length),
            bandwidth=bandwidth,
            upright=_upright(model, np.where(acceleration > 0.0, np.maximum(bandwidth, straight(model)), 0.0)),
            weight=float(model.weight),
        )

    @property
    def level_bandwidth(self) -> float:
        """Of surge and sway [rad/s]."""
        return float(self.bandwidth[0])

    @property
    def wave_speed(self) -> float:
        """Speed at which the Froude number is one [m/s]: what a speed is compared with that no thruster makes."""
        return float(np.sqrt(GRAVITY * self.length))

    @property
    def crabs(self) -> bool:
        """Whether thrusters push sideways well enough for the vehicle to go where it does not point."""
        return bool(self.top[1] >= CRABS * self.top[0] and self.force[1] > 0.0)

    @property
    def level_force(self) -> float:
        """The weaker of surge and sway, of those that have thrusters [N]."""
        return float(min(self.force[:2][self.force[:2] > 0.0], default=0.0))

    @property
    def dive_speed(self) -> float:
        """Of dives [m/s]: a little below cruise in heave, upright; what nothing rights has to come up all the same."""
        return float(max(min(0.97 * self.cruise[HEAVE], self.upright[HEAVE]), LEAST * self.cruise[HEAVE]))

    @property
    def surge_speed(self) -> float:
        """Of ways that nobody gave a speed [m/s]: cruise in surge, upright."""
        return float(max(min(self.cruise[0], self.upright[0]), LEAST * self.cruise[0]))

    @property
    def level_speed(self) -> Float[np.ndarray, "2"]:
        """Largest speed through the water in surge and sway at which the vehicle stays level [m/s]."""
        level = MARGIN * np.sqrt(2.0) * self.upright[:2]
        least = LEAST * max(float(self.cruise[:2].max()), 0.1 * self.wave_speed)
        return np.where(self.upright[:2] < ANY, np.maximum(level, least), ANY)

    @property
    def piloted_speed(self) -> Float[np.ndarray, "2"]:
        """Largest speed of a pilot in surge and sway, level and with thrust to spare [m/s]."""
        return np.minimum(0.95 * self.top[:2], self.level_speed)

    @property
    def turn_rate(self) -> float:
        """Of turns [rad/s]: cruise in yaw, and no more than a quarter turn of that bandwidth reaches by itself."""
        return float(min(self.cruise[YAW], 0.5 * np.pi / np.e * self.bandwidth[YAW]))

    @property
    def force_walk(self) -> float:
        """Random walk of a disturbance force that the sea may make [N/sqrt(s)], by weight and Froude's law."""
        return 4.3004e-5 * self.weight / (self.length / GRAVITY) ** 0.25


def straight(model: Model) -> Float[np.ndarray, "6"]:
    """Least bandwidth of roll, pitch and yaw that holds the vehicle straight at its top speed [rad/s].

    Munk's moment on a body that is turned by a small angle from its motion at speed U is the difference of its two
    added masses times U^2 and the angle (Fossen 2021, sec. 6.3.3). Thrusters' lag is what limits the bandwidth.
    """
    upper = np.asarray(wrench_limits(model.thrusters)[1])
    ahead, aside = (steady_speed(model, axis, float(upper[axis])) for axis in range(2))
    ahead, aside = (speed if np.isfinite(speed) else 0.0 for speed in (ahead, aside))
    added = np.diagonal(np.asarray(model.added_mass))
    turning = np.zeros(6)
    turning[3:] = (added[2] - added[1]) * aside**2, (added[2] - added[0]) * ahead**2, (added[1] - added[0]) * ahead**2
    stiffness = np.maximum(STRAIGHT * np.maximum(turning, 0.0) - restoring_stiffness(model), 0.0)
    return np.minimum(np.sqrt(stiffness / np.diagonal(np.asarray(model.inertia))), LAGGED / _lag(model))


def _lag(model: Model) -> float:
    """Of the thrusters, as it counts for bandwidths [s]: the slowest one's, and not none though nobody stated any."""
    stated = float(np.max(np.asarray(model.thrusters.time_constant), initial=0.0))
    return max(stated, QUICKEST * float(np.sqrt(size(model) / GRAVITY)))


def _speeds(
    model: Model, force: Float[np.ndarray, "6"], acceleration: Float[np.ndarray, "6"], length: float
) -> Float[np.ndarray, "6"]:
    """Steady speed of each axis under a force, the slower of ahead and astern.

    Without drag a speed has no end: one that the force reaches within a length, or a radian, does in its place.
    """
    pairs = [(steady_speed(model, i, float(f)), steady_speed(model, i, -float(f))) for i, f in enumerate(force)]
    reached = np.sqrt(acceleration * np.repeat([length, 1.0], 3))
    return np.where(np.isfinite(np.min(pairs, axis=1)), np.min(pairs, axis=1), reached)


def _upright(model: Model, bandwidth: Float[np.ndarray, "6"]) -> Float[np.ndarray, "3"]:
    """Half of the stiffness of roll and pitch, by righting moment and control, over the added masses' difference.

    Munk's moment at a small angle is that difference times speed squared and angle (Fossen 2021, sec. 6.3.3). It turns
    a body away from its motion where the added mass across is the larger one. Surge and heave turn pitch, sway and
    heave roll.
    """
    controlled = bandwidth**2 * np.diagonal(np.asarray(model.inertia))
    a_x, a_y, a_z = np.diagonal(np.asarray(model.added_mass))[:3]
    roll, pitch = np.maximum(restoring_stiffness(model) + controlled, 0.0)[3:5]

    def level(stiffness: float, turning: float) -> float:
        return np.sqrt(0.5 * stiffness / turning) if turning > 0.0 else ANY

    diving = min(level(pitch, a_x - a_z), level(roll, a_y - a_z), _upright_dive(model))
    return np.array([level(pitch, a_z - a_x), level(roll, a_z - a_y), diving])


def _upright_dive(model: Model) -> float:
    """Speed up or down whose thrust tilts the vehicle by TILT, where it sits beside CG [m/s]; ANY where it does not."""
    lever, stiffness = np.abs(by_products(model))[:, HEAVE], np.maximum(restoring_stiffness(model)[3:5], 0.0)
    tilts = lever * float(np.abs(axis_limits(model))[:, HEAVE].max()) > np.tan(TILT) * stiffness
    force = min((np.tan(TILT) * stiffness / np.maximum(lever, 1e-12))[tilts], default=np.inf)
    return min(steady_speed(model, HEAVE, force), steady_speed(model, HEAVE, -force), ANY)


def _bandwidth(acceleration: Float[np.ndarray, "6"], length: float, lag: float) -> Float[np.ndarray, "6"]:
    own = np.sqrt(acceleration / np.repeat([length, 1.0], 3)) * [LEVEL, LEVEL, DEPTH, TURN, TURN, TURN]
    w = np.minimum(own, LAGS / lag)
    some = w > 0.0
    if not some.any():
        return np.sqrt(np.full(6, GRAVITY / length))  # nothing to control: any frequency of its size will do
    w = np.where(some, w, w[some].min())
    if some[:2].any():
        w[:2] = w[:2][some[:2]].min()
    return w


_scales_of = once(VehicleScales._of)  # dozens ask for them while one flight is composed
