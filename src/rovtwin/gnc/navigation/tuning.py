"""What the filter assumes of its sensors, of its model and of the sea."""

from collections.abc import Container, Mapping, Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.sensors import SENSORS, kind_of
from rovtwin.core.types import Scalar, Vector3
from rovtwin.gnc.mounting import Mount
from rovtwin.gnc.navigation.state import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    CURRENT,
    DRAG,
    ERRORS,
    FORCE_B,
    FORCE_N,
    GYRO_BIAS,
    POSITION,
    VELOCITY,
    WAVE_PLACE,
    WAVE_VELOCITY,
)
from rovtwin.gnc.scales import VehicleScales
from rovtwin.gnc.thesis.ekf_tuning import STATES
from rovtwin.vehicle.physics.model import Model

SENSOR_STD = {name: SENSORS[name].std for name in STATES}
"""Usual standard deviation of the sensors that the filter takes in, per axis."""

GATE = {"position": 18.4, "pressure": 15.1, "attitude": 21.1, "dvl": 21.1, "accelerometer": 21.1}
"""Largest squared normalised innovation accepted: chi-square of 2, 1, else 3 degrees of freedom at 1e-4."""


class Tuning(eqx.Module):
    """Beliefs of the filter; what walks is given as the standard deviation after one second.

    Attributes:
        mounts: Sensors by name; those that are not named are left out.
        initial_std: Of the error at the start; of north and east `Start.position_std` tells.
        walk: White noise that drives each error [unit/sqrt(s)].
        acceleration_noise: Unmodelled acceleration as white noise [m/s/sqrt(s)]: surge, sway, heave.
        acceleration_share: Share of the model's own acceleration by which it may err (a mass that is not right).
        acceleration_memory: How long such an error lasts [s].
        turn_noise: Attitude while the gyro is silent [rad/sqrt(s)].
        wave_damping: Half the relative width of the band of waves.
        wave_slip: Share of the waves' heave by which the vehicle does not follow the water.
        gate: By kind of sensor, squared normalised innovation beyond which a reading counts as an outlier.
        patience: So many positions beyond the gate in a row that agree with each other are accepted.
        max_rejections: So many ticks in a row may another sensor be beyond its gate before it is accepted.
        max_age: Of a reading [s]; one with a stamp further off counts as new.
    """

    mounts: dict[str, Mount]
    initial_std: Float[Array, "31"] = eqx.field(converter=as_array)
    walk: Float[Array, "31"] = eqx.field(converter=as_array)
    acceleration_noise: Vector3 = eqx.field(converter=as_array)
    acceleration_share: Scalar = eqx.field(converter=as_array)
    acceleration_memory: Scalar = eqx.field(converter=as_array)
    turn_noise: Scalar = eqx.field(converter=as_array)
    wave_damping: Scalar = eqx.field(converter=as_array)
    wave_slip: Scalar = eqx.field(converter=as_array)
    gate: dict[str, Scalar]
    patience: int = eqx.field(static=True)
    max_rejections: int = eqx.field(static=True)
    max_age: Scalar = eqx.field(converter=as_array)

    def named(self, kind: str, among: Container[str]) -> list[str]:
        """Names of the sensors of a kind that are known and `among` those on board."""
        return [name for name in sorted(self.mounts) if kind_of(name) == kind and name in among]

    @property
    def rate_variance(self) -> Vector3:
        """Of the angular velocity that all gyros together tell, b [rad2/s2]."""
        gyros = [self.mounts[name].variance for name in self.named("gyro", self.mounts)]
        if not gyros:
            return jnp.full(3, 1.0) * self.turn_noise**2
        return gyros[0] if len(gyros) == 1 else 1.0 / jnp.sum(1.0 / jnp.stack(gyros), axis=0)

    @classmethod
    def of(
        cls,
        model: Model,
        mounts: Mapping[str, Mount] | None = None,
        *,
        force_walk: float | None = None,
        turning_force_walk: float | None = None,
        drag_std: float = 0.14,
        force_std: float | None = None,
        turning_force_std: float | None = None,
        current_std: float | None = None,
        acceleration_noise: float = 1e-3,
        acceleration_share: float = 0.1,
        wave_damping: float = 0.2,
        wave_slip: float = 0.3,
        max_age: float = 2.0,
        gyro_bias: float = 1e-5,
        gyro_bias_walk: float = 1e-8,
        accelerometer_bias: float = 0.03,
        accelerometer_bias_walk: float = 1e-5,
    ) -> "Tuning":
        """Beliefs in the units in which people think of them; forces, speeds and times that are None: the vehicle's.

        Args:
            model: The vehicle, whose size says what disturbs it.
            mounts: Sensors; None: those of thesis table 5.7 and a DVL, at CO.
            force_walk: Of the disturbance force, each axis of n [N/sqrt(s)].
            turning_force_walk: Of the one that turns with the vehicle [N/sqrt(s)].
            drag_std: Relative error of the model's drag.
            force_std: Disturbance force at the start [N].
            turning_force_std: The same of the one that turns with the vehicle [N].
            current_std: Water's velocity at the start, each axis [m/s].
            acceleration_noise: Unmodelled acceleration as white noise [m/s/sqrt(s)].
            acceleration_share: Relative error of the model's acceleration.
            wave_damping: Half the relative width of the band of waves.
            wave_slip: Share of the waves' heave by which the vehicle does not follow the water.
            max_age: How far back readings are compared with the past [s].
            gyro_bias: At the start, each axis [rad/s].
            gyro_bias_walk: [rad/s/sqrt(s)].
            accelerometer_bias: At the start, each axis [m/s2].
            accelerometer_bias_walk: [m/s2/sqrt(s)].
        """
        scales, own = VehicleScales.of(model), disturbance_levels(model)
        force_walk, force_std, current_std = (
            own[name] if given is None else given
            for name, given in (("force_walk", force_walk), ("force_std", force_std), ("current_std", current_std))
        )
        if turning_force_walk is None:
            turning_force_walk = 0.1 * scales.force_walk
        if turning_force_std is None:
            turning_force_std = 0.015 * scales.level_force
        # A current changes by its own size in some thousand times the controller's time.
        current_walk = 0.01414 * own["current_std"] * np.sqrt(scales.level_bandwidth)
        start = (
            (POSITION, [0.0, 0.0, 0.02]),
            (VELOCITY, [own["current_std"]] * 3),
            (ATTITUDE, [0.01] * 3),
            (WAVE_PLACE, [0.1] * 3),
            (WAVE_VELOCITY, [0.15] * 3),
            (GYRO_BIAS, [gyro_bias] * 3),
            (ACCELEROMETER_BIAS, [accelerometer_bias] * 3),
            (FORCE_N, [force_std, force_std, 0.01 * scales.weight]),
            (FORCE_B, [turning_force_std] * 2),
            (CURRENT, [current_std] * 2),
            (DRAG, [drag_std] * 3),
        )
        walk = (
            (GYRO_BIAS, [gyro_bias_walk] * 3),
            (ACCELEROMETER_BIAS, [accelerometer_bias_walk] * 3),
            (FORCE_N, [force_walk] * 3),
            (FORCE_B, [turning_force_walk] * 2),
            (CURRENT, [current_walk] * 2),
            (DRAG, [2e-3] * 3),
        )
        return cls(
            mounts=dict(mounts or {name: Mount(std) for name, std in SENSOR_STD.items()}),
            initial_std=_laid_out(start),
            walk=_laid_out(walk),
            acceleration_noise=np.full(3, acceleration_noise),
            acceleration_share=acceleration_share,
            acceleration_memory=1.0 / scales.level_bandwidth,
            turn_noise=0.05,
            wave_damping=wave_damping,
            wave_slip=wave_slip,
            gate={name: as_array(value) for name, value in GATE.items()},
            patience=3,
            max_rejections=15,
            max_age=max_age,
        )


def disturbance_levels(model: Model) -> dict[str, float]:
    """What a vehicle's size says of the forces and currents that it meets: `force_walk`, `force_std`, `current_std`.

    The sea's forces grow with the weight (Froude's law), forces at the start are a tenth of the thrust, and nobody
    flies a vehicle in currents much above a third of its speed. One without level thrust meets them all the same.
    """
    scales = VehicleScales.of(model)
    fastest = float(scales.top[:2].max())
    return {
        "force_walk": scales.force_walk,
        "force_std": 0.1 * (scales.level_force or 0.034 * scales.weight),
        "current_std": 0.309 * (fastest or 0.2 * scales.wave_speed),
    }


def _laid_out(parts: Sequence[tuple[slice, list[float]]]) -> Float[np.ndarray, "31"]:
    whole = np.zeros(ERRORS)
    for place, values in parts:
        whole[place] = values
    return whole
