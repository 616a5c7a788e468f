"""Tuning of the extended Kalman filter: what it assumes of its sensors, of the disturbance and of its start."""

from collections.abc import Mapping

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import Array, as_array
from rovtwin.core.sensors import SENSORS, kind_of
from rovtwin.core.types import Scalar, Vector6

STATES: dict[str, tuple[int, ...]] = {
    "accelerometer": (6, 7, 8),
    "attitude": (3, 4, 5),
    "dvl": (6, 7, 8),
    "gyro": (9, 10, 11),
    "position": (0, 1),
    "pressure": (2,),
}
"""States of the filter that each sensor reads; the accelerometer's entry is the pseudo-measurement (7.7)."""

SENSOR_STD = {name: SENSORS[name].std for name in STATES if name != "accelerometer"}
"""Usual standard deviation of the sensors that the filter takes in, per axis."""

GATE = {"position": 27.6, "dvl": 30.7}
"""Largest squared normalised innovation accepted: chi-square of 2 and 3 degrees of freedom at a tail of 1e-6."""


class EkfTuning(eqx.Module):
    """Covariances of the filter.

    Attributes:
        measurement_variance: R of each sensor by name, one number for all its axes; sensors that are not named are
            left out.
        process_variance: Intensity of the white noise that drives each of [eta, nu, b] [unit^2/s]: the random walk of
            the disturbance in b, unmodelled acceleration in nu. (2.38) of the thesis has it in the rows of nu alone, so
            that its b never learns.
        initial_variance: Diagonal of P0.
        bias_decay: 1 / T_b of (2.36) [1/s]; 0 is a random walk.
        thrust_noise: White noise of each thruster's force as a share of the force [sqrt(s)].
        gate: By sensor name, the squared normalised innovation (summed over the axes) beyond which a reading counts
            as an outlier; sensors that are not named are not gated.
        patience: After so many readings of a sensor beyond its gate in a row, the next are accepted: the filter errs.
        max_age: Readings are compared with the state when they were taken, as far back as this [s]; a stamp further
            off, or ahead of the filter's clock, is not used and the reading counts as new.
        pseudo_velocity: Whether the accelerometer enters as (7.7).
        thruster_lag: Whether the force follows the command through the thrusters' lag.
    """

    measurement_variance: dict[str, Scalar]
    process_variance: Float[Array, "18"] = eqx.field(converter=as_array)
    initial_variance: Float[Array, "18"] = eqx.field(converter=as_array)
    bias_decay: Vector6 = eqx.field(converter=as_array)
    thrust_noise: Scalar = eqx.field(converter=as_array)
    gate: dict[str, Scalar]
    max_age: Scalar = eqx.field(converter=as_array)
    patience: int = eqx.field(static=True)
    pseudo_velocity: bool = eqx.field(static=True)
    thruster_lag: bool = eqx.field(static=True)

    def uses(self, name: str) -> bool:
        """Whether readings of this sensor are taken in; others are passed over."""
        kind = kind_of(name)
        return kind in self.measurement_variance and (kind != "accelerometer" or self.pseudo_velocity)

    def variance_of(self, name: str) -> Scalar:
        """R of a sensor; of one of several of a kind, its own or else that of the kind."""
        return self.measurement_variance.get(name, self.measurement_variance[kind_of(name)])

    @classmethod
    def as_printed(cls, dt: float = 0.02) -> "EkfTuning":
        """Thesis table 7.2, used as printed: its R and Q are the diagonals of the matrices in (2.40) and (2.41).

        R mixes standard deviations and variances: 0.5 m of the acoustic positions, 3.08e-5 rad/s of the gyro and
        1e-3 rad of the attitude are the standard deviations of table 5.7, 0.017 of the depth and 0.308 of the
        velocity belong to nothing there. Q has 18 entries, so E is the identity, and (2.42) makes the covariance
        added in each tick T^2 Q. The thesis prints neither P0 nor T_b: P0 is that of `consistent`, 1 / T_b is 0.

        Args:
            dt: Step of the filter, T in (2.42) [s].
        """
        Q = np.r_[1e-8, 1e-8, 1e-10, 1e-6, 1e-6, 1e-6, np.full(6, 1e-10), np.full(6, 1e-10)]
        R = {"position": 0.5, "pressure": 0.017, "attitude": 1e-3, "accelerometer": 0.308, "gyro": 3.08e-5}
        R["dvl"] = SENSOR_STD["dvl"] ** 2  # the thesis has none
        return cls(
            measurement_variance={name: as_array(value) for name, value in R.items()},
            process_variance=Q * dt,
            initial_variance=_initial_variance(2.0),
            bias_decay=np.zeros(6),
            thrust_noise=0.0,
            gate={},
            max_age=0.0,
            patience=0,
            pseudo_velocity=True,
            thruster_lag=False,
        )

    @classmethod
    def consistent(
        cls,
        sensor_std: Mapping[str, float] | None = None,
        *,
        force_walk: float = 0.03,
        moment_walk: float = 0.5,
        velocity_noise: float = 1e-3,
        heave_noise: float = 1e-2,
        rate_noise: float = 0.05,
        attitude_walk: float = 3e-5,
        thrust_noise: float = 0.0,
        initial_force: float = 2.0,
        gate: Mapping[str, float] | None = None,
        max_age: float = 1.0,
    ) -> "EkfTuning":
        """What the filter is given is what holds: sensors' real noise, a declared intensity of the disturbance.

        Heave and the moments are declared far worse known than the disturbance asks for. Through C(nu) nu they depend
        on u and v (a sideways drift makes a yaw moment, Munk's), and pressure, gyro and compass are so good that the
        filter would read the horizontal velocity off them to millimetres a second: right for a perfect model, and off
        by decimetres where added masses err by a tenth. It costs nothing, since those states are measured themselves.

        Args:
            sensor_std: Standard deviations by sensor name, instead of those of `SENSOR_STD`.
            force_walk: Random walk of the disturbance force, each axis of n [N/sqrt(s)].
            moment_walk: Of the disturbance moment, each axis of b [N m/sqrt(s)].
            velocity_noise: Unmodelled acceleration in surge and sway as white noise [m/s/sqrt(s)].
            heave_noise: The same in heave.
            rate_noise: Unmodelled angular acceleration as white noise [rad/s/sqrt(s)].
            attitude_walk: What the gyro's bias, which is no state here, does to the attitude between readings of the
                compass [rad/sqrt(s)].
            thrust_noise: White noise of each thruster's force as a share of the force [sqrt(s)].
            initial_force: Standard deviation of the disturbance force at the start [N].
            gate: By sensor name, instead of `GATE`; {} rejects nothing.
            max_age: How far back readings are compared with the past state [s]; 0 takes all as new.
        """
        std = SENSOR_STD | dict(sensor_std or {})
        _check_names("sensor_std", std)
        gate = GATE if gate is None else gate
        _check_names("gate", gate)
        for name, value in std.items():
            if not (np.isfinite(value) and value > 0):
                raise ConfigError(f"sensor_std: {name}: found {value}, expected a positive standard deviation")
        _check_sizes(
            force_walk=force_walk,
            moment_walk=moment_walk,
            velocity_noise=velocity_noise,
            heave_noise=heave_noise,
            rate_noise=rate_noise,
            attitude_walk=attitude_walk,
            thrust_noise=thrust_noise,
            initial_force=initial_force,
            max_age=max_age,
        )
        noise = np.r_[
            np.zeros(3), np.full(3, attitude_walk), np.full(2, velocity_noise), heave_noise, np.full(3, rate_noise)
        ]
        walk = np.r_[np.full(3, force_walk), np.full(3, moment_walk)]
        return cls(
            measurement_variance={name: as_array(value**2) for name, value in std.items()},
            process_variance=np.r_[noise, walk] ** 2,
            initial_variance=_initial_variance(initial_force),
            bias_decay=np.zeros(6),
            thrust_noise=thrust_noise,
            gate={name: as_array(value) for name, value in gate.items()},
            max_age=max_age,
            patience=5,
            pseudo_velocity=False,
            thruster_lag=True,
        )


def _initial_variance(initial_force: float) -> Float[Array, "18"]:
    """P0: the place is known to decimetres, velocity and disturbance are not."""
    pose = [0.1, 0.1, 0.02, 0.01, 0.01, 0.01]
    rates = [0.05] * 3 + [0.02] * 3
    disturbance = [initial_force] * 3 + [0.2] * 3
    return as_array(np.square(pose + rates + disturbance))


def _check_names(where: str, given: Mapping[str, object]) -> None:
    for name in given:
        if kind_of(name) not in STATES:
            raise ConfigError(f"{where}: no sensor {name!r}; the filter knows {', '.join(STATES)}")


def _check_sizes(**given: float) -> None:
    for name, value in given.items():
        if not (np.isfinite(value) and value >= 0):
            raise ConfigError(f"{name}: found {value}, expected a number of at least 0")
