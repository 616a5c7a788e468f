"""Constants of sensors that the filter has no state for: a compass that is turned, a Doppler log turned or scaled.

A compass in a steel frame is off by a degree or two all through a dive, and says nothing of it. Each constant is taken
out of the readings by a step each way, and filter and smoother run again: what they answer is its response. The
innovations of the positions say what the dive itself knows of it: of a track measured by compass and Doppler log how
far it is turned and stretched. Innovations of other sensors do not count: they are not white, as the filter allows for
more noise than there is, and a scale of 1.6 % was read off them where there was none.

    c = -(S0^-1 + J'J)^-1 J' z,   S = (S0^-1 + J'J)^-1

with z the normalised innovations of positions and J their derivative by the constants: Friedland's bias filter, all at
once.

Reference: Friedland (1969), IEEE Transactions on Automatic Control 14(4); Schmidt (1966), on considered parameters.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import turn_about_z
from rovtwin.core.block import Start
from rovtwin.core.flow import Measurements, Slot
from rovtwin.core.frames import quaternion_from_euler, quaternion_multiply
from rovtwin.core.numerics import jnp
from rovtwin.core.sensors import kind_of
from rovtwin.gnc.navigation.tuning import Tuning

Kind = Literal["heading", "dvl_yaw", "dvl_scale"]
SENSOR = {"heading": "attitude", "dvl_yaw": "dvl", "dvl_scale": "dvl"}  # kind of sensor that each belongs to
# Prior standard deviations [rad; rad; share]. Heading: accuracies of AHRS near steel are stated as 1 to 2 deg (Xsens
# MTi-3 data sheet: 2 deg rms; VectorNav VN-100: 2 deg). Doppler logs: long-term accuracy of +-1.01 % stated for Water
# Linked A50, 0.1 % for its Performance version, taken between; mounting as a builder's square allows.
USUAL_STD: dict[str, float] = {"heading": np.radians(1.0), "dvl_yaw": np.radians(0.5), "dvl_scale": 0.005}


@dataclass(frozen=True)
class SensorConstant:
    """An error that stays the same.

    Attributes:
        kind: `heading`: readings of a compass are that much too large [rad]; `dvl_yaw`: the log is turned clockwise by
            that from where it is stated to be, about z of b [rad]; `dvl_scale`: its speeds are that share too large.
        sensor: Name.
        std: Before the dive.
    """

    kind: Kind
    sensor: str
    std: float

    @property
    def name(self) -> str:
        return f"{self.sensor}.{self.kind}"


def usual_constants(
    tuning: Tuning, names: Iterable[str], std: Mapping[str, float] | None = None
) -> list[SensorConstant]:
    """Those of the sensors that spoke.

    Args:
        tuning: Of the filter, whose sensors count.
        names: Of the sensors with readings.
        std: In place of some of USUAL_STD; 0 leaves a kind out.
    """
    given = {**USUAL_STD, **(std or {})}
    found = [name for name in sorted(names) if name in tuning.mounts]
    kinds: list[Kind] = ["heading", "dvl_yaw", "dvl_scale"]
    return [
        SensorConstant(kind, name, given[kind])
        for kind in kinds
        for name in found
        if kind_of(name) == SENSOR[kind] and given[kind] > 0.0
    ]


def without(
    slots: Measurements, constant: SensorConstant, value: float, tuning: Tuning, velocity: Float[np.ndarray, "n 3"]
) -> Measurements:
    """Readings from which a constant of some value is taken.

    What a turned or scaled log adds is taken from the velocity that was expected, not from the reading: that one has
    noise, which would pass for a scale (of 9 % in a survey of five minutes).

    Args:
        slots: Readings tick by tick, NumPy arrays.
        constant: Which.
        value: Of it.
        tuning: Of the filter.
        velocity: Of CO that was expected at each tick before its readings, in b [m/s].
    """
    slot = slots[constant.sensor]
    readings = np.array(slot.value, dtype=float)
    if constant.kind == "heading":
        readings[..., 2] -= value
    else:
        turned = velocity @ turn_about_z(-value).T if constant.kind == "dvl_yaw" else velocity * (1.0 + value)
        added = (turned - velocity) @ np.asarray(tuning.mounts[constant.sensor].rotation)
        readings = readings - added[:, None]
    changed: Any = readings  # NumPy: the compiled step takes both
    return {**slots, constant.sensor: Slot(changed, slot.valid, slot.t_valid)}


def started_without(start: Start, constant: SensorConstant, value: float) -> Start:
    """A start whose heading came from the compass, as headings at the start do: it is no second witness."""
    if constant.kind != "heading":
        return start
    turn = quaternion_from_euler(jnp.array([0.0, 0.0, -value]))
    return replace(start, attitude=quaternion_multiply(turn, start.attitude))


def estimate_constants(
    z: Float[np.ndarray, " m"],
    plus: Float[np.ndarray, "c m"],
    minus: Float[np.ndarray, "c m"],
    steps: Float[np.ndarray, " c"],
    std: Float[np.ndarray, " c"],
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, "c c"]]:
    """Value and covariance of constants.

    Args:
        z: Normalised innovations of positions, white and of variance 1 but for the constants; no number where not used.
        plus: The same with each constant's step taken out of the readings.
        minus: The same with it put in.
        steps: Of the constants.
        std: Of the constants before.
    """
    used = np.isfinite(z) & np.isfinite(plus).all(axis=0) & np.isfinite(minus).all(axis=0)
    J = (plus[:, used] - minus[:, used]) / (2.0 * steps[:, None])
    information = np.diag(std**-2.0) + J @ J.T
    covariance = np.linalg.inv(information)
    return -covariance @ (J @ z[used]), 0.5 * (covariance + covariance.T)
