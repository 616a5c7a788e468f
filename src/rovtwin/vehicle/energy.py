"""Batteries of a vehicle file, and what its thrusters draw from them.

A T200 at 16 V in Blue Robotics' bollard test (2019) draws P = c |F|^1.5 with c = 1.00 W/N^1.5 ahead (1.1 % rms of full
power) and 1.45 astern (2.0 %); exponents fitted freely are 1.56 and 1.61, momentum theory says 1.5
(tests/vehicle/test_energy.py). It stands for thrusters of which the file says nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovtwin.vehicle.assembly import Mounted, bodies
from rovtwin.vehicle.propulsion import thrust_limits
from rovtwin.vehicle.schema import Body, Thruster

T200_POWER = (1.00, 1.45)  # ahead, astern [W/N^1.5]


@dataclass(frozen=True)
class PowerSource:
    """A battery and what hangs on it.

    Attributes:
        name: Of the part it sits in, `port`; `vehicle` where it is the whole's.
        capacity_wh: [Wh].
        hotel_load: Of all but the thrusters [W].
        feeds: Numbers of its thrusters, in the order of the commands.
    """

    name: str
    capacity_wh: float
    hotel_load: float
    feeds: tuple[int, ...]


def power_sources(body: Body, thrusters: Sequence[str]) -> list[PowerSource]:
    """The batteries of a vehicle. Each thruster hangs on that of the nearest part around it that has one.

    Args:
        body: The vehicle, all parts in place.
        thrusters: Names, `port.surge`, in the order of the commands.
    """
    found = {path: part.battery for path, part in bodies(body, "") if part.battery is not None}
    owners = [
        max((path for path in found if f".{name}".startswith(f"{path}.")), key=len, default="-") for name in thrusters
    ]
    return [
        PowerSource(
            path.removeprefix(".") or "vehicle",
            battery.capacity_wh,
            battery.hotel_load,
            tuple(i for i, owner in enumerate(owners) if owner == path),
        )
        for path, battery in found.items()
    ]


def specific_power(thrusters: Sequence[Mounted], supply_voltage: float | None = None) -> np.ndarray:
    """c of each thruster, ahead and astern, shape (n, 2) [W/N^1.5], from its power at full force or as a T200's.

    Args:
        thrusters: Of an assembly.
        supply_voltage: At which thrust tables are read [V]; None: each at that of its part.
    """
    return np.array([_coefficients(mounted, supply_voltage) for mounted in thrusters]).reshape(-1, 2)


def _coefficients(mounted: Mounted, supply_voltage: float | None) -> tuple[float, float]:
    assert isinstance(mounted.item, Thruster)
    if mounted.item.power is None:
        return T200_POWER
    most = max(thrust_limits(mounted, supply_voltage))
    return (mounted.item.power / most**1.5,) * 2 if most > 0 else (0.0, 0.0)
