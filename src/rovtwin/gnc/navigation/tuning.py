"""What the filter believes of its sensors, of its model and of the sea."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import numpy as np

from rovtwin.core.numerics import Array, as_array
from rovtwin.gnc import ekf_tuning
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

SENSOR_STD = ekf_tuning.SENSOR_STD | {"accelerometer": 0.0308}
"""Of thesis table 5.7 and of a DVL, per axis [m, rad, m/s, rad/s, m/s2]."""

GATE = {"position": 18.4, "pressure": 15.1, "attitude": 21.1, "dvl": 21.1, "accelerometer": 21.1}
"""Largest squared normalised innovation believed: chi-square of 2, 1, else 3 degrees of freedom at 1e-4."""


class Mount(eqx.Module):
    """A sensor as the filter believes it: std per axis, place seen from CO, b [m], (3,), and R_bs, (3, 3)."""

    std: Array = eqx.field(converter=as_array)
    lever: Array = eqx.field(converter=as_array, default=(0.0, 0.0, 0.0))
    rotation: Array = eqx.field(converter=as_array, default_factory=lambda: np.eye(3))


class Tuning(eqx.Module):
    """Beliefs of the filter; what walks is given as the standard deviation after one second.

    Attributes:
        mounts: Sensors by name; those that are not named are left out.
        initial_std: Of the error at the start, shape (31,).
        walk: White noise that drives each error [unit/sqrt(s)], shape (31,).
        acceleration_noise: Unmodelled acceleration as white noise [m/s/sqrt(s)]: surge, sway, heave, shape (3,).
        acceleration_share: Share of the model's own acceleration by which it may err (a mass that is not right).
        acceleration_memory: How long such an error lasts [s].
        turn_noise: Attitude while the gyro is silent [rad/sqrt(s)].
        wave_damping: Half the relative width of the band of waves.
        wave_slip: Share of the waves' heave by which the vehicle does not follow the water.
        gate: By sensor name, squared normalised innovation beyond which a reading counts as an outlier.
        patience: So many positions beyond the gate in a row that agree with each other are believed.
        stubbornness: So many ticks in a row may another sensor be beyond its gate before it is believed.
        max_age: Of a reading [s]; one with a stamp further off counts as new.
    """

    mounts: dict[str, Mount]
    initial_std: Array = eqx.field(converter=as_array)
    walk: Array = eqx.field(converter=as_array)
    acceleration_noise: Array = eqx.field(converter=as_array)
    acceleration_share: Array = eqx.field(converter=as_array)
    acceleration_memory: Array = eqx.field(converter=as_array)
    turn_noise: Array = eqx.field(converter=as_array)
    wave_damping: Array = eqx.field(converter=as_array)
    wave_slip: Array = eqx.field(converter=as_array)
    gate: dict[str, Array]
    patience: int = eqx.field(static=True)
    stubbornness: int = eqx.field(static=True)
    max_age: Array = eqx.field(converter=as_array)

    @classmethod
    def of(
        cls,
        mounts: Mapping[str, Mount] | None = None,
        *,
        force_walk: float = 0.03,
        turning_force_walk: float = 3e-3,
        drag_std: float = 0.14,
        force_std: float = 1.0,
        turning_force_std: float = 0.15,
        current_std: float = 0.1,
        acceleration_noise: float = 1e-3,
        acceleration_share: float = 0.1,
        wave_damping: float = 0.2,
        wave_slip: float = 0.3,
        max_age: float = 2.0,
    ) -> "Tuning":
        """Beliefs in the units in which people think of them.

        Args:
            mounts: Sensors; None: those of thesis table 5.7 and a DVL, at CO.
            force_walk: Of the disturbance force, each axis of n [N/sqrt(s)].
            turning_force_walk: Of the one that turns with the vehicle [N/sqrt(s)].
            drag_std: Relative error of the model's drag.
            force_std: Disturbance force at the start [N].
            turning_force_std: The same of the one that turns with the vehicle [N].
            current_std: Water's velocity at the start, each axis [m/s].
            acceleration_noise: Unmodelled acceleration as white noise [m/s/sqrt(s)].
            acceleration_share: Relative error of the model's acceleration.
            wave_damping: Half the relative width of their band.
            wave_damping: Half the relative width of the band of waves.
            wave_slip: Share of the waves' heave by which the vehicle does not follow the water.
            max_age: How far back readings are compared with the past [s].
        """
        start = (
            (POSITION, [0.1, 0.1, 0.02]),
            (VELOCITY, [0.1] * 3),
            (ATTITUDE, [0.01] * 3),
            (WAVE_PLACE, [0.1] * 3),
            (WAVE_VELOCITY, [0.15] * 3),
            (GYRO_BIAS, [1e-5] * 3),
            (ACCELEROMETER_BIAS, [0.03] * 3),
            (FORCE_N, [force_std, force_std, 3.0]),
            (FORCE_B, [turning_force_std] * 2),
            (CURRENT, [current_std] * 2),
            (DRAG, [drag_std] * 3),
        )
        walk = (
            (GYRO_BIAS, [1e-8] * 3),
            (ACCELEROMETER_BIAS, [1e-5] * 3),
            (FORCE_N, [force_walk] * 3),
            (FORCE_B, [turning_force_walk] * 2),
            (CURRENT, [1e-3] * 2),
            (DRAG, [2e-3] * 3),
        )
        return cls(
            mounts=dict(mounts or {name: Mount(std) for name, std in SENSOR_STD.items()}),
            initial_std=_laid_out(start),
            walk=_laid_out(walk),
            acceleration_noise=np.full(3, acceleration_noise),
            acceleration_share=acceleration_share,
            acceleration_memory=2.0,
            turn_noise=0.05,
            wave_damping=wave_damping,
            wave_slip=wave_slip,
            gate={name: as_array(value) for name, value in GATE.items()},
            patience=3,
            stubbornness=15,
            max_age=max_age,
        )


def _laid_out(parts: Sequence[tuple[slice, list[float]]]) -> np.ndarray:
    whole = np.zeros(ERRORS)
    for place, values in parts:
        whole[place] = values
    return whole
